"""OpenCV's calcOpticalFlowPyrLK on the pictures and points of `cargo bench -p foveate-imaging --bench lucas_kanade`, in one thread.

pip install numpy opencv-python-headless scikit-image
The bench calls it, where FOVEATE_PEER_PYTHON names a Python that has these:
python3 peer_lucas_kanade.py texture FOLDER   writes scikit-image's astronaut, 512 x 512 gray, as the surface to look at
python3 peer_lucas_kanade.py track FOLDER     tracks what the bench has written there
"""

import statistics
import sys
import time
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 640, 480
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01)
WINDOW = (21, 21)


def picture(folder, name):
    return np.fromfile(folder / name, np.uint8).reshape(HEIGHT, WIDTH)


def texture(folder):
    import skimage.data

    cv2.cvtColor(skimage.data.astronaut(), cv2.COLOR_RGB2GRAY).tofile(folder / "texture.raw")


def track(folder):
    cv2.setNumThreads(1)
    print("OpenCV", cv2.__version__)
    for case in (folder / "cases.txt").read_text().splitlines():
        name = case.replace("_", " ")
        first, second = picture(folder, case + ".0.raw"), picture(folder, case + ".1.raw")
        table = np.loadtxt(folder / (case + ".points.txt"))
        points, truth = table[:, :2].astype(np.float32).reshape(-1, 1, 2), table[:, 2:4]
        guess = table[:, 4:6].astype(np.float32).reshape(-1, 1, 2)
        for way in ("raw", "stabilised"):
            flags = cv2.OPTFLOW_USE_INITIAL_FLOW if way == "stabilised" else 0
            found, status, _ = cv2.calcOpticalFlowPyrLK(
                first, second, points, guess.copy() if flags else None, winSize=WINDOW, maxLevel=3, criteria=CRITERIA, flags=flags
            )
            error = np.hypot(*(found.reshape(-1, 2) - truth).T)
            claimed = status.ravel() == 1
            good = claimed & (error < 1)
            median = np.median(error[good]) if good.any() else float("nan")
            rms = np.sqrt((error[good] ** 2).mean()) if good.any() else float("nan")
            print(f"  {name}, {way}: {good.sum()} of {len(error)} within 1 px, median {median:.4f}, rms {rms:.4f} px; "
                  f"{(claimed & (error >= 1)).sum()} wrong as found")
    first, second = picture(folder, "speed.0.raw"), picture(folder, "speed.1.raw")
    points = np.loadtxt(folder / "speed.points.txt")[:, :2].astype(np.float32).reshape(-1, 1, 2)
    for name, work in (
        ("both pyramids built", lambda: cv2.calcOpticalFlowPyrLK(first, second, points, None, winSize=WINDOW, maxLevel=3, criteria=CRITERIA)),
        ("pyramid of one picture alone", lambda: cv2.buildOpticalFlowPyramid(second, WINDOW, 3)),
        ("phaseCorrelate of the whole pictures", lambda: cv2.phaseCorrelate(np.float32(first), np.float32(second))),
    ):
        times = []
        for _ in range(400):
            start = time.perf_counter()
            work()
            times.append((time.perf_counter() - start) * 1e3)
        print(f"  {len(points)} points, {name}: median {statistics.median(times):.4f} ms, least {min(times):.4f} ms")


if __name__ == "__main__":
    {"texture": texture, "track": track}[sys.argv[1]](Path(sys.argv[2]))
