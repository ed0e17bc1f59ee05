# SPDX-License-Identifier: GPL-3.0-or-later
"""The surface in a volume of signed distances, by surface nets (Gibson 1998).

A cell lies between eight voxels' centres. Where their signs differ it has a vertex, in the middle of the points at
which its edges meet the surface; each such edge gives a quad of the four cells around it.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...core.scenes.mesh import NEUTRAL_GREY, Mesh
from .blocks import BLOCK, Blocks, Keys, find, keys_of, places_of

_AT_ONCE = 1024  # blocks, whose arrays with their neighbours' first layers take 60 MB
_CORNERS = tuple(product((0, 1), repeat=3))
_EDGES = tuple((corner, axis) for axis in range(3) for corner in _CORNERS if corner[axis] == 0)

SDF, WEIGHT, COLOUR_WEIGHT, RED = range(4)
"""Planes of a voxel: distance in metres, the weights of the distance and of the colour, and three of colour."""


def surface_of(blocks: Blocks, voxel_m: float, origin_m: NDArray[np.float64]) -> Mesh | None:
    """Return the surface as quads that face where the distance is positive; None where there is none.

    Planes of the voxels: distance, its weight, the colour's weight, colours of 0 to 255. origin_m: (3,), the corner of
    block (0, 0, 0). Only cells of which all eight voxels were seen have a vertex. Colours are left out where no vertex
    has one; a vertex without one is grey.
    """
    cells, points, colours, edges = [], [], [], []
    for first in range(0, len(blocks), _AT_ONCE):
        keys = blocks.keys[first : first + _AT_ONCE]
        grid = _with_neighbours(blocks, keys)
        origins = places_of(keys) * BLOCK
        where, at, colour = _vertices(grid)
        cells.append(keys_of(origins[where[0]] + np.stack(where[1:], axis=1)))
        points.append((origins[where[0]] + np.stack(where[1:], axis=1) + at + 0.5) * voxel_m + origin_m)
        colours.append(colour)
        edges.append(_crossed(grid, origins))
    if not cells:
        return None
    all_cells = np.concatenate(cells)
    order = np.argsort(all_cells)
    quads = _quads(all_cells[order], np.concatenate(edges))
    used, corners = np.unique(quads, return_inverse=True)
    if not len(used):
        return None
    kept = order[used]
    rgb = np.concatenate(colours)[kept]
    coloured = rgb[:, 0] >= 0
    return Mesh(
        np.concatenate(points)[kept],
        np.where(coloured[:, None], rgb / np.float32(255), np.float32(NEUTRAL_GREY)) if coloured.any() else None,
        corners.reshape(-1).astype(np.int32),
        np.arange(0, 4 * len(quads), 4, dtype=np.int32),
    )


def _with_neighbours(blocks: Blocks, keys: Keys) -> NDArray[np.float32]:
    """Return blocks' voxels (planes, N, 9, 9, 9) with the first layers of the blocks after them, zeros without one."""
    planes = len(blocks.voxels)
    grid = np.zeros((planes, len(keys), *[BLOCK + 1] * 3), dtype=np.float32)
    voxels = blocks.voxels.reshape(planes, -1, BLOCK, BLOCK, BLOCK)
    places = places_of(keys)
    for side in _CORNERS:
        slots = blocks.slots(keys_of(places + side))
        there = np.flatnonzero(slots >= 0)
        target = tuple(slice(BLOCK, None) if s else slice(0, BLOCK) for s in side)
        origin = tuple(slice(0, 1) if s else slice(0, BLOCK) for s in side)
        grid[(slice(None), there, *target)] = voxels[(slice(None), slots[there], *origin)]
    return grid


def _vertices(
    grid: NDArray[np.float32],
) -> tuple[tuple[NDArray[np.intp], ...], NDArray[np.float32], NDArray[np.float32]]:
    """Return cells with a vertex (block, i, j, k), where in them it is (N, 3), and colours (N, 3), -1 without one."""
    known, inside = grid[WEIGHT] > 0, grid[SDF] < 0
    count = np.zeros((grid.shape[1], BLOCK, BLOCK, BLOCK), dtype=np.int8)
    whole = np.ones(count.shape, dtype=bool)
    for corner in _CORNERS:
        part = (slice(None), *(slice(c, c + BLOCK) for c in corner))
        count += inside[part]
        whole &= known[part]
    where = np.nonzero(whole & (count > 0) & (count < 8))
    block, *cell = where
    place = np.zeros((3, len(block)), dtype=np.float32)
    colour = np.zeros_like(place)
    crossings, coloured = np.zeros((2, len(block)), dtype=np.float32)
    for corner, axis in _EDGES:
        start = [c + offset for c, offset in zip(cell, corner, strict=True)]
        end = [c + (a == axis) for a, c in enumerate(start)]
        here, there = grid[(SDF, block, *start)], grid[(SDF, block, *end)]
        rows = np.flatnonzero((here < 0) != (there < 0))
        share = here[rows] / (here[rows] - there[rows])
        crossings[rows] += 1
        for a in range(3):
            place[a, rows] += share if a == axis else corner[a]
        for ends, part in ((start, 1 - share), (end, share)):
            at = (block[rows], *(e[rows] for e in ends))
            weight = (part + np.float32(1e-3)) * (grid[(COLOUR_WEIGHT, *at)] > 0)
            coloured[rows] += weight
            for channel in range(3):
                colour[channel, rows] += weight * grid[(RED + channel, *at)]
    colour = np.where(coloured > 0, colour / np.where(coloured > 0, coloured, 1), -1)
    return where, (place / crossings).T, colour.astype(np.float32).T


def _crossed(grid: NDArray[np.float32], origins: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the edges of voxels that meet the surface (N, 5): voxel, axis, and whether the distance falls along it."""
    inside, known = grid[SDF] < 0, grid[WEIGHT] > 0
    first = (slice(None), *[slice(0, BLOCK)] * 3)
    found = []
    for axis in range(3):
        last = tuple(slice(1, None) if a == axis else slice(0, BLOCK) for a in range(3))
        last = (slice(None), *last)
        block, *place = np.nonzero((inside[first] != inside[last]) & known[first] & known[last])
        falls = inside[last][(block, *place)]
        rows = origins[block] + np.stack(place, axis=1)
        found.append(np.column_stack([rows, np.full(len(rows), axis), falls]))
    return np.concatenate(found)


def _quads(cells: Keys, edges: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return quads (Q, 4) of places in sorted cells: for each edge the four cells around it, if all have a vertex."""
    quads = []
    for axis in range(3):
        rows = edges[edges[:, 3] == axis]
        second, third = np.eye(3, dtype=np.int64)[[(axis + 1) % 3, (axis + 2) % 3]]
        # Around an edge, as seen from its end, counter-clockwise.
        around = [rows[:, :3] - second - third, rows[:, :3] - third, rows[:, :3], rows[:, :3] - second]
        corners = np.stack([find(cells, keys_of(places)) for places in around], axis=1)
        turned = np.where(rows[:, 4:] == 1, corners[:, ::-1], corners)
        quads.append(turned[(corners >= 0).all(axis=1)])
    return np.concatenate(quads)
