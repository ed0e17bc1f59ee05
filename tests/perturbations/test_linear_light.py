# SPDX-License-Identifier: GPL-3.0-or-later
"""sRGB's curve, calculated fast, against IEC 61966-2-1 in float64."""

import numpy as np

import srgb
from noisy_world.core.srgb import decoded, encoded


def test_the_curve_is_the_standard_s_to_a_millionth():
    given = np.linspace(-0.1, 1, 300_000, dtype=np.float32).reshape(1000, 100, 3)[:, ::-1]  # not contiguous
    assert np.abs(decoded(given) - srgb.linear(given)).max() < 1e-6
    assert np.abs(encoded(given) - srgb.encoded(given)).max() < 1e-6


def test_lamps_keep_their_light():
    lamps = np.array([[[1.0, 4.0, 20.0], [100.0, 1000.0, 0.0]]], np.float32)
    assert np.abs(decoded(encoded(lamps)) / np.maximum(lamps, 1e-9) - (lamps > 0)).max() < 5e-6
