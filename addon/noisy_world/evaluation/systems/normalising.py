# SPDX-License-Identifier: GPL-3.0-or-later
"""What a system wrote, read as its definition says, as poses of the frames that it was given."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ...core.datasets.association import associate
from ...core.errors import InputError, NotFiniteError
from ...core.regular_files import read_bytes
from ...core.trajectories.files import STAMPED_FORMATS, Auto, read_trajectory_file
from ...core.trajectories.pose_text import TrajectoryFormat
from ..estimate import Estimate
from ..outcome import Outcome
from ..whole_text import check_whole
from .definition import Writes
from .leavings import LARGEST_READ_BYTES, OverLimitError, check_output, found_output
from .readers import READERS, TEXT_FORMATS, read_estimate

LATEST_S = 0.02  # a pose belongs to a frame whose stamp differs by less, as in core/datasets/association
_NOT_FINITE = re.compile(r"(?<![A-Za-z0-9_.])[-+]?(?:nan|inf|infinity)(?![A-Za-z0-9_.])", re.IGNORECASE)


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
    of_reader = writes.format not in ("auto", *TEXT_FORMATS)
    path = found_output(folder, pattern or writes.file)
    if path is None:
        return Normalised(Outcome.NO_ESTIMATE, f"it wrote no {pattern or writes.file}", NOTHING)
    try:
        whole = of_reader and READERS[writes.format].reads_parts
        check_output(path, folder, None if whole else largest_bytes, "limits.estimate_mb")
    except InputError as error:
        return _unread(error)
    if of_reader:
        return _read(path, writes, stamps_s, colour, largest_bytes)
    text = _text(path)
    if text is not None:
        if not _has_rows(text):
            return Normalised(Outcome.FINISHED, "", NOTHING)
        if found := _NOT_FINITE.search(_without_comments(text)):
            line = text.count("\n", 0, found.start()) + 1
            return Normalised(Outcome.NOT_FINITE, f"{path.name} holds {found[0]} in line {line}", NOTHING)
    try:
        if text is not None:
            check_whole(path, text)
        return _matched(path, writes, np.array(stamps_s, dtype=np.float64))
    except InputError as error:
        return _unread(error)


def _read(path: Path, writes: Writes, stamps_s: list[float], colour: Sequence[Path], largest_bytes: int) -> Normalised:
    """Read an estimate by the reader of its format."""
    images = map(str, colour) if colour else repeat("")
    frames = [{"stamp_s": stamp_s, "colour": name} for stamp_s, name in zip(stamps_s, images, strict=False)]
    direction = None if writes.direction == "auto" else writes.direction
    axes = None if writes.axes == "auto" else writes.axes
    try:
        found = read_estimate(
            writes.format, path, {"frames": frames}, direction=direction, axes=axes, largest_bytes=largest_bytes
        )
        if not len(found):
            return Normalised(Outcome.FINISHED, "", NOTHING)
        return _of_frames(path, np.array(stamps_s, dtype=np.float64), found.stamps_s, found.c2w)
    except InputError as error:
        return _unread(error)


def _unread(error: InputError) -> Normalised:
    where = f"{error.where}: " if error.where else ""
    outcome = Outcome.NOT_FINITE if isinstance(error, NotFiniteError) else Outcome.UNREADABLE
    if isinstance(error, OverLimitError):
        outcome = Outcome.OVER_LIMIT
    return Normalised(outcome, f"{Path(error.file).name}: {where}{error.problem}", NOTHING)


def _matched(path: Path, writes: Writes, stamps_s: NDArray[np.float64]) -> Normalised:
    read = read_trajectory_file(
        path,
        format=cast("TrajectoryFormat | Auto", writes.format),
        direction=writes.direction,
        axes=writes.axes,
        stamp_unit=writes.stamp_unit,
    )
    c2w, own_s = read.trajectory.c2w, read.trajectory.stamps_s
    if writes.stamps == "none" or (writes.stamps == "time" and read.format not in STAMPED_FORMATS):
        if len(c2w) != len(stamps_s):
            problem = f"holds {len(c2w)} poses without stamps, but {len(stamps_s)} frames were given"
            raise InputError(path, problem)
        return Normalised(Outcome.FINISHED, "", Estimate(stamps_s, c2w))
    if writes.stamps == "index":
        given, of_pose = _by_index(path, own_s, len(stamps_s))
        return Normalised(Outcome.FINISHED, "", Estimate(stamps_s[given], c2w[of_pose]))
    return _of_frames(path, stamps_s, own_s, c2w)


def _of_frames(
    path: Path, stamps_s: NDArray[np.float64], own_s: NDArray[np.float64], c2w: NDArray[np.float64]
) -> Normalised:
    """Return the poses that belong to frames by their stamps. Raises InputError where none does."""
    given, of_pose = associate(stamps_s, own_s, LATEST_S)
    if not given.size:
        problem = "no pose belongs to a frame that was given, by its stamp"
        raise InputError(path, problem)
    lost = len(own_s) - len(of_pose)
    detail = f"{lost} of {len(own_s)} poses belong to no frame that was given" if lost else ""
    return Normalised(Outcome.FINISHED, detail, Estimate(stamps_s[given], c2w[of_pose]))


def _by_index(path: Path, own: NDArray[np.float64], frames: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    wrong = np.flatnonzero((own != np.floor(own)) | (own < 0) | (own >= frames))
    if wrong.size:
        raise InputError(path, f"{own[wrong[0]]:g} is no index of {frames} frames")
    return own.astype(np.int64), np.arange(len(own))


def _text(path: Path) -> str | None:
    """Return the text of a file; None where it is none, and a reader has to judge it."""
    data = read_bytes(path)
    try:
        return None if b"\0" in data else data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None


def _without_comments(text: str) -> str:
    """Return a text with blanks for its comments."""
    return re.sub(r"#[^\n]*", lambda found: " " * len(found[0]), text)


def _has_rows(text: str) -> bool:
    """Tell whether a text has more than comments, blank lines and a header."""
    return any(re.search(r"[0-9]|\bnan\b", line, re.IGNORECASE) for line in _without_comments(text).splitlines())
