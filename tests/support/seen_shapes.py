# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth images of shapes in closed form, and the views from which they are seen."""

from dataclasses import dataclass

import numpy as np

from noisy_world.core.geometry import Intrinsics, pose
from noisy_world.scenes.polygon_mesh import Mesh

CAMERA = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)


@dataclass(frozen=True)
class View:
    """A frame that was calculated."""

    rgb: np.ndarray
    depth_m: np.ndarray
    c2w: np.ndarray


def looking(from_m, at_m=(0.0, 0.0, 0.0)):
    """The pose of a camera at a point that looks at another; its x is as level as it can be."""
    forward = np.subtract(at_m, from_m) / np.linalg.norm(np.subtract(at_m, from_m))
    up = (0, 0, 1) if abs(forward[2]) < 0.9 else (0, 1, 0)
    right = np.cross(forward, up)
    right = right / np.linalg.norm(right)
    return pose(np.stack([right, np.cross(forward, right), forward], axis=1), np.asarray(from_m, float))


def sphere_view(c2w, radius_m, centre_m=(0.0, 0.0, 0.0), camera=CAMERA):
    """A sphere seen from outside or inside; its colour at a point is the direction there, half grey in between."""
    rays = camera.ray_directions() @ c2w[:3, :3].T
    to_centre = c2w[:3, 3] - np.asarray(centre_m)
    a, b = (rays**2).sum(-1), (rays @ to_centre) * 2
    c = to_centre @ to_centre - radius_m**2
    root = np.sqrt(np.maximum(b * b - 4 * a * c, 0))
    near, far = (-b - root) / (2 * a), (-b + root) / (2 * a)
    depth = np.where(b * b < 4 * a * c, 0, np.where(near > 0, near, np.maximum(far, 0)))
    normal = (to_centre + rays * depth[..., None]) / radius_m
    rgb = np.where(depth[..., None] > 0, np.rint(127.5 + 100 * normal), 0).astype(np.uint8)
    return View(rgb, depth.astype(np.float32), c2w)


def around(distance_m, centre_m=(0.0, 0.0, 0.0)):
    """Poses on the corners and faces of a cube around a point, looking at it."""
    directions = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1.0
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return [looking(np.asarray(centre_m) + distance_m * d, centre_m) for d in directions]


def sphere_mesh(radius_m, parts=64, centre_m=(0.0, 0.0, 0.0)):
    """A sphere as triangles between circles of latitude."""
    turn = np.linspace(0, 2 * np.pi, 2 * parts, endpoint=False)
    down = np.linspace(0, np.pi, parts + 1)
    rows = np.stack([np.outer(np.sin(down), np.cos(turn)), np.outer(np.sin(down), np.sin(turn))], axis=-1)
    points = np.concatenate([rows, np.broadcast_to(np.cos(down)[:, None, None], (*rows.shape[:2], 1))], axis=-1)
    at = np.arange(points.size // 3).reshape(rows.shape[:2])
    after = np.roll(at, -1, axis=1)
    quads = np.stack([at[:-1], at[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return triangle_mesh(radius_m * points.reshape(-1, 3) + np.asarray(centre_m), triangles)


def wall(x_m, width_m=2.0, rgb=None, steps=1):
    """A square wall across the x axis, around it, of squares with two triangles each."""
    side = np.linspace(-width_m / 2, width_m / 2, steps + 1)
    y, z = np.meshgrid(side, side, indexing="ij")
    at = np.arange(y.size).reshape(y.shape)
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return triangle_mesh(np.stack([np.full(y.size, x_m), y.ravel(), z.ravel()], axis=1), triangles, rgb)


def triangle_mesh(vertices_m, triangles, rgb=None):
    """A mesh of triangles, of one colour where one is given."""
    colours = None if rgb is None else np.tile(np.float32(rgb) / np.float32(255), (len(vertices_m), 1))
    corners = np.asarray(triangles, dtype=np.int32).reshape(-1)
    return Mesh(np.asarray(vertices_m, float), colours, corners, np.arange(0, len(corners), 3, dtype=np.int32))


def together(*meshes):
    """Several meshes of triangles as one, without colours."""
    firsts = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes)])
    triangles = [mesh.corner_vertices + first for mesh, first in zip(meshes, firsts, strict=False)]
    return triangle_mesh(np.concatenate([mesh.vertices_m for mesh in meshes]), np.concatenate(triangles))
