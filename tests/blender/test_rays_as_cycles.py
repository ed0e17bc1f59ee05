# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays alone see what Cycles renders: faces split alike, the same depth and colours off edges."""

from dataclasses import replace

import bpy
import cv2
import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")

from analytic import look_at
from ray_tools import OPTIONS, polygons

from noisy_world.render.mesh_session import add_mesh, empty_scene
from noisy_world.core.geometry import Intrinsics
from noisy_world.scenes.polygon_mesh import Texture
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.render.triangles import triangle_corners
from noisy_world.sources.renderers import open_session

CAMERA = Intrinsics(320, 240, 200.0, 180.0, 150.0, 130.0)
EYES = np.stack([look_at([0.2, -0.1, 0.3], [1.0, 0.4, 0.2]), look_at([0.1, 0.3, 0.2], [-1.0, 0.9, 0.5], roll_deg=30)])
STEP_M = 1 / 6553.5  # of Replica's depth images


def outlines(seed, count, flat):
    """Faces (n, 3) of 3 to 12 corners around the origin: convex, star-shaped or, unless flat, warped."""
    rng = np.random.default_rng(seed)
    faces = []
    for _ in range(count):
        corners = int(rng.integers(3, 13))
        angle = np.sort(rng.uniform(0, 2 * np.pi, corners)) * rng.choice([-1, 1])
        radius = np.ones(corners) if rng.random() < 0.3 else rng.uniform(0.2, 1, corners)
        height = np.zeros(corners) if flat else rng.normal(0, 0.2, corners)
        face = np.column_stack([np.cos(angle) * radius, np.sin(angle) * radius, height])
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        away = rng.normal(size=3)
        faces.append(face @ turned.T + away / np.linalg.norm(away) * rng.uniform(1.5, 6))
    return faces


def split_by_blender(mesh):
    data = add_mesh(empty_scene(), mesh, "faces", decoding="none").data
    assert isinstance(data, bpy.types.Mesh)
    data.calc_loop_triangles()
    corners = np.empty(3 * len(data.loop_triangles), np.int32)
    data.loop_triangles.foreach_get("loops", corners)
    return corners.reshape(-1, 3)


@pytest.mark.parametrize("flat", [True, False])
def test_faces_are_split_as_blender_splits_them(flat):
    mesh = polygons(outlines(3, 1500, flat))
    assert np.array_equal(triangle_corners(mesh, mesh.vertices_m.astype(np.float32)), split_by_blender(mesh))


def colourful(seed, shift_m):
    """Warped faces in front of a room's walls: every corner has a colour of its own."""
    rng = np.random.default_rng(seed)
    walls = [np.roll([[x, y, 8.0 * side] for x, y in ((-8, -8), (8, -8), (8, 8), (-8, 8))], axis, axis=1)
             for axis in range(3) for side in (-1, 1)]  # fmt: skip
    faces = [np.asarray(face) + shift_m for face in [*walls, *outlines(seed, 250, False)]]
    return polygons(faces, [rng.integers(0, 256, (len(face), 3)) for face in faces])


def with_textures(mesh, seed):
    rng = np.random.default_rng(seed)
    smooth = [cv2.resize(rng.integers(0, 256, (5, 4, 3), dtype=np.uint8), (37, 50)) for _ in range(2)]
    uv = rng.uniform(-1, 2, (len(mesh.corner_vertices), 2)).astype(np.float32)
    pictures = rng.integers(-1, 2, len(mesh.face_starts)).astype(np.int32)
    return replace(mesh, texture=Texture(("a.png", "b.png"), tuple(smooth), uv, pictures))


def frames(engine, mesh, shift_m, **options):
    eyes = EYES.copy()
    eyes[:, :3, 3] += shift_m
    paths = SensorPaths(evenly_stamped(eyes))
    with open_session(mesh, "test", paths, CAMERA, replace(OPTIONS, engine=engine, **options)) as session:
        return [session.frame(paths.request(index)) for index in range(len(eyes))]


def off_edges(depth_m):
    """Where depth changes by less than 5 % within 2 px, and all of it is seen."""
    around = np.ones((5, 5), np.uint8)
    low, high = cv2.erode(depth_m, around), cv2.dilate(depth_m, around)
    return (low > 0) & (high < 1.05 * low)


def compare(mesh, shift_m=(0.0, 0.0, 0.0), **options):
    """The shares of pixels off edges with depth more than half a step apart, and with colour more than 1/255."""
    pairs = zip(*(frames(engine, mesh, np.array(shift_m), **options) for engine in ("cycles", "embree")), strict=True)
    depth, colour = [], []
    for cycles, rays in pairs:
        sure = off_edges(cycles.depth_m)
        assert sure.sum() > 10_000, "the test sees too little"
        assert np.mean((rays.depth_m > 0) != (cycles.depth_m > 0)) < 5e-4
        depth.append((np.abs(rays.depth_m - cycles.depth_m) > STEP_M / 2)[sure])
        colour.append((np.abs(rays.rgb - cycles.rgb).max(axis=-1) > 1 / 255)[sure])
    return np.mean(np.concatenate(depth)), np.mean(np.concatenate(colour))


@pytest.mark.parametrize("shift_m", [(0.0, 0.0, 0.0), (1e5, -2e4, 300.0)])
def test_depth_and_colours_are_those_of_cycles(shift_m):
    depth, colour = compare(colourful(7, shift_m), shift_m)
    assert depth <= 1e-4
    assert colour <= 1e-4


def test_textures_are_those_of_cycles():
    depth, colour = compare(with_textures(colourful(8, 0), 8))
    assert depth <= 1e-4
    assert colour <= 1e-4


def test_near_and_far_are_those_of_cycles():
    depth, colour = compare(colourful(9, 0), near_m=2.0, far_m=5.0)
    assert depth <= 1e-4
    assert colour <= 1e-4
