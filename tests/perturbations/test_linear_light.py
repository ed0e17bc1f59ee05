# SPDX-License-Identifier: GPL-3.0-or-later
"""sRGB's curve, calculated fast, against IEC 61966-2-1 in float64."""

import numpy as np

from noisy_world.perturbations._linear_light import decoded, encoded


def test_the_curve_is_the_standard_s_to_a_millionth():
    given = np.linspace(-0.1, 1, 300_000, dtype=np.float32).reshape(1000, 100, 3)[:, ::-1]  # not contiguous
    exact = given.astype(np.float64)
    light = np.where(exact <= 0.04045, exact / 12.92, ((np.maximum(exact, 0) + 0.055) / 1.055) ** 2.4)
    assert np.abs(decoded(given) - light).max() < 1e-6
    bright = np.where(exact <= 0.0031308, exact * 12.92, 1.055 * np.maximum(exact, 0) ** (1 / 2.4) - 0.055)
    assert np.abs(encoded(given) - bright).max() < 1e-6


def test_lamps_keep_their_light():
    lamps = np.array([[[1.0, 4.0, 20.0], [100.0, 1000.0, 0.0]]], np.float32)
    assert np.abs(decoded(encoded(lamps)) / np.maximum(lamps, 1e-9) - (lamps > 0)).max() < 5e-6
