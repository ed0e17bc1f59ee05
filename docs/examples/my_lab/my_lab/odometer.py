# SPDX-License-Identifier: GPL-3.0-or-later
"""The path of our robot on a floor, as its odometer writes it: `ms;x_m;y_m;heading_deg` under a header."""

import numpy as np

from noisy_world.extend import FilePoses, InputError, PoseFile, ReadOptions, TrajectoryFormat

HEADER = "ms;x_m;y_m;heading_deg"


def read(file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read the poses: x forward, y left, z up."""
    header, *lines = file.text.split("\n")
    try:
        table = np.array([[float(number) for number in line.split(";")] for line in lines if line])
        ms, x_m, y_m, heading_deg = table.T
    except ValueError:
        raise InputError(file.path, f"is no table of {HEADER}") from None
    if not np.isfinite(table).all() or np.any(np.diff(ms) <= 0):
        raise InputError(file.path, "holds what is no number, or times that do not increase")
    heading = np.deg2rad(heading_deg)
    poses = np.tile(np.eye(4), (len(table), 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(heading)
    poses[:, 1, 0], poses[:, 0, 1] = np.sin(heading), -np.sin(heading)
    poses[:, 0, 3], poses[:, 1, 3] = x_m, y_m
    return FilePoses("odometer", poses, ms / 1000, axes="robot")


FORMAT = TrajectoryFormat(
    "odometer",
    "Odometer",
    "Milliseconds, x, y and heading, separated by semicolons",
    lambda file: file.begins_with(HEADER),
    read,
    stamped=True,
    looks_like=f"`{HEADER}` under a header of these names",
    recognised_by="its header",
    times="its own: milliseconds",
)
