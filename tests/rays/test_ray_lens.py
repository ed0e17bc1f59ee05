# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames through a lens that distorts: rays by OpenCV's projection, depth of walls in closed form."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
pytestmark = pytest.mark.usefixtures("way_of_casting")

from cases import cases
from ray_tools import OPTIONS
from shutters import HIGH, LOW, coloured_room, moved, paths, psnr_db

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.lens import lens_rays
from noisy_world.core.lens import Distortion
from noisy_world.core.frame_request import RequestedRays, Shutter
from noisy_world.render.ray_session import RaySession

CAMERA = Intrinsics(96, 72, 60.0, 56.0, 45.5, 36.0)
LENSES = {
    "barrel": Distortion("radial-tangential", (-0.28, 0.07, 2e-3, -1e-3)),
    "pincushion": Distortion("radial-tangential", (0.1, 0.02, -1e-3, 2e-3, 0.01)),
    "rational": Distortion("radial-tangential", (0.5, 0.05, 1e-3, 2e-4, 0.01, 0.6, 0.1, 0.0)),
    "fisheye": Distortion("equidistant", (-0.02, 0.01, -0.004, 0.001)),
}


def seen_by(lens, request=None, mesh=None, **options):
    sensors = paths("rotation")
    with RaySession(mesh or coloured_room(), sensors, CAMERA, replace(OPTIONS, **options), lens) as session:
        return session.frame(sensors.request(1) if request is None else request(sensors))


def wall_depth(lens, c2w):
    """Planar depth of the room, from inside, along the rays of a lens: the nearest of six planes."""
    rays = lens_rays(CAMERA, lens)
    local = np.stack([rays.right, rays.down, np.ones_like(rays.right)], axis=-1)
    to_world = local @ np.asarray(c2w)[:3, :3].T
    with np.errstate(divide="ignore"):
        bounds = np.where(to_world > 0, HIGH - c2w[:3, 3], LOW - c2w[:3, 3]) / to_world
    return bounds.min(axis=-1), np.diff(np.sort(bounds, axis=-1)[..., :2], axis=-1)[..., 0] > 0.05


@pytest.mark.parametrize("name", LENSES)
def test_depth_is_planar_along_each_ray_of_the_lens(name):
    frame = seen_by(LENSES[name])
    true_m, sure = wall_depth(LENSES[name], moved("rotation", 0.0))
    assert sure.mean() > 0.7
    assert np.abs(frame.depth_m / true_m - 1)[sure].max() < 1e-6


@pytest.mark.parametrize("name", LENSES)
def test_what_a_pixel_sees_is_projected_into_it_by_opencv(name):
    lens, frame = LENSES[name], seen_by(LENSES[name])
    rays = lens_rays(CAMERA, lens)
    points = np.stack([rays.right, rays.down, np.ones_like(rays.right)], axis=-1) * frame.depth_m[..., None]
    points, still, values = points.reshape(-1, 1, 3), np.zeros(3), np.array(lens.coefficients)
    if lens.model == "equidistant":
        found, _ = cv2.fisheye.projectPoints(points, still, still, CAMERA.matrix, values)
    else:
        found, _ = cv2.projectPoints(points, still, still, CAMERA.matrix, values)
    u, v = np.meshgrid(np.arange(CAMERA.width_px), np.arange(CAMERA.height_px))
    assert np.abs(found.reshape(CAMERA.height_px, CAMERA.width_px, 2) - np.stack([u, v], axis=-1)).max() < 1e-9


@cases("direction", ["down", "left"])
def test_each_line_of_a_rolling_shutter_is_seen_through_the_lens(direction):
    lens, shutter = LENSES["barrel"], Shutter.centred(0.0, 0.04, direction)
    rolled = seen_by(lens, lambda sensors: replace(sensors.request(1), rays=RequestedRays(shutter)))
    rows = direction == "down"
    times_s = shutter.line_times_s(CAMERA.height_px if rows else CAMERA.width_px)
    for line in range(0, len(times_s), 7):
        single = seen_by(lens, lambda sensors, at=times_s[line]: sensors.at(at))
        place = np.s_[line] if rows else np.s_[:, line]
        true_m, sure = wall_depth(lens, moved("rotation", times_s[line]))
        assert np.abs(rolled.depth_m[place] / true_m[place] - 1)[sure[place]].max() < 1e-6
        assert psnr_db(rolled.rgb[place], single.rgb[place]) > 65
    assert psnr_db(rolled.rgb, seen_by(lens).rgb) < 30  # the camera turns by pixels meanwhile


@pytest.mark.parametrize("name", ["barrel", "fisheye"])
def test_more_rays_through_a_pixel_stay_within_it(name):
    """Against single rays of a camera of three times as many pixels: the same rays, averaged in linear light."""
    lens, side = LENSES[name], 3
    fine = Intrinsics(
        CAMERA.width_px * side, CAMERA.height_px * side, CAMERA.fx_px * side, CAMERA.fy_px * side,
        CAMERA.cx_px * side + 1, CAMERA.cy_px * side + 1,
    )  # fmt: skip
    sensors = paths("rotation")
    with RaySession(coloured_room(), sensors, fine, OPTIONS, lens) as session:
        rgb = session.frame(sensors.request(1)).rgb.astype(float)
    light = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    light = light.reshape(CAMERA.height_px, side, CAMERA.width_px, side, 3).mean(axis=(1, 3))
    true = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    smooth, plain = seen_by(lens, samples=9).rgb, seen_by(lens).rgb
    # A few pixels are told as even though they are not, and at a border of two colours a ray may fall to either side.
    assert np.quantile(np.abs(smooth - true).max(axis=-1), 0.99) < 0.02
    assert psnr_db(smooth, true) > psnr_db(plain, true) + 10


@pytest.mark.parametrize("name", ["barrel", "pincushion"])
def test_undistorting_brings_back_the_pinhole_within_interpolation(name):
    """The control is a pinhole's frame of rays half a pixel away, interpolated back, without any lens."""
    lens, room, sensors = LENSES[name], coloured_room(smooth=True), paths("rotation")
    bent = seen_by(lens, mesh=room).rgb
    half = replace(CAMERA, cx_px=CAMERA.cx_px + 0.5, cy_px=CAMERA.cy_px + 0.5)
    seen = []
    for camera in (CAMERA, half):
        with RaySession(room, sensors, camera, OPTIONS) as session:
            seen.append(session.frame(sensors.request(1)).rgb)
    back = cv2.undistort(bent, CAMERA.matrix, np.array(lens.coefficients))
    shift = np.float32([[1, 0, 0.5], [0, 1, 0.5]])
    size, flags = (CAMERA.width_px, CAMERA.height_px), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    control = cv2.warpAffine(seen[1], shift, size, flags=flags)
    inner = np.s_[14:-14, 18:-18]  # a pincushion's border does not reach the pinhole's
    assert psnr_db(back[inner], seen[0][inner]) > psnr_db(control[inner], seen[0][inner]) - 1
    assert psnr_db(bent[inner], seen[0][inner]) < psnr_db(back[inner], seen[0][inner]) - 8  # the lens does bend it
