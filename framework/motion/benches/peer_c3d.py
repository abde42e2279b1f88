"""Times ezc3d at what `cargo bench -p foveate-motion --bench c3d` times, on the same kind of recording.

pip install numpy ezc3d
python3 framework/motion/benches/peer_c3d.py
"""

import os
import tempfile
import time

import ezc3d
import numpy as np

MARKS, DURATION_S, ROUNDS = 100, 60, 9


def timed(what, work):
    work()
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        work()
        times.append((time.perf_counter() - start) * 1e3)
    times.sort()
    print(f"{what}: median {times[ROUNDS // 2]:.2f} ms, least {times[0]:.2f} ms")


for rate_hz in (60, 240):
    points = np.ones((4, MARKS, DURATION_S * rate_hz))
    points[:3] = np.cumsum(np.random.default_rng(70).normal(0, 1, (3, MARKS, DURATION_S * rate_hz)), 2)
    path = os.path.join(tempfile.gettempdir(), f"foveate-peer-{os.getpid()}.c3d")

    def write():
        file = ezc3d.c3d()
        file["parameters"]["POINT"]["RATE"]["value"] = [float(rate_hz)]
        file["parameters"]["POINT"]["LABELS"]["value"] = [f"M{it:03d}" for it in range(MARKS)]
        file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
        file["data"]["points"] = points
        file.write(path)

    name = f"ezc3d, {DURATION_S} s x {MARKS} marks at {rate_hz} Hz"
    timed(f"{name}, written to a file", write)
    timed(f"{name}, read from a file", lambda: ezc3d.c3d(path)["data"]["points"])
    os.remove(path)
