# SPDX-License-Identifier: GPL-3.0-or-later
"""`estimate.txt`: the poses that a system estimated, in the folder of a run: TUM's format, camera-to-world."""

from pathlib import Path

import numpy as np

from ...core.errors import InputError
from ...core.geometry import continuous_quats, quat_wxyz_from_rotation
from ...core.regular_files import read_text
from ..estimate import Estimate
from ..estimates import Asked, Frames, estimate_of, read_poses

ESTIMATE = "estimate.txt"
KEYFRAMES = "keyframes.txt"


def estimate_text(estimate: Estimate) -> str:
    """Return a line a pose: stamp_s tx ty tz qx qy qz qw; nine decimals of the stamp, 17 digits of the others."""
    quat_wxyz = continuous_quats(quat_wxyz_from_rotation(estimate.c2w[:, :3, :3]))
    rows = np.concatenate([estimate.c2w[:, :3, 3], np.roll(quat_wxyz, -1, axis=1)], axis=1) + 0.0
    stamps = estimate.stamps_s.tolist()
    return "".join(
        f"{stamp:.9f} {' '.join(f'{number:.17g}' for number in row)}\n"
        for stamp, row in zip(stamps, rows.tolist(), strict=True)
    )


def read_estimate_file(path: Path) -> Estimate:
    """Read what `estimate_text` wrote. Raises InputError for anything else."""
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read: {error}") from error
    lines = text.splitlines()
    if text and not text.endswith("\n"):  # which `estimate_text` ends each line with
        problem = "the file ends in the middle of a line, so it was cut"
        remedy = "remove the run's folder and run the same command again"
        raise InputError(path, problem, where=f"line {len(lines)}", remedy=remedy)
    return estimate_of(path, read_poses(path, "tum", Asked(stamp_unit="s")), Frames.of([]))[0]
