# SPDX-License-Identifier: GPL-3.0-or-later
"""Track a sequence in the TUM RGB-D benchmark's layout with OpenCV's RGB-D odometry, and say how far it drifts.

    python odometry.py SEQUENCE [SEQUENCE ...] --camera FX FY CX CY

It reads the files as ORB-SLAM's loader does, associations.txt and depth / 5000, and knows nothing of Noisy World. The
poses are chained from frame to frame and held against groundtruth.txt after the alignment that moves the one path
onto the other best (Horn, 1987; without scale): the root mean square is the absolute trajectory error.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

DEPTH_SCALE_PER_M = 5000.0  # the benchmark's


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(description="Track sequences with OpenCV's RGB-D odometry.")
    parser.add_argument("sequences", metavar="SEQUENCE", nargs="+", type=Path, help="a folder with associations.txt")
    parser.add_argument("--camera", metavar=("FX", "FY", "CX", "CY"), nargs=4, type=float, required=True)
    options = parser.parse_args(arguments)
    print("sequence                        frames  lost  path, m  error, mm  error / path")
    for folder in options.sequences:
        tracked_m, true_m, lost = track(folder, *options.camera)
        error_m = absolute_error_m(tracked_m, true_m)
        length_m = float(np.linalg.norm(np.diff(true_m, axis=0), axis=1).sum())
        share = 100 * error_m / length_m
        print(f"{folder!s:<30}  {len(true_m):>6}  {lost:>4}  {length_m:7.2f}  {1e3 * error_m:9.1f}  {share:10.2f} %")
    return 0


def track(
    folder: Path, fx_px: float, fy_px: float, cx_px: float, cy_px: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Chain a sequence's frames; return the tracked and the true positions, (N, 3) in metres, and the frames lost."""
    settings = cv2.OdometrySettings()
    settings.setCameraMatrix(np.array([[fx_px, 0, cx_px], [0, fy_px, cy_px], [0, 0, 1]], dtype=np.float32))
    odometry = cv2.Odometry(cv2.OdometryType_RGB_DEPTH, settings, cv2.OdometryAlgoType_COMMON)
    pairs = [line.split() for line in (folder / "associations.txt").read_text().splitlines() if line.strip()]
    truth = np.loadtxt(folder / "groundtruth.txt", ndmin=2)
    true_m, tracked_m = [], []
    c2w = np.eye(4)
    before: tuple[NDArray[np.float32], NDArray[Any]] | None = None
    lost = 0
    shown = tqdm(pairs, desc=str(folder), unit="frame", leave=False, disable=None)  # None: no bar in a log
    for rgb_stamp_s, rgb_name, _, depth_name in shown:
        grey = read_image(folder / rgb_name, cv2.IMREAD_GRAYSCALE)
        steps = read_image(folder / depth_name, cv2.IMREAD_UNCHANGED)
        depth_m = steps.astype(np.float32) / DEPTH_SCALE_PER_M
        depth_m[steps == 0] = np.nan  # void
        if before is not None:
            found, motion = odometry.compute(*before, depth_m, grey)
            lost += not found
            # The motion takes points from the camera before to the one now.
            c2w = c2w @ np.linalg.inv(motion) if found else c2w
        before = depth_m, grey
        tracked_m.append(c2w[:3, 3])
        true_m.append(truth[np.abs(truth[:, 0] - float(rgb_stamp_s)).argmin(), 1:4])
    return np.array(tracked_m), np.array(true_m), lost


def read_image(path: Path, form: int) -> NDArray[Any]:
    """Read an image, (H, W) or (H, W, 3) BGR; ends the program where it cannot be read."""
    image = cv2.imread(str(path), form)
    if image is None:
        raise SystemExit(f"{path}: cannot be read")
    return image


def absolute_error_m(tracked_m: NDArray[np.float64], true_m: NDArray[np.float64]) -> float:
    """Return the root mean square distance of two paths, (N, 3), after the best rigid alignment."""
    centred, wanted = tracked_m - tracked_m.mean(axis=0), true_m - true_m.mean(axis=0)
    u, _, vt = np.linalg.svd(wanted.T @ centred)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])  # a rotation, not a reflection
    return float(np.sqrt(((centred @ (u @ mirror @ vt).T - wanted) ** 2).sum(axis=1).mean()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
