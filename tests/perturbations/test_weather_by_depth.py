# SPDX-License-Identifier: GPL-3.0-or-later
"""Snow and rain by depth against their laws: how many, how large, where, how long a streak, how thick the veil."""

from dataclasses import replace

import numpy as np
import pytest
from cases import cases
from scipy import stats
from scipy.spatial.transform import Rotation

from srgb import linear
from noisy_world.core.geometry import Intrinsics, rotation_from_euler_deg, rotvec_from_rotation
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.core.camera_motion import motion_between
from noisy_world.perturbations.shipped import rain_depth, snow_depth
from noisy_world.perturbations.shipped._particles import NEAR_M, Air, Particles, AirCamera, in_sight
from noisy_world.perturbations.shipped._particles import Precipitation, veil_depth
from noisy_world.perturbations.shipped._weather import view_of
from noisy_world.perturbations.shipped._weather import Lens, Streaks, optical_depth, streaks_of

MODULES = {"snow_depth": snow_depth, "rain_depth": rain_depth}
STILL = np.zeros(3)
VIEW = AirCamera(np.eye(3), STILL, STILL, STILL, (200.0, 210.0), (99.5, 59.5), (200, 120), np.inf, 0.0)


def published(name, rate_mm_h, diameter_mm):
    """N(D) per m^3 and mm of what is seen, as the papers print it; a flake is ten times as light as water."""
    if name == "rain_depth":
        return 8000 * np.exp(-4.1 * rate_mm_h**-0.21 * diameter_mm)
    swollen = 10 ** (1 / 3)
    return 3800 * rate_mm_h**-0.87 * np.exp(-25.5 * rate_mm_h**-0.48 * diameter_mm / swollen / 10) / swollen


def perturbed(name, rgb, depth_m, index=0, temporal="fresh", **values):
    item = MODULES[name].PERTURBATION
    context = FrameContext(index, (1, "scene", "setting", name, 0), temporal, read_depth_m=lambda: depth_m)
    return item.apply(rgb, item.at_severity(3, **values), context)


def air_of(name, **values):
    parameters = MODULES[name].PERTURBATION.at_severity(3, **values)
    return MODULES[name].KIND.air(parameters)


# --- the veil ---


@cases("name", MODULES)
def test_what_is_not_drawn_veils_as_koschmieder_says(name):
    rng = np.random.default_rng(3)
    rgb = rng.random((40, 60, 3), dtype=np.float32)
    depth_m = rng.uniform(0.1, 3000, (40, 60)).astype(np.float32)
    depth_m[:5] = 0
    # Particles of a fifth of their size span no tenth of their distance, so all of them veil.
    found = perturbed(name, rgb, depth_m, rate_mm_h=20.0, size=0.2, least_mrad=100.0, void_m=321.0, tint=1.0)
    diameter_mm = np.linspace(0, 60, 600_001)
    area_m2 = 2 * np.pi * (0.2 * diameter_mm / 2000) ** 2
    sigma = np.trapezoid(published(name, 20.0, diameter_mm) * area_m2, diameter_mm)
    seen = np.exp(-sigma * np.where(depth_m > 0, depth_m, 321.0))[..., None]
    light = linear(rgb).mean(axis=(0, 1)) * MODULES[name].PERTURBATION.parameters().brightness
    assert np.abs(linear(found) - (linear(rgb) * seen + light * (1 - seen))).max() < 1e-4


def test_what_is_drawn_is_missing_in_the_veil():
    air = Precipitation(8e6, 0.4e-3)
    z = np.linspace(0, 40, 400_001)
    x = 1e-3 * np.minimum(z, 40) / air.scale_m
    below = 1 - np.exp(-x) * (1 + x + x**2 / 2)  # the share of D^2 N(D) below the least diameter
    below[z > 12] = 1
    wanted = np.concatenate([[0], np.cumsum((below[1:] + below[:-1]) / 2 * np.diff(z))]) * air.extinction_per_m
    at = np.array([0, 1e-3, 0.02, 0.1, 0.119, 0.121, 0.5, 2, 11.9, 12.1, 39.9], np.float32)
    found = veil_depth(at, air, 1e-3, 12.0)
    assert np.abs(np.exp(-found) - np.exp(-np.interp(at, z, wanted))).max() < 1e-6
    assert found[0] == 0
    assert (np.diff(found) >= 0).all()


