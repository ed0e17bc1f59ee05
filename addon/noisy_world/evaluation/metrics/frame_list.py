# SPDX-License-Identifier: GPL-3.0-or-later
"""A list of the frames that a system was given: a stamp a line, as TUM's rgb.txt, EuRoC's data.csv and times.txt."""

import re
from decimal import Decimal
from pathlib import Path

import numpy as np

from ...core.errors import InputError
from ...core.schema import shown
from ...core.trajectories.pose_text import LARGEST_STAMP_S, is_header, read_text
from ..estimates import Frames

_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?")
_LEAST_NS = 10**17  # 1973 in nanoseconds: stamps from here on are nanoseconds, as in files of poses
_MOST_DIGITS = 40
_REMEDY = "a line is a time stamp, and perhaps a file, as in TUM's rgb.txt and EuRoC's data.csv"


def read_frame_list(path: Path) -> Frames:
    """Read a list of frames: each line's first word is a stamp in seconds, or in nanoseconds from 1e17 on.

    What follows, at its end the name of the frame's image, is separated by blanks or commas. Raises InputError.
    """
    stamps: list[Decimal] = []
    names: list[str] = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        data = line.partition("#")[0].strip()
        words = re.split(r"[\s,]+", data)
        if not data or (not stamps and is_header(words[0])):
            continue
        if len(words[0]) > _MOST_DIGITS or not _NUMBER.fullmatch(words[0]):
            raise InputError(path, f"{shown(words[0])} is no time stamp", where=f"line {number}", remedy=_REMEDY)
        stamps.append(Decimal(words[0]))
        names.append(words[1] if len(words) > 1 else "")
    if not stamps:
        raise InputError(path, "lists no frame", remedy=_REMEDY)
    per_s = 10**9 if all(stamp >= _LEAST_NS for stamp in stamps) else 1
    seconds = np.array([float(stamp / per_s) for stamp in stamps])
    if np.abs(seconds).max() > LARGEST_STAMP_S:
        raise InputError(path, "has time stamps of more than 1e11 s", remedy="write them in seconds, or in nanoseconds")
    seconds, first = np.unique(seconds, return_index=True)
    return Frames.of(seconds, [names[row] for row in first.tolist()] if all(names) else ())
