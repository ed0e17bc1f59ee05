# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth images of shapes in closed form, and the views from which they are seen."""

from dataclasses import dataclass

import numpy as np

from noisy_world.core.geometry import Intrinsics, pose

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
