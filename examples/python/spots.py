"""Finds bright spots in gray pictures, each with a sub-pixel centre: `foveate new plugin` writes the same node in Rust.

A pixel above the threshold that no neighbour outshines is the middle of a spot; the centre is the mean of the 5 x 5 pixels around it, weighted by
how far each is above the threshold. Run by a rig:

    [scale.room.node.spots]
    type = "process.detector"
    each = "wide-*"
    in = { image = "video.image" }
    command = ["python3", "spots.py", "120"]
"""

import sys

import numpy as np
from foveate_node import Gap, feature, run
from numpy.lib.stride_tricks import sliding_window_view

THRESHOLD = int(sys.argv[1]) if len(sys.argv) > 1 else 120
ACROSS = np.tile(np.arange(-2, 3), 5)
DOWN = np.repeat(np.arange(-2, 3), 5)


def detect(message):
    image, window = message.pixels, message.value["window"]
    if image is None or image.ndim != 2 or min(image.shape) < 5:
        raise Gap("found a picture that is not gray or not whole, expected one byte a pixel")
    rows, columns = np.nonzero(image[2:-2, 2:-2] > THRESHOLD)
    around = sliding_window_view(image, (5, 5))[rows, columns].reshape(-1, 25).astype(float)
    peaks = around[:, 12:13]
    # Of equal pixels the first one counts.
    is_peak = (around[:, :12] < peaks).all(axis=1) & (around[:, 13:] <= peaks).all(axis=1)
    rows, columns, around = rows[is_peak] + 2, columns[is_peak] + 2, around[is_peak]
    weights = np.maximum(around - THRESHOLD, 0.0)
    total = weights.sum(axis=1)
    x, y = columns + weights @ ACROSS / total, rows + weights @ DOWN / total
    x, y = [start + (at + 0.5) * window["shrink"] - 0.5 for start, at in ((window["left"], x), (window["top"], y))]
    areas = (weights > 0).sum(axis=1)
    found = [feature(x[i], y[i], 0.01, areas[i], around[i, 12]) for i in range(len(total))]
    return [("features", {"camera": message.value["camera"], "list": found})]


run({"image": detect})
