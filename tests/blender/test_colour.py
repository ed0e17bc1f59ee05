# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex colours come back as they were, byte for byte where a face has one colour."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from analytic import look_at, quads_mesh, rays

from noisy_world.render.mesh_session import Session
from noisy_world.core.geometry import Intrinsics
from noisy_world.images.pixels import rgb_bytes
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.render.source import RenderOptions
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import evenly_stamped

CAMERA = Intrinsics(160, 160, 100.0, 100.0, 79.5, 79.5)
OPTIONS = RenderOptions(near_m=0.01, far_m=100.0, samples=1, seed=0)
EYE = look_at([0, 0, 0], [0, 1, 0])
STILL = SensorPaths(evenly_stamped(EYE[None]))
CELL_PX = 10


def render(mesh, options=OPTIONS, camera=CAMERA):
    with Session(mesh, "test", STILL, camera, options) as session:
        return session.frame(STILL.request(0))


def checkerboard(colours):
    """16 x 16 squares, each of one colour and CELL_PX wide in the image, filling it."""
    corners = []
    for row in range(16):
        for column in range(16):
            u = np.array([column, column + 1, column + 1, column]) * CELL_PX - 0.5
            v = np.array([row, row, row + 1, row + 1]) * CELL_PX - 0.5
            local = np.stack(
                [(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones(4)], axis=-1
            )
            corners.append(2.0 * local @ EYE[:3, :3].T)
    return quads_mesh(corners, colours)


@pytest.mark.parametrize("samples", [1, 16])
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_every_byte_comes_back(samples, channel):
    # All 256 values in one channel, other values in the others.
    colours = np.zeros((256, 3), int)
    colours[:, channel] = np.arange(256)
    colours[:, (channel + 1) % 3] = np.arange(256)[::-1]
    colours[:, (channel + 2) % 3] = (np.arange(256) * 37) % 256
    image = rgb_bytes(render(checkerboard(colours), replace(OPTIONS, samples=samples)).rgb)
    inner = image.reshape(16, CELL_PX, 16, CELL_PX, 3)[:, 3:-3, :, 3:-3]  # away from the averaging filter's reach
    expected = colours.reshape(16, 1, 16, 1, 3)
    assert np.array_equal(inner, np.broadcast_to(expected, inner.shape))


def test_one_sample_shows_the_pixel_centre():
    image = rgb_bytes(render(checkerboard(np.arange(256)[:, None].repeat(3, 1))).rgb)
    expected = np.arange(256).reshape(16, 16).repeat(CELL_PX, 0).repeat(CELL_PX, 1)
    assert np.array_equal(image, expected[..., None].repeat(3, -1))


def test_colours_between_vertices_are_interpolated_as_stored():
    # A triangle with a byte ramp along x: at each pixel the affine value, in display-encoded numbers.
    vertices = np.array([[-1.0, 2.0, -1.0], [1.0, 2.0, -1.0], [-1.0, 2.0, 1.0]])
    rgb = np.array([[10, 200, 0], [250, 100, 0], [10, 0, 255]], np.float32) / 255
    mesh = Mesh(vertices, rgb, np.array([0, 1, 2], np.int32), np.array([0], np.int32))
    for samples in (1, 64):
        frame = render(mesh, replace(OPTIONS, samples=samples))
        point = 2.0 * rays(CAMERA, EYE)
        weights = np.stack([-(point[..., 0] + point[..., 2]) / 2, (point[..., 0] + 1) / 2, (point[..., 2] + 1) / 2], -1)
        inside = (weights > 0.05).all(-1)
        expected = weights @ rgb.astype(np.float64)
        tolerance = 2e-6 if samples == 1 else 2e-3  # the averaging filter reaches over neighbours
        assert np.abs(frame.rgb[inside] - expected[inside]).max() < tolerance
        assert inside.sum() > 1000


def test_no_colours_are_neutral_grey_and_void_is_black():
    corner = [[-0.5, 2, -0.5], [0.5, 2, -0.5], [0.5, 2, 0.5], [-0.5, 2, 0.5]]
    frame = render(quads_mesh([corner]))
    image = rgb_bytes(frame.rgb)
    assert set(np.unique(image[frame.depth_m > 0])) == {128}
    assert set(np.unique(image[frame.depth_m == 0])) == {0}
    assert (frame.depth_m > 0).sum() == 50 * 50


def test_both_sides_show():
    corner = np.array([[-0.5, 2, -0.5], [0.5, 2, -0.5], [0.5, 2, 0.5], [-0.5, 2, 0.5]])
    for order in (slice(None), slice(None, None, -1)):
        frame = render(quads_mesh([corner[order]], [[200, 30, 60]]))
        assert (rgb_bytes(frame.rgb)[80, 80] == [200, 30, 60]).all()
        assert frame.depth_m[80, 80] == pytest.approx(2.0, rel=1e-6)


def test_clipping_makes_void():
    corner = np.array([[-50, 2, -50], [50, 2, -50], [50, 2, 50], [-50, 2, 50.0]])
    assert not render(quads_mesh([corner]), replace(OPTIONS, far_m=1.5)).depth_m.any()
    assert not render(quads_mesh([corner]), replace(OPTIONS, near_m=2.5)).depth_m.any()


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (33, 5)])
def test_small_and_odd_sizes(size):
    camera = Intrinsics(*size, 20.0, 20.0, (size[0] - 1) / 2, (size[1] - 1) / 2)
    corner = np.array([[-50, 2, -50], [50, 2, -50], [50, 2, 50], [-50, 2, 50.0]])
    frame = render(quads_mesh([corner], [[1, 2, 3]]), camera=camera)
    assert frame.rgb.shape == (size[1], size[0], 3)
    assert (rgb_bytes(frame.rgb) == [1, 2, 3]).all()
    assert np.allclose(frame.depth_m, 2.0, rtol=1e-6)


