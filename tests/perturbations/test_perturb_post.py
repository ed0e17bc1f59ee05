# SPDX-License-Identifier: GPL-3.0-or-later
"""Brightness, contrast, JPEG and pixelate against closed forms and plain loops."""

import colorsys
import math

import numpy as np
import pytest
from cases import cases
from pixelating import pixelated

from noisy_world.images.pixels import rgb_bytes
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations import registry

pytestmark = pytest.mark.filterwarnings("error")

POST = ("brightness", "contrast", "jpeg_compression", "pixelate")
# The tables of the paper, written out again.
TABLES = {
    "brightness": ("offset", [0.1, 0.2, 0.3, 0.4, 0.5]),
    "contrast": ("factor", [0.4, 0.3, 0.2, 0.1, 0.05]),
    "jpeg_compression": ("quality", [25, 18, 15, 10, 7]),
    "pixelate": ("factor", [0.6, 0.5, 0.4, 0.3, 0.25]),
}
# The luminance table of ITU-T T.81, annex K.1.
LUMINANCE = """
16 11 10 16 24 40 51 61 12 12 14 19 26 58 60 55 14 13 16 24 40 57 69 56 14 17 22 29 51 87 80 62
18 22 37 56 68 109 103 77 24 35 55 64 81 104 113 92 49 64 78 87 103 121 120 101 72 92 95 98 112 100 103 99
"""


def perturbed(name, rgb, severity=3, **given):
    item = registry()[name]
    kept = rgb.copy()
    apply = item.apply if rgb.dtype == np.float32 else item.apply_bytes
    result = apply(rgb, item.at_severity(severity, **given), FrameContext(0, ("test",)))
    assert result.dtype == rgb.dtype
    assert result.shape == rgb.shape
    np.testing.assert_array_equal(rgb, kept)
    return result


def colours(*shape):
    return np.random.default_rng(5).random((*shape, 3), np.float32)


def smooth(height, width):
    y, x = np.mgrid[:height, :width]
    return np.stack([0.5 + 0.4 * np.sin(x / 9 + c) * np.cos(y / (7 + c)) for c in range(3)], -1).astype(np.float32)


@cases("name", POST)
def test_severities_are_the_papers_and_the_default_is_the_third(name):
    key, table = TABLES[name]
    item = registry()[name]
    assert [getattr(item.at_severity(level), key) for level in range(1, 6)] == table
    assert item.parameters() == item.at_severity(3)


def test_a_fractional_severity_rounds_the_quality():
    assert registry()["jpeg_compression"].at_severity(2.5).quality == 17  # 16.5, half up
    assert type(registry()["jpeg_compression"].at_severity(4.5).quality) is int
    assert registry()["brightness"].at_severity(2.5).offset == pytest.approx(0.25)


@cases("offset", [0.0, 0.1, 0.5, 1.0])
def test_brightness_adds_to_the_value_and_keeps_hue_and_saturation(offset):
    rgb = colours(20, 15)
    rgb[0, 0], rgb[0, 1], rgb[0, 2], rgb[0, 3] = 0, 1, 0.5, (1, 0, 0)
    result = np.clip(perturbed("brightness", rgb, offset=offset), 0, 1)
    for clean, bright in zip(rgb.reshape(-1, 3).tolist(), result.reshape(-1, 3), strict=True):
        hue, saturation, value = colorsys.rgb_to_hsv(*clean)
        np.testing.assert_allclose(bright, colorsys.hsv_to_rgb(hue, saturation, min(value + offset, 1)), atol=1e-6)


def test_what_is_all_but_black_has_no_hue_to_blow_up():
    for value in (1e-45, 1e-38, 1e-20, 1e-7):
        rgb = np.full((2, 2, 3), (value, 0, value / 3), np.float32)
        np.testing.assert_allclose(perturbed("brightness", rgb, offset=0.25), 0.25)


@cases("factor", [0.0, 0.05, 0.4, 1.0, 3.0])
def test_contrast_scales_each_channel_about_its_own_mean(factor):
    rgb = colours(33, 21) * np.array([1, 0.5, 0.25], np.float32)
    means = rgb.astype(np.float64).mean(axis=(0, 1))
    np.testing.assert_allclose(perturbed("contrast", rgb, factor=factor), means + factor * (rgb - means), atol=1e-6)


