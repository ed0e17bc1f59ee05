# SPDX-License-Identifier: GPL-3.0-or-later
"""Dirt on the lens: what it takes away, where the light that it scatters goes, and that it stays."""

import numpy as np
import pytest
from refusals import refused
from cases import cases

from srgb import linear
from noisy_world.core.errors import NoisyWorldError
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations.shipped import lens_dirt
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped.lens_dirt import tile
from noisy_world.perturbations.shipped.lens_dirt import PARTS, Spread, glare_of

ITEM = lens_dirt.PERTURBATION


def where(index=0, temporal="fixed", seed=1):
    return FrameContext(index, (seed, "scene", "setting"), temporal)


def seen(rgb, context=None, **values):
    return ITEM.apply(rgb, ITEM.at_severity(values.pop("severity", 3), **values), context or where())


def test_before_an_even_wall_dirt_is_what_dust_absorbs():
    """Light that is scattered comes back from all around, so grease and scratches cannot be seen."""
    wall = np.full((90, 140, 3), 0.6, np.float32)
    found = linear(seen(wall, dust=0.8, smudges=0.7, scratches=0.9, size=0.5))
    dust = lens_dirt.dirt_before(where(), (90, 140), 0.5)[..., :1]
    assert np.ptp(dust) > 0.1
    assert np.abs(found - linear(0.6) * (1 - 0.8 * 0.6 * dust)).max() < 1e-4
    clean = seen(wall, dust=0.0, smudges=0.7, scratches=0.9)
    assert np.abs(linear(clean) - linear(0.6)).max() < 1e-5


def test_light_from_beside_is_seen_on_what_scatters_in_flat_light_too():
    """Before an even wall: as much of its light as dirt scatters, times what falls on it from beside."""
    wall = np.full((90, 140, 3), 0.6, np.float32)
    without, found = (linear(seen(wall, beside=beside)) for beside in (0.0, 0.7))
    dirt = lens_dirt.dirt_before(where(), (90, 140), 1.0).astype(np.float64)
    scattered = dirt @ [0.35 * 0.4, 0.35, 0.25]
    assert np.abs(found - without - 0.7 * linear(0.6) * scattered[..., None]).max() < 1e-4


def test_what_is_scattered_is_mixed_by_its_share():
    rng = np.random.default_rng(2)
    rgb = rng.random((64, 96, 3), dtype=np.float32)
    values = {"dust": 0.5, "smudges": 0.4, "scratches": 0.6, "glare": 3.0}
    found = linear(seen(rgb, **values))
    dirt = lens_dirt.dirt_before(where(), (64, 96), 1.0).astype(np.float64)
    scattered = dirt @ [0.5 * 0.4, 0.4, 0.6]
    left = 1 - scattered - dirt[..., 0] * 0.5 * 0.6
    spread = (found - linear(rgb) * left[..., None]) / (3 * scattered[..., None])
    # All that is left is far smoother than the frame, and as bright.
    assert np.abs(np.diff(spread, axis=1)).max() < 0.03
    assert spread.mean() == pytest.approx(linear(rgb).mean(), rel=0.1)


def test_glare_is_a_sum_of_gaussians_and_loses_no_light():
    small = np.zeros((161, 201, 3), np.float32)
    small[80, 100] = (50, 100, 200)
    found = glare_of(small, Spread(12.0, 0.0, 0.3))
    assert found.sum(axis=(0, 1)) == pytest.approx([50, 100, 200], rel=0.01)
    for rows, columns in ((0, 0), (3, 4), (-20, 15), (0, 40)):
        squared = rows**2 + columns**2
        sigmas = [times * 12.0 for _, times in PARTS]
        wanted = sum(
            share / (2 * np.pi * sigma**2) * np.exp(-squared / (2 * sigma**2))
            for (share, _), sigma in zip(PARTS, sigmas, strict=True)
        )
        # The narrowest is about as wide as a pixel, of which the blur takes samples.
        assert found[80 + rows, 100 + columns, 1] == pytest.approx(100 * wanted, rel=0.08, abs=1e-5)


@cases("turn_deg", [0.0, 35.0, 90.0, -60.0])
def test_streaks_run_across_the_wiping(turn_deg):
    small = np.zeros((141, 141, 3), np.float32)
    small[68:73, 68:73] = 1
    found = glare_of(small, Spread(10.0, 1.0, np.radians(turn_deg)))[..., 0].astype(np.float64)
    assert found.sum() == pytest.approx(25, rel=0.05)
    rows, columns = np.mgrid[:141, :141] - 70
    moments = [(found * item).sum() / found.sum() for item in (columns**2, rows**2, rows * columns)]
    angle = 0.5 * np.arctan2(2 * moments[2], moments[0] - moments[1])
    assert np.abs(np.sin(angle - np.radians(turn_deg))) < 0.03
    widths = np.linalg.eigvalsh([[moments[0], moments[2]], [moments[2], moments[1]]])
    assert np.sqrt(widths[1]) == pytest.approx(16, rel=0.1)
    assert widths[0] < 0.05 * widths[1]


def test_the_picture_of_dirt_repeats_and_has_all_three():
    drawn = tile().astype(float)
    assert (drawn.reshape(-1, 3).max(axis=0) > 200).all()
    assert drawn[..., 0].mean() < 10  # most of the glass has no speck
    for axis in (0, 1):
        across = np.abs(np.take(drawn, 0, axis) - np.take(drawn, -1, axis)).mean(axis=0)
        inside = np.abs(np.diff(drawn, axis=axis)).mean(axis=(0, 1))
        assert (across < 2.5 * inside + 0.5).all()


def test_dirt_stays_where_it_is():
    (step,) = parse_steps([{"lens_dirt": {"severity": 2}}], ConfigPath("test"), registry())
    assert step.temporal == "fixed"
    given = [{"lens_dirt": {"temporal": "drift"}}]
    refused(parse_steps, given, ConfigPath("test"), registry(), names="drift", error=NoisyWorldError)


def test_more_dirt_at_each_severity():
    rgb = np.random.default_rng(3).random((80, 120, 3), dtype=np.float32)
    changed = [np.abs(seen(rgb, severity=severity) - rgb).mean() for severity in range(1, 6)]
    assert (np.diff(changed) > 0).all()
    assert np.abs(seen(rgb, dust=0.0, smudges=0.0, scratches=0.0) - rgb).max() < 1e-5
