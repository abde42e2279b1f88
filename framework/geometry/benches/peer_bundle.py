"""Bundle adjustment of the same rooms by Ceres (pycolmap), SciPy and aniposelib.

    cargo bench -p foveate-geometry --bench bundle -- --write DIR      # leaves DIR/room_known.txt and DIR/room_focal.txt
    pip install numpy scipy pycolmap aniposelib                       # a peer that is not installed is left out
    python framework/geometry/benches/peer_bundle.py DIR

One thread each. Prints milliseconds (the best of some rounds), pixel error at the optimum, and errors of centres and points after the
best similarity. Ceres is timed with the conversion of the scene that pycolmap makes.
"""
import os
import sys
import time

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


def report(name, ms, scene, cameras, points):
    true_cameras, true_points, _, _, camera, point, pixels = scene
    error = project(cameras, points, camera, point) - pixels
    rms = np.sqrt((error**2).sum(1).mean())
    print(
        f"{name:<34} {ms:9.2f} ms {rms:.4f} px, centres {aligned(centres(cameras), centres(true_cameras)):.2f} mm, "
        f"points {aligned(points, true_points):.2f} mm",
        flush=True,
    )


def scipy_(scene, focal_free):
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
    began = time.perf_counter()
    found = least_squares(residuals, start, jac_sparsity=sparsity, x_scale="jac", ftol=1e-6, method="trf")
    return (time.perf_counter() - began) * 1e3, *unpack(found.x)


def ceres(scene, focal_free):
    import pycolmap

    _, _, cameras, points, camera, point, pixels = scene
    best = np.inf
    for _ in range(10):
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
            for o in np.nonzero(point == p)[0]:
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


def anipose(scene, focal_free):
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


if __name__ == "__main__":
    for case in ("known", "focal"):
        scene = read(os.path.join(sys.argv[1], f"room_{case}.txt"))
        for name, peer in (("Ceres (pycolmap)", ceres), ("SciPy", scipy_), ("aniposelib", anipose)):
            try:
                ms, *found = peer(scene, case == "focal")
                report(f"{name}, {case}", ms, scene, *found)
            except Exception as fault:  # a peer that is missing or refuses is told, the others go on
                print(f"{name}, {case}: {type(fault).__name__}: {fault}", flush=True)
