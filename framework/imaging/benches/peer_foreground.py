"""Times OpenCV's MOG2 at what `cargo bench -p foveate-imaging --bench foreground` times, on the same kind of scene, in one thread.

pip install numpy opencv-python-headless
python3 framework/imaging/benches/peer_foreground.py
"""

import time

import cv2
import numpy as np

WIDTH, HEIGHT, PICTURES, ROUNDS = 640, 480, 30, 60


def picture(random, room, discs):
    columns, rows = np.arange(WIDTH), np.arange(HEIGHT)[:, None]
    levels = room.copy()
    for x, y in discs:
        levels[np.hypot(columns - x, rows - y) < 40] = 220
    return (levels + random.normal(0, 3, levels.shape)).round().clip(0, 255).astype(np.uint8)


def main():
    cv2.setNumThreads(1)
    random = np.random.default_rng(20020601)
    room = random.uniform(80, 120, (HEIGHT, WIDTH))
    discs = [((100.3 + 10.37 * k, 150.4), (500.2 - 8.21 * k, 330.7)) for k in range(PICTURES)]
    empty = [picture(random, room, ()) for _ in range(PICTURES)]
    moving = [picture(random, room, it) for it in discs]
    print("OpenCV", cv2.__version__)
    for shadows in (False, True):
        alone, whole, errors = [], [], []
        for _ in range(ROUNDS):
            model = cv2.createBackgroundSubtractorMOG2(history=200, detectShadows=shadows)
            for image in empty:
                model.apply(image)
            found, in_model, start = [], 0.0, time.perf_counter()
            for image in moving:
                before = time.perf_counter()
                mask = model.apply(image)
                in_model += time.perf_counter() - before
                mask = cv2.medianBlur(cv2.compare(mask, 200, cv2.CMP_GT), 3)
                found.append(cv2.connectedComponentsWithStats(mask))
            whole.append((time.perf_counter() - start) * 1e3 / PICTURES)
            alone.append(in_model * 1e3 / PICTURES)
            for (_, _, stats, centroids), (disc, _) in zip(found, discs):
                large = centroids[1:][stats[1:, cv2.CC_STAT_AREA] >= 400]
                errors.append(np.hypot(*(large - disc).T).min())
        name = "MOG2 with shadows" if shadows else "MOG2"
        print(f"{name} alone: median {np.median(alone):.3f} ms, least {min(alone):.3f} ms")
        print(f"{name}, median filter, components: median {np.median(whole):.3f} ms, least {min(whole):.3f} ms")
        print(f"{name}, centroid: median error {np.median(errors):.3f} px, largest {max(errors):.3f} px")


if __name__ == "__main__":
    main()
