# SPDX-License-Identifier: GPL-3.0-or-later
"""The inverse of a lens against OpenCV's own projection, and lenses that have none."""

import cv2
import numpy as np
import pytest
from cases import cases

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.lens import lens_problem, lens_rays, projected, straightened
from noisy_world.core.lens import Distortion

CAMERA = Intrinsics(752, 480, 458.654, 457.296, 367.215, 248.375)
WIDE = Intrinsics(1200, 680, 600.0, 600.0, 599.5, 339.5)
# EuRoC's cam0 and TUM's freiburg1 as their files have them, the middle of TUM-VI's cam0; the others are chosen.
LENSES = [
    (CAMERA, Distortion("radial-tangential", (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05))),
    (Intrinsics(640, 480, 517.3, 516.5, 318.6, 255.3),
     Distortion("radial-tangential", (0.2624, -0.9531, -0.0054, 0.0026, 1.1633))),
    (WIDE, Distortion("radial-tangential", (0.5, 0.05, 1e-3, -2e-3, 0.01, 0.6, 0.1, 0.0))),
    (WIDE, Distortion("equidistant", (-0.01, 0.02, -0.01, 0.002))),
    (Intrinsics(400, 360, 190.978, 190.973, 198.932, 180.897),
     Distortion("equidistant", (0.0034824, 0.0007150, -0.0020532, 0.00020294))),
]  # fmt: skip


@pytest.mark.parametrize(("camera", "lens"), LENSES, ids=range(len(LENSES)))
def test_rays_are_projected_back_into_their_pixels_by_opencv(camera, lens):
    assert lens_problem(camera, lens) == ""
    rays = lens_rays(camera, lens)
    points = np.stack([rays.right, rays.down, np.ones_like(rays.right)], axis=-1).reshape(-1, 1, 3)
    project = cv2.fisheye.projectPoints if lens.model == "equidistant" else cv2.projectPoints
    found, _ = project(points, np.zeros(3), np.zeros(3), camera.matrix, np.array(lens.coefficients))
    u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    off_px = np.abs(found.reshape(camera.height_px, camera.width_px, 2) - np.stack([u, v], axis=-1))
    assert off_px.max() < 1e-9  # the bar is 1e-3


@cases(("camera", "lens"), [
    (WIDE, Distortion("radial-tangential", (-0.5, 0.0, 0.0, 0.0))),
    (WIDE, Distortion("radial-tangential", (-0.25, 0.0, 0.0, 0.0))),
    (WIDE, Distortion("equidistant", (-0.3, 0.0, 0.0, 0.0))),
    (WIDE, Distortion("radial-tangential", (0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0))),
    (Intrinsics(640, 480, 100.0, 100.0, 319.5, 239.5), Distortion("equidistant", (0.01, 0.0, 0.0, 0.0))),
])  # fmt: skip
def test_a_lens_that_folds_over_within_the_image_is_told(camera, lens):
    assert lens_problem(camera, lens) != ""


@cases("k1", np.linspace(-0.6, -0.05, 23).tolist())
def test_the_fold_is_where_the_closed_form_puts_it(k1):
    # r + k1 r^3 is largest at r^2 = -1 / (3 k1), where it is 2 r / 3. The outer corner is the farthest place.
    most = 2 / 3 * np.sqrt(-1 / (3 * k1))
    camera = Intrinsics(400, 300, 300.0, 300.0, 199.5, 149.5)
    corner = np.hypot(200.0, 150.0) / 300.0
    folds = lens_problem(camera, Distortion("radial-tangential", (k1, 0.0, 0.0, 0.0))) != ""
    assert folds == (corner > most)


def test_beyond_the_largest_radius_there_is_no_ray():
    lens = Distortion("radial-tangential", (-0.3, 0.0, 0.0, 0.0))
    most = 2 / 3 * np.sqrt(1 / 0.9)
    x, _ = straightened(lens, np.array([0.99 * most, 1.01 * most]), np.zeros(2))
    assert x[0] + lens.coefficients[0] * x[0] ** 3 == pytest.approx(0.99 * most, abs=1e-13)
    assert x[0] < np.sqrt(1 / 0.9)
    assert np.isnan(x[1])


def test_points_beside_the_image_are_projected_nowhere():
    lens = Distortion("radial-tangential", (-0.28, 0.07, 0.0, 0.0))
    radius = lens_rays(CAMERA, lens).radius
    points = np.array([[0.1, 0.2, 1.0], [1.01 * radius, 0.0, 1.0], [-30.0, 2.0, 1.0]])
    u, v = projected(points, CAMERA, lens)
    assert np.isfinite(u[0])
    assert np.isnan(u[1:]).all()
    assert np.isnan(v[1:]).all()
    plain_u, _ = projected(points, CAMERA, None)
    assert plain_u[2] == pytest.approx(-30 * CAMERA.fx_px + CAMERA.cx_px)
