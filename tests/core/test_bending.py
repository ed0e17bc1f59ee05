# SPDX-License-Identifier: GPL-3.0-or-later
"""A pinhole's images bent as a lens does, against planes in closed form and pictures that are known everywhere."""

import cv2
import numpy as np
from cases import cases

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.lens import lens_rays
from noisy_world.core.lens import Distortion
from noisy_world.core.lens import Bending, overscanned

CAMERA = Intrinsics(160, 120, 100.0, 96.0, 77.5, 62.0)
LENS = Distortion("radial-tangential", (-0.25, 0.06, 0.002, -0.001))
FISHEYE = Distortion("equidistant", (-0.02, 0.01, -0.004, 0.001))


def plane(rays, normal, distance_m):
    return distance_m / (rays @ np.asarray(normal))


def lens_directions(camera, lens):
    found = lens_rays(camera, lens)
    return np.stack([found.right, found.down, np.ones_like(found.right)], axis=-1)


@cases("lens", [LENS, FISHEYE])
def test_depth_of_a_plane_is_exact_and_no_border_is_missing(lens):
    pinhole = overscanned(CAMERA, lens)
    bending = Bending(pinhole, CAMERA, lens)
    for normal in ([0.0, 0.0, 1.0], [0.2, -0.1, 1.0], [0.05, 0.3, 1.0]):
        seen_m = plane(pinhole.ray_directions(), normal, 2.5).astype(np.float32)
        true_m = plane(lens_directions(CAMERA, lens), normal, 2.5)
        assert np.abs(bending.depth_m(seen_m) / true_m - 1).max() < 1e-6


@cases("lens", [LENS, FISHEYE])
def test_a_line_needs_few_of_the_pinholes_and_is_the_same_plane(lens):
    """Of a plane in closed form, and of a picture the whole has: each line alone is the whole image's."""
    pinhole = overscanned(CAMERA, lens)
    bending, normal = Bending(pinhole, CAMERA, lens), [0.2, -0.1, 1.0]
    seen_m = plane(pinhole.ray_directions(), normal, 2.5).astype(np.float32)
    true_m = plane(lens_directions(CAMERA, lens), normal, 2.5)
    picture = np.random.default_rng(0).uniform(size=(*seen_m.shape, 4)).astype(np.float32)
    whole = bending.rgb(picture)
    for rows, columns in (
        (slice(0, 1), slice(0, 160)),
        (slice(60, 61), slice(0, 160)),
        (slice(0, 120), slice(159, 160)),
    ):
        down, across, part = bending.part(rows, columns)
        assert (down.stop - down.start) * (across.stop - across.start) < 0.4 * seen_m.size
        np.testing.assert_allclose(part.depth_m(seen_m[down, across]), true_m[rows, columns], rtol=1e-6)
        np.testing.assert_allclose(part.rgb(picture[down, across]), whole[rows, columns], atol=1e-6)


def test_between_two_surfaces_there_is_nothing():
    pinhole = overscanned(CAMERA, LENS)
    bending = Bending(pinhole, CAMERA, LENS)
    seen_m = np.full((pinhole.height_px, pinhole.width_px), 2.0, np.float32)
    seen_m[:, 90:] = 3.0
    seen_m[60:70, 40:60] = 0.0
    made = bending.depth_m(seen_m)
    assert set(np.unique(made)) == {np.float32(0.0), np.float32(2.0), np.float32(3.0)}
    u = lens_rays(CAMERA, LENS).right * pinhole.fx_px + pinhole.cx_px
    assert np.array_equal(made == 3.0, (u >= 89.5) & (made > 0))


def test_a_smooth_picture_is_shown_where_the_lens_brings_it():
    pinhole = overscanned(CAMERA, LENS)
    bending = Bending(pinhole, CAMERA, LENS)

    def picture(rays):
        return (0.5 + 0.4 * np.sin(3 * rays @ np.array([[1.0, 2.0, 0.3], [0.4, -1.0, 2.0], [0.1, 0.2, 0.3]]))).astype(
            np.float32
        )

    made = bending.rgb(picture(pinhole.ray_directions()))
    assert np.abs(made - picture(lens_directions(CAMERA, LENS))).max() < 1e-3  # of interpolation
    coarse = bending.rgb(np.rint(picture(pinhole.ray_directions()) * 255).astype(np.uint8))
    assert coarse.dtype == np.uint8
    assert np.abs(coarse / 255 - made).max() < 1.01 / 255


def test_undistorting_brings_back_the_pinhole_within_interpolation():
    """The control is a picture that is moved by half a pixel and back: interpolated twice, bent nowhere."""
    pinhole = overscanned(CAMERA, LENS)
    rng = np.random.default_rng(4)
    rgb = cv2.GaussianBlur(rng.uniform(0, 1, (pinhole.height_px, pinhole.width_px, 3)).astype(np.float32), (0, 0), 1.5)
    left, top = int(pinhole.cx_px - CAMERA.cx_px + 0.5), int(pinhole.cy_px - CAMERA.cy_px)
    shifted = Intrinsics(160, 120, 100.0, 96.0, pinhole.cx_px - left, pinhole.cy_px - top)
    bent = Bending(pinhole, shifted, LENS).rgb(rgb)
    back = cv2.undistort(bent, shifted.matrix, np.array(LENS.coefficients))
    true = rgb[top : top + 120, left : left + 160]
    half = cv2.warpAffine(true, np.float32([[1, 0, 0.5], [0, 1, 0.5]]), (160, 120))
    control = cv2.warpAffine(half, np.float32([[1, 0, -0.5], [0, 1, -0.5]]), (160, 120))
    inner = np.s_[12:-12, 12:-12]

    def psnr_db(seen):
        return -10 * np.log10(np.mean((seen[inner] - true[inner]) ** 2))

    assert psnr_db(back) > psnr_db(control)
    assert psnr_db(back) > 35
