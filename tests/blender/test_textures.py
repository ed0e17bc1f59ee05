# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours of faces and of textures come back as they were: seen head on, a texel a pixel, byte for byte."""

from dataclasses import replace

import numpy as np
import pytest

from analytic import interpolated, look_at, quads_mesh
from engines import each_engine, need_gl, other_engines_at_length
from ply_files import INDICES, XYZ, ply, vertex

from noisy_world.render.mesh_session import Session
from noisy_world.images.pixels import rgb_bytes
from noisy_world.core.geometry import Intrinsics
from noisy_world.render.source import RenderOptions
from noisy_world.scenes.polygon_mesh import Mesh, Texture
from noisy_world.scenes.ply import read_ply
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import evenly_stamped

W, H = 64, 48
CAMERA = Intrinsics(W, H, 50.0, 50.0, (W - 1) / 2, (H - 1) / 2)
EYE = look_at([0, 0, 0], [0, 1, 0])
STILL = SensorPaths(evenly_stamped(EYE[None]))
OPTIONS = RenderOptions(near_m=0.01, far_m=100.0, samples=1, seed=0)
WHOLE_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # clockwise from the top left


def render(mesh, engine="cycles", samples=1):
    need_gl(engine)
    with Session(mesh, "test", STILL, CAMERA, replace(OPTIONS, engine=engine, samples=samples)) as session:
        return rgb_bytes(session.frame(STILL.request(0)).rgb)


