"""Times SciPy on the fits of `cargo bench -p foveate-estimation --bench bounded`, which runs this and feeds it its numbers.

pip install numpy scipy
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time

import numpy as np
import scipy
from scipy.optimize import lsq_linear, nnls


def ms(work, frames, rounds):
    """Median and least time a frame."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        for frame in frames:
            work(frame)
        times.append((time.perf_counter() - start) * 1e3 / len(frames))
    return np.median(times), min(times)


def main():
    numbers = np.frombuffer(sys.stdin.buffer.read(), dtype="<f8")
    rows, columns, count = numbers[:3].astype(int)
    sizes = np.cumsum([3, rows * columns, rows * count, count, columns * count])
    matrix = np.ascontiguousarray(numbers[3 : sizes[1]].reshape(columns, rows).T)
    frames = numbers[sizes[1] : sizes[2]].reshape(count, rows)
    costs = numbers[sizes[2] : sizes[3]]
    weights = numbers[sizes[3] : sizes[4]].reshape(count, columns)
    print("SciPy", scipy.__version__)
    few = frames[:: max(1, count // 20)]
    for name, work, rounds in (
        ("NNLS (no upper bound)", lambda it: nnls(matrix, it, maxiter=2000), 10),
        ("lsq_linear BVLS", lambda it: lsq_linear(matrix, it, (0, 1), method="bvls"), 3),
        ("lsq_linear TRF", lambda it: lsq_linear(matrix, it, (0, 1), method="trf"), 3),
    ):
        median, least = ms(work, few, rounds)
        print(f"SciPy {name}: median {median:.4f} ms, least {least:.4f} ms")
    bvls = [lsq_linear(matrix, it, (0, 1), method="bvls", tol=1e-14).x for it in frames]
    residuals = np.array([((matrix @ w - it) ** 2).sum() for w, it in zip(bvls, frames)])
    print(
        f"against BVLS: cost at most {np.max(costs / residuals - 1):.1e} above, at most {np.max(1 - costs / residuals):.1e} below; "
        f"weights at most {np.abs(np.array(bvls) - weights).max():.1e} apart"
    )


if __name__ == "__main__":
    main()
