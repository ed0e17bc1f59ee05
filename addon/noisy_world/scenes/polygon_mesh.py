# SPDX-License-Identifier: GPL-3.0-or-later
"""A coloured polygon mesh as arrays, the objects that it shows, and the names of the embedded rooms."""

import fnmatch
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

OBJECT_ID = "object_id"  # the property of faces in Replica's mesh_semantic.ply
OBJECT_NAMES = "info_semantic.json"  # beside it
NEUTRAL_GREY = 128 / 255  # display-encoded colour of a mesh without colours; chosen


@dataclass(frozen=True)
class Texture:
    """Pictures, and where in them the corners of faces lie.

    names: of the pictures' files. pictures: each (H, W, 3) uint8, RGB, display-encoded (sRGB), the top row first.
    corner_uv: (C, 2) float32, to the right and up from a picture's bottom left corner; 1 is its whole width or height,
    and beyond [0, 1] it repeats. face_pictures: (F,) int32, the picture of each face; -1 where a face has none.
    """

    names: tuple[str, ...]
    pictures: tuple[NDArray[np.uint8], ...]
    corner_uv: NDArray[np.float32]
    face_pictures: NDArray[np.int32]


@dataclass(frozen=True)
class Mesh:
    """Polygons of any size, coloured at their vertices, at their corners or by a texture.

    vertices_m: (V, 3) float64, metres, Z up. Float64 so that a scene far from the origin can be moved without loss.
    rgb: (V, 3) float32 in [0, 1], display-encoded (sRGB), or None where vertices have no colours.
    corner_vertices: (C,) int32, the vertices of all faces, one face after another.
    face_starts: (F,) int32, where each face begins in corner_vertices; the first is 0.
    notes: what a user should know about how the file was read, one sentence each.
    corner_rgb: (C, 3) float32 as rgb, instead of it: equal at all corners of a face that has one colour.
    texture: what is shown instead of other colours, where a face has a picture.
    object_ids: (F,) int64, the object that each face belongs to, as the file numbers them; None where it does not.
    names_path: the file beside the mesh's that names these objects and their classes, where there is one.
    object_classes: number and name of the class of each object from 1 on, where the mesh knows them itself.
    """

    vertices_m: NDArray[np.float64]
    rgb: NDArray[np.float32] | None
    corner_vertices: NDArray[np.int32]
    face_starts: NDArray[np.int32]
    notes: tuple[str, ...] = ()
    corner_rgb: NDArray[np.float32] | None = None
    texture: Texture | None = None
    object_ids: NDArray[np.int64] | None = None
    names_path: Path | None = None
    object_classes: tuple[tuple[int, str], ...] = ()

    @property
    def face_sizes(self) -> NDArray[np.int32]:
        """(F,) int32: the number of corners of each face."""
        return np.diff(self.face_starts, append=np.int32(len(self.corner_vertices))).astype(np.int32)


# Turns meshes whose files have another axis up, as Blender's importers do, and back.


Up: TypeAlias = Literal["y", "z"]
"""The axis of a mesh's file that points up."""


def turned(mesh: Mesh, stands: Up, asked: Up) -> Mesh:
    """Return a mesh as it stands where another axis of its file is taken for up; Z is up then, whichever it was.

    stands: the axis that was taken for up. Y up becomes (x, -z, y).
    """
    if stands == asked:
        return mesh
    x, y, z = mesh.vertices_m.T
    return replace(mesh, vertices_m=np.stack([x, -z, y] if asked == "y" else [x, z, -y], axis=1) + 0.0)


# The objects of a scene in Blender, as plain data.


@dataclass(frozen=True)
class SceneObject:
    """An object of a scene in Blender: its number, its name, and the pass index that the artist gave it.

    category: its class of things, "" without one.
    """

    number: int
    name: str
    pass_index: int
    category: str = ""


# The names of the embedded rooms: `embedded:room`, and `embedded:room?seed=0` to 7, the first of which is the same.


EMBEDDED_ROOM = "embedded:room"
ROOMS = 8
MEANT = f"did you mean {EMBEDDED_ROOM!r}, or {EMBEDDED_ROOM}?seed=0 to {ROOMS - 1}?"  # the remedy for another name


def is_embedded(mesh: str | None) -> bool:
    """Return whether a preset's mesh is one that comes with Noisy World, or is meant to be."""
    return mesh is not None and mesh.startswith("embedded:")


def room_mesh(seed: int) -> str:
    """Return what a preset says for the room of a seed; room 0 is the plain name."""
    return f"{EMBEDDED_ROOM}?seed={seed}" if seed else EMBEDDED_ROOM


def room_name(mesh: str, seed: int) -> str:
    """Return the name of a scene that has none of its own: room for the plain name, else room and the seed."""
    return "room" if mesh == EMBEDDED_ROOM else f"room{seed}"


def room_seeds(mesh: str) -> list[int]:
    """Return the seeds that a preset's mesh stands for: one, or as many as its wildcards (* and [1-3]) match.

    Raises ValueError where it stands for none.
    """
    if mesh == EMBEDDED_ROOM:
        return [0]
    found = re.fullmatch(re.escape(EMBEDDED_ROOM) + r"\?seed=(.+)", mesh)
    if found is None:
        raise ValueError(f"there is no {mesh!r}")
    seeds = [k for k in range(ROOMS) if fnmatch.fnmatchcase(str(k), found[1])]
    if not seeds:
        raise ValueError(f"there is no {mesh!r}")
    return seeds
