# SPDX-License-Identifier: GPL-3.0-or-later
"""The map of a run: the mesh that the system wrote, or its input frames fused along its poses."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..dataset.loader import Frame
from ..dataset.opening import open_path
from ..rooms import kept_room
from ..scenes.ply import read_ply
from ..scenes.polygon_mesh import MEANT, Mesh, is_embedded, room_seeds
from ..sources.rendered_mesh import read_mesh
from .cases import MAP
from .estimates import MAX_DIFFERENCE_S, Estimate, associate_poses
from .map_fusion import VOXEL_M, Fused, fuse
from .map_metrics import moved
from .pose_errors import Similarity, aligned_poses

# Reads what a user names for a map's score: meshes and sequences.


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
    return kept_room(seeds[0])


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


MOST_CORNERS = 64
"""Of a face of a map that a system wrote. Chosen: systems write triangles and quads."""


@dataclass(frozen=True)
class RunMap:
    """A run's map in the true world. mesh: None where there is none; problem: why, "" where a frame saw nothing.

    origin: who made it, the system or we; "" where there is none.
    """

    mesh: Mesh | None
    origin: Literal["system", "fused", ""] = ""
    problem: str = ""


def map_of_run(
    folder: Path,
    estimate: Estimate,
    by: Similarity | None,
    frames: Sequence,
    camera: Intrinsics,
) -> RunMap:
    """Return the map of the run in a folder, moved as its path is: map.ply where it is there, else one that is fused.

    by: the alignment of the path, None where the run failed, which has no map then. A map.ply that cannot be read is a
    result: no map, and what is wrong with the file.
    """
    if by is None:
        return RunMap(None, problem="the path cannot be aligned")
    if (folder / MAP).exists():
        try:
            mesh = read_ply(folder / MAP)
            _check_faces(mesh, folder / MAP)
            return RunMap(moved(mesh, by.matrix), "system")
        except InputError as error:
            return RunMap(None, problem=str(error))
    mesh = fuse_along(estimate, frames, camera, by=by).mesh
    return RunMap(mesh, "" if mesh is None else "fused")


def _check_faces(mesh: Mesh, path: Path) -> None:
    """Refuse a map with faces of many corners: to split one takes the cube of their number."""
    most = int(mesh.face_sizes.max(initial=0))
    if most > MOST_CORNERS:
        problem = f"has a face of {most} corners, and those of a system's map have {MOST_CORNERS} at most"
        raise InputError(path, problem, remedy="split it into triangles")


def fuse_along(
    estimate: Estimate,
    frames: Sequence,
    camera: Intrinsics,
    *,
    by: Similarity | None = None,
    voxel_m: float = VOXEL_M,
) -> Fused:
    """Fuse the frames that have an estimated pose, as stamps say; images of the others are not read.

    frames: as they were given to the system, with stamp_s, rgb and depth_m. by: the alignment of the estimate; the map
    then lies in the true world, with the frames' own scale, also where the estimate has another.
    """
    stamps_s = np.array([frame.stamp_s for frame in frames])
    rows, of_frames = associate_poses(estimate.stamps_s, stamps_s, MAX_DIFFERENCE_S)
    c2w = estimate.c2w[rows] if by is None else aligned_poses(estimate.c2w[rows], by)
    poses = dict(zip(of_frames.tolist(), c2w, strict=True))
    every = (poses.get(index) for index in range(len(frames)))
    return fuse(frames, every, camera, voxel_m=voxel_m)
