# SPDX-License-Identifier: GPL-3.0-or-later
"""Readers of estimates: from what a system wrote to the poses of its frames."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ....core.errors import NotFiniteError
from ....core.trajectories.pose_text import FORMATS
from ....core.trajectories.trajectory import Axes, Direction
from ...estimate import Estimate
from ..leavings import LARGEST_READ_BYTES
from . import arrays, colmap, numbered, splatam, stamped, vslamlab
from .frames import Index

__all__ = ["READERS", "TEXT_FORMATS", "Index", "NotFiniteError", "Reader", "read_estimate"]


@dataclass(frozen=True)
class Reader:
    """A reader of estimates. meaning: what it reads, for people. any_convention: whether the format leaves direction
    and axes of its poses open, so that a system has to say them where they are not camera-to-world and OpenCV's.
    reads_parts: whether it reads a part of a file that may be large, and takes `largest_bytes` of it.
    """

    name: str
    meaning: str
    read: Callable[..., Estimate]
    any_convention: bool = False
    reads_parts: bool = False


def _registry(*readers: Reader) -> dict[str, Reader]:
    return {reader.name: reader for reader in readers}


READERS: dict[str, Reader] = _registry(
    Reader("tum", "text: t tx ty tz qx qy qz qw", partial(stamped.read, format="tum"), any_convention=True),
    Reader("euroc", "table: t, x, y, z, qw, qx, qy, qz", partial(stamped.read, format="euroc"), any_convention=True),
    Reader(
        "kitti",
        "text: 12 numbers a frame, for every frame",
        partial(numbered.read, format="kitti"),
        any_convention=True,
    ),
    Reader(
        "replica",
        "text: 16 numbers a frame, for every frame",
        partial(numbered.read, format="replica"),
        any_convention=True,
    ),
    Reader(
        "matrices",
        "text: four lines of four numbers a frame, in a file or a folder",
        partial(numbered.read, format="matrices"),
        any_convention=True,
    ),
    Reader("log", "Open3D's .log", partial(numbered.read, format="log"), any_convention=True),
    Reader(
        "transforms",
        "nerfstudio's transforms.json, for every frame",
        partial(numbered.read, format="transforms"),
        any_convention=True,
    ),
    Reader("array", "numpy's .npy or .npz of N x 4 x 4", arrays.read, any_convention=True, reads_parts=True),
    Reader("colmap", "COLMAP's images.txt", colmap.read),
    Reader("vslamlab", "VSLAM-LAB's NNNNN_KeyFrameTrajectory.csv", vslamlab.read),
    Reader("splatam", "SplaTAM's params.npz", splatam.read, reads_parts=True),
)
"""Every reader by the name that a system's definition gives."""

TEXT_FORMATS: tuple[str, ...] = FORMATS
"""The formats of trajectories, of which `core.trajectories` can tell one by its content."""


def read_estimate(
    name: str,
    path: Path,
    index: Index,
    *,
    direction: Direction | None = None,
    axes: Axes | None = None,
    largest_bytes: int = LARGEST_READ_BYTES,
) -> Estimate:
    """Return what a system estimated, from the file or folder that it wrote.

    name: of the reader. index: the frames that the system was given. direction, axes: of the poses, where the format
    leaves them open (`Reader.any_convention`); None for camera-to-world and OpenCV's, or the format's own.
    largest_bytes: that are read of a file with more than poses in it (`Reader.reads_parts`).
    Frames that the system did not track are missing; a file without a pose is an estimate of none.
    Raises NotFiniteError where poses hold NaN or infinity, InputError, of which it is one, where the file is not what
    its reader reads, and ValueError for an unknown name or a convention that the reader does not take.
    """
    reader = READERS.get(name)
    if reader is None:
        raise ValueError(f"no reader is called {name!r}; known are {', '.join(READERS)}")
    given: dict[str, Any] = {"direction": direction, "axes": axes}
    chosen = {key: value for key, value in given.items() if value is not None}
    if chosen and not reader.any_convention:
        raise ValueError(f"the poses of {name} have one convention, so {' and '.join(chosen)} cannot be given")
    if reader.reads_parts:
        chosen["largest_bytes"] = largest_bytes
    return reader.read(path, index, **chosen)
