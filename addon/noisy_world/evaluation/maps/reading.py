# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads what a user names for a map's score: meshes and sequences."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.geometry import Intrinsics
from ...core.scenes.embedded import MEANT, is_embedded, room_seeds
from ...core.scenes.mesh import Mesh
from ...recipes.opened import Frame
from ...recipes.opening import open_path
from ...rooms import build_room
from ...sources.mesh_reading import read_mesh

MAP = "map.ply"
"""The file of a run's folder that holds its map."""


@dataclass(frozen=True)
class SequenceToMap:
    """A sequence's folder, its frames, in order, and their camera."""

    folder: Path
    frames: list[Frame]
    camera: Intrinsics

    @property
    def c2w(self) -> NDArray[np.float64]:
        """The true poses (N, 4, 4)."""
        return np.array([frame.c2w for frame in self.frames])


def read_scene(name: str) -> Mesh:
    """Read a mesh of any format, or build an embedded room. Raises InputError for anything else."""
    if not is_embedded(name):
        return read_mesh(Path(name))
    try:
        seeds = room_seeds(name)
    except ValueError as error:
        raise InputError(name, str(error), remedy=MEANT) from error
    if len(seeds) != 1:
        raise InputError(name, f"is {len(seeds)} rooms", remedy="name one of them")
    return build_room(seeds[0])


def read_sequence(folder: Path, camera: Intrinsics | None = None) -> SequenceToMap:
    """Open the sequence of a folder. camera: where its files say none.

    Raises InputError where it holds none or several, where its intrinsics are not known, and where its lens distorts.
    """
    opened = open_path(folder)
    names = list(opened)
    if len(names) != 1:
        some = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
        raise InputError(folder, f"holds {len(names)} sequences: {some}", remedy="name the folder of one")
    sequence = opened[names[0]]
    known = sequence.camera if camera is None else camera
    if known is None:
        raise InputError(folder, "no file says its camera's intrinsics", remedy="give --camera W,H,FX,FY,CX,CY")
    if sequence.distortion is not None:
        remedy = "make a dataset of it first, with undistort: true for the scene"
        raise InputError(folder, "its lens distorts, and maps are fused and rendered by a pinhole", remedy=remedy)
    frames = list(sequence)
    if not frames:
        raise InputError(folder, "holds no frame")
    return SequenceToMap(folder, frames, known)
