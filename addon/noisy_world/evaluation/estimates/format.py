# SPDX-License-Identifier: GPL-3.0-or-later
"""What a format of estimates is: a name, a function that reads a file of it, and what may be said about its poses."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from ...core.trajectories.pose_text import StampUnit
from ...core.trajectories.trajectory import Axes, Direction
from .poses import LARGEST_READ_BYTES, ReadPoses

Auto: TypeAlias = Literal["auto"]
StampsOf: TypeAlias = Literal["time", "index", "none"]
"""How a pose says its frame: by its time, by the frame's number in place of the time, or by its order."""


@dataclass(frozen=True)
class Asked:
    """How a file is to be read, where its format leaves that open.

    direction, axes: of the poses; "auto" is camera-to-world with the format's own axes. stamps: how a pose says its
    frame. stamp_unit: of its time; "auto" is what the file says or looks like. largest_bytes: that are read of a file
    with more than poses in it.
    """

    direction: Direction | Auto = "auto"
    axes: Axes | Auto = "auto"
    stamps: StampsOf = "time"
    stamp_unit: StampUnit | Auto = "auto"
    largest_bytes: int = LARGEST_READ_BYTES


def _never(path: Path, head: bytes) -> bool:
    del path, head
    return False


@dataclass(frozen=True)
class EstimateFormat:
    """A format of estimates.

    meaning: what it is, for people. read: a file, and how -> its poses; raises InputError, and NotFiniteError, which is
    one, where a pose is not finite. recognises: a file and its first bytes -> whether it is of this format, where none
    is named. any_convention: whether it leaves direction and axes open. any_stamps: whether it leaves `stamps` and
    `stamp_unit` open. any_unit: whether the unit of its times is tried by those of the frames. reads_parts: whether a
    part of a file is read that may be large.
    """

    name: str
    meaning: str
    read: Callable[[Path, Asked], ReadPoses]
    recognises: Callable[[Path, bytes], bool] = _never
    any_convention: bool = False
    any_stamps: bool = False
    any_unit: bool = False
    reads_parts: bool = False
