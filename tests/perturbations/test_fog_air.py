# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog that is no even layer, against quadrature: thinner with height, uneven in the world, glowing around lamps."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cases import cases
from scipy.integrate import quad

from srgb import encoded, linear
from noisy_world.core.geometry import Intrinsics, rotation_from_euler_deg
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.steps import Setting
from noisy_world.core.schema import ConfigPath
from noisy_world.core.camera_motion import motion_between
from noisy_world.core.camera_motion import AT_REST, CameraState, camera_state_of
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped.fog_depth import optical_depth
from noisy_world.perturbations.shipped.fog_depth import EDGES, Bank, mean_before, phases_rad, slab_means, waves
from noisy_world.perturbations.shipped.fog_depth import PERTURBATION, is_even

CAMERA = Intrinsics(9, 7, 6.0, 5.5, 3.7, 3.1)
SIZE = (7, 9)


def moved(rotation, position_m, origin_m=(0.0, 0.0, 0.0)):
    """A world whose z is up; the first camera looks along y, this one is elsewhere."""
    first = np.eye(4)
    first[:3, :3], first[:3, 3] = rotation_from_euler_deg(-90.0, 0.0, 0.0), origin_m
    now = np.eye(4)
    now[:3, :3], now[:3, 3] = rotation @ first[:3, :3], np.add(origin_m, position_m)
    return motion_between(first, first, now, 0.1)


def context_of(depth_m, *, index=0, temporal="drift", motion=None, camera=CAMERA):
    return FrameContext(index, (1, "x"), temporal, intrinsics=camera, motion=motion, read_depth_m=lambda: depth_m)


def fogged(rgb, depth_m, *, index=0, temporal="drift", motion=None, camera=None, **values):
    context = context_of(depth_m, index=index, temporal=temporal, motion=motion, camera=camera)
    return PERTURBATION.apply(rgb, PERTURBATION.at_severity(3, **values), context)


# --- thinner with height ---


@cases("origin_m", [(0.0, 0.0, 0.0), (1e5, -3e4, 50.0)])
@cases("falloff_m", [0.7, 5.0, 300.0])
def test_fog_that_thins_with_height_is_its_integral_along_the_ray(falloff_m, origin_m):
    turn = rotation_from_euler_deg(12.0, -5.0, 40.0)
    motion = moved(turn, (0.3, 2.0, 0.8), origin_m)
    rng = np.random.default_rng(0)
    depth_m = rng.uniform(0.1, 40, SIZE).astype(np.float32)
    parameters = PERTURBATION.at_severity(3, falloff_m=falloff_m, camera_height_m=1.2)
    found = optical_depth(parameters, context_of(depth_m, motion=motion), SIZE)
    axes = motion.c2w[:3, :3]
    for row, column in ((0, 0), (3, 4), (6, 8), (2, 7)):
        ray = axes @ [(column - 3.7) / 6.0, (row - 3.1) / 5.5, 1.0]
        wanted, _ = quad(lambda z, up=ray[2]: np.exp(-(2.0 + z * up) / falloff_m), 0, depth_m[row, column])
        assert np.exp(-found[row, column]) == pytest.approx(0.05 ** (wanted / 15), abs=1e-4)


def test_the_sky_is_seen_above_low_fog_and_not_through_even_fog():
    rgb, depth_m = np.full((8, 8, 3), 0.2, np.float32), np.zeros((8, 8), np.float32)
    even, low = fogged(rgb, depth_m), fogged(rgb, depth_m, falloff_m=1.0, airlight=0.8)
    assert np.abs(even - 0.8).max() < 1e-5
    assert low[0].max() < 0.3
    assert np.abs(low[-1] - 0.8).max() < 1e-5
    assert (np.diff(low[:, 0, 0]) > -1e-6).all()


# --- uneven ---


def field(bank, place):
    """The field at places (N, 3), right, forward, up of the air."""
    origin = phases_rad(bank, AT_REST)
    vectors = np.array([wave.vector for wave in waves()]) / bank.clump_m
    return np.cos(place @ vectors.T + origin) @ [wave.amplitude for wave in waves()]


BANK = Bank(8.0, 0.0, 15.0, (1234, 77, 0))


