# SPDX-License-Identifier: GPL-3.0-or-later
"""What a pose sees of the surface of a mesh, by an engine, and the same in closed form."""

from dataclasses import replace

import numpy as np
from analytic import box_depth, box_mesh, look_at, plane_mesh, rays, sphere_depth
from ray_tools import OPTIONS

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.scenes.mesh import Mesh
from noisy_world.core.trajectories.sensor_paths import SensorPaths
from noisy_world.core.trajectories.trajectory import evenly_stamped
from noisy_world.sources.rendering import open_session

CAMERA = Intrinsics(120, 80, 78.0, 60.0, 57.5, 41.5)


def seen(engine, mesh, c2w, camera=CAMERA, **options):
    """A frame of a mesh from a pose (4, 4), by a session of an engine."""
    paths = SensorPaths(evenly_stamped(np.asarray(c2w)[None]))
    with open_session(mesh, "test", paths, camera, replace(OPTIONS, engine=engine, **options)) as session:
        return session.frame(paths.request(0))


def plane():
    """A slanted plane that fills the image: its mesh, the pose, the camera, normals (H, W, 3), and where these hold."""
    view = look_at([0.2, -0.1, 0.3], [1.0, 0.4, 0.2], roll_deg=25)
    normal = np.array([0.5, 0.3, -0.8]) / np.linalg.norm([0.5, 0.3, -0.8])
    mesh = plane_mesh(view[:3, 3] + 2.5 * view[:3, 2], view[:3, :3] @ normal, half_size_m=60)
    shape = (CAMERA.height_px, CAMERA.width_px)
    ray = rays(CAMERA, np.eye(4))
    sure = (ray @ normal < -0.05) & (2.5 * normal[2] / (ray @ normal) < 40)
    return mesh, view, CAMERA, np.broadcast_to(normal, (*shape, 3)), sure


def box():
    """A room far from the origin from inside, likewise: the walls' normals point at the camera."""
    view = look_at([90.3, -0.7, 0.9], [91.0, 1.0, 0.4], roll_deg=-10)
    low, high = view[:3, 3] - [1.0, 2.5, 1.5], view[:3, 3] + [4.0, 3.0, 2.2]
    _, sure = box_depth(CAMERA, view, low, high)
    direction = rays(CAMERA, view)
    bounds = np.where(direction > 0, high - view[:3, 3], low - view[:3, 3]) / direction
    axis = bounds.argmin(axis=-1)[..., None]
    world = np.zeros_like(direction)
    np.put_along_axis(world, axis, -np.sign(np.take_along_axis(direction, axis, -1)), -1)
    return box_mesh(low, high), view, CAMERA, world @ view[:3, :3], sure


def sphere():
    """The cap of a sphere, likewise, in facets that turn by less than 1e-4 from one to the next.

    It passes through the origin, where float32 holds the corners of facets so small.
    """
    radius, camera = 4.0, Intrinsics(120, 80, 600.0, 600.0, 59.5, 39.5)
    view = look_at([-0.3, 0.02, 0.01], [0.0, 0.0, 0.0], roll_deg=40)
    angle = np.linspace(-0.0095, 0.0095, 240)
    a, b = np.meshgrid(angle, angle, indexing="ij")
    up, right = np.sin(a), np.cos(a) * np.sin(b)
    # Not 1 - cos: that would lose the digits that the facets' directions are made of.
    inward = 2 * np.sin(a / 2) ** 2 + np.cos(a) * 2 * np.sin(b / 2) ** 2
    index = np.arange(a.size).reshape(a.shape)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    mesh = Mesh(
        radius * np.stack([inward, right, up], axis=-1).reshape(-1, 3),
        None,
        quads.ravel().astype(np.int32),
        np.arange(0, quads.size, 4, dtype=np.int32),
    )
    centre = np.array([radius, 0.0, 0.0])
    depth, hit = sphere_depth(camera, view, centre, radius)
    points = view[:3, 3] + np.where(hit, depth, 0)[..., None] * rays(camera, view)
    sure = hit & (np.abs(points[..., 1:]) < 0.037).all(axis=-1)
    return mesh, view, camera, (points - centre) / radius @ view[:3, :3], sure


SURFACES = (plane, box, sphere)


def worst_normal(engine, made, **options):
    """How far normals are from those in closed form, at most, and what was rendered."""
    mesh, view, camera, expected, sure = made()
    assert sure.sum() > 0.3 * sure.size, "the test sees too little"
    frame = seen(engine, mesh, view, camera, **options)
    return np.abs(frame.image("normal") - expected)[sure].max(), frame
