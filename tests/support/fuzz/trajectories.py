# SPDX-License-Identifier: GPL-3.0-or-later
"""Mutated trajectories, whose poses are compared with those of independent readers."""

import json
from typing import get_args

import numpy as np
from fuzz import pose_readers
from fuzz.mutation import NUMBERS, mutate_mixed, pick

from noisy_world.core.geometry import quat_wxyz_from_rotation
from noisy_world.core.trajectories import files

WORDS = (
    *NUMBERS, "#", "# timestamp tx ty tz qx qy qz qw\n", "timestamp", "#timestamp [ns]", "q_w", "q_x", ",", ", ", ";",
    " ", "\t", "\n", "\r", "\r\n", "\n\n", "\0", "\ufeff", "\u2028", "\x0c", "1403636579763555584", "0 0 0 1",
    "0 0 0", "1e", "e", "-", "{", "}", "[", "]", '"', ":", "frames", "transform_matrix", "None", "null", "NaN",
)  # fmt: skip


def _poses(rng, count):
    quats = rng.standard_normal((count, 4))
    rotations = pose_readers.rotations(quats / np.linalg.norm(quats, axis=1, keepdims=True))
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = rotations
    poses[:, :3, 3] = rng.normal(0, 3, (count, 3))
    return poses


def _rows(table, digits, separator=" "):
    return "".join(separator.join(f"{value:.{digits}f}" for value in row) + "\n" for row in table)


def _stamped(rng, poses, first_s=1305031449.0):
    stamps_s = first_s + np.cumsum(rng.uniform(0.02, 0.06, len(poses)))
    return stamps_s, poses[:, :3, 3], quat_wxyz_from_rotation(poses[:, :3, :3])


def tum(rng, poses):
    """Return a TUM file, with or without its comment lines."""
    stamps_s, at, wxyz = _stamped(rng, poses, pick(rng, (0.0, 1305031449.0)))
    head = pick(rng, ("", "# ground truth trajectory\n# file: 'a.bag'\n# timestamp tx ty tz qx qy qz qw\n"))
    return head + _rows(np.column_stack([stamps_s, at, np.roll(wxyz, -1, axis=1)]), int(rng.integers(4, 10)))


def kitti(rng, poses):
    """Return a KITTI file."""
    return _rows(poses[:, :3].reshape(-1, 12), int(rng.integers(6, 13)))


def replica(rng, poses):
    """Return a Replica file."""
    return _rows(poses.reshape(-1, 16), int(rng.integers(6, 18)))


def euroc(rng, poses):
    """Return EuRoC's data.csv, of 8 or 17 columns."""
    stamps_s, at, wxyz = _stamped(rng, poses, 1403636579.0)
    rest = [f"{0.1:.3f}"] * pick(rng, (0, 9))
    names = "p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
    more = ", v_RS_R_x [m s^-1]" + ", b [m]" * 8 if rest else ""
    lines = [f"#timestamp [ns], {names}{more}"]
    for stamp_s, position, quat in zip(stamps_s, at, wxyz, strict=True):
        numbers = [f"{value:.6f}" for value in (*position, *quat)]
        lines.append(",".join([str(round(stamp_s * 1e9)), *numbers, *rest]))
    return "\n".join(lines) + "\n"


def log(_rng, poses):
    """Return an Open3D .log."""
    blocks = (f"{k} {k} {k + 1}\n" + _rows(item, 8) for k, item in enumerate(poses))
    return "".join(blocks)


def blocks(rng, poses):
    """Return 4 x 4 blocks of four lines."""
    return pick(rng, ("", "\n")).join(_rows(item, 8) for item in poses)


def transforms(rng, poses):
    """Return nerfstudio's transforms.json."""
    frames = [{"file_path": f"images/{k:05d}.png", "transform_matrix": item.tolist()} for k, item in enumerate(poses)]
    return json.dumps({"fl_x": 500.0, "w": 640, "h": 480, "frames": frames}, indent=int(rng.integers(0, 3)))


KNOWN = get_args(files.TrajectoryFormat)
KINDS = {
    "traj.txt": (tum, kitti, replica, blocks),
    "data.csv": (euroc,),
    "traj.log": (log,),
    "transforms.json": (transforms,),
}


def write(folder, rng):
    """Write a file of poses; its name is in name.txt."""
    name = pick(rng, ("traj.txt",) * 4 + ("data.csv",) * 2 + ("traj.log", "transforms.json"))
    text = pick(rng, KINDS[name])(rng, _poses(rng, int(rng.integers(1, 7))))
    for old, new in ((" ", pick(rng, (" ", " ", " ", "  ", "\t", ",", ", "))), ("\n", pick(rng, ("\n", "\n", "\r\n")))):
        text = text.replace(old, new) if name == "traj.txt" else text
    (folder / name).write_bytes(mutate_mixed(text, rng, WORDS))


def _file(folder):
    return next(folder / name for name in KINDS if (folder / name).exists())


def read(folder):
    """Read the file; return what it was read as, with its poses."""
    path = _file(folder)
    trajectory = files.read_trajectory(path)
    assert len(trajectory)
    assert np.isfinite(trajectory.c2w).all()
    assert np.isfinite(trajectory.stamps_s).all()
    return files.detect_format(path), trajectory


def differs(folder, meaning, peer):
    """Return how the poses differ from those of a plain reader and of evo, or "".

    A reader that refuses the file says nothing: ours also takes commas, tabs and comments behind numbers.
    """
    format_, trajectory = meaning
    path = _file(folder)
    if "euroc" in KNOWN and format_ != "euroc" and path.name == "data.csv" and pose_readers.is_euroc(path):
        return f"a data.csv of EuRoC is read as {format_}"
    found = {"a plain reader": pose_readers.read(path, format_)}
    # evo takes the columns in EuRoC's order, whatever the header names.
    if peer is not None and not (format_ == "euroc" and pose_readers.named_order(path) != list("wxyz")):
        found["evo"] = peer.poses(path, format_)
    for name, other in found.items():
        if other is not None and (told := _difference(trajectory, *other)):
            return f"{told} in {name}, read as {format_}"
    return ""


def _difference(ours, stamps_s, c2w):
    """Compare with stamps (N,), None where the format has none, and poses (N, 4, 4), the rotations as they stand."""
    if stamps_s is not None and len(stamps_s) == len(c2w):  # of poses with one stamp ours keeps the first
        first = np.flatnonzero(np.diff(stamps_s, prepend=-np.inf) != 0.0)
        stamps_s, c2w = np.asarray(stamps_s)[first], c2w[first]
    if len(ours) != len(c2w):
        return f"{len(ours)} poses, but {len(c2w)}"
    if stamps_s is not None and not np.allclose(ours.stamps_s, stamps_s, rtol=1e-15, atol=1e-9):
        return f"other stamps: {ours.stamps_s[:3]}, but {stamps_s[:3]}"
    if not np.allclose(ours.c2w[:, :3, 3], c2w[:, :3, 3], rtol=1e-12, atol=1e-12):
        return f"other positions: {ours.c2w[0, :3, 3]}, but {c2w[0, :3, 3]}"
    if not np.allclose(ours.c2w[:, :3, :3], c2w[:, :3, :3], atol=1e-2):
        return f"other rotations: {ours.c2w[0, :3, :3].tolist()}, but {c2w[0, :3, :3].tolist()}"
    return ""
