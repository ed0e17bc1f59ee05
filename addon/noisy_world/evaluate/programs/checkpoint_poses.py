# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses of a checkpoint that torch saved; a program of its own, for the Python of the system that saved it.

    PYTHON checkpoint_poses.py nice_slam|imap|co_slam CHECKPOINTS OUT [PROGRAM ARGUMENTS ...]

A PROGRAM is run first, by the same Python. CHECKPOINTS is a checkpoint, or a folder, of whose checkpoints the one with
the highest number is read. Writes OUT/poses.npz: `poses`, (N, 4, 4) float64, camera-to-world with OpenGL's axes, and
`frames`, the number of each one's frame; of Co-SLAM OUT/relative_poses.npz too.

NICE-SLAM and its iMAP (src/utils/Logger.py and src/tools/eval_ate.py of https://github.com/cvg/nice-slam):
ckpts/00000.tar, where `estimate_c2w_list` has a matrix for each frame, zeros where the tracker has not come to, and
`idx` is the last frame of the estimate; lengths are `scale` times metres, a tenth in configs/imap.yaml. Co-SLAM
(save_ckpt and convert_relative_pose in coslam.py of https://github.com/HengyiWang/Co-SLAM): checkpointN.pt, where
`pose` maps a frame's number to a matrix as it was tracked; `pose_rel` maps the first frame, and those that are no
keyframes, to their pose relative to the keyframe before them, which was optimised further after the frame was tracked.

Its language is that of Python 3.7, which these systems are installed with.
"""

from __future__ import annotations

import importlib
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

NAMES = {"nice_slam": r"(\d+)\.tar", "imap": r"(\d+)\.tar", "co_slam": r"checkpoint(\d+)\.pt"}
IMAP_SCALE = 0.1  # of configs/imap.yaml: its lengths are so many times metres


def main(arguments: list[str]) -> None:
    """Run the command line; what is wrong with the checkpoint ends it with a line."""
    kind, checkpoints, out, *program = arguments
    if program:
        ended = subprocess.call([sys.executable, *program])  # noqa: S603 - the system itself
        if ended < 0:  # by a signal, as we end too, so that whoever started us sees it
            os.kill(os.getpid(), -ended)
        if ended:
            sys.exit(ended)
    path = last_checkpoint(kind, Path(checkpoints))
    held = loaded(path, trusted=bool(program))
    try:
        c2w = {"nice_slam": of_nice_slam, "imap": of_imap, "co_slam": of_co_slam}[kind](held)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        sys.exit(f"{path}: holds no poses as {kind} saves them: {in_a_line(error)}")
    for name, (frames, poses) in c2w.items():
        np.savez(Path(out) / name, frames=np.array(frames, np.int64), poses=poses)


def last_checkpoint(kind: str, path: Path) -> Path:
    """Return the checkpoint of the highest number in a folder, or the path itself where it is none."""
    if not path.is_dir():
        return path
    named = [(re.fullmatch(NAMES[kind], file.name, re.ASCII), file) for file in path.iterdir()]
    checkpoints = sorted((int(number.group(1)), file) for number, file in named if number)
    if not checkpoints:
        sys.exit(f"{path}: holds no checkpoint of {kind}")
    return checkpoints[-1][1]


def loaded(path: Path, *, trusted: bool) -> Any:
    """Return what a checkpoint holds. trusted: this Python's own program has just written it.

    A checkpoint is a pickle, which can name any function. From 1.13 on torch loads what tensors need and refuses the
    rest. What an older one loads runs what the file names, as its program may do itself; no other file is given to it.
    """
    try:
        torch = importlib.import_module("torch")
    except ImportError as error:
        sys.exit(f"{sys.executable} has no torch, which reads checkpoints: {error}")
    strict = {"weights_only": True} if "weights_only" in inspect.signature(torch.load).parameters else {}
    if not strict and not trusted:
        sys.exit(f"torch {torch.__version__} may run what a checkpoint names; read it with torch 1.13 or newer")
    try:
        return torch.load(str(path), map_location="cpu", **strict)
    except Exception as error:  # noqa: BLE001 - whatever a damaged file makes of torch
        sys.exit(f"{path}: torch cannot load it: {in_a_line(error)}")


def in_a_line(error: Exception) -> str:
    """Return what an error says as one line of bounded length."""
    return " ".join(str(error).split())[:300]


def of_nice_slam(held: Any) -> dict[str, tuple[Any, np.ndarray]]:
    """Return the poses of NICE-SLAM by the file's name: numbers of frames, and matrices."""
    poses, last = matrices(held["estimate_c2w_list"], axes=3), int(held["idx"])
    if not 0 <= last < len(poses):
        raise ValueError(f"idx is {last}, of {len(poses)} frames")
    return {"poses.npz": (range(last + 1), poses[: last + 1])}


def of_imap(held: Any) -> dict[str, tuple[Any, np.ndarray]]:
    """Return the poses of iMAP by the file's name, in metres, as src/tools/eval_ate.py has them."""
    scaled = of_nice_slam(held)
    for _, poses in scaled.values():
        poses[:, :3, 3] /= IMAP_SCALE
    return scaled


def of_co_slam(held: Any) -> dict[str, tuple[Any, np.ndarray]]:
    """Return the poses of Co-SLAM by the file's name: as they were tracked, and as the keyframes are in the end."""
    poses, relative = by_frame(held["pose"]), by_frame(held["pose_rel"])
    final: dict[int, np.ndarray] = {}
    keyframe = None
    for frame, pose in poses.items():
        if keyframe is None or frame not in relative:
            final[frame] = keyframe = pose
        else:
            final[frame] = relative[frame] @ keyframe
    named = {"poses.npz": poses, "relative_poses.npz": final}
    return {name: (list(each), np.reshape(list(each.values()), (-1, 4, 4))) for name, each in named.items()}


def by_frame(poses: dict[Any, Any]) -> dict[int, np.ndarray]:
    """Return matrices by the numbers of their frames, in their order."""
    return {int(frame): matrices(poses[frame], axes=2) for frame in sorted(poses, key=int)}


def matrices(tensor: Any, axes: int) -> np.ndarray:
    """Return matrices (..., 4, 4) in float64. By lists, since a torch older than numpy does not know its arrays."""
    values = np.array(tensor.tolist(), np.float64)
    if values.ndim != axes or values.shape[-2:] != (4, 4):
        raise ValueError(f"numbers of {values.shape}, which are no matrices of 4 x 4")
    return values


if __name__ == "__main__":
    main(sys.argv[1:])
