# SPDX-License-Identifier: GPL-3.0-or-later
"""What a system wrote, read as its definition says, as poses of the frames that it was given."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.errors import InputError, NotFiniteError
from ..estimate import Estimate
from ..estimates import FORMATS, Asked, Frames, estimate_of, match_frames, read_poses
from ..estimates.poses import LARGEST_READ_BYTES, OverLimitError
from ..outcome import Outcome
from .definition import Writes
from .leavings import check_output, found_output


@dataclass(frozen=True)
class Normalised:
    """How an estimate was read. estimate: empty unless outcome is FINISHED. detail: a sentence, "" for nothing."""

    outcome: Outcome
    detail: str
    estimate: Estimate


NOTHING = Estimate(np.empty(0), np.empty((0, 4, 4)))


def normalised(
    folder: Path,
    writes: Writes,
    stamps_s: list[float],
    pattern: str = "",
    *,
    colour: Sequence[Path] = (),
    largest_bytes: int = LARGEST_READ_BYTES,
) -> Normalised:
    """Read the estimate that a system wrote into a folder.

    stamps_s: of the frames that it was given. pattern: of the file; that of the estimate if it is "". colour: the
    frames' images, for a format that names them. largest_bytes: more of an estimate is not read.
    """
    path = found_output(folder, pattern or writes.file)
    if path is None:
        return Normalised(Outcome.NO_ESTIMATE, f"it wrote no {pattern or writes.file}", NOTHING)
    frames = Frames.of(stamps_s, colour)
    asked = Asked(writes.direction, writes.axes, writes.stamps, writes.stamp_unit, largest_bytes)
    try:
        parts = writes.format in FORMATS and FORMATS[writes.format].reads_parts
        check_output(path, folder, None if parts else largest_bytes, "limits.estimate_mb")
        read = read_poses(path, writes.format, asked, frames.stamps_s)
        estimate, notes = estimate_of(path, read, frames)
    except InputError as error:
        return _unread(error)
    found, others = match_frames(estimate, frames.stamps_s)
    said = [*read.notes, *notes, *([others] if others else [])]
    return Normalised(Outcome.FINISHED, "; ".join(said), found)


def _unread(error: InputError) -> Normalised:
    where = f"{error.where}: " if error.where else ""
    outcome = Outcome.NOT_FINITE if isinstance(error, NotFiniteError) else Outcome.UNREADABLE
    if isinstance(error, OverLimitError):
        outcome = Outcome.OVER_LIMIT
    return Normalised(outcome, f"{Path(error.file).name}: {where}{error.problem}", NOTHING)
