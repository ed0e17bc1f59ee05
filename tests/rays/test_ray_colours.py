# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours from rays: bytes come back, between corners and texels they are interpolated as stored."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
pytestmark = pytest.mark.usefixtures("way_of_casting")

from analytic import interpolated, look_at, quads_mesh
from cases import cases
from ray_tools import cast, polygons

from noisy_world.images.pixels import rgb_bytes
from noisy_world.core.geometry import Intrinsics
from noisy_world.scenes.polygon_mesh import Mesh, Texture

W, H = 64, 48
CAMERA = Intrinsics(W, H, 50.0, 50.0, (W - 1) / 2, (H - 1) / 2)
EYE = look_at([0, 0, 0], [0, 1, 0])
WHOLE_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # clockwise from the top left
DICE = np.random.default_rng(0)
PICTURE = np.stack([DICE.permutation(np.arange(W * H) % 256).reshape(H, W) for _ in range(3)], -1).astype(np.uint8)


def on_board(points_px, depth_m=2.0):
    """Points (n, 3) that are seen at these places of the image, whole numbers at pixels' corners."""
    u, v = np.asarray(points_px, float).T - 0.5
    local = np.stack([(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones(len(u))], axis=-1)
    return depth_m * local @ EYE[:3, :3].T


def at(left, top, right, bottom):
    return on_board([(left, top), (right, top), (right, bottom), (left, bottom)])


def textured(pictures, uv=WHOLE_UV, boards=((0, 0, W, H),), face_pictures=(0,), rgb=None):
    mesh = quads_mesh([at(*board) for board in boards], rgb)
    names = tuple(f"{number}.png" for number in range(len(pictures)))
    uv = np.asarray(uv, np.float32)
    return replace(mesh, texture=Texture(names, tuple(pictures), uv, np.array(face_pictures, np.int32)))


def image(mesh):
    return rgb_bytes(cast(mesh, EYE, CAMERA).rgb)


def test_corners_colours_are_interpolated_as_stored():
    # An affine ramp over the image is the same ramp within every triangle, whichever way faces are split.
    cuts = [(0, 0), (40, 0), (64, 0), (64, 20), (64, 48), (24, 48), (0, 48)]
    faces = [(0, 1, 5, 6), (1, 2, 3), (1, 3, 4, 5)]

    def ramp(x, y):
        return np.stack([3.5 * x, 5 * y, 255 - 2 * x - 2 * y], axis=-1)

    corners = [np.array([cuts[k] for k in face], float) for face in faces]
    mesh = polygons([on_board(points) for points in corners], [ramp(*points.T) for points in corners])
    x, y = np.meshgrid(np.arange(W) + 0.5, np.arange(H) + 0.5)
    assert np.abs(255 * cast(mesh, EYE, CAMERA).rgb - ramp(x, y)).max() < 1e-2


def test_faces_have_their_bytes_up_to_the_edge():
    grid = [at(4 * c, 3 * r, 4 * c + 4, 3 * r + 3) for r in range(16) for c in range(16)]
    vertices_m, corners = np.unique(np.round(np.reshape(grid, (-1, 3)), 9), axis=0, return_inverse=True)
    colours = np.stack([np.arange(256), np.arange(256)[::-1], np.arange(256) * 37 % 256], axis=-1)
    corner_rgb = (np.repeat(colours, 4, axis=0) / 255).astype(np.float32)
    starts = np.arange(0, 1024, 4, dtype=np.int32)
    mesh = Mesh(vertices_m, None, corners.ravel().astype(np.int32), starts, corner_rgb=corner_rgb)
    assert np.array_equal(image(mesh), colours.reshape(16, 1, 16, 1, 3).repeat(3, 1).repeat(4, 3).reshape(H, W, 3))


def test_a_texel_a_pixel_is_its_bytes():
    assert np.array_equal(image(textured([PICTURE])), PICTURE)


def test_between_texels_colours_are_interpolated_and_the_picture_repeats():
    picture = np.array([[[0, 255, 10], [200, 5, 250]], [[100, 30, 60], [20, 40, 255]]], np.uint8)
    assert np.abs(image(textured([picture])) - interpolated(picture, W, H)).max() < 0.51


def test_coordinates_beyond_the_picture_repeat_it():
    part = PICTURE[: H // 2, : W // 4]
    assert np.array_equal(image(textured([part], WHOLE_UV * [4, 2] + [3, -5])), np.tile(part, (2, 4, 1)))


def test_a_quarter_turn():
    part = PICTURE[:, :H]
    turned = image(textured([part], np.roll(WHOLE_UV, 1, axis=0), ((0, 0, H, H),)))[:, :H]
    assert np.array_equal(turned, np.rot90(part, -1))


@cases("rgb, beside", [([[1, 2, 3], [4, 5, 6], [70, 80, 90], [0, 255, 0]], [70, 80, 90]), (None, [128] * 3)])
def test_several_pictures_beside_other_colours(rgb, beside):
    pictures = [PICTURE[:, :16], PICTURE[:, 16:32]]
    boards = [(0, 0, 16, H), (16, 0, 32, H), (32, 0, 48, H), (48, 0, W, H)]
    shown = image(textured(pictures, np.tile(WHOLE_UV, (4, 1)), boards, [1, 0, -1, 1], rgb))
    assert np.array_equal(shown[:, :16], pictures[1])
    assert np.array_equal(shown[:, 16:32], pictures[0])
    assert (shown[:, 32:48] == beside).all()
    assert np.array_equal(shown[:, 48:], pictures[1])


def test_faces_without_a_picture_alone_in_view():
    mesh = textured([PICTURE], np.tile(WHOLE_UV, (2, 1)), [(0, 0, W, H), (W + 9, 0, W + 19, H)], [-1, 0])
    assert (image(mesh) == 128).all()
