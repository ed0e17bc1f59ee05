# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes that no scanner makes, from a seed: soups, slivers, wrong units, far offsets, floors far below."""

import numpy as np

from noisy_world.scenes.polygon_mesh import Mesh

KINDS = ("soup", "slivers", "single", "room", "offset", "degenerate", "far_floor", "sheets", "dust")
_BOX = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def odd_mesh(seed: int) -> Mesh:
    """Return a mesh whose kind and numbers all follow from the seed."""
    rng = np.random.default_rng([seed, 20])
    vertices_m, faces = _KINDS[KINDS[seed % len(KINDS)]](rng)
    if rng.random() < 0.3:  # wrong units, along all axes or along each its own
        vertices_m = vertices_m * 10.0 ** rng.uniform(-6, 6, rng.choice([1, 3]))
    if rng.random() < 0.2:
        vertices_m = vertices_m @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    starts = np.arange(len(faces), dtype=np.int32) * faces.shape[1]
    return Mesh(vertices_m, None, faces.astype(np.int32).ravel(), starts)


def _soup(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    count = int(10.0 ** rng.uniform(0, 3.3))
    middles = rng.uniform(-0.5, 0.5, (count, 1, 3)) * 10.0 ** rng.uniform(-1, 2.5, 3)
    return _triangles(middles + rng.normal(size=(count, 3, 3)) * 10.0 ** rng.uniform(-2, 2, (count, 1, 1)))


def _slivers(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    count = int(10.0 ** rng.uniform(0, 3))
    ends = rng.uniform(-0.5, 0.5, (count, 2, 3)) * 10.0 ** rng.uniform(0, 4)
    third = ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * rng.uniform(size=(count, 1, 1))
    return _triangles(np.concatenate([ends, third + rng.normal(size=third.shape) * 1e-6], axis=1))


def _single(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return _triangles(rng.normal(size=(1, 3, 3)) * 10.0 ** rng.uniform(-3, 5, 3))


def _room(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    boxes = [(np.zeros(3), rng.uniform([2, 2, 2], [60, 60, 4]))]
    for _ in range(int(rng.integers(0, 40))):
        low = rng.uniform(size=3) * boxes[0][1]
        boxes.append((low, low + rng.uniform(0.02, 2.0, 3)))
    corners = [[[x, y, z] for x in (a[0], b[0]) for y in (a[1], b[1]) for z in (a[2], b[2])] for a, b in boxes]
    return np.reshape(corners, (-1, 3)), np.concatenate([_BOX + 8 * i for i in range(len(boxes))])


def _offset(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    vertices_m, faces = _room(rng)
    return vertices_m + rng.choice([-1.0, 1.0], 3) * 10.0 ** rng.uniform(0, 18, 3), faces


def _degenerate(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    vertices_m, faces = _room(rng)
    faces = rng.integers(0, len(vertices_m), faces.shape) if rng.random() < 0.5 else faces
    vertices_m[:, rng.integers(0, 3)] *= rng.choice([0.0, 1e-9, 1.0])
    return vertices_m, np.concatenate([faces, np.repeat(faces[:, :1], faces.shape[1], axis=1)])


def _far_floor(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A room, and wide levels and single points far below or above it."""
    vertices_m, faces = _room(rng)
    moved = vertices_m[:8].copy()
    moved[:, 2] = moved[:, 2] * rng.choice([0.0, 1.0]) - rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(0, 5)
    joined = np.concatenate([vertices_m, moved, vertices_m[:1] - [0, 0, 10.0 ** rng.uniform(0, 6)]])
    walls = np.concatenate([_BOX[2:] % 8, _BOX[:2] % 8]) + len(vertices_m)
    tall = np.array([[0, 1, len(joined) - 1, len(joined) - 1]])
    return joined, np.concatenate([faces, walls, tall] if rng.random() < 0.5 else [faces, walls])


def _sheets(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Level rectangles at random, side by side and corner to corner: many small islands of floor."""
    count = int(rng.integers(1, 400))
    low = np.round(rng.uniform(0, 10.0 ** rng.uniform(0.5, 2), (count, 2)), 1)
    high = low + np.round(rng.uniform(0.1, 3.0, (count, 2)), 1)
    z = rng.choice([0.0, 0.0, 0.0, 2.6, -30.0], count)
    corners = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high, np.stack([low[:, 0], high[:, 1]], 1)], axis=1)
    vertices_m = np.concatenate([corners, np.broadcast_to(z[:, None, None], (count, 4, 1))], axis=2).reshape(-1, 3)
    return vertices_m, np.arange(4 * count).reshape(-1, 4)


def _dust(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    count = int(10.0 ** rng.uniform(0, 5))
    vertices_m = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-3, 2, 3)
    return vertices_m, np.zeros((0, 3), dtype=np.int64)


def _triangles(corners_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return corners_m.reshape(-1, 3), np.arange(3 * len(corners_m)).reshape(-1, 3)


_KINDS = {
    "soup": _soup, "slivers": _slivers, "single": _single, "room": _room, "offset": _offset,
    "degenerate": _degenerate, "far_floor": _far_floor, "sheets": _sheets, "dust": _dust,
}  # fmt: skip
