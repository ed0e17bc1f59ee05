# SPDX-License-Identifier: GPL-3.0-or-later
"""The air's light on lit frames: the sky's own, or a mean that lamps do not move."""

import numpy as np
import pytest
from noisy_world.core.perturbing.execution import ColourWork
from noisy_world.core.perturbing.kinds import FrameContext
from noisy_world.core.perturbing.lit import on_light
from noisy_world.core.perturbing.reading import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry
from noisy_world.perturbations._air_light import air_light, robust_mean
from srgb import encoded

DUSK = np.array([0.1620, 0.1001, 0.1070], np.float32)  # 112, 89, 92 of 255
BY_DEPTH = ("fog_depth", "haze", "snow_depth", "rain_depth")


def dusk_street(lamp=0.0):
    """Light (H, W, 3) of a street under a dusk sky, with a lamp on a 400th of it; and its depth (H, W)."""
    rng = np.random.default_rng(3)
    light = (rng.uniform(0.01, 0.2, (60, 80, 1)) * rng.uniform(0.8, 1, (60, 80, 3))).astype(np.float32)
    light[:20] = DUSK
    depth_m = np.tile(np.linspace(3, 70, 80, dtype=np.float32), (60, 1))
    depth_m[:20] = 0
    light[40:43, 10:14] = lamp or light[40:43, 10:14]
    return light, depth_m


def made(light, depth_m, name, *, lit=True, **values):
    steps = parse_steps([{name: values}], ConfigPath("test"), registry())
    work = ColourWork.of(steps, FrameContext(5, (7, "street", "x"), read_depth_m=lambda: depth_m))
    return on_light(work, light) if lit else work.on(encoded(light).astype(np.float32))


@pytest.mark.parametrize("name", BY_DEPTH)
@pytest.mark.parametrize("severity", [1, 5])
def test_a_dusk_sky_stays_dusk(name, severity):
    light, depth_m = dusk_street()
    found = 255 * encoded(made(light, depth_m, name, severity=severity)[:18].mean((0, 1)))
    assert np.abs(found - (112, 89, 92)).max() < 1


@pytest.mark.parametrize("name", BY_DEPTH)
def test_a_lamp_does_not_light_the_air(name):
    far = np.s_[45:, 60:]
    before, after = (made(*dusk_street(lamp), name, severity=5)[far].mean() for lamp in (0, 100))
    assert abs(after / before - 1) < 0.02
    light, depth_m = dusk_street(100)
    without = air_light(dusk_street()[0][20:], depth_m[20:]).surfaces
    assert np.abs(air_light(light[20:], depth_m[20:]).surfaces / without - 1).max() < 0.02


def test_the_mean_of_what_is_even_is_that_and_no_pixels_are_dark():
    even = np.tile(DUSK, (50, 1))
    assert np.allclose(robust_mean(even), DUSK, rtol=1e-5)
    assert not robust_mean(even[:0]).any()


@pytest.mark.parametrize("name", BY_DEPTH)
def test_a_colour_that_is_given_is_the_airs_and_the_sky_can_be_left(name):
    light, depth_m = dusk_street()
    red = made(light, depth_m, name, severity=5, air_red=0.9, air_green=0.1, air_blue=0.1)
    assert (red[:, 70:, 0] > light[:, 70:, 0]).mean() > 0.9
    assert red[22:, 70:, 0].mean() > 1.2 * red[22:, 70:, 1].mean()
    left = made(light, depth_m, name, severity=5, air_red=0.9, air_green=0.1, air_blue=0.1, leave_sky=True)
    veiled, kept = (np.abs(item[:20] - light[:20]).mean() for item in (red, left))
    assert kept < 0.3 * veiled if "snow" in name or "rain" in name else kept < 1e-6  # flakes stand before it
    assert np.array_equal(left[20:], red[20:])


def test_a_grey_that_is_given_is_used_on_lit_frames_too():
    light, depth_m = dusk_street()
    grey = made(light, depth_m, "fog_depth", visibility_m=10, airlight=0.5)
    assert np.abs(255 * encoded(grey[:20]) - 127.5).max() < 0.01
    assert np.array_equal(grey, made(light, depth_m, "fog_depth", visibility_m=10, air="grey", airlight=0.5))


@pytest.mark.parametrize("name", BY_DEPTH)
def test_frames_that_are_not_lit_have_the_light_that_they_had(name):
    light, depth_m = dusk_street()
    plain = "mean" if name in ("snow_depth", "rain_depth") else "grey"
    before = made(light, depth_m, name, lit=False, severity=2, air=plain)
    assert np.array_equal(made(light, depth_m, name, lit=False, severity=2), before)
    assert np.abs(made(light, depth_m, name, lit=False, severity=2, air="scene").astype(int) - before).mean() > 1


@pytest.mark.parametrize(("severity", "visibility_m"), [(1, 1000), (3.5, 150), (5, 50), (None, 200)])
def test_fog_outdoors_has_the_severities_of_streets(severity, visibility_m):
    values = {"outdoors": True} | ({} if severity is None else {"severity": severity})
    (step,) = parse_steps([{"fog_depth": values}], ConfigPath("test"), registry())
    assert step.parameters(step.severity).visibility_m == visibility_m
    (step,) = parse_steps([{"fog_depth": values | {"visibility_m": 7.0}}], ConfigPath("test"), registry())
    assert step.parameters(step.severity).visibility_m == 7
