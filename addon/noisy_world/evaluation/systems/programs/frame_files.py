# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading images and writing poses, shared by the programs in this folder."""

import cv2
import numpy as np


def read_image(path: str, mode: int) -> np.ndarray:
    """Return an image as OpenCV reads it."""
    image = cv2.imread(path, mode)
    if image is None:
        raise SystemExit(f"{path}: is no image")
    return image


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