def at(left, top, right, bottom, depth_m=2.0):
    """The corners (4, 3) of a board that fills these pixels, clockwise from the top left."""
    u, v = np.array([left, right, right, left]) - 0.5, np.array([top, top, bottom, bottom]) - 0.5
    local = np.stack([(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones(4)], axis=-1)
    return depth_m * local @ EYE[:3, :3].T


def textured(pictures, uv=WHOLE_UV, boards=((0, 0, W, H),), face_pictures=(0,), rgb=None):
    mesh = quads_mesh([at(*board) for board in boards], rgb)
    names = tuple(f"{number}.png" for number in range(len(pictures)))
    return replace(mesh, texture=Texture(names, tuple(pictures), np.asarray(uv), np.array(face_pictures, np.int32)))


def every_byte():
    """(48, 64, 3) noise in which each channel has all 256 values."""
    dice = np.random.default_rng(0)
    return np.stack([dice.permutation(np.arange(W * H) % 256).reshape(H, W) for _ in range(3)], -1).astype(np.uint8)


@each_engine
def test_a_texel_a_pixel_is_its_bytes(engine):
    picture = every_byte()
    assert np.array_equal(render(textured([picture]), engine), picture)


@each_engine
def test_faces_have_their_bytes_up_to_the_edge(engine):
    # 256 boards of 4 x 3 pixels that share their vertices
    grid = [at(4 * c, 3 * r, 4 * c + 4, 3 * r + 3) for r in range(16) for c in range(16)]
    vertices_m, corners = np.unique(np.round(np.reshape(grid, (-1, 3)), 9), axis=0, return_inverse=True)
    assert len(vertices_m) == 17 * 17
    colours = np.stack([np.arange(256), np.arange(256)[::-1], np.arange(256) * 37 % 256], axis=-1)
    corner_rgb = (np.repeat(colours, 4, axis=0) / 255).astype(np.float32)
    starts = np.arange(0, 1024, 4, dtype=np.int32)
    mesh = Mesh(vertices_m, None, corners.ravel().astype(np.int32), starts, corner_rgb=corner_rgb)
    expected = colours.reshape(16, 1, 16, 1, 3).repeat(3, 1).repeat(4, 3).reshape(H, W, 3)
    assert np.array_equal(render(mesh, engine), expected)


@other_engines_at_length
def test_several_samples_keep_colours(engine):
    # each texel is 16 x 12 pixels; away from its edges several samples average to it, within a half of a byte
    picture = every_byte()[:4, :4]
    boards = [(16 * c, 12 * r, 16 * c + 16, 12 * r + 12) for r in range(4) for c in range(4)]
    middle = [[((c + 0.5) / 4, 1 - (r + 0.5) / 4)] * 4 for r in range(4) for c in range(4)]
    mesh = textured([picture], np.reshape(middle, (-1, 2)).astype(np.float32), boards, [0] * 16)
    image = render(mesh, engine, samples=8).reshape(4, 12, 4, 16, 3)[:, 4:-4, :, 4:-4].astype(int)
    assert np.abs(image - picture[:, None, :, None]).max() <= (0 if engine == "cycles" else 1)


@each_engine
def test_between_texels_colours_are_interpolated_as_stored(engine):
    picture = np.array([[[0, 255, 10], [200, 5, 250]], [[100, 30, 60], [20, 40, 255]]], np.uint8)
    image = render(textured([picture]), engine)
    # graphics cards and Mesa weigh with 8 bits, so that a step is 1/256 of the span
    tolerance = {"cycles": 0.51, "eevee": 0.7, "workbench": 2.0}[engine]
    assert np.abs(image - interpolated(picture, W, H)).max() < tolerance


@other_engines_at_length
def test_coordinates_beyond_the_picture_repeat_it(engine):
    picture = every_byte()[: H // 2, : W // 4]
    assert np.array_equal(render(textured([picture], WHOLE_UV * [4, 2] + [3, -5]), engine), np.tile(picture, (2, 4, 1)))


@other_engines_at_length
def test_a_quarter_turn(engine):
    picture = every_byte()[:, :H]
    board = ((0, 0, H, H),)
    turned = render(textured([picture], np.roll(WHOLE_UV, 1, axis=0), board), engine)[:, :H]
    assert np.array_equal(turned, np.rot90(picture, -1))


@pytest.mark.parametrize("engine", ["cycles", "eevee"])
def test_several_pictures_beside_other_colours(engine):
    pictures = [every_byte()[:, :16], every_byte()[:, 16:32]]
    boards = [(0, 0, 16, H), (16, 0, 32, H), (32, 0, 48, H), (48, 0, W, H)]
    rgb = [[1, 2, 3], [4, 5, 6], [70, 80, 90], [0, 255, 0]]
    image = render(textured(pictures, np.tile(WHOLE_UV, (4, 1)), boards, [1, 0, -1, 1], rgb), engine)
    assert np.array_equal(image[:, :16], pictures[1])
    assert np.array_equal(image[:, 16:32], pictures[0])
    assert (image[:, 32:48] == [70, 80, 90]).all()
    assert np.array_equal(image[:, 48:], pictures[1])


@pytest.mark.parametrize("samples", [1, 8])
def test_workbench_shows_faces_beside_a_texture_in_grey(samples):
    mesh = textured([every_byte()], np.tile(WHOLE_UV, (2, 1)), [(0, 0, 32, H), (32, 0, W, H)], [0, -1], [[9, 9, 9]] * 2)
    assert (render(mesh, "workbench", samples)[4:-4, 36:-4] == 128).all()


def test_from_a_file_written_by_hand(tmp_path):
    # Quads and a triangle that lean, so that a corner with the coordinates of another shows at once.
    import cv2

    picture = every_byte()
    cv2.imwrite(str(tmp_path / "a.png"), picture[..., ::-1])
    corners_px = [(0, 0), (40, 0), (64, 0), (64, 20), (64, 48), (24, 48), (0, 48)]
    board = at(0, 0, W, H)
    points = [board[0] + x / W * (board[1] - board[0]) + y / H * (board[3] - board[0]) for x, y in corners_px]
    faces = [(0, 1, 5, 6), (1, 2, 3), (1, 3, 4, 5)]
    uv = [tuple(c for k in f for c in (corners_px[k][0] / W, 1 - corners_px[k][1] / H)) for f in faces]
    data = ply(
        "binary_big_endian",
        vertex(tuple(d.replace("float", "double") for d in XYZ), [tuple(point) for point in points]),
        ("face", (*INDICES, "list uchar float texcoord"), list(zip(faces, uv, strict=True))),
        extra=("comment TextureFile a.png",),
    )
    (tmp_path / "mesh.ply").write_bytes(data)
    assert np.array_equal(render(read_ply(tmp_path / "mesh.ply")), picture)
