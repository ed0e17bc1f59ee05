# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded rooms: furnished scenes as one mesh of quads with light and texture in its vertex colours."""

from collections.abc import Callable

import numpy as np

from ..scenes.polygon_mesh import Mesh
from .bedroom import bedroom
from .corridor import corridor
from .furniture import furniture
from .l_shape import l_shape
from .light import Lighting, lit
from .living_room import INTERIOR_MAX_M, INTERIOR_MIN_M, LIGHTING, decor, shell
from .meeting_room import meeting_room
from .open_office import open_office
from .small_office import small_office
from .surfaces import Piece
from .two_rooms import two_rooms

__all__ = ["INTERIOR_MAX_M", "INTERIOR_MIN_M", "build_room"]


def _living_room() -> tuple[Piece, Lighting]:
    return shell() + furniture() + decor(), LIGHTING


_ROOMS: tuple[Callable[[], tuple[Piece, Lighting]], ...] = (
    _living_room,
    bedroom,
    l_shape,
    corridor,
    two_rooms,
    open_office,
    small_office,
    meeting_room,
)


def build_room(seed: int = 0) -> Mesh:
    """The room of a seed, the same to the byte on every call.

    Metres, Z up, floor at z = 0. Room 0's inside is between INTERIOR_MIN_M and INTERIOR_MAX_M; what is seen through
    windows lies outside of the rooms. All faces are quads; colours are display-encoded multiples of 1/255. Raises
    ValueError for a seed that has no room.
    """
    if not 0 <= seed < len(_ROOMS):
        raise ValueError(f"there are rooms 0 to {len(_ROOMS) - 1}, not {seed}")
    piece, lighting = _ROOMS[seed]()
    vertices = [s.points_m.reshape(-1, 3) for s in piece.sheets]
    corners: list[np.ndarray] = []
    first = 0
    for s in piece.sheets:
        rows, columns = s.points_m.shape[:2]
        at = first + (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        corners.append(np.stack([at, at + 1, at + columns + 1, at + columns], -1).astype(np.int32))
        first += rows * columns
    quads = np.concatenate(corners)
    return Mesh(
        # Rounded to micrometres, as the last bits of a sine differ between processors.
        vertices_m=np.concatenate(vertices, dtype=np.float64).round(6) + 0.0,
        rgb=lit(piece, lighting).astype(np.float32),
        corner_vertices=quads.ravel(),
        face_starts=np.arange(0, quads.size, 4, dtype=np.int32),
    )
