# SPDX-License-Identifier: GPL-3.0-or-later
"""Haze against Koschmieder's law at three wavelengths, in float64."""

import numpy as np
import pytest

from srgb import linear
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.shipped.haze import PERTURBATION, Haze

DEPTHS_M = np.array([0, np.nan, 1e-6, 0.5, 3, 40, 250, 1e4, 1e10, np.inf], np.float32)


def hazed(rgb, depth_m, **values):
    context = FrameContext(0, (1,), read_depth_m=lambda: depth_m)
    return PERTURBATION.apply(rgb, PERTURBATION.at_severity(3, **values), context)


def test_each_channel_fades_by_its_own_wavelength():
    rgb = np.random.default_rng(0).random((9, len(DEPTHS_M), 3), dtype=np.float32)
    rgb[0] = 1.055 * 100 ** (1 / 2.4) - 0.055  # a lamp
    depth_m = np.repeat(DEPTHS_M[None], 9, axis=0)
    for angstrom, blueness in ((0.0, 1.0), (1.3, 0.5), (4.0, 1.0)):
        found = hazed(rgb, depth_m, visibility_m=300.0, angstrom=angstrom, blueness=blueness, airlight=0.7, void_m=2e4)
        ratios = 550 / np.array([611.4, 549.1, 464.2])
        far_m = np.where(depth_m > 0, np.minimum(depth_m, 2e4), 2e4)[..., None]
        seen = 0.05 ** (far_m / 300 * ratios**angstrom)
        light = ratios ** (angstrom * blueness)
        light *= linear(0.7) / (light @ [0.2126, 0.7152, 0.0722])
        apart = np.abs(linear(found) - (linear(rgb) * seen + light * (1 - seen)))
        assert apart[1:].max() < 1e-4
        assert (apart[0] / linear(rgb[0])).max() < 1e-5


def test_haze_is_blue_and_what_shines_through_it_is_red():
    rgb, depth_m = np.zeros((1, 2, 3), np.float32), np.full((1, 2), 60.0, np.float32)
    rgb[0, 1] = 1
    dark, lamp = linear(hazed(rgb, depth_m))[0]
    assert dark[2] > dark[1] > dark[0] > 0
    through = lamp - dark
    assert through[0] > through[1] > through[2] > 0
    grey = linear(hazed(rgb, depth_m, angstrom=0.0))[0, 0]
    assert grey == pytest.approx([grey[0]] * 3, rel=1e-5)


def test_severities_are_denser_and_denser():
    seen = [np.exp(-30 * PERTURBATION.at_severity(k).extinction_per_m()) for k in (1, 2, 3, 4, 5)]
    assert (np.diff(seen, axis=0) < 0).all()
    assert Haze().light() @ [0.2126, 0.7152, 0.0722] == pytest.approx(linear(0.8))
