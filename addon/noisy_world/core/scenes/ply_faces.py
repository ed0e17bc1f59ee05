# SPDX-License-Identifier: GPL-3.0-or-later
"""The faces of a PLY file: which vertices are their corners, and which of the file's corners and faces are kept."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .ply_file import DAMAGED, Rows

INDEX_NAMES = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class Faces:
    """Faces of three or more corners, none repeated in succession.

    corners: (C,) int32, and starts: (F,) int32, as a Mesh has them. stored_sizes: the number of corners of each face in
    the file. kept_corners, kept_faces: which of the file's corners and faces these are; None where all.
    """

    corners: NDArray[np.int32]
    starts: NDArray[np.int32]
    stored_sizes: NDArray[np.int64]
    kept_corners: NDArray[np.bool_] | None
    kept_faces: NDArray[np.bool_] | None

    def of_corners(self, values: NDArray) -> NDArray:
        """Return the kept rows of what the file has for each corner."""
        return values if self.kept_corners is None else values[self.kept_corners]

    def of_faces(self, values: NDArray) -> NDArray:
        """Return the kept rows of what the file has for each face."""
        return values if self.kept_faces is None else values[self.kept_faces]

    def at_corners(self, values: NDArray) -> NDArray:
        """Return what the file has for each face at each of the face's kept corners."""
        return self.of_corners(np.repeat(values, self.stored_sizes, axis=0))


def read_faces(rows: Rows, vertex_count: int, notes: list[str]) -> Faces:
    """Return the faces. Raises InputError where an index names no vertex, or no face is left."""
    name = next(name for name in INDEX_NAMES if name in rows.element.lists)
    values, sizes = rows.values(name), np.broadcast_to(rows.counts(name), rows.element.rows)
    corners = values.astype(np.int32)
    bad = np.flatnonzero((values < 0) | (values >= vertex_count) | (values != corners))  # the last finds fractions
    if len(bad):
        where = f"face {np.searchsorted(np.cumsum(sizes), bad[0], side='right')}"
        problem = f"vertex index {values[bad[0]]:.15g} is none of the {vertex_count} vertices, {len(bad)} such in all"
        raise InputError(rows.body.path, problem, where=where, remedy=DAMAGED)
    stored_sizes, kept, kept_corners = sizes, None, None
    ends, following = np.cumsum(sizes), np.roll(corners, -1)
    following[ends[sizes > 0] - 1] = corners[
        (ends - sizes)[sizes > 0]
    ]  # what follows a face's last corner is its first
    repeated = corners == following
    if repeated.any() or sizes.min() < 3:
        repeats = np.bincount(np.repeat(np.arange(len(sizes)), sizes)[repeated], minlength=len(sizes))
        kept = sizes - repeats >= 3
        if np.any(kept & (repeats > 0)):
            notes.append(f"{np.count_nonzero(kept & (repeats > 0))} faces repeated a corner: the repeats were removed")
        if not kept.all():
            notes.append(f"{np.count_nonzero(~kept)} faces had fewer than 3 different corners: dropped")
        kept_corners = ~repeated & np.repeat(kept, sizes)
        corners, sizes = corners[kept_corners], (sizes - repeats)[kept]
    if len(sizes) == 0:
        raise InputError(rows.body.path, "no face has three different corners", remedy=DAMAGED)
    return Faces(corners, (np.cumsum(sizes) - sizes).astype(np.int32), stored_sizes, kept_corners, kept)
