# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain readers of poses, with numpy's loadtxt and json: independent of the project's own."""

import json
import re

import numpy as np


def rotations(quat_wxyz):
    """Return (N, 3, 3) of unit quaternions (N, 4), written out from Hamilton's product."""
    w, x, y, z = quat_wxyz.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _from_quats(stamps_s, at, quat_wxyz):
    poses = np.tile(np.eye(4), (len(at), 1, 1))
    poses[:, :3, :3] = rotations(quat_wxyz / np.linalg.norm(quat_wxyz, axis=1, keepdims=True))
    poses[:, :3, 3] = at
    return stamps_s, poses


def _table(path, columns, separator=None):
    table = np.loadtxt(path, ndmin=2, delimiter=separator, encoding="utf-8")
    if table.shape[1] not in columns:
        raise ValueError("another number of columns")
    return table


def _tum(path):
    table = _table(path, (8,))
    return _from_quats(table[:, 0], table[:, 1:4], np.roll(table[:, 4:], 1, axis=1))


def _kitti(path):
    table = _table(path, (12,)).reshape(-1, 3, 4)
    return None, np.concatenate([table, np.tile([[[0.0, 0.0, 0.0, 1.0]]], (len(table), 1, 1))], axis=1)


def _replica(path):
    return None, _table(path, (16,)).reshape(-1, 4, 4)


def named_order(path):
    """Return the order of a quaternion's numbers that the header of EuRoC's columns names; w, x, y, z without one."""
    first = path.read_text(encoding="utf-8", errors="replace").splitlines()[0]
    named = re.findall(r"q_RS_([wxyz]) \[\]", first)
    return named if sorted(named) == list("wxyz") else list("wxyz")


def _euroc(path):
    table = _table(path, (8, 17), ",")
    order = [4 + named_order(path).index(name) for name in "wxyz"]
    return _from_quats(table[:, 0] / 1e9, table[:, 1:4], table[:, order])


def _finite(poses):
    """Leave out the poses where tracking was lost."""
    return poses[np.isfinite(poses).all(axis=(1, 2))]


def _matrices(path):
    return None, _finite(_table(path, (4,)).reshape(-1, 4, 4))


def _log(path):
    numbers = [float(word) for word in path.read_text().split()]
    return None, _finite(np.array(numbers).reshape(-1, 19)[:, 3:].reshape(-1, 4, 4))


def _transforms(path):
    document = json.loads(path.read_text())
    poses = np.array([item["transform_matrix"] for item in document["frames"]], dtype=np.float64)
    return None, _finite(poses @ np.diag([1.0, -1.0, -1.0, 1.0]))  # OpenGL's camera axes to OpenCV's


READERS = {"tum": _tum, "kitti": _kitti, "replica": _replica, "euroc": _euroc, "matrices": _matrices, "log": _log,
           "transforms": _transforms}  # fmt: skip


def is_euroc(path):
    """Tell whether a file is read as EuRoC's: whole nanoseconds before 7 or 16 numbers, separated by commas."""
    try:
        _euroc(path)
    except ValueError:
        return False
    rows = [
        line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip() and line.strip()[0] != "#"
    ]
    return all(row.partition(",")[0].strip().isdecimal() for row in rows)


def read(path, format_):
    """Return stamps, or None, and poses (N, 4, 4); None where the format is unknown or this reader refuses the file."""
    if format_ not in READERS:
        return None
    try:
        return READERS[format_](path)
    except (ValueError, KeyError, TypeError, OverflowError):
        return None
