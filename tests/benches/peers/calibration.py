#!/usr/bin/env python3
"""Calibration here and by its peers, on the same problems in one run, one after the other.

    python3 tests/benches/peers/calibration.py                  (from the repository's root)
    python3 tests/benches/peers/calibration.py --large          also 200 cameras and 20,000 points, with the memory each takes
    python3 tests/benches/peers/calibration.py --from-nothing   also without any start, 20 seeds: ours alone, see below
    python3 tests/benches/peers/calibration.py --bal FOLDER     instead: SciPy's optimum of the BAL problems in FOLDER

Needs the Rust toolchain and `pip install numpy scipy pycolmap aniposelib`, best in an environment of its own; a peer that is not
installed is left out, with a line that says so. One thread each; the least of --rounds. Ours writes the problems
(`cargo bench -p foveate-geometry --bench bundle -- --write DIR`), the peers read them. Every line tells the error at the optimum, which
must be the same for all, and the errors of centres and points after the best similarity. Ceres is timed with the conversion of the scene that
pycolmap makes. Memory is what the process of the peer holds at most, Python and its libraries included.

None of the three calibrates without a start. MultiCamSelfCal does; it needs GNU Octave and is not run here.
"""
import argparse
import multiprocessing
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix
from scipy.spatial.transform import Rotation

CENTRE = np.array([319.5, 239.5])


def read(path):
    rows = {"ct": [], "pt": [], "cs": [], "ps": [], "o": []}
    for line in open(path):
        kind, *numbers = line.split()
        rows[kind].append([float(it) for it in numbers])
    rows = {kind: np.array(list_) for kind, list_ in rows.items()}

    def cameras(table):  # rotation vector, translation, focal
        turn = Rotation.from_quat(table[:, [2, 3, 4, 1]]).as_rotvec()
        return np.hstack([turn, table[:, 5:8], table[:, :1]])

    camera, point = rows["o"][:, 0].astype(int), rows["o"][:, 1].astype(int)
    return cameras(rows["ct"]), rows["pt"], cameras(rows["cs"]), rows["ps"], camera, point, rows["o"][:, 2:]


def project(cameras, points, camera, point):
    own = cameras[camera]
    there = Rotation.from_rotvec(own[:, :3]).apply(points[point]) + own[:, 3:6]
    return there[:, :2] / there[:, 2:] * own[:, 6:7] + CENTRE


def aligned(found, truth):
    a, b = found.mean(0), truth.mean(0)
    u, s, vt = np.linalg.svd((truth - b).T @ (found - a))
    d = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    scale = np.trace(np.diag(s) @ d) / ((found - a) ** 2).sum()
    return 1e3 * np.sqrt((((scale * (found - a) @ (u @ d @ vt).T + b) - truth) ** 2).sum(1).mean())


def centres(cameras):
    return -Rotation.from_rotvec(cameras[:, :3]).inv().apply(cameras[:, 3:6])


def report(name, ms, mib, scene, cameras, points):
    true_cameras, true_points, _, _, camera, point, pixels = scene
    error = project(cameras, points, camera, point) - pixels
    rms = np.sqrt((error**2).sum(1).mean())
    print(
        f"{name:<34} {ms:9.2f} ms {rms:.4f} px, centres {aligned(centres(cameras), centres(true_cameras)):.2f} mm, "
        f"points {aligned(points, true_points):.2f} mm, {mib:.0f} MiB",
        flush=True,
    )


def scipy_(scene, focal_free, rounds):
    _, _, cameras, points, camera, point, pixels = scene
    n, m, free = len(cameras), len(points), 7 if focal_free else 6
    index = np.arange(len(camera))
    sparsity = lil_matrix((2 * len(camera), n * free + 3 * m), dtype=int)
    for row in range(2):
        for column in range(free):
            sparsity[2 * index + row, camera * free + column] = 1
        for column in range(3):
            sparsity[2 * index + row, n * free + point * 3 + column] = 1

    def unpack(vector):
        moved = cameras.copy()
        moved[:, :free] = vector[: n * free].reshape(n, free)
        return moved, vector[n * free :].reshape(m, 3)

    def residuals(vector):
        return (project(*unpack(vector), camera, point) - pixels).ravel()

    start = np.r_[cameras[:, :free].ravel(), points.ravel()]
    best = np.inf
    for _ in range(rounds):
        began = time.perf_counter()
        found = least_squares(residuals, start, jac_sparsity=sparsity, x_scale="jac", ftol=1e-6, method="trf")
        best = min(best, (time.perf_counter() - began) * 1e3)
    return best, *unpack(found.x)


