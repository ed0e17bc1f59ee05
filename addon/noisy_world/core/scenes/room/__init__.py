# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo scene: a furnished living room as one mesh of quads with light and texture in its vertex colours."""

import numpy as np

from ..mesh import Mesh
from .decor import decor
from .furniture import furniture
from .light import lit
from .shell import INTERIOR_MAX_M, INTERIOR_MIN_M, LIGHTING, shell

__all__ = ["INTERIOR_MAX_M", "INTERIOR_MIN_M", "build_room"]


def build_room() -> Mesh:
    """The room, the same to the byte on every call.

    Metres, Z up, floor at z = 0. The room's inside is between INTERIOR_MIN_M and INTERIOR_MAX_M; the garden behind the
    windows lies outside of it. All faces are quads; colours are display-encoded multiples of 1/255.
    """
    piece = shell() + furniture() + decor()
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
        rgb=lit(piece, LIGHTING).astype(np.float32),
        corner_vertices=quads.ravel(),
        face_starts=np.arange(0, quads.size, 4, dtype=np.int32),
    )
