# SPDX-License-Identifier: GPL-3.0-or-later
"""What a pose sees of the surface of a mesh, by an engine, and the same in closed form."""

from dataclasses import replace

import numpy as np
from analytic import box_depth, box_mesh, grid_mesh, look_at, plane_mesh, quads_mesh, rays, sphere_depth
from ray_tools import OPTIONS

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.sources.renderers import open_session

CAMERA = Intrinsics(120, 80, 78.0, 60.0, 57.5, 41.5)


def seen(engine, mesh, c2w, camera=CAMERA, **options):
    """A frame of a mesh from a pose (4, 4), by a session of an engine."""
    paths = SensorPaths(evenly_stamped(np.asarray(c2w)[None]))
    with open_session(mesh, "test", paths, camera, replace(OPTIONS, engine=engine, **options)) as session:
        return session.frame(paths.request(0))


def along(engine, mesh, views, **options):
    """The frames of a mesh from poses (N, 4, 4), one after another."""
    paths = SensorPaths(evenly_stamped(np.asarray(views)))
    with open_session(mesh, "test", paths, CAMERA, replace(OPTIONS, engine=engine, **options)) as session:
        return [session.frame(paths.request(index)) for index in range(len(views))]


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
    mesh = grid_mesh(radius * np.stack([inward, right, up], axis=-1))
    centre = np.array([radius, 0.0, 0.0])
    depth, hit = sphere_depth(camera, view, centre, radius)
    points = view[:3, 3] + np.where(hit, depth, 0)[..., None] * rays(camera, view)
    sure = hit & (np.abs(points[..., 1:]) < 0.037).all(axis=-1)
    return mesh, view, camera, (points - centre) / radius @ view[:3, :3], sure


def numbered(ids, shift_m=(0.0, 0.0, 0.0)):
    """A room whose walls are of many quads, each an object of its own id, and the walls' cells in closed form.

    Returns the mesh, the pose, the object (H, W) that each pixel sees, and where no edge of a cell is within 0.01 px.
    """
    view = look_at(np.array([0.2, -0.1, 0.3]) + shift_m, np.array([1.0, 0.4, 0.2]) + shift_m, roll_deg=20)
    size, cells = 2.0, 5
    edges = np.linspace(-size, size, cells + 1)
    quads, index = [], np.zeros((3, 2, cells, cells), np.int64)
    for axis in range(3):
        for side in range(2):
            for row in range(cells):
                for column in range(cells):
                    index[axis, side, row, column] = len(quads)
                    quad = np.empty((4, 3))
                    quad[:, axis] = size * (2 * side - 1)
                    free = [k for k in range(3) if k != axis]
                    quad[:, free[0]] = edges[[row, row + 1, row + 1, row]]
                    quad[:, free[1]] = edges[[column, column, column + 1, column + 1]]
                    quads.append(quad + shift_m)
    mesh = replace(quads_mesh(quads), object_ids=np.asarray(ids(len(quads)), np.int64))

    def objects(dx_px, dy_px):
        moved = replace(CAMERA, cx_px=CAMERA.cx_px - dx_px, cy_px=CAMERA.cy_px - dy_px)
        direction, eye = rays(moved, view), view[:3, 3] - shift_m
        bounds = (np.where(direction > 0, size, -size) - eye) / direction
        axis = bounds.argmin(axis=-1)
        point = eye + bounds.min(axis=-1)[..., None] * direction
        side = (np.take_along_axis(direction, axis[..., None], -1)[..., 0] > 0).astype(int)
        cell = np.clip(((point + size) / (2 * size) * cells).astype(int), 0, cells - 1)
        free = np.array([[1, 2], [0, 2], [0, 1]])[axis]
        row, column = (np.take_along_axis(cell, free[..., k : k + 1], -1)[..., 0] for k in range(2))
        return mesh.object_ids[index[axis, side, row, column]]

    expected = objects(0.0, 0.0)
    sure = np.ones(expected.shape, bool)
    for dx_px, dy_px in ((-0.01, -0.01), (0.01, -0.01), (-0.01, 0.01), (0.01, 0.01)):
        sure &= objects(dx_px, dy_px) == expected
    return mesh, view, expected, sure


def check_instances(engine):
    """Every pixel off edges has its object: near and far from the origin, of few samples and of many."""
    scattered = np.random.default_rng(5).permutation(np.arange(65535 - 150, 65535) + 1)
    for shift_m, samples in (((0.0, 0.0, 0.0), 1), ((3e4, -2e4, 100.0), 4)):
        mesh, view, expected, sure = numbered(lambda count: scattered[:count], shift_m)
        assert sure.mean() > 0.98
        assert len(np.unique(expected[sure])) > 15
        frame = seen(engine, mesh, view, samples=samples, channels={"rgb", "depth", "normal", "instance"})
        assert frame.image("instance").dtype == np.uint16
        assert np.array_equal(frame.image("instance")[sure], expected[sure])
    unknown, view, _, _ = numbered(lambda count: np.full(count, -1))
    assert not seen(engine, unknown, view, channels={"instance"}).image("instance").any()


SURFACES = (plane, box, sphere)


def worst_normal(engine, made, **options):
    """How far normals are from those in closed form, at most, and what was rendered."""
    mesh, view, camera, expected, sure = made()
    assert sure.sum() > 0.3 * sure.size, "the test sees too little"
    frame = seen(engine, mesh, view, camera, **options)
    return np.abs(frame.image("normal") - expected)[sure].max(), frame