def test_frames_do_not_depend_on_threads_or_order():
    rng = np.random.default_rng(1)
    mesh = checkerboard(rng.integers(0, 256, (256, 3)))
    poses = np.stack([look_at([0.1 * k, 0, 0], [0, 1, 0.1 * k]) for k in range(4)])
    results = {}
    for threads, order in ((1, [0, 1, 2, 3]), (2, [3, 1, 0, 2])):
        options = replace(OPTIONS, threads=threads, samples=4)
        paths = SensorPaths(evenly_stamped(poses))
        with Session(mesh, "test", paths, CAMERA, options) as session:
            frames = {k: session.frame(paths.request(k)) for k in order}
        results[threads] = [frames[k].rgb.tobytes() + frames[k].depth_m.tobytes() for k in range(4)]
    assert results[1] == results[2]


def test_blenders_own_png_shows_the_same_bytes(tmp_path):
    # What an artist sees: linear light through the Standard view transform, by Blender's own colour management.
    import cv2

    colours = np.stack([np.arange(256), (np.arange(256) * 37) % 256, np.arange(256)[::-1]], axis=-1)
    with Session(checkerboard(colours), "test", STILL, CAMERA, replace(OPTIONS, samples=4)) as session:
        session.frame(STILL.request(0))
        scene = bpy.context.scene
        settings = scene.render.image_settings
        settings.media_type, settings.file_format, settings.color_depth = "IMAGE", "PNG", "8"
        scene.render.filepath = str(tmp_path / "blender.png")
        bpy.ops.render.render(write_still=True)
    image = cv2.imread(str(tmp_path / "blender.png"))[..., ::-1]
    inner = image.reshape(16, CELL_PX, 16, CELL_PX, 3)[:, 3:-3, :, 3:-3]
    assert np.array_equal(inner, np.broadcast_to(colours.reshape(16, 1, 16, 1, 3), inner.shape))
