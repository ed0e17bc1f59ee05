# SPDX-License-Identifier: GPL-3.0-or-later
"""More than one ray: the light of an edge's known coverage, means of shifted cameras' images, depth as with one ray."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
pytestmark = pytest.mark.usefixtures("way_of_casting")

from analytic import look_at
from cases import cases
from ray_tools import cast, polygons

from noisy_world.core.geometry import Intrinsics
from noisy_world.preset.keys import EMBREE_SAMPLES
from noisy_world.scenes.polygon_mesh import Texture
from noisy_world.render import ray_session

W, H = 45, 31
CAMERA = Intrinsics(W, H, 50.0, 40.0, 21.3, 15.2)
EYE = look_at([0, 0, 0], [0, 1, 0])
DICE = np.random.default_rng(5)
DARK, BRIGHT = 30, 220
CHANNELS = frozenset({"rgb", "depth", "normal"})


def decoded(colours):
    """IEC 61966-2-1."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def encoded(light):
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


def board(*corners_px, depth_m=2.0):
    """A face that is seen with these corners, in pixels whose centres are whole numbers."""
    u, v = np.asarray(corners_px, float).T
    local = np.stack([(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones(len(u))], axis=-1)
    return depth_m * local @ EYE[:3, :3].T


def halves(ends_px):
    """A bright half-plane to the left of the line between two points, on a dark one."""
    start, end = np.array(ends_px, float)
    along = 1000 * (end - start) / np.linalg.norm(end - start)
    left = np.array([along[1], -along[0]])
    a, b = start - along, start + along
    faces = [board(a, b, b + left, a + left), board(a, a - left, b - left, b)]
    return polygons(faces, [np.full((4, 3), value) for value in (BRIGHT, DARK)])


def light_of(coverage):
    bright, dark = (decoded(value / 255) for value in (BRIGHT, DARK))
    return encoded(coverage * bright + (1 - coverage) * dark)


@cases("samples", [4, 9, 25, 64])
@cases("upright", [True, False])
def test_an_edge_between_the_rays_of_a_grid(samples, upright):
    side, place = round(samples**0.5), 11
    for part in range(side + 1):
        at = place - 0.5 + part / side
        ends = [(at, H), (at, 0)] if upright else [(0, at), (W, at)]
        rgb = cast(halves(ends), EYE, CAMERA, samples=samples).rgb
        line = rgb[7] if upright else rgb[:, 7]
        expected = light_of(np.where(np.arange(len(line)) == place, part / side, np.arange(len(line)) < place))
        assert np.abs(line - expected[:, None]).max() < 1e-4


def test_a_slanted_edge_has_the_light_of_its_coverage():
    (x, y), (along, down) = (20.2, 14.1), (0.6, -1.0)
    fine = (np.arange(64) + 0.5) / 64 - 0.5
    u, v = (np.add.outer(np.arange(count), fine) for count in (W, H))
    bright = (u[None, None] - x) * down - (v[:, :, None, None] - y) * along > 0
    coverage = bright.mean(axis=(1, 3))
    rgb = cast(halves([(x, y), (x + along, y + down)]), EYE, CAMERA, samples=64).rgb
    assert ((coverage > 0) & (coverage < 1)).sum() > 30
    error = decoded(rgb[..., 0]) - decoded(light_of(coverage))
    assert np.abs(error).max() < 0.5 / 8  # half a column of the grid
    assert np.sqrt(np.mean(error[(coverage > 0) & (coverage < 1)] ** 2)) < 0.02


def rubble():
    """Small faces at all depths, partly with a texture, each corner with a colour of its own, and void between."""
    faces = [
        board(*(DICE.uniform(0, [W, H]) + DICE.normal(0, 4, (3, 2))), depth_m=DICE.uniform(1, 4)) for _ in range(70)
    ]
    mesh = polygons(faces, [DICE.integers(0, 256, (3, 3)) for _ in faces])
    uv = DICE.uniform(0, 3, (len(mesh.corner_vertices), 2)).astype(np.float32)
    shown = DICE.integers(-1, 1, len(faces)).astype(np.int32)
    return replace(mesh, texture=Texture(("a",), (DICE.integers(0, 256, (9, 7, 3), np.uint8),), uv, shown))


@cases("samples", EMBREE_SAMPLES[1:4])
def test_uneven_pixels_are_means_of_shifted_cameras_images(samples):
    mesh, side = rubble(), round(samples**0.5)
    frame = cast(mesh, EYE, CAMERA, samples=samples, channels=CHANNELS)
    one = cast(mesh, EYE, CAMERA, channels=CHANNELS)
    places = (np.arange(side) + 0.5) / side - 0.5
    shifted = [
        cast(mesh, EYE, replace(CAMERA, cx_px=CAMERA.cx_px - right, cy_px=CAMERA.cy_px - down)).rgb
        for right in places
        for down in places
    ]
    mean = encoded(np.mean([decoded(np.clip(rgb, 0, 1)) for rgb in shifted], axis=0))
    padded = np.pad(one.rgb, ((1, 1), (1, 1), (0, 0)), mode="edge")
    beside = [padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1]]
    uneven = np.max([np.abs(one.rgb - other).max(axis=-1) for other in beside], axis=0) > 0.15
    assert 0.2 < uneven.mean() < 0.95
    assert np.abs(frame.rgb - mean)[uneven].max() < 1e-4
    assert np.array_equal(frame.rgb[~uneven], one.rgb[~uneven])
    assert frame.colour_rays == W * H + (samples - samples % 2) * uneven.sum()
    assert one.colour_rays is None
    for channel in ("depth", "normal"):  # are the centre's
        assert frame.image(channel).tobytes() == one.image(channel).tobytes()


