# SPDX-License-Identifier: GPL-3.0-or-later
"""The tutorial's plain tracker on a sequence: OpenCV's RGB-D odometry chained from frame to frame, and nothing else.

    python plain_odometry.py FRAMES OUT
    python plain_odometry.py --versions

It has no keyframes, closes no loops and never asks whether what it found is true, so errors add up: what a system does
without any of the care that others take. docs/examples/odometry.py is the same on a folder of images. Writes
trajectory.txt (TUM, camera-to-world, the tracked frames) and frames.csv.
"""

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

import cv2
import numpy as np
from frame_files import carry_out, read_image, write_estimate


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = ArgumentParser(prog="plain_odometry.py", description="Chain OpenCV's odometry along a sequence.")
    return carry_out(arguments, parser, lambda: {"numpy": np.__version__, "opencv": cv2.__version__}, run)


def run(index: dict, out: Path, _: Namespace) -> None:
    """Show all frames to the tracker, then write what it estimated."""
    poses = track(index)
    write_estimate(out, index, poses)


def track(index: dict) -> dict[int, np.ndarray]:
    """Return the poses (4, 4), c2w, of the tracked frames by their index; the first frame is the origin.

    A frame that OpenCV cannot align with the one before has no pose; the path goes on from the last pose all the same.
    """
    camera, scale_per_m = index["camera"], float(index["depth_scale_per_m"])
    matrix = [[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]]
    settings = cv2.OdometrySettings()
    settings.setCameraMatrix(np.array(matrix, dtype=np.float32))
    odometry = cv2.Odometry(cv2.OdometryType_RGB_DEPTH, settings, cv2.OdometryAlgoType_COMMON)
    c2w, before = np.eye(4), None
    poses: dict[int, np.ndarray] = {}
    for frame in index["frames"]:
        now = read_view(frame, scale_per_m)
        solved, motion = (True, np.eye(4)) if before is None else odometry.compute(*before, *now)
        if solved:
            # The motion takes points from the camera before to the one now.
            c2w = c2w @ np.linalg.inv(motion)
            poses[frame["index"]] = c2w
        before = now
    return poses


def read_view(frame: dict, scale_per_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a frame's depth, (H, W) float32 in metres, NaN where it is void, and its grey image, (H, W) bytes."""
    grey = read_image(frame["colour"], cv2.IMREAD_GRAYSCALE)
    steps = read_image(frame["depth"], cv2.IMREAD_UNCHANGED)
    depth_m = steps.astype(np.float32) / np.float32(scale_per_m)
    depth_m[steps == 0] = np.nan
    return depth_m, grey


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