# --- the particles ---


def drawn(air, view, keys=range(40)):
    many = [in_sight(air, view, key, 0.0) for key in keys]
    within = [part.position_m[inside(part, view)] for part in many]
    return np.concatenate(within), np.concatenate([part.diameter_m[inside(part, view)] for part in many]), within


def inside(part, view):
    z_m = part.position_m[:, 2]
    (left, right), (top, bottom) = view.slopes()
    x, y = part.position_m[:, 0] / z_m, part.position_m[:, 1] / z_m
    return (x >= left) & (x <= right) & (y >= top) & (y <= bottom)


@pytest.mark.one_python
@cases("name", MODULES)
def test_numbers_sizes_and_depths_follow_the_law(name):
    air = replace(air_of(name), least_rad=2e-3, reach_m=4.0)
    turned = replace(VIEW, rotation=rotation_from_euler_deg(20.0, 130.0, -35.0), position_m=np.array([1e5, -3e4, 7.0]))
    positions_m, diameters_m, each = drawn(air, turned)
    z_m = positions_m[:, 2].astype(np.float64)
    scale_m = air.particles.scale_m
    # A cone's area at depth z times N(D > least z).
    solid = np.prod(np.diff(turned.slopes(), axis=1))
    grid_m = np.linspace(NEAR_M, 4.0, 4001)
    density = air.particles.count_m3 * solid * grid_m**2 * np.exp(-air.least_rad * grid_m / scale_m)
    below = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(grid_m))])
    assert len(z_m) > 2000
    assert abs(len(z_m) / len(each) - below[-1]) < 4 * np.sqrt(below[-1] / len(each))
    assert stats.kstest(z_m, lambda value: np.interp(value, grid_m, below / below[-1])).pvalue > 0.001
    for low, high in ((NEAR_M, 0.8), (0.8, 1.6), (1.6, 4.0)):
        chosen = (z_m >= low) & (z_m < high)
        excess = (diameters_m[chosen] - air.least_rad * z_m[chosen]) / scale_m
        assert stats.kstest(excess, "expon").pvalue > 0.001, (low, high, chosen.sum())
    slopes = positions_m[:, :2] / positions_m[:, 2:]
    for axis, (low, high) in enumerate(turned.slopes()):
        assert stats.kstest((slopes[:, axis] - low) / (high - low), "uniform").pvalue > 0.001
    counts = [len(part) for part in each]
    assert 0.5 < np.var(counts, ddof=1) / np.mean(counts) < 1.8  # Poisson's variance is its mean


def test_a_particle_goes_where_its_velocity_says_and_another_time_needs_no_earlier_one():
    air = replace(air_of("snow_depth", gusts_m_s=0.2), least_rad=2e-3, reach_m=4.0)
    view = replace(
        VIEW, position_m=np.array([3.0, 2.0, -1e5]), velocity_m_s=np.array([0.5, -0.3, 2.0]), exposure_s=0.01
    )
    first = in_sight(air, view, 11, 1234.5)
    later = replace(view, position_m=view.position_m + view.velocity_m_s * 1e-3)
    second = in_sight(air, later, 11, 1234.501)
    matched = 0
    for position_m, velocity_m_s, diameter_m in zip(
        first.position_m, first.velocity_m_s, first.diameter_m, strict=True
    ):
        same = second.diameter_m == diameter_m
        if same.sum() == 1:
            matched += 1
            moved_m = second.position_m[same][0] - position_m
            # A class's cubes fall at one speed, so a particle's own is that within 20 %.
            assert np.abs(moved_m - velocity_m_s * 1e-3).max() < 3e-4
    assert matched > 0.95 * len(first.diameter_m) > 50