def quantisation(quality):
    """libjpeg's table of a quality below 50: annex K's, scaled by 5000 / quality percent, at most 255."""
    table = np.array(LUMINANCE.split(), int).reshape(8, 8)
    return np.clip((table * (5000 // quality) + 50) // 100, 1, 255)


def code_grey(grey, quality):
    """A JPEG of a grey image whose sides are multiples of 8, in float64."""
    u = np.arange(8)
    basis = np.sqrt(np.where(u == 0, 1, 2) / 8)[:, None] * np.cos((2 * u[None] + 1) * u[:, None] * math.pi / 16)
    result = np.empty(grey.shape)
    for y in range(0, grey.shape[0], 8):
        for x in range(0, grey.shape[1], 8):
            block = basis @ (grey[y : y + 8, x : x + 8] - 128.0) @ basis.T
            kept = np.round(block / quantisation(quality)) * quantisation(quality)
            result[y : y + 8, x : x + 8] = basis.T @ kept @ basis + 128
    return np.clip(np.round(result), 0, 255)


@cases("quality", TABLES["jpeg_compression"][1])
def test_jpeg_is_the_standards_on_grey(quality):
    grey = rgb_bytes(smooth(64, 88)[..., 0] + 0.1 * colours(64, 88)[..., 1])
    result = perturbed("jpeg_compression", np.repeat(grey[..., None], 3, 2), quality=quality)
    np.testing.assert_array_equal(result.max(axis=2), result.min(axis=2))
    error = np.abs(result[..., 0] - code_grey(grey, quality))
    assert np.mean(error > 1) < 0.04  # libjpeg's DCT is of whole numbers: a coefficient half-way may round elsewhere
    assert error.mean() < 0.15


@cases("quality", TABLES["jpeg_compression"][1])
@cases("grey", [0, 1, 77, 128, 200, 255])
def test_a_constant_grey_is_quantised_as_its_mean(grey, quality):
    step = quantisation(quality)[0, 0]
    expected = np.clip(128 + math.floor(8 * (grey - 128) / step + 0.5) * step / 8, 0, 255)
    result = perturbed("jpeg_compression", np.full((9, 23, 3), grey, np.uint8), quality=quality)
    assert np.abs(result - expected).max() <= 1


def test_jpeg_halves_the_resolution_of_colours_and_not_that_of_grey():
    red, blue = (230, 60, 60), (60, 107, 255)  # of about the same luma
    rgb = np.tile(np.array([[red, blue]], np.uint8), (32, 16, 1))
    result = perturbed("jpeg_compression", rgb, quality=100).astype(int)
    assert abs((result[:, ::2, 0] - result[:, 1::2, 0]).mean()) < 20
    checks = np.tile(np.array([[[40] * 3, [200] * 3]], np.uint8), (32, 16, 1))
    np.testing.assert_allclose(perturbed("jpeg_compression", checks, quality=100), checks, atol=2)


def test_jpeg_keeps_the_order_of_colours():
    rgb = np.full((16, 16, 3), (200, 100, 50), np.uint8)
    np.testing.assert_allclose(perturbed("jpeg_compression", rgb, quality=95), rgb, atol=3)


@cases("factor", [0.6, 0.5, 0.4, 0.3, 0.25, 0.37, 1.0, 0.05, 0.001])
@cases("shape", [(20, 30), (37, 23), (41, 1), (1, 64), (70, 55)])
def test_pixelate_is_pils_box_down_and_nearest_up(factor, shape):
    rgb = colours(*shape)
    np.testing.assert_allclose(perturbed("pixelate", rgb, factor=factor), pixelated(rgb, factor), atol=6e-6)


def test_pixelate_of_whole_blocks_is_the_mean_of_each():
    rgb = colours(24, 40)
    means = rgb.astype(np.float64).reshape(6, 4, 10, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(
        perturbed("pixelate", rgb, factor=0.25), means.repeat(4, axis=0).repeat(4, axis=1), atol=6e-6
    )


def test_the_means_of_bytes_round_half_up():
    rgb = np.array([[[10, 0, 254], [11, 1, 255]]], np.uint8)
    assert perturbed("pixelate", rgb, factor=0.5).tolist() == [[[11, 1, 255]] * 2]


def test_bytes_are_the_rounded_floats_for_every_block():
    rgb = np.random.default_rng(1).integers(0, 256, (90, 100, 3), np.uint8)
    for factor in np.linspace(0.01, 1, 60):
        floats = perturbed("pixelate", rgb / np.float32(255), factor=float(factor))
        np.testing.assert_array_equal(perturbed("pixelate", rgb, factor=float(factor)), rgb_bytes(floats))


@pytest.mark.one_python
@cases("name", POST)
@cases("shape", [(1, 1), (1, 7), (7, 1), (4, 1), (3, 4), (33, 41), (1081, 1921)])
def test_every_size_and_every_colour(name, shape):
    for value in (0, 1, 0.4) if shape[0] < 1000 else (0.4,):
        result = perturbed(name, np.full((*shape, 3), value, np.float32), 5)
        expected = min(value + 0.5, 1) if name == "brightness" else value
        tolerance = 4 / 255 if name == "jpeg_compression" else 1e-5
        rounded = 11 / 255 if name == "jpeg_compression" else 1 / 255
        np.testing.assert_allclose(np.clip(result, 0, 1), expected, atol=max(tolerance, rounded))
        as_bytes = perturbed(name, np.full((*shape, 3), round(value * 255), np.uint8), 5)
        np.testing.assert_allclose(as_bytes / 255, expected, atol=rounded)


def test_nothing_asked_for_is_the_identity():
    rgb = colours(31, 17)
    for name, given in (("brightness", {"offset": 0.0}), ("contrast", {"factor": 1.0}), ("pixelate", {"factor": 1.0})):
        np.testing.assert_allclose(perturbed(name, rgb, **given), rgb, atol=5e-6)
        np.testing.assert_array_equal(perturbed(name, rgb_bytes(rgb), **given), rgb_bytes(rgb))