def test_threads_and_portions_change_no_byte(monkeypatch):
    mesh = rubble()
    whole = cast(mesh, EYE, CAMERA, samples=9).rgb
    monkeypatch.setattr(ray_session, "PIXELS_AT_ONCE", 7)
    assert cast(mesh, EYE, CAMERA, samples=9, threads=3).rgb.tobytes() == whole.tobytes()
    assert cast(mesh, EYE, CAMERA, samples=9, channels=CHANNELS).rgb.tobytes() == whole.tobytes()


@cases("width, height", [(1, 1), (1, 7), (13, 1), (41, 43)])
def test_images_of_any_size(width, height):
    camera = replace(CAMERA, width_px=width, height_px=height, cx_px=(width - 1) / 2, cy_px=(height - 1) / 2)
    mesh = rubble()
    frame = cast(mesh, EYE, camera, samples=16)
    assert frame.rgb.shape == (height, width, 3)
    assert frame.colour_rays >= width * height
    if width * height == 1:  # there is no neighbour to differ from
        assert frame.rgb.tobytes() == cast(mesh, EYE, camera).rgb.tobytes()


def test_where_nothing_is_seen_a_pixel_takes_one_ray():
    frame = cast(rubble(), look_at([0, 0, 0], [0, -1, 0]), CAMERA, samples=64)
    assert not frame.rgb.any()
    assert not frame.depth_m.any()
    assert frame.colour_rays == W * H


def test_void_is_black_light():
    edge = polygons([board((10.5, -99), (99, -99), (99, 99), (10.5, 99))], [np.full((4, 3), BRIGHT)])
    nearer = cast(edge, EYE, replace(CAMERA, cx_px=CAMERA.cx_px + 0.25), samples=4).rgb[5, 9:13, 0]
    assert np.allclose(nearer, [0, 0, BRIGHT / 255, BRIGHT / 255], atol=1e-4)
    half = cast(edge, EYE, replace(CAMERA, cx_px=CAMERA.cx_px + 0.5), samples=4).rgb[5, 9:13, 0]
    assert np.allclose(half, [0, 0, encoded(decoded(BRIGHT / 255) / 2), BRIGHT / 255], atol=1e-4)