def test_a_camera_that_turns_sees_the_same_particles_elsewhere():
    air = replace(air_of("rain_depth"), least_rad=2e-3, reach_m=3.0)
    rotation = rotation_from_euler_deg(0.0, 12.0, 5.0)
    one, other = in_sight(air, VIEW, 5, 2.0), in_sight(air, replace(VIEW, rotation=rotation), 5, 2.0)
    known = {float(d): p for d, p in zip(one.diameter_m, one.position_m, strict=True)}
    both = [
        (known[float(d)], rotation @ p) for d, p in zip(other.diameter_m, other.position_m, strict=True) if d in known
    ]
    assert len(both) > 20
    assert max(np.abs(first - second).max() for first, second in both) < 1e-5
    half = replace(VIEW, rotation=np.diag([-1.0, 1.0, -1.0]))
    behind = in_sight(air, half, 5, 2.0)
    assert not {float(d) for d in behind.diameter_m} & set(known)


# --- the streaks ---


def alone(position_m, velocity_m_s, diameter_m):
    return Particles(*(np.array([item], np.float32) for item in (position_m, velocity_m_s, diameter_m)))


@cases("z_m", [0.7, 2.0, 9.0])
def test_a_streak_is_as_long_as_shutter_speed_and_depth_make_it(z_m):
    part = alone((0.02, -0.01, z_m), (1.5, -6.0, 0.0), 2e-3)
    made = streaks_of(part, replace(VIEW, exposure_s=0.02), Lens(0.0, 5.0))
    run_px = (made.end_px - made.start_px)[0]
    assert run_px == pytest.approx([0.02 * 1.5 * 200 / z_m, -0.02 * 6 * 210 / z_m], rel=1e-4)
    middle_px = (made.end_px + made.start_px)[0] / 2
    assert middle_px == pytest.approx([99.5 + 4 / z_m, 59.5 - 2.1 / z_m], abs=1e-3)
    # Towards the camera it runs away from the middle: x f / z at both ends.
    towards = streaks_of(alone((0.1, 0.0, z_m), (0, 0, -5.0), 2e-3), replace(VIEW, exposure_s=0.02), Lens(0.0, 5.0))
    wanted = 20 / (z_m - 0.05) - 20 / (z_m + 0.05)
    assert towards.end_px[0, 0] - towards.start_px[0, 0] == pytest.approx(wanted, rel=1e-3)


@cases("run", [(0.0, 0.0), (0.0, 14.0), (11.3, 3.0), (-6.0, 6.0)])
@cases("width_px", [1.0, 2.7, 9.0])
def test_a_streak_covers_its_capsule(run, width_px):
    start = np.array([[40.3, 30.7]], np.float32)
    one = np.ones(1, np.float32)
    made = Streaks(start, start + np.float32([run]), one * np.float32(width_px), one * np.float32(1e-5), one)
    found = optical_depth(made, np.full((80, 100), 5.0, np.float32)) / np.float32(1e-5)
    rows, columns = np.mgrid[:80, :100]
    along = np.array(run)
    share = np.clip(((columns - 40.3) * run[0] + (rows - 30.7) * run[1]) / max(along @ along, 1e-9), 0, 1)
    distance = np.hypot(columns - 40.3 - share * run[0], rows - 30.7 - share * run[1])
    ramp = max(0.7 * width_px, 1)
    assert found == pytest.approx(np.clip((width_px / 2 - distance) / ramp + 0.5, 0, 1), abs=1e-4)
    area = np.hypot(*run) * width_px + np.pi / 4 * (width_px**2 + ramp**2 / 3)
    assert found.sum() == pytest.approx(area, rel=0.12)


