# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces whose planar depth is known in closed form, and meshes of them: a source independent of what is tested."""

import numpy as np

from noisy_world.core.geometry import Intrinsics
from noisy_world.scenes.polygon_mesh import Mesh

CAMERAS = {
    "replica": Intrinsics(1200, 680, 600.0, 600.0, 599.5, 339.5),
    "off centre": Intrinsics(640, 480, 525.0, 525.0, 250.25, 300.75),
    "fx above fy": Intrinsics(320, 240, 400.0, 250.0, 150.0, 130.0),
    "fx below fy, tall": Intrinsics(201, 333, 180.0, 260.0, 120.5, 140.0),
}


def look_at(eye, target, roll_deg=0.0):
    """Camera-to-world, OpenCV axes, by cross products; for a vertical view x stays x."""
    eye, target = np.asarray(eye, float), np.asarray(target, float)
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(x) < 1e-9 else x / np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    c2w = np.eye(4)
    c2w[:3, :3] = np.stack([c * x + s * y, -s * x + c * y, z], axis=1)
    c2w[:3, 3] = eye
    return c2w


def rays(camera, c2w):
    """World directions (H, W, 3) of the pixels' centres, with a component of 1 along the optical axis."""
    u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    local = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, np.ones(u.shape)], axis=-1)
    return local @ c2w[:3, :3].T


def interpolated(picture, width_px, height_px):
    """A picture (h, w, 3) laid once over an image, its texels interpolated; the picture repeats."""
    rows, columns = picture.shape[:2]
    x = (np.arange(width_px) + 0.5) * columns / width_px - 0.5
    y = (np.arange(height_px) + 0.5) * rows / height_px - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - column)[None, :, None], (y - row)[:, None, None]

    def texel(right, down):
        return picture[np.ix_((row + down) % rows, (column + right) % columns)].astype(float)

    upper = texel(0, 0) * (1 - fx) + texel(1, 0) * fx
    lower = texel(0, 1) * (1 - fx) + texel(1, 1) * fx
    return upper * (1 - fy) + lower * fy


def plane_depth(camera, c2w, point, normal):
    """Planar depth (H, W); infinite where the plane is behind or parallel."""
    with np.errstate(divide="ignore"):
        depth = ((point - c2w[:3, 3]) @ normal) / (rays(camera, c2w) @ normal)
    return np.where(depth > 0, depth, np.inf)


def box_depth(camera, c2w, low, high):
    """Planar depth (H, W) of a box from inside, and where it is sure: not within 2 px of an edge of the box."""
    direction = rays(camera, c2w)
    with np.errstate(divide="ignore"):
        bounds = np.where(direction > 0, high - c2w[:3, 3], low - c2w[:3, 3]) / direction
    bounds = np.where(direction == 0, np.inf, bounds)
    wall = bounds.argmin(axis=-1) + 3 * (np.take_along_axis(direction, bounds.argmin(-1)[..., None], -1)[..., 0] > 0)
    return bounds.min(axis=-1), _uniform(wall)


def sphere_depth(camera, c2w, centre, radius):
    """Planar depth (H, W) of a sphere from outside, and where the ray meets it at more than 11 degrees."""
    direction = rays(camera, c2w)
    offset = c2w[:3, 3] - centre
    a = (direction**2).sum(-1)
    b = direction @ offset
    c = offset @ offset - radius**2
    discriminant = b * b - a * c
    hit = discriminant > 0
    depth = np.where(hit, (-b - np.sqrt(np.where(hit, discriminant, 0))) / a, np.inf)
    normal = (offset + np.where(hit, depth, 0)[..., None] * direction) / radius
    cosine = np.abs((normal * direction).sum(-1)) / np.sqrt(a)
    return depth, hit & (cosine > 0.2)


def _uniform(labels):
    """Where a 5 x 5 neighbourhood holds one label."""
    padded = np.pad(labels, 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (5, 5))
    return (windows == labels[..., None, None]).all(axis=(-1, -2))


def quads_mesh(corners, rgb=None):
    """A mesh of separate quads: corners (F, 4, 3), rgb (F, 3) bytes or None."""
    corners = np.asarray(corners, dtype=np.float64)
    count = len(corners)
    colours = None if rgb is None else np.repeat(np.asarray(rgb, np.float32) / np.float32(255), 4, axis=0)
    return Mesh(
        corners.reshape(-1, 3),
        colours,
        np.arange(4 * count, dtype=np.int32),
        np.arange(0, 4 * count, 4, dtype=np.int32),
    )


def plane_mesh(point, normal, half_size_m):
    first = np.cross(normal, [0.3, 0.9, 0.2])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    signs = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    return quads_mesh([[point + half_size_m * (a * first + b * second) for a, b in signs]])


def box_mesh(low, high):
    x, y, z = np.stack([low, high], axis=1)
    walls = []
    for axis in range(3):
        for side in range(2):
            fixed = (x, y, z)[axis][side]
            free = [k for k in range(3) if k != axis]
            wall = np.empty((4, 3))
            wall[:, axis] = fixed
            wall[:, free[0]] = np.array((x, y, z)[free[0]])[[0, 1, 1, 0]]
            wall[:, free[1]] = np.array((x, y, z)[free[1]])[[0, 0, 1, 1]]
            walls.append(wall)
    return quads_mesh(walls)


def sphere_mesh(centre, radius, rings):
    """A sphere of latitude and longitude quads, fine enough that its flatness stays under the tolerance."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rings // 2 + 1)
    longitude = np.linspace(0, 2 * np.pi, rings + 1)
    a, b = np.meshgrid(latitude, longitude, indexing="ij")
    vertices = centre + radius * np.stack([np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a)], axis=-1)
    return grid_mesh(vertices)


def grid_mesh(vertices_m):
    """A mesh of the quads between neighbours of a grid of vertices (rows, columns, 3)."""
    index = np.arange(vertices_m.size // 3).reshape(vertices_m.shape[:2])
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    starts = np.arange(0, quads.size, 4, dtype=np.int32)
    return Mesh(vertices_m.reshape(-1, 3), None, quads.ravel().astype(np.int32), starts)


def dense_box(low, high):
    """A box's walls as scattered vertices, for checks that look at nothing else."""
    rng = np.random.default_rng(0)
    points = rng.uniform(low, high, (60_000, 3))
    axis, side = rng.integers(0, 3, len(points)), rng.integers(0, 2, len(points))
    points[np.arange(len(points)), axis] = np.where(side, np.asarray(high)[axis], np.asarray(low)[axis])
    corners = np.arange(len(points), dtype=np.int32)
    return Mesh(points, None, corners, corners[::3])
