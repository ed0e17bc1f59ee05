# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a run leaves: estimate.txt, frames.csv and keyframes.txt."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.datasets.storage import storage_errors
from ...core.geometry import continuous_quats, quat_wxyz_from_rotation
from .agreement import Agreement
from .tracking import State

ESTIMATE, FRAMES, KEYFRAMES = "estimate.txt", "frames.csv", "keyframes.txt"
HEADER = "index,stamp_s,state,keyframe,overlap,seen,depth,grey"


@dataclass(frozen=True)
class FrameResult:
    """What is known of a frame in the end: c2w (4, 4), None where it was lost."""

    index: int
    stamp_s: float
    state: State
    keyframe: int
    agreement: Agreement
    c2w: NDArray[np.float64] | None


def tum_lines(stamps_s: Sequence[float], c2w: Sequence[NDArray[np.float64]]) -> str:
    """Return poses as lines `stamp_s tx ty tz qx qy qz qw`: camera-to-world, nine decimals of a second."""
    if not stamps_s:
        return ""
    poses = np.stack(c2w)
    quats = np.roll(continuous_quats(quat_wxyz_from_rotation(poses[:, :3, :3])), -1, axis=1)
    rows = (np.concatenate([poses[:, :3, 3], quats], axis=1) + 0.0).tolist()  # + 0.0: no negative zeros
    return "".join(
        f"{stamp_s:.9f} {' '.join(f'{value:.17g}' for value in row)}\n"
        for stamp_s, row in zip(stamps_s, rows, strict=True)
    )


def frame_lines(frames: Sequence[FrameResult]) -> str:
    """Return a line a frame: its state, the keyframe that it hangs on, and how well it agreed with what was known."""
    lines = [HEADER]
    for frame in frames:
        seen = frame.agreement
        shares = ",".join(f"{share:.4f}" for share in (seen.overlap, seen.seen, seen.depth, seen.grey))
        keyframe = "" if frame.c2w is None else str(frame.keyframe)
        lines.append(f"{frame.index},{frame.stamp_s:.9f},{frame.state},{keyframe},{shares}")
    return "\n".join(lines) + "\n"


def write_results(folder: Path, frames: Sequence[FrameResult], keyframes: Sequence[FrameResult]) -> None:
    """Write the files of a run into its folder, which is made. Raises StorageError where that cannot be."""
    known = [(frame.stamp_s, frame.c2w) for frame in frames if frame.c2w is not None]
    kept = [(frame.stamp_s, frame.c2w) for frame in keyframes if frame.c2w is not None]
    texts = {
        ESTIMATE: tum_lines([stamp_s for stamp_s, _ in known], [c2w for _, c2w in known]),
        FRAMES: frame_lines(frames),
        KEYFRAMES: tum_lines([stamp_s for stamp_s, _ in kept], [c2w for _, c2w in kept]),
    }
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8", newline="\n")
