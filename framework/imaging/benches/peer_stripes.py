"""Times OpenCV on what `cargo bench -p foveate-imaging --bench stripes` times: 42 pictures of 1280x1024 under Gray code of 1024x768.

pip install numpy opencv-contrib-python-headless
FOVEATE_DATA=... python3 framework/imaging/benches/peer_stripes.py

Reads `s11_procam_graycode/capture_0`; says so in one line and ends where the recording or OpenCV is missing. One thread.
"""

import glob
import os
import sys
import time

try:
    import cv2
    import numpy as np
except ImportError as error:
    sys.exit(f"skipped: {error}")

cv2.setNumThreads(1)
FILES = sorted(glob.glob(os.path.join(os.environ.get("FOVEATE_DATA", "../shared/data"), "s11_procam_graycode/capture_0/*.jpg")))


def median_ms(run, times):
    run()
    taken = []
    for _ in range(times):
        start = time.perf_counter()
        run()
        taken.append(1e3 * (time.perf_counter() - start))
    return float(np.median(taken))


def vector_operations(pictures, black=40, white=5):
    lit = cv2.compare(cv2.subtract(pictures[40], pictures[41]), black, cv2.CMP_GT)
    codes = []
    for start in (0, 20):
        high = low = bit = None
        for plane in range(10):
            picture, inverse = pictures[start + 2 * plane], pictures[start + 2 * plane + 1]
            brighter = cv2.compare(picture, inverse, cv2.CMP_GT)
            cv2.bitwise_and(lit, cv2.compare(cv2.absdiff(picture, inverse), white, cv2.CMP_GE), lit)
            bit = brighter if bit is None else cv2.bitwise_xor(bit, brighter)
            part = cv2.bitwise_and(bit, 2 - plane if plane < 2 else 1 << (9 - plane))
            if plane < 2:
                high = part if high is None else cv2.bitwise_or(high, part)
            else:
                low = part if low is None else cv2.bitwise_or(low, part)
        codes.append(high.astype(np.uint16) << 8 | low)
    return codes, lit


def main():
    if len(FILES) != 42:
        sys.exit(f"skipped: found {len(FILES)} pictures of s11_procam_graycode/capture_0, expected 42; set FOVEATE_DATA")
    pictures = [cv2.imread(it, 0) for it in FILES]
    print(f"reading 42 JPEG pictures: {median_ms(lambda: [cv2.imread(it, 0) for it in FILES], 5):.1f} ms")
    print(f"vector operations: {median_ms(lambda: vector_operations(pictures), 15):.2f} ms")
    coder = cv2.structured_light.GrayCodePattern.create(1024, 768)
    coder.setBlackThreshold(40)
    coder.setWhiteThreshold(5)
    shown, white, black = pictures[:40], pictures[40], pictures[41]
    decode = lambda: coder.decode([shown, shown], None, [black, black], [white, white], cv2.structured_light.DECODE_3D_UNDERWORLD)
    print(f"GrayCodePattern.decode, a view of two: {median_ms(decode, 3) / 2:.1f} ms")


main()