def ceres(scene, focal_free, rounds):
    import pycolmap

    _, _, cameras, points, camera, point, pixels = scene
    of_point = [[] for _ in points]
    for o, p in enumerate(point):
        of_point[p].append(o)
    best = np.inf
    for _ in range(rounds):
        room, place = pycolmap.Reconstruction(), {}
        for c, row in enumerate(cameras):
            room.add_camera_with_trivial_rig(
                pycolmap.Camera(camera_id=c + 1, model="SIMPLE_PINHOLE", width=640, height=480, params=[row[6], *CENTRE])
            )
            own = np.nonzero(camera == c)[0]
            place.update({(c, point[o]): k for k, o in enumerate(own)})
            image = pycolmap.Image(
                name=f"c{c}", points2D=pycolmap.Point2DList([pycolmap.Point2D(pixels[o]) for o in own]), camera_id=c + 1, image_id=c + 1
            )
            turn = pycolmap.Rotation3d(Rotation.from_rotvec(row[:3]).as_quat())
            room.add_image_with_trivial_frame(image, pycolmap.Rigid3d(turn, row[3:6]))
        ids = []
        for p in range(len(points)):
            track = pycolmap.Track()
            for o in of_point[p]:
                track.add_element(int(camera[o]) + 1, place[(camera[o], p)])
            ids.append(room.add_point3D(points[p], track))
        options = pycolmap.BundleAdjustmentOptions()
        options.refine_focal_length, options.refine_principal_point, options.refine_extra_params = focal_free, False, False
        options.print_summary = False
        solver = options.ceres.solver_options
        solver.num_threads, solver.max_num_iterations, solver.function_tolerance = 1, 100, 1e-6
        began = time.perf_counter()
        pycolmap.bundle_adjustment(room, options)
        best = min(best, (time.perf_counter() - began) * 1e3)
    found = []
    for c in range(len(cameras)):
        pose = room.images[c + 1].cam_from_world()
        turn = Rotation.from_quat(pose.rotation.quat).as_rotvec()
        found.append(np.r_[turn, pose.translation, room.cameras[c + 1].params[0]])
    return best, np.array(found), np.array([room.points3D[it].xyz for it in ids])


def anipose(scene, focal_free, rounds):
    from aniposelib.cameras import Camera, CameraGroup

    if focal_free:
        raise RuntimeError("frees distortion with the focal length: another problem")
    _, _, cameras, points, camera, point, pixels = scene
    table = np.full((len(cameras), len(points), 2), np.nan)
    table[camera, point] = pixels
    matrix = lambda row: np.array([[row[6], 0, CENTRE[0]], [0, row[6], CENTRE[1]], [0, 0, 1.0]])
    group = CameraGroup(
        [
            Camera(name=str(c), matrix=matrix(row), dist=np.zeros(5), size=(640, 480), rvec=row[:3].copy(), tvec=row[3:6].copy())
            for c, row in enumerate(cameras)
        ]
    )
    began = time.perf_counter()
    group.bundle_adjust(table, loss="linear", verbose=False)
    ms = (time.perf_counter() - began) * 1e3
    found = [np.r_[it.get_rotation().ravel(), it.get_translation().ravel(), it.get_camera_matrix()[0, 0]] for it in group.cameras]
    return ms, np.array(found), group.triangulate(table, progress=False)