def test_the_field_has_mean_0_and_deviation_1_and_is_evened_out_by_far_ones():
    places = np.random.default_rng(1).uniform(-4000, 4000, (40_000, 3))
    values = field(BANK, places)
    assert abs(values.mean()) < 0.02
    assert values.std() == pytest.approx(1, abs=0.02)
    other = field(replace(BANK, key=(1235, 77, 0)), places)
    assert abs(np.corrcoef(values, other)[0, 1]) < 0.5  # another seed, other phases


def test_slabs_are_the_means_of_the_field_on_the_way():
    rotation = rotation_from_euler_deg(20.0, 70.0, -5.0)
    camera_state = CameraState(rotation, np.array([3.0, -1.0, 20.0]), np.zeros(3), np.zeros(3))
    rays = np.array([[[0.3, -0.7]], [[0.1, 0.4]], [[1.0, 1.0]]], np.float32)
    found = slab_means(BANK, camera_state, rays)
    for k in range(2):
        way = rotation @ rays[:, 0, k].astype(np.float64)
        for slab, (begin, end) in enumerate(pairwise(EDGES)):
            z = (np.arange(2000) + 0.5) / 2000 * (end - begin) * 15 + begin * 15
            at = camera_state.position_m + z[:, None] * way
            values = field(BANK, np.column_stack([at[:, 0], at[:, 2], -at[:, 1]]))
            assert found[slab, 0, k] == pytest.approx(values.mean(), abs=1e-4)


def test_the_mean_before_a_depth_is_put_together_from_slabs():
    means = np.random.default_rng(2).standard_normal((6, 1, 1)).astype(np.float32)
    edges_m = np.array(EDGES) * 15
    depth_m = np.array([[1e-9, 0.3, 1.0, 5.0, 17.9, 18.0, 1e4]], np.float32)
    found = mean_before(means, 15.0, depth_m)
    for k, far_m in enumerate(depth_m[0]):
        parts_m = np.clip(min(far_m, 18.0) - edges_m[:-1], 0, np.diff(edges_m))
        assert found[0, k] == pytest.approx(parts_m @ means[:, 0, 0] / max(min(far_m, 18.0), 1e-6), abs=1e-5)


def test_clumps_stay_in_the_world_when_the_camera_turns_and_go_with_the_wind():
    turn = rotation_from_euler_deg(0.0, 25.0, 0.0)
    seen = np.array([0.2, -0.1, 1.0])
    first = slab_means(BANK, AT_REST, seen.astype(np.float32)[:, None, None])
    turned = replace(AT_REST, rotation=turn)
    second = slab_means(BANK, turned, (turn.T @ seen).astype(np.float32)[:, None, None])
    assert np.abs(first - second).max() < 1e-4
    along = replace(AT_REST, position_m=np.array([2.5, 0.0, 0.0]))
    assert np.abs(phases_rad(replace(BANK, blown_m=2.5), along) - phases_rad(BANK, AT_REST)).max() < 1e-9


def test_patterns_stay_drift_or_are_new():
    rgb, depth_m = np.full((24, 32, 3), 0.1, np.float32), np.full((24, 32), 6.0, np.float32)

    def at(index, temporal, **values):
        return fogged(rgb, depth_m, index=index, temporal=temporal, unevenness=0.7, **values)

    assert np.array_equal(at(0, "fixed"), at(50, "fixed"))
    assert np.abs(at(0, "drift") - at(50, "drift")).max() > 0.01
    assert np.array_equal(at(0, "drift", wind_m_s=0.0), at(50, "drift", wind_m_s=0.0))
    assert not np.array_equal(at(0, "fresh"), at(1, "fresh"))
    assert np.ptp(at(0, "drift")) > 0.01
    assert is_even(PERTURBATION.parameters())
    assert not is_even(PERTURBATION.at_severity(3, glow=0.1))


# --- glow ---


def lamp(depth, glow, brightness=100.0, size=(120, 160)):
    """The linear light that is brighter than the airlight around a lamp of 4 x 4 pixels, at an optical depth."""
    light = np.zeros((*size, 3))
    light[58:62, 78:82] = brightness
    depth_m = np.full(size, 10.0, np.float32)
    visibility_m = 10 * np.log(20) / depth
    found = fogged(
        encoded(light).astype(np.float32),
        depth_m,
        visibility_m=visibility_m,
        airlight=0.0,
        glow=glow,
        glow_width_deg=0.7,
    )
    return linear(found)[..., 0]


