"""OpenCV's calibration of camera and projector from the three captures that `foveate run graphs/procam.toml` calibrates from.

pip install numpy opencv-python-headless
FOVEATE_DATA=... python3 plugins/structured_light/benches/peer_procam.py

Corners: findChessboardCorners and cornerSubPix; projector: a homography by RANSAC around each corner; then stereoCalibrate with free optics. Each capture is held out
in turn: its board is placed by solvePnP of the camera, or of the projector by itself. Says so in one line and ends where the recording or OpenCV is missing.
"""

import glob
import os
import sys

try:
    import cv2
    import numpy as np
except ImportError as error:
    sys.exit(f"skipped: {error}")

FOLDER = os.path.join(os.environ.get("FOVEATE_DATA", "../shared/data"), "s11_procam_graycode")
CAMERA, PROJECTOR, REACH = (1280, 1024), (1024, 768), 20
BOARD = np.zeros((63, 3), np.float32)
BOARD[:, :2] = np.mgrid[0:9, 0:7].T.reshape(-1, 2) * 0.075


def corners(folder):
    pictures = [cv2.imread(it, 0) for it in sorted(glob.glob(folder + "/*.jpg"))]
    white, black = pictures[40], pictures[41]
    found, camera = cv2.findChessboardCorners(white, (9, 7))
    assert found, folder
    camera = cv2.cornerSubPix(white, camera, (7, 7), (-1, -1), (3, 50, 1e-4)).reshape(-1, 2)
    lit, codes = cv2.subtract(white, black) > 40, []
    for start in (0, 20):
        code = bit = 0
        for plane in range(10):
            picture, inverse = pictures[start + 2 * plane], pictures[start + 2 * plane + 1]
            lit &= cv2.absdiff(picture, inverse) >= 5
            bit = (picture > inverse) ^ bit if plane else picture > inverse
            code = code * 2 + bit.astype(int)
        codes.append(code)
    projector = []
    for x, y in camera:
        rows, columns = np.mgrid[round(y) - REACH : round(y) + REACH + 1, round(x) - REACH : round(x) + REACH + 1]
        used = lit[rows, columns]
        source = np.stack([columns[used], rows[used]], 1).astype(float)
        target = np.stack([it[rows, columns][used] for it in codes], 1).astype(float)
        matrix, _ = cv2.findHomography(source, target, cv2.RANSAC, 2.0)
        at = matrix @ [x, y, 1]
        projector.append(at[:2] / at[2])
    return camera.astype(np.float32), np.array(projector, np.float32)


def calibrate(sets, flags):
    boards, cameras, projectors = [BOARD] * len(sets), [it[0] for it in sets], [it[1] for it in sets]
    _, camera, bent, _, _ = cv2.calibrateCamera(boards, cameras, CAMERA, None, None, flags=flags)
    _, projector, other, _, _ = cv2.calibrateCamera(boards, projectors, PROJECTOR, None, None, flags=flags)
    flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    return cv2.stereoCalibrate(boards, cameras, projectors, camera, bent, projector, other, CAMERA, flags=flags)


def rms(errors):
    return float(np.sqrt((np.concatenate(errors) ** 2).sum(1).mean()))


def main():
    folders = sorted(glob.glob(FOLDER + "/capture_*"))
    if len(folders) < 3:
        sys.exit(f"skipped: found {len(folders)} captures in {FOLDER}, expected 3; set FOVEATE_DATA")
    sets = [corners(it) for it in folders]
    no_lens = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    for name, flags in (("all optics", 0), ("no lens", no_lens)):
        print(f"{name}: camera and projector together {calibrate(sets, flags)[0]:.3f} px rms")
        transfer, own = [], []
        for at, (camera, projector) in enumerate(sets):
            _, k, d, kp, dp, turn, move, _, _ = calibrate(sets[:at] + sets[at + 1 :], flags)
            _, r, t = cv2.solvePnP(BOARD, camera, k, d)
            points = (turn @ (cv2.Rodrigues(r)[0] @ BOARD.T + t) + move).T
            transfer.append(cv2.projectPoints(points, np.zeros(3), np.zeros(3), kp, dp)[0].reshape(-1, 2) - projector)
            _, r, t = cv2.solvePnP(BOARD, projector, kp, dp)
            own.append(cv2.projectPoints(BOARD, r, t, kp, dp)[0].reshape(-1, 2) - projector)
        print(f"  held out in turn: placed by the camera {rms(transfer):.3f} px, by the projector itself {rms(own):.3f} px rms")


main()
