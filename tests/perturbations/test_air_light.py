# SPDX-License-Identifier: GPL-3.0-or-later
"""The air's light on lit frames: the sky's own, or a mean that lamps do not move."""

import math

import numpy as np
import pytest
from cases import cases
from noisy_world.core.node_graph import Graph, GroupInput
from noisy_world.core.graph_arrays import carried_out
from noisy_world.perturbations.execution import ColourWork
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.execution import on_light
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped._air import air_light, robust_mean
from noisy_world.perturbations.shipped._air import DROP, FLAKE, VOLUMES, WIDTHS_RAD
from noisy_world.perturbations.shipped._sheet_nodes import SPREAD, ellipse
from srgb import encoded, linear

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
    before, after = (made(*dusk_street(lamp), name, severity=5, lamps=0)[far].mean() for lamp in (0, 100))
    assert abs(after / before - 1) < 0.02
    light, depth_m = dusk_street(100)
    without = air_light(dusk_street()[0][20:], depth_m[20:]).surfaces
    assert np.abs(air_light(light[20:], depth_m[20:]).surfaces / without - 1).max() < 0.02


@pytest.mark.parametrize("lit", [True, False])
def test_fog_in_a_brown_room_is_as_light_and_as_grey_as_is_asked_for(lit):
    """Far away all is the air's light: that of even walls, or by a tint of 0 a grey of their luminance."""
    walls = np.full((20, 30, 3), (0.2, 0.08, 0.04), np.float32)
    depth_m = np.full((20, 30), 5.0, np.float32)
    luminance = walls[0, 0] @ (0.2126, 0.7152, 0.0722)
    for tint in (1.0, 0.25, 0.0):
        found = made(walls, depth_m, "fog_depth", lit=lit, visibility_m=0.5, air="scene", air_tint=tint)[10, 10]
        found = found if lit else linear(found.astype(np.float32) / 255)
        assert found == pytest.approx(luminance + tint * (walls[0, 0] - luminance), abs=5e-4 if lit else 2e-3)


@cases(
    "name, lit, around, air",
    [
        ("fog_depth", True, True, 0.01 + 0.1 * 0.5),
        ("fog_depth", False, True, 0.01 + 0.1 * 0.5),
        ("fog_depth", True, False, 0.51),
        ("haze", True, True, 0.01 + 0.1 * 0.5),
        # As bright as the air: 2.5 times the surfaces' mean of snow, and twice of rain.
        ("snow_depth", True, True, 0.9 * 2.5 * 0.01 + 0.1 * 0.51),
    ],
)
def test_a_window_lights_the_air_of_a_room_by_its_share_where_that_is_asked_for(name, lit, around, air):
    room, depth_m = np.full((40, 40, 3), 0.01, np.float32), np.full((40, 40), 2.0, np.float32)
    room[:, 16:20], depth_m[:, 16:20] = 0.51, 0  # a tenth of the frame is sky
    dense = {"rate_mm_h": 500, "least_mrad": 100, "reach_m": 0.5} if name == "snow_depth" else {"visibility_m": 0.1}
    depth_m *= 1000 if name == "snow_depth" else 1  # all of it is veil there
    found = made(room, depth_m, name, lit=lit, air="scene", air_around=around, lamps=0, **dense)[4, 4]
    luminance = (found if lit else linear(found.astype(np.float32) / 255)) @ (0.2126, 0.7152, 0.0722)
    assert luminance == pytest.approx(air, rel=0.01)


@cases("given", [{}, {"falloff_m": 1e5, "camera_height_m": 0.0}, {"air": "auto"}])
def test_a_window_is_seen_through_as_much_air_as_is_said(given):
    light, depth_m = np.full((8, 8, 3), 0.4, np.float32), np.full((8, 8), 5.0, np.float32)
    depth_m[:4] = 0
    given = {"air": "colour", "air_red": 0, "air_green": 0, "air_blue": 0, "lamps": 0} | given
    lit = given["air"] == "colour"
    for void_m, seen in ((0.0, 0.0), (8.0, 0.05 ** (8 / 10))):
        found = made(light, depth_m, "fog_depth", lit=lit, visibility_m=10, airlight=0, void_m=void_m, **given)
        found = found if lit else linear(found.astype(np.float32) / 255)
        assert found[1, 1] == pytest.approx(0.4 * np.array([seen] * 3), abs=2e-3)
        assert found[6, 6] == pytest.approx(0.4 * np.array([0.05**0.5] * 3), abs=2e-3)


