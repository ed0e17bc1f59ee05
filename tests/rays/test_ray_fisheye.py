# SPDX-License-Identifier: GPL-3.0-or-later
"""A fisheye that sees sideways and back: rays by OpenCV's projection, colour and depth of a room in closed form."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
pytestmark = pytest.mark.usefixtures("way_of_casting")

from cases import cases
from ray_tools import OPTIONS
from shutters import HIGH, LOW, coloured_room, moved, paths, psnr_db
from srgb import linear

from noisy_world.core.errors import InputError
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.lens import directions, lens_problem, lens_rays, projected
from noisy_world.core.lens import Distortion
from noisy_world.core.camera_motion import travel_px
from noisy_world.preset.sensor_keys import DistortionSpec
from noisy_world.sources.rendered_mesh import reprojection_problem
from noisy_world.core.schema import ConfigPath
from noisy_world.core.frame_request import RequestedRays, Shutter
from noisy_world.render.ray_session import SIDEWAYS, RaySession
from noisy_world.sources.renderers import lens_of

# 105 degrees to the sides, 120 into the corners.
CAMERA = Intrinsics(96, 72, 27.0, 26.0, 46.5, 36.0)
LENS = Distortion("equidistant", (-0.02, 0.01, -0.002, 0.0001))
WIDEST_DEG = 85.0


def angles_deg():
    """(H, W): how far each pixel's ray is from the axis, by solving the model's polynomial for it."""
    u, v = np.meshgrid(np.arange(CAMERA.width_px), np.arange(CAMERA.height_px))
    bent = np.hypot((u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px)
    fine = np.linspace(0, np.pi, 200_001)
    k1, k2, k3, k4 = LENS.coefficients
    grown = fine * (1 + k1 * fine**2 + k2 * fine**4 + k3 * fine**6 + k4 * fine**8)
    return np.degrees(np.interp(bent, grown, fine))


def seen_by(request=None, mesh=None, **options):
    sensors = paths("rotation")
    with RaySession(mesh or coloured_room(), sensors, CAMERA, replace(OPTIONS, **options), LENS) as session:
        return session.frame(sensors.request(1) if request is None else request(sensors)), session.notes


def walls(c2w):
    """(H, W): how far the room's walls are along each ray, from inside: the nearest of six planes."""
    rays = lens_rays(CAMERA, LENS)
    local = np.stack([rays.right, rays.down, rays.forward], axis=-1)
    to_world = local @ np.asarray(c2w)[:3, :3].T
    with np.errstate(divide="ignore"):
        bounds = np.where(to_world > 0, HIGH - c2w[:3, 3], LOW - c2w[:3, 3]) / to_world
    return bounds.min(axis=-1), to_world, np.diff(np.sort(bounds, axis=-1)[..., :2], axis=-1)[..., 0] > 0.05


def test_each_ray_is_projected_into_its_pixel_by_opencv():
    """OpenCV's projection of points before the camera; of those behind it by its formula, which it divides by z."""
    assert lens_problem(CAMERA, LENS, all_around=True) == ""
    assert "85 degrees" in lens_problem(CAMERA, LENS)
    rays = lens_rays(CAMERA, LENS)
    local = np.stack([rays.right, rays.down, rays.forward], axis=-1)
    np.testing.assert_allclose(np.linalg.norm(local, axis=-1), 1.0, rtol=1e-12)
    found_deg = np.degrees(np.arctan2(np.hypot(local[..., 0], local[..., 1]), local[..., 2]))
    assert found_deg.max() > 110
    np.testing.assert_allclose(found_deg, angles_deg(), atol=2e-5)
    u, v = np.meshgrid(np.arange(96.0), np.arange(72.0))
    before = found_deg < 89
    points, still = local[before].reshape(-1, 1, 3), np.zeros(3)
    there, _ = cv2.fisheye.projectPoints(points, still, still, CAMERA.matrix, np.array(LENS.coefficients))
    assert np.abs(there[:, 0] - np.stack([u[before], v[before]], axis=-1)).max() < 1e-9
    for values, wanted in zip(projected(3.0 * local, CAMERA, LENS), (u, v), strict=True):
        np.testing.assert_allclose(values, wanted, atol=1e-9)
    azimuth = np.arctan2(local[..., 1], local[..., 0])
    off = np.hypot(u - CAMERA.cx_px, v - CAMERA.cy_px) > 0
    bent = np.arctan2((v - CAMERA.cy_px) / CAMERA.fy_px, (u - CAMERA.cx_px) / CAMERA.fx_px)
    assert np.abs(np.exp(1j * azimuth) - np.exp(1j * bent))[off].max() < 1e-12


def test_depth_is_planar_and_ends_where_it_means_nothing():
    (frame, notes), (away_m, to_world, sure) = seen_by(), walls(moved("rotation", 0.0))
    assert notes[-1] == SIDEWAYS
    deep = angles_deg() < WIDEST_DEG
    assert 0.2 < np.mean(~deep) < 0.7
    assert (frame.depth_m[~deep] == 0).all()
    ahead = to_world @ moved("rotation", 0.0)[:3, 2]
    np.testing.assert_allclose(frame.depth_m[deep & sure], (away_m * ahead)[deep & sure], rtol=5e-6)