@cases("depth", [0.3, 1.0, 3.0])
def test_glow_adds_no_light(depth):
    direct, whole = lamp(depth, 0.0), lamp(depth, 1.0)
    assert direct.sum() == pytest.approx(1600 * np.exp(-depth), rel=1e-3)
    assert whole.sum() == pytest.approx(1600, rel=5e-3)
    assert lamp(depth, 0.25).sum() == pytest.approx(1600 * (np.exp(-depth) + 0.25 * (1 - np.exp(-depth))), rel=5e-3)


def test_glow_is_wider_in_thicker_fog_and_lamps_stay_bright():
    widths = []
    for depth in (0.3, 1.0, 3.0, 9.0):
        glow = lamp(depth, 1.0) - lamp(depth, 0.0)
        rows, columns = np.indices(glow.shape)
        widths.append(np.sqrt((glow * ((rows - 59.5) ** 2 + (columns - 79.5) ** 2)).sum() / glow.sum() / 2))
    assert widths[0] == pytest.approx(widths[1], rel=1e-6)  # the narrowest, but for float32
    assert (np.diff(widths[1:]) > 0).all()
    assert lamp(0.3, 1.0)[59, 79] > 70
    dark = fogged(np.zeros((16, 16, 3), np.float32), np.full((16, 16), 5.0, np.float32), glow=1.0)
    assert np.ptp(dark) < 1e-6  # what is darker than the air does not glow


@cases("size", [(1, 1), (1, 13), (17, 9)])
def test_images_of_any_size_and_void(size):
    rgb, depth_m = np.full((*size, 3), 0.9, np.float32), np.zeros(size, np.float32)
    depth_m[0, 0] = np.nan
    values = {"falloff_m": 2.0, "unevenness": 1.0, "glow": 1.0}
    found = fogged(rgb, depth_m, **values)
    assert found.shape == rgb.shape
    assert np.isfinite(found).all()
    assert found.dtype == np.float32


# --- the camera in Blender's words ---


def test_a_stance_is_a_blender_object_s():
    rng = np.random.default_rng(5)
    for _ in range(20):
        angles = rng.uniform(-180, 180, 3)
        turn = rotation_from_euler_deg(*angles)
        euler = CameraState(turn, rng.random(3), rng.random(3), rng.random(3)).as_blender()[1]
        axes = rotation_from_euler_deg(*np.degrees(euler))
        # Forward in the air is y in Blender, and a camera there looks along -z.
        wanted = turn @ [0.0, 0.0, 1.0]
        assert axes @ [0.0, 0.0, -1.0] == pytest.approx([wanted[0], wanted[2], -wanted[1]], abs=1e-9)
        wanted = turn @ [1.0, 0.0, 0.0]
        assert axes @ [1.0, 0.0, 0.0] == pytest.approx([wanted[0], wanted[2], -wanted[1]], abs=1e-9)
    assert camera_state_of(None).as_blender()[1] == pytest.approx((np.pi / 2, 0, 0))
    rolled = CameraState(rotation_from_euler_deg(0.0, 0.0, 90.0), np.zeros(3), np.zeros(3), np.zeros(3)).as_blender()[1]
    assert np.isfinite(rolled).all()


@cases(
    "values, asks",
    [
        ({"severity": 3}, False),
        ({"severity": 3, "mode": "dynamic"}, False),
        ({"severity": 0, "unevenness": 0.6}, False),
        ({"severity": 3, "unevenness": 0.6}, True),
        ({"visibility_m": 9, "falloff_m": 2}, True),
    ],
)
def test_only_fog_that_is_in_the_world_asks_how_the_camera_moves(values, asks):
    (step,) = parse_steps([{"fog_depth": values}], ConfigPath("test"), registry())
    motion = moved(np.eye(3), (1.0, 2.0, 3.0))
    assert step.uses_motion == asks
    assert Setting("fog", (step,)).uses_motion == asks
    assert (step.context(FrameContext(0, (1, "a", "b"), motion=motion)).motion is motion) == asks