@cases(
    "name, rate_mm_h, per_m",
    [
        # The integral of 8000 exp(-4.1 R^-0.21 D) 2 pi (D / 2)^2, mm2 in a cubic metre; of flakes by their own size.
        ("rain_depth", 40.0, math.pi * 8000 / (4.1 * 40**-0.21) ** 3 * 1e-6),
        ("snow_depth", 6.0, math.pi * 100 ** (1 / 3) * 3800 * 6**-0.87 / (2.55 * 6**-0.48) ** 3 * 1e-6),
    ],
)
def test_behind_a_mirror_all_that_falls_veils(name, rate_mm_h, per_m):
    kind = registry()[name]
    given = {"air": "colour", "air_red": 0.5, "air_green": 0.5, "air_blue": 0.5}
    context = FrameContext(5, (7, "street", "x"), lit=True)
    for leave_sky, sky_m in ((False, 500.0), (True, 0.0)):
        air = kind.even_air(
            dusk_street()[0], kind.parameters(rate_mm_h=rate_mm_h, leave_sky=leave_sky, **given), context
        )
        assert air.rates_per_m == pytest.approx([per_m] * 3, rel=1e-3)
        assert air.light == pytest.approx([0.21404] * 3, rel=1e-4)
        assert air.sky_m == sky_m


def test_the_mean_of_what_is_even_is_that_and_no_pixels_are_dark():
    even = np.tile(DUSK, (50, 1))
    assert np.allclose(robust_mean(even), DUSK, rtol=1e-5)
    assert not robust_mean(even[:0]).any()


def halo(name, degrees, **values):
    """What a small lamp adds to the dark air around it, at angles on a row of a frame 90 degrees wide."""
    light, depth_m = np.full((240, 400, 3), 1e-4, np.float32), np.full((240, 400), 40.0, np.float32)
    light[115:117, 43:45], depth_m[115:117, 43:45] = 100, 20  # amid a block of eight pixels
    columns = np.round(43.5 + 200 * np.tan(np.radians(degrees))).astype(int)
    with_lamps, without = (made(light, depth_m, name, **values, lamps=lamps)[116, columns, 0] for lamps in (1, 0))
    return with_lamps - without


@pytest.mark.parametrize("name", ["fog_depth", "haze"])
def test_lamps_have_a_halo_that_falls_with_the_angle(name):
    degrees = np.array([3.0, 6.0, 12.0, 20.0])
    found = halo(name, degrees, visibility_m=2000)
    solid = 4 / 200**2
    share = 1 - 0.05 ** (40 / 2000)
    wanted = DROP * 100 * solid / np.tan(np.radians(degrees)) * share
    print(found / wanted)
    assert np.abs(found / wanted - 1).max() < 0.1


def test_the_lamps_kernel_is_one_over_the_angle_and_the_drops_share_snells():
    angles = np.array([0.02, 0.05, 0.1, 0.2, 0.4])
    widths, volumes = np.array(WIDTHS_RAD), np.array(VOLUMES)
    sums = (volumes * np.exp(-0.5 * (angles[:, None] / widths) ** 2) / (2 * np.pi * widths**2)).sum(axis=1)
    assert np.abs(sums * angles - 1).max() < 0.06
    inside = np.linspace(1e-4, np.pi / 2 - 1e-4, 200_001)
    within = np.arcsin(np.sin(inside) / 1.333)
    across, along = (
        (a - b) / (a + b)
        for a, b in (
            (np.cos(inside), 1.333 * np.cos(within)),
            (1.333 * np.cos(inside), np.cos(within)),
        )
    )
    passes = (1 - (across**2 + along**2) / 2) ** 2
    turned = 2 * (inside - within)
    phase = passes * np.gradient(np.sin(inside) ** 2, inside) / (2 * np.pi * np.sin(turned))
    assert np.trapezoid(phase, inside) / 2 == pytest.approx(DROP, rel=0.01)
    assert np.trapezoid(np.full(100, 1 / (4 * np.pi)), np.linspace(0, np.pi, 100)) / 2 == pytest.approx(FLAKE)


