"""OpenCV's SGBM beside `crates/stereo/examples/middlebury.rs`: the same pairs, the same figures.

    pip install opencv-python-headless numpy
    python scripts/stereo_sgbm.py ../shared/data/stereo_middlebury [--noise S] [--gain G] [--offset O] [--half]
"""

import argparse
import time

import cv2
import numpy as np

PAIRS = [
    ("teddy", "im2.png", "im6.png", "disp2.png", 4, 64),
    ("venus", "im2.png", "im6.png", "disp2.pgm", 8, 32),
    ("tsukuba", "im3.png", "im4.png", "disp3.pgm", 16, 16),
]
# OpenCV's documentation: P1 and P2 are 8 and 32 times the pixels of a block
SETTINGS = {
    "5 paths, block 3": dict(blockSize=3, P1=72, P2=288),
    "5 paths, block 5": dict(blockSize=5, P1=200, P2=800),
    "8 paths, block 3": dict(blockSize=3, P1=72, P2=288, mode=cv2.STEREO_SGBM_MODE_HH),
}
CHECKS = dict(disp12MaxDiff=1, uniquenessRatio=10, speckleWindowSize=100, speckleRange=2)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--noise", type=float, default=0)
    parser.add_argument("--gain", type=float, default=1)
    parser.add_argument("--offset", type=float, default=0)
    parser.add_argument("--half", action="store_true")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    for label, settings in SETTINGS.items():
        for name, left, right, truth, scale, disparities in PAIRS:
            random = np.random.default_rng(1)
            images = [cv2.imread(f"{args.folder}/{name}/{file}").astype(float) for file in (left, right)]
            images[1] = images[1] * args.gain + args.offset
            images = [image + args.noise * random.standard_normal(image.shape) for image in images]
            images = [cv2.cvtColor(image.round().clip(0, 255).astype(np.uint8), cv2.COLOR_BGR2GRAY) for image in images]
            exact = cv2.imread(f"{args.folder}/{name}/{truth}", 0).astype(float) / scale
            if args.half:
                height, width = [2 * (side // 2) for side in exact.shape]
                images = [cv2.resize(i[:height, :width], (width // 2, height // 2), interpolation=cv2.INTER_AREA) for i in images]
                exact = 0.5 * exact[:height:2, :width:2]
                disparities = max(16, disparities // 2)
            matcher = cv2.StereoSGBM_create(minDisparity=0, numDisparities=disparities, **settings, **CHECKS)
            times = []
            for _ in range(21):
                start = time.thread_time()
                found = matcher.compute(*images)
                times.append(1e3 * (time.thread_time() - start))
            found = found / 16
            known = exact > 0
            matched = known & (found >= 0)
            error = np.abs(found - exact)[matched]
            rms = np.sqrt(np.mean(error[error <= 1] ** 2))
            print(
                f"{label}: {name:8} density {100 * matched.sum() / known.sum():5.2f} %, off by more than 1: "
                f"{100 * np.mean(error > 1):5.2f} %; rms of the others {rms:.3f}; {np.median(times):.1f} ms (least {min(times):.1f})"
            )


main()
