# SPDX-License-Identifier: GPL-3.0-or-later
"""The time stamps in the frames.jsonl of a recording, which this program wrote beside the images."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..messages import Message, PresetKey
from ..trajectories.stamps import FrameStamps, Stamps
from .json_text import finite_number, parse_given_json
from .records import FRAMES
from .stored import recorded_text

_REMEDY = Message("mend it; without it, frames are ", PresetKey("rate_hz"), " apart")


def read_frame_times(folder: Path, frames: Sequence[int]) -> FrameStamps | None:
    """Return the stamps of a sequence's frames; None where there is no frames.jsonl.

    frames: the numbers of the frames that there are; the file may tell of others too. Poses have the stamps of colour.
    Raises InputError where the file is damaged, lacks a frame, or tells stamps that do not increase.
    """
    path = folder / FRAMES
    if not os.path.lexists(path):
        return None
    times_s = _times(path)
    lacking = next((frame for frame in frames if frame not in times_s), None)
    if lacking is not None:
        raise InputError(path, f"has no line for frame {lacking}", remedy=_REMEDY)
    rgb_s, depth_s = (np.array([times_s[frame][column] for frame in frames]) for column in (0, 1))
    late = np.flatnonzero(np.diff(rgb_s) <= 0)
    if late.size:
        raise InputError(path, f"frame {frames[late[0] + 1]} is not later than the one before it", remedy=_REMEDY)
    rgb = Stamps(rgb_s)
    return FrameStamps(rgb, rgb if np.array_equal(rgb_s, depth_s) else Stamps(depth_s), rgb)


def _times(path: Path) -> dict[int, tuple[float, float]]:
    """Return by frame the stamps of its colour and of its depth."""
    times_s: dict[int, tuple[float, float]] = {}
    for number, line in enumerate(recorded_text(path).split("\n"), 1):
        if not line.strip():
            continue
        where = f"line {number}"
        record = parse_given_json(line, path, where=where, remedy=_REMEDY)
        if not isinstance(record, dict) or not _is_frame(record.get("frame")) or record["frame"] in times_s:
            raise InputError(path, "is no line for a frame of its own", where=where, remedy=_REMEDY)
        time_s = finite_number(record.get("time_s"))
        depth_time_s = finite_number(record.get("depth_time_s", record.get("time_s")))
        if time_s is None or depth_time_s is None:
            raise InputError(path, "has no time stamp in seconds", where=where, remedy=_REMEDY)
        times_s[record["frame"]] = (time_s, depth_time_s)
    return times_s


def _is_frame(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0