def test_flakes_shine_beside_a_lamp_and_take_the_air_s_light_far_from_it():
    light, depth_m = np.full((120, 160, 3), 0.004, np.float32), np.full((120, 160), 30.0, np.float32)
    light[20:24, 20:24] = 100
    for name in ("snow_depth", "rain_depth"):
        lit, dark = (made(light, depth_m, name, severity=5, least_mrad=4.0, lamps=lamps) for lamps in (1, 0))
        gained = (lit - dark)[..., 0]
        near, far = gained[10:40, 26:50].mean(), gained[80:, 110:].mean()
        assert near > 5 * far > 0, name


def streak(away_px, run_px, radius_px, blurred_px):
    """What a streak hides by its nodes, at places (H, W) right and down of its middle. run_px: right and down."""
    graph = Graph("Streak", "")
    sides = [graph.input(GroupInput(name, "float", 0.0, "")) for name in ("Right", "Down", "Run right", "Run down")]
    squares = [graph.input(GroupInput(name, "float", 1.0, "")) for name in ("Area", "Blurred", "Longest")]
    graph.output("Hidden", ellipse(graph, sides[:2], sides[2:], (squares[0], squares[1]), squares[2]), "float")
    spread_px = [SPREAD * each for each in run_px]
    given = dict(zip(("Right", "Down", "Run right", "Run down"), (*away_px, *spread_px), strict=True))
    given |= {"Area": radius_px**2, "Blurred": blurred_px**2, "Longest": 1e6}
    return carried_out(graph, given)["Hidden"][::-1].astype(np.float64)


@pytest.mark.parametrize("run_px", [(0.0, 0.0), (3.0, 0.0), (12.0, 16.0)])
def test_a_round_streak_hides_its_own_area_as_widely_as_a_disc_that_runs(run_px):
    step_px, blurred_px = 0.05, 3.0
    places = np.arange(-20, 20, step_px, dtype=np.float32)
    away_px = np.meshgrid(places, places)
    seen = streak(away_px, run_px, 0.2, blurred_px)
    assert seen.min() >= 0
    assert seen.sum() * step_px**2 == pytest.approx(np.pi * 0.2**2, rel=2e-3)
    for axis, along in enumerate(run_px):
        # The paraboloid's variance along a line is a sixth of its radius squared, that of a way a twelfth; they add up.
        variance = (seen * away_px[axis].astype(np.float64) ** 2).sum() / seen.sum()
        assert variance == pytest.approx(blurred_px**2 / 6 + along**2 / 12, rel=5e-3)
    # At rest it is the paraboloid itself: twice its mean in the middle.
    middle = streak([np.zeros((1, 1), np.float32)] * 2, (0.0, 0.0), 0.2, blurred_px)
    assert middle[0, 0] == pytest.approx(2 * (0.2 / blurred_px) ** 2, rel=1e-3)


@pytest.mark.parametrize("name", BY_DEPTH)
def test_a_colour_that_is_given_is_the_airs_and_the_sky_can_be_left(name):
    light, depth_m = dusk_street()
    given = {"severity": 5, "air_red": 0.9, "air_green": 0.1, "air_blue": 0.1, "lamps": 0.0}
    red = made(light, depth_m, name, **given)
    assert (red[:, 70:, 0] > light[:, 70:, 0]).mean() > 0.9
    assert red[22:, 70:, 0].mean() > 1.2 * red[22:, 70:, 1].mean()
    left = made(light, depth_m, name, **given, leave_sky=True)
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
