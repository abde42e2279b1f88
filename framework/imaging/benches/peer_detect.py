"""Times OpenCV at what `cargo bench -p foveate-imaging` times, on the same kind of scene, in one thread.

pip install numpy opencv-python-headless
python3 framework/imaging/benches/peer_detect.py
"""

import time

import cv2
import numpy as np

PICTURES, SPOTS, ROUNDS = 30, 8, 50
BACKGROUND, OFFSET = 32, 25


def picture(random, width, height):
    """Eight Gaussian spots (sigma 1.6 px, 200 gray levels over 20), noise of 3 gray levels; and their centres."""
    centres = []
    while len(centres) < SPOTS:
        place = random.uniform((12, 12), (width - 12, height - 12))
        if all(np.hypot(*(place - other)) > 25 for other in centres):
            centres.append(place)
    columns, rows = np.arange(width), np.arange(height)[:, None]
    levels = np.full((height, width), 20.0)
    for x, y in centres:
        levels += 200 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 1.6**2))
    levels += random.normal(0, 3, levels.shape)
    return levels.clip(0, 255).astype(np.uint8), np.array(centres)


def contours(image, _thresholds):
    lit = cv2.threshold(image, BACKGROUND + OFFSET, 255, cv2.THRESH_BINARY)[1]
    outlines, _ = cv2.findContours(lit, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [cv2.moments(it) for it in outlines]


def components(image, thresholds):
    lit = cv2.compare(image, thresholds, cv2.CMP_GT)
    return cv2.connectedComponentsWithStats(lit, connectivity=8)


def rounds_ms(work, pictures, thresholds):
    """Median and least time a picture, of rounds over all pictures."""
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for image, _ in pictures:
            work(image, thresholds)
        times.append((time.perf_counter() - start) * 1e3 / PICTURES)
    return np.median(times), min(times)


def weighted_errors(pictures, thresholds):
    """Distance from each true centre to the mean of the lit pixels, weighted by intensity over the background."""
    errors = []
    for image, centres in pictures:
        n, labels, _, _ = components(image, thresholds)
        found = []
        for label in range(1, n):
            y, x = np.nonzero(labels == label)
            weight = image[y, x].astype(float) - BACKGROUND
            found.append((np.average(x, weights=weight), np.average(y, weights=weight)))
        errors += [np.hypot(*(np.array(found) - centre).T).min() for centre in centres]
    return errors


def main():
    cv2.setNumThreads(1)
    random = np.random.default_rng(20020601)
    print("OpenCV", cv2.__version__)
    for width, height in ((640, 480), (640, 240), (1280, 1024)):
        pictures = [picture(random, width, height) for _ in range(PICTURES)]
        thresholds = np.full((height, width), BACKGROUND + OFFSET, np.uint8)
        for name, work in (
            ("threshold + findContours + moments", contours),
            ("compare + connectedComponentsWithStats", components),
            ("compare with a table only", lambda image, table: cv2.compare(image, table, cv2.CMP_GT)),
        ):
            median, least = rounds_ms(work, pictures, thresholds)
            print(f"{width}x{height} {name}: median {median:.4f} ms, least {least:.4f} ms")
        errors = weighted_errors(pictures, thresholds)
        print(f"{width}x{height} weighted centroid: mean {np.mean(errors):.4f} px, p95 {np.percentile(errors, 95):.4f} px")


if __name__ == "__main__":
    main()