def bal(path):
    """½ Σ r² of a problem in the BAL format at SciPy's optimum: with poses and points free, focal lengths too, all optics too."""
    numbers = iter(Path(path).read_text().split())
    take = lambda n: [float(next(numbers)) for _ in range(n)]
    n_cameras, n_points, n_seen = (int(it) for it in take(3))
    seen = np.array([take(4) for _ in range(n_seen)])
    cameras = np.array([take(9) for _ in range(n_cameras)])
    points = np.array([take(3) for _ in range(n_points)])
    camera, point, pixels = seen[:, 0].astype(int), seen[:, 1].astype(int), seen[:, 2:]

    def residuals(vector, free):
        moved = cameras.copy()
        moved[:, :free] = vector[: n_cameras * free].reshape(n_cameras, free)
        own = moved[camera]
        there = Rotation.from_rotvec(own[:, :3]).apply(vector[n_cameras * free :].reshape(n_points, 3)[point]) + own[:, 3:6]
        flat = -there[:, :2] / there[:, 2:]
        r2 = (flat**2).sum(1, keepdims=True)
        return (own[:, 6:7] * (1 + own[:, 7:8] * r2 + own[:, 8:9] * r2**2) * flat - pixels).ravel()

    costs = []
    # With all optics free there are more unknowns than numbers: it need not end, only show that the cost falls towards 0.
    for free, most in ((6, 20000), (7, 20000), (9, 300)):
        start = np.r_[cameras[:, :free].ravel(), points.ravel()]
        exact = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-12, "max_nfev": most, "x_scale": "jac"}
        costs.append(least_squares(residuals, start, args=(free,), **exact).cost)
    print(f"{Path(path).name}: poses {costs[0]:.12g}, and focal {costs[1]:.12g}, and k1, k2 below {costs[2]:.3g}", flush=True)


def in_process(peer, scene, focal_free, rounds, answers):
    try:
        found = peer(scene, focal_free, rounds)
        answers.put((*found, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))
    except Exception as fault:  # a peer that is missing or refuses is told, the others go on
        answers.put(f"{type(fault).__name__}: {fault}")


def ours(folder, *more):
    run = ["cargo", "bench", "--quiet", "-p", "foveate-geometry", "--bench", "bundle", "--", "--write", folder, *more]
    print(subprocess.run(run, check=True, stdout=subprocess.PIPE, text=True).stdout, end="", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=10, help="of Ceres and SciPy; the least counts")
    parser.add_argument("--large", action="store_true", help="also 200 cameras and 20,000 points")
    parser.add_argument("--from-nothing", action="store_true", help="also without a start, ours")
    parser.add_argument("--folder", help="of problems that ours wrote before; ours is not run")
    parser.add_argument("--bal", metavar="FOLDER", help="of problems in the BAL format, and nothing else")
    options = parser.parse_args()
    if options.bal:
        for path in sorted(Path(options.bal).glob("dubrovnik-*.txt")):
            bal(path)
        return
    with tempfile.TemporaryDirectory() as made:
        folder = options.folder or made
        if not options.folder:
            ours(folder, *(["--large"] if options.large else []))
        peers = [("Ceres (pycolmap)", ceres), ("SciPy", scipy_), ("aniposelib", anipose)]
        jobs = [(case, *peer, options.rounds) for case in ("known", "focal") for peer in peers]
        if options.large:
            jobs.append(("large", *peers[0], 1))
        for case, name, peer, rounds in jobs:
            scene = read(os.path.join(folder, f"room_{case}.txt"))
            answers = multiprocessing.Queue()
            process = multiprocessing.Process(target=in_process, args=(peer, scene, case == "focal", rounds, answers))
            process.start()
            answer = answers.get()
            process.join()
            if isinstance(answer, str):
                print(f"{name}, {case}: left out: {answer}", flush=True)
            else:
                ms, cameras, points, mib = answer
                report(f"{name}, {case}", ms, mib, scene, cameras, points)
    if options.from_nothing:
        print(flush=True)
        subprocess.run(["cargo", "bench", "--quiet", "-p", "foveate-geometry", "--bench", "self_calibration"], check=True)
    load = os.getloadavg()
    print(f"load {load[0]:.1f} over the last minute, {load[1]:.1f} over five, {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