def test_a_streak_hides_what_its_particle_would_for_its_share_of_the_exposure():
    for velocity_m_s, aperture_m in (((0, 0, 0), 0.0), ((0, 4.0, 0), 0.0), ((2.0, 4.0, 0), 0.01)):
        made = streaks_of(alone((0, 0, 0.5), velocity_m_s, 4e-3), replace(VIEW, exposure_s=0.01), Lens(aperture_m, 5.0))
        length_px = np.hypot(*(made.end_px - made.start_px)[0])
        covered = made.opacity[0] * (length_px * made.width_px[0] + np.pi / 4 * made.width_px[0] ** 2)
        particle_px = 4e-3 * np.sqrt(200 * 210) / 0.5
        assert covered == pytest.approx(np.pi / 4 * particle_px**2, rel=2e-3)


@cases("name", MODULES)
def test_nothing_is_seen_before_what_is_nearer(name):
    rgb = np.full((60, 80, 3), 0.2, np.float32)
    near = np.full((60, 80), NEAR_M, np.float32)
    near[:, 40:] = 30.0
    values = {"rate_mm_h": 100.0, "least_mrad": 2.0}
    found = perturbed(name, rgb, near, **values) - rgb
    assert np.ptp(found[:, :40], axis=(0, 1)).max() < 1e-6
    assert np.ptp(found[:, 40:], axis=(0, 1)).max() > 0.005
    # A wall hides what is behind it and nothing before it.
    far, wall = np.full((60, 80), 30.0, np.float32), np.full((60, 80), 2.0, np.float32)
    air = air_of(name, **values)
    view = replace(VIEW, size_px=(80, 60), middle_px=(39.5, 29.5), focal_px=(40.0, 40.0), exposure_s=0.005)
    made = streaks_of(in_sight(air, view, 1, 0.0), view, Lens(0.002, 5.0))
    kept = made.depth_m < 2.0
    before = Streaks(*(getattr(made, item)[kept] for item in ("start_px", "end_px", "width_px", "opacity", "depth_m")))
    assert np.array_equal(optical_depth(made, wall), optical_depth(before, far))


@cases("name", MODULES)
def test_patterns_stay_fall_or_are_new(name):
    rgb = np.full((48, 64, 3), 0.3, np.float32)
    depth_m = np.full((48, 64), 5.0, np.float32)

    def at(index, temporal, **values):
        return perturbed(name, rgb, depth_m, index, temporal, least_mrad=3.0, **values)

    assert np.array_equal(at(0, "fixed"), at(50, "fixed"))
    assert not np.array_equal(at(0, "drift"), at(50, "drift"))
    assert np.array_equal(at(0, "drift"), at(0, "fixed"))
    assert not np.array_equal(at(0, "fresh"), at(1, "fresh"))
    held = {"fall": 0.0, "wind_m_s": 0.0, "gusts_m_s": 0.0}
    assert np.array_equal(at(0, "drift", **held), at(50, "drift", **held))


def test_the_camera_s_intrinsics_are_used():
    rgb, depth_m = np.full((40, 60, 3), 0.3, np.float32), np.full((40, 60), 8.0, np.float32)
    item = snow_depth.PERTURBATION
    seen = [
        item.apply(rgb, item.at_severity(5), FrameContext(0, (1,), intrinsics=camera, read_depth_m=lambda: depth_m))
        for camera in (None, Intrinsics(60, 40, 30, 30, 29.5, 19.5), Intrinsics(60, 40, 60, 60, 29.5, 19.5))
    ]
    assert np.array_equal(seen[0], seen[1])  # 90 degrees
    assert not np.array_equal(seen[1], seen[2])


def seen_by(motion, temporal="drift", index=7):
    depth_m = np.full((60, 80), 6.0, np.float32)
    context = FrameContext(index, (1,), temporal, motion=motion, read_depth_m=lambda: depth_m)
    return view_of(depth_m, snow_depth.PERTURBATION.at_severity(3), context)


