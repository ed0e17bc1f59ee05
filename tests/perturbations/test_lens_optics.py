# SPDX-License-Identifier: GPL-3.0-or-later
"""Vignetting, lateral chromatic aberration and bloom against their laws."""

import math

import numpy as np
import pytest
from cases import cases

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.srgb import decoded, encoded
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped.bloom import PARTS, Bloom
from noisy_world.perturbations.shipped.bloom import apply as apply_bloom
from noisy_world.perturbations.shipped.chromatic_aberration import ChromaticAberration
from noisy_world.perturbations.shipped.vignetting import Vignetting, gain

CAMERA = Intrinsics(80, 60, 50.0, 48.0, 36.25, 31.5)


def context(camera=CAMERA):
    return FrameContext(0, (1, "a"), intrinsics=camera)


def linear(rgb):
    rgb = np.asarray(rgb, float)
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


@cases(
    ("loss", "power", "cosine"),
    [(0.5, 3.0, 0.0), (0.0, 3.0, 4.0), (0.8, 1.0, 2.0), (1.0, 6.0, 0.0), (0.0, 2.0, 0.0)],
)
def test_light_is_lost_as_the_law_says_on_linear_light(loss, power, cosine):
    grey = np.full((60, 80, 3), 0.6, np.float32)
    made = registry()["vignetting"].apply(grey, Vignetting(loss, power, cosine), context())
    for row, column in ((0, 0), (59, 79), (31, 36), (10, 70)):
        x, y = column - 36.25, row - 31.5
        angle = np.arctan(np.hypot(x / 50.0, y / 48.0))
        share = max(0.0, 1 - loss * (np.hypot(x, y) / 50.0) ** power) * np.cos(angle) ** cosine
        assert linear(made[row, column, 1]) / linear(0.6) == pytest.approx(share, abs=2e-6)


def test_a_thin_lens_passes_the_fourth_power_of_the_cosine():
    camera = Intrinsics(3, 1, 1.0, 1.0, 0.0, 0.0)  # 45 degrees at the second pixel
    share = gain(Vignetting(0.0, 3.0, 4.0), context(camera), (3, 1))
    np.testing.assert_allclose(share[0], [1.0, 0.25, 0.04], rtol=1e-6)


def test_without_intrinsics_the_axis_and_the_view_are_as_given():
    known = Intrinsics(80, 60, 40.0, 40.0, 39.5, 29.5)
    given = Vignetting(0.5, 3.0, 4.0, view_deg=90.0)
    assert np.array_equal(gain(given, context(known), (80, 60)), gain(given, context(None), (80, 60)))


@cases(("red", "blue"), [(2.0, -2.0), (-1.25, 0.75), (0.0, 3.0)])
def test_colours_of_a_slope_are_magnified_about_the_axis(red, blue):
    # A plane's values are linear in the place, so interpolation is exact away from the repeated border.
    u, v = np.meshgrid(np.arange(80.0), np.arange(60.0))
    plane = 0.2 + 0.004 * u + 0.003 * v
    made = registry()["chromatic_aberration"].apply(
        np.repeat(plane[..., None], 3, axis=2).astype(np.float32), ChromaticAberration(red, blue), context()
    )
    inner = np.s_[6:-6, 6:-6]
    for channel, out_px in ((0, red), (1, 0.0), (2, blue)):
        times = 1 + out_px / 50.0  # half the diagonal of 80 x 60 is 50
        true = 0.2 + 0.004 * (36.25 + (u - 36.25) / times) + 0.003 * (31.5 + (v - 31.5) / times)
        np.testing.assert_allclose(made[..., channel][inner], true[inner], atol=1e-6)


def test_green_and_the_axis_stay():
    rgb = np.random.default_rng(2).random((61, 81, 3), dtype=np.float32)
    camera = Intrinsics(81, 61, 50.0, 50.0, 40.0, 30.0)
    made = registry()["chromatic_aberration"].apply(rgb, ChromaticAberration(3.0, -3.0), context(camera))
    assert np.array_equal(made[..., 1], rgb[..., 1])
    assert np.array_equal(made[30, 40], rgb[30, 40])
    assert not np.array_equal(made[..., 0], rgb[..., 0])


def test_bloom_loses_no_light_and_gives_no_negative():
    light = np.full((240, 320, 3), 0.02, np.float32)
    light[119:122, 159:162] = 100.0
    apart = [(119, 4.0), (200, 20.0)]
    for row, strength in apart:
        light[row, 60] = strength
    made = decoded(apply_bloom(encoded(light), Bloom(0.4, 20.0), context(None)))
    assert made.min() >= 0.02 * 0.99
    assert made.sum() == pytest.approx(light.sum(), rel=1e-4)


def test_bloom_of_a_lamp_is_three_gaussians():
    """Across a long lamp's edge, each part's share of what is spread is the integral of its Gaussian."""
    light = np.zeros((200, 600, 3), np.float32)
    light[:, 300:] = 20.0
    made = decoded(apply_bloom(encoded(light), Bloom(0.5, 40.0), context(None)))[100, :, 1]
    across = np.arange(600) - 299.5
    normal = [0.5 * (1 + np.vectorize(math.erf)(across / (40.0 * times) / math.sqrt(2))) for _, times, _ in PARTS]
    law = 20.0 * (0.5 * (across > 0) + 0.5 * sum(part[0] * each for part, each in zip(PARTS, normal, strict=True)))
    assert np.abs(made - law).max() < 20.0 * 0.5 * 0.01
    assert np.abs(made - law).mean() < 20.0 * 0.5 * 0.003


def test_bloom_of_no_amount_and_of_no_reach_is_the_image():
    rgb = np.random.default_rng(4).random((30, 40, 3), dtype=np.float32)
    assert np.abs(apply_bloom(rgb, Bloom(0.0, 60.0), context(None)) - rgb).max() < 1e-6
    assert np.isfinite(apply_bloom(rgb, Bloom(1.0, 0.0), context(None))).all()
