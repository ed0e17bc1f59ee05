# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line, reading images and writing estimates, shared by the programs in this folder."""

import json
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np


def carry_out(
    arguments: list[str],
    parser: ArgumentParser,
    versions: Callable[[], dict[str, str]],
    run: Callable[[dict, Path, Namespace], None],
) -> int:
    """Carry out `FRAMES OUT [options]` or `--versions`, and return the exit status.

    parser: has the program's own options. versions: says those of what runs. run: is given the index of the frames, the
    folder to write into and the options; it has one thread of OpenCV.
    """
    if arguments[:1] == ["--versions"]:
        print(json.dumps(versions() | {"python": ".".join(map(str, sys.version_info[:3]))}))
        return 0
    parser.add_argument("frames", type=Path, help="the index of the frames")
    parser.add_argument("out", type=Path, help="the folder to write into")
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    run(json.loads(options.frames.read_text(encoding="utf-8")), options.out, options)
    return 0


def read_image(path: str, mode: int) -> np.ndarray:
    """Return an image as OpenCV reads it."""
    image = cv2.imread(path, mode)
    if image is None:
        raise SystemExit(f"{path}: is no image")
    return image


def write_estimate(out: Path, index: dict, poses: dict[int, np.ndarray]) -> None:
    """Write trajectory.txt (TUM) and frames.csv: poses (4, 4), c2w, of the tracked frames; all others are lost."""
    rows = [
        f"{frame['index']},{frame['stamp_s']!r},{'tracked' if frame['index'] in poses else 'lost'}\n"
        for frame in index["frames"]
    ]
    (out / "frames.csv").write_text("index,stamp_s,state\n" + "".join(rows), encoding="utf-8")
    stamps_s = np.array([frame["stamp_s"] for frame in index["frames"]])
    (out / "trajectory.txt").write_text(tum_text(stamps_s, poses), encoding="utf-8")


def rigid(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) of a rotation (3, 3) and a position of three numbers."""
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = np.ravel(position)
    return pose


def inverse(pose: np.ndarray) -> np.ndarray:
    """Return the inverse of a rigid pose (4, 4)."""
    return rigid(pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3])


def tum_text(stamps_s: np.ndarray, poses: dict[int, np.ndarray]) -> str:
    """Return poses (4, 4) of frames as lines `stamp tx ty tz qx qy qz qw`."""
    lines = []
    for index in sorted(poses):
        quaternion = quat_xyzw(poses[index][:3, :3])
        numbers = " ".join(f"{number:.17g}" for number in (*poses[index][:3, 3], *quaternion))
        lines.append(f"{float(stamps_s[index])!r} {numbers}\n")
    return "".join(lines)


def quat_xyzw(rotation: np.ndarray) -> np.ndarray:
    """Return the unit quaternion of a rotation (3, 3): the eigenvector of the largest eigenvalue of Davenport's K."""
    r = rotation
    z = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    k = np.zeros((4, 4))
    k[:3, :3] = r + r.T - np.trace(r) * np.eye(3)
    k[:3, 3] = k[3, :3] = z
    k[3, 3] = np.trace(r)
    return np.linalg.eigh(k)[1][:, -1]