def test_the_air_is_level_and_begins_at_the_first_image():
    """A world whose z is up; a camera that looks along y, 25 degrees down, then turns left and climbs."""
    tilted = rotation_from_euler_deg(-90.0 - 25.0, 0.0, 0.0)
    first, now = np.eye(4), np.eye(4)
    first[:3, :3], first[:3, 3] = tilted, (1e5, 4.0, 2.0)
    now[:3, :3], now[:3, 3] = rotation_from_euler_deg(0.0, 0.0, 30.0) @ tilted, (1e5, 4.5, 2.1)
    motion = motion_between(first, first, now, 0.1)
    view = seen_by(motion)
    assert view.position_m == pytest.approx([0.0, -0.1, 0.5], abs=1e-9)
    assert view.velocity_m_s == pytest.approx([0.0, -1.0, 5.0], abs=1e-8)
    assert pytest.approx(now[:3, :3].T @ [0.0, 0.0, -1.0]) == view.rotation.T @ [0.0, 1.0, 0.0]
    assert np.linalg.det(view.rotation) == pytest.approx(1)
    still = seen_by(motion, "fixed")
    assert np.array_equal(still.rotation, np.eye(3))
    assert not still.velocity_m_s.any()


def test_motion_is_since_the_frame_before_and_as_scipy_turns():
    rng = np.random.default_rng(2)
    for angle in (0.0, 1e-9, 0.3, 3.0, np.pi):
        axis = rng.standard_normal(3)
        vector = angle * axis / np.linalg.norm(axis)
        found = rotvec_from_rotation(Rotation.from_rotvec(vector).as_matrix())
        apart = min(np.abs(found - vector).max(), np.abs(found + vector).max() if angle == np.pi else np.inf)
        assert apart < 1e-7
    assert not motion_between(np.eye(4), np.eye(4), np.eye(4), 0.0).velocity_m_s.any()


def test_a_camera_that_rolls_makes_streaks_about_its_middle():
    part = alone((0.5, 0.0, 1.0), np.zeros(3), 2e-3)
    rolling = replace(VIEW, turning_rad_s=np.array([0.0, 0.0, 2.0]), exposure_s=0.01)
    air = Air(Precipitation(2e6, 1e-3), 2e-3, 4.0, lambda diameter_m: diameter_m * 0, 0.0, 0.0)
    seen = in_sight(air, rolling, 3, 0.0)
    assert seen.velocity_m_s == pytest.approx(-np.cross([0.0, 0.0, 2.0], seen.position_m), abs=1e-5)
    made = streaks_of(replace(part, velocity_m_s=np.array([[0.0, -1.0, 0.0]], np.float32)), rolling, Lens(0.0, 5.0))
    assert (made.end_px - made.start_px)[0] == pytest.approx([0.0, -2.1], abs=1e-4)


def test_no_particle_is_none():
    air = Air(Precipitation(1.0, 1e-6), 1e-3, 5.0, lambda diameter_m: diameter_m * 0, 0.0, 0.0)
    made = in_sight(air, VIEW, 0, 0.0)
    assert made.position_m.shape == made.velocity_m_s.shape == (0, 3)
    assert not optical_depth(streaks_of(made, VIEW, Lens(0.0, 1.0)), np.ones((3, 4), np.float32)).any()


@pytest.mark.parametrize("name", ["snow_depth", "rain_depth"])
def test_a_sky_that_is_very_far_is_as_void(name):
    rgb = np.full((8, 12, 3), 0.3, np.float32)
    rgb[:4] = 0.7
    void, sky = np.full((8, 12), 5.0, np.float32), np.full((8, 12), 5.0, np.float32)
    void[:4], sky[:4] = 0.0, 1e10
    assert np.array_equal(perturbed(name, rgb, void), perturbed(name, rgb, sky))