def test_colour_is_that_of_the_wall_that_each_ray_meets_sideways_and_back_too():
    room, c2w = coloured_room(), moved("rotation", 0.0)
    frame, _ = seen_by(mesh=room)
    away_m, to_world, _ = walls(c2w)
    points = c2w[:3, 3] + to_world * away_m[..., None]
    quads = room.vertices_m.reshape(-1, 4, 3)
    centres, colours = quads.mean(axis=1), room.rgb.reshape(-1, 4, 3)[:, 0]
    extent = np.abs(quads - centres[:, None]).max(axis=1)
    true, found = np.zeros((*away_m.shape, 3)), np.zeros(away_m.shape, bool)
    for centre, half, colour in zip(centres, extent, colours, strict=True):
        inside = (np.abs(points - centre) < np.where(half > 1e-6, half - 2e-3, 2e-4)).all(axis=-1)
        true[inside], found = colour, found | inside
    assert found.mean() > 0.9
    assert np.abs(frame.rgb - true)[found].max() < 1e-5
    assert (found & (angles_deg() > 95)).sum() > 500


@cases("direction", ["down", "left"])
def test_each_line_of_a_rolling_shutter_is_seen_through_it(direction):
    shutter = Shutter.centred(0.0, 0.04, direction)
    rolled, _ = seen_by(lambda sensors: replace(sensors.request(1), rays=RequestedRays(shutter)))
    lines = CAMERA.height_px if direction == "down" else CAMERA.width_px
    times_s = shutter.line_times_s(lines)
    for line in range(0, lines, 9):
        single, _ = seen_by(lambda sensors, at=times_s[line]: sensors.at(at))
        place = np.s_[line] if direction == "down" else np.s_[:, line]
        assert psnr_db(rolled.rgb[place], single.rgb[place]) > 65
        np.testing.assert_allclose(rolled.depth_m[place], single.depth_m[place], rtol=1e-6)


def test_more_rays_of_a_pixel_are_those_of_a_finer_camera():
    side = 3
    fine = Intrinsics(
        96 * side, 72 * side, CAMERA.fx_px * side, CAMERA.fy_px * side,
        (CAMERA.cx_px + 0.5) * side - 0.5, (CAMERA.cy_px + 0.5) * side - 0.5,
    )  # fmt: skip
    sensors = paths("rotation")
    with RaySession(coloured_room(), sensors, fine, OPTIONS, LENS) as session:
        pixels = session.frame(sensors.request(1)).rgb
    mean = linear(pixels.astype(np.float64)).reshape(72, side, 96, side, 3).mean(axis=(1, 3))
    (smooth, _), (plain, _) = seen_by(samples=9), seen_by()
    off = np.abs(linear(smooth.rgb.astype(np.float64)) - mean).max(axis=-1)
    assert np.mean(off < 0.02) > 0.99
    assert np.mean(np.abs(linear(plain.rgb.astype(np.float64)) - mean).max(axis=-1) < 0.02) < 0.9


def test_the_way_on_its_image_is_that_of_points_on_a_sphere():
    """A turn about the axis moves what the outer rays see by their radius times the angle."""
    depth_m = np.where(angles_deg() < WIDEST_DEG, np.cos(np.radians(np.minimum(angles_deg(), 89))), 0).astype(
        np.float32
    )
    turn = np.repeat(np.eye(4)[None], 2, axis=0)
    angle = 0.01
    turn[1, :2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    round_camera = replace(CAMERA, fx_px=27.0, fy_px=27.0)
    way_px = travel_px(depth_m, np.eye(4), turn, round_camera, round_camera, lens=LENS)
    radius_px = max(np.hypot(u - 46.5, v - 36.0) for u in (0, 95) for v in (0, 71))
    seen_px = [radius_px * angle, max(46.5 * angle, 36 * angle)]
    assert seen_px[1] < way_px <= seen_px[0] + 1e-6


def test_the_mesh_is_where_the_pose_says_and_not_where_another_one_does():
    frame, _ = seen_by()
    room = coloured_room()
    assert reprojection_problem(room, moved("rotation", 0.0), CAMERA, frame.depth_m, LENS) is None
    wrong = moved("rotation", 0.0) @ np.diag([1.0, -1.0, -1.0, 1.0])
    assert reprojection_problem(room, wrong, CAMERA, frame.depth_m, LENS) is not None


def test_where_it_ends_is_told_and_others_are_pointed_to_embree():
    spec, place = DistortionSpec("equidistant", k1=0.001), ConfigPath("preset.yaml", "camera.distortion")
    assert lens_of(spec, CAMERA, place, cast=True).model == "equidistant"
    with pytest.raises(InputError, match=r"85 degrees.*render a mesh with render\.engine: embree"):
        lens_of(spec, CAMERA, place, cast=False)
    with pytest.raises(InputError, match="beyond 180 degrees from its axis"):
        lens_of(spec, replace(CAMERA, fx_px=12.0, fy_px=12.0), place, cast=True)
    x, y = np.array([0.0, np.pi / 2]), np.zeros(2)
    ideal = directions(Distortion("equidistant", (1e-15, 0.0, 0.0, 0.0)), x, y)
    np.testing.assert_allclose(ideal, [[0, 0, 1], [1, 0, 0]], atol=1e-12)
