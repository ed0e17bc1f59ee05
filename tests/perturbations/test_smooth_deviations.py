# SPDX-License-Identifier: GPL-3.0-or-later
"""Vibration, drift and jerk: their spectra, their derivatives, and that they are exact at any time."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused
from cases import cases
from inertial_paths import lively_path

from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.geometry import rotation_angle_rad, rotvec_from_rotation
from noisy_world.trajectories.rig import ImuModel
from noisy_world.trajectories.rig import Imu, measure
from noisy_world.perturbations.kinds import SequenceContext
from noisy_world.core.curve import MountedCurve, motion_of
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.perturbations.shipped import drift, jerk, vibration
from noisy_world.perturbations.shipped._deviations import SPECTRA, AxisSpectrum, drawn_sines, limited

SMOOTH = [vibration.PERTURBATION, drift.PERTURBATION, jerk.PERTURBATION]


def context(seed=1):
    return SequenceContext((seed, "box", "shaky", "vibration", 0))


def still(count=201, rate_hz=20.0):
    return evenly_stamped(np.tile(np.eye(4), (count, 1, 1)), rate_hz)


def deviations(path, moved):
    return np.linalg.inv(path.c2w) @ moved.c2w


# --- spectra ---


def band_powers(values, rate_hz, bands):
    """The power of a series (N,) in each band, by Welch's periodogram, with its lobe where no other begins."""
    signal = pytest.importorskip("scipy.signal", reason="scipy is not installed")
    frequency, density = signal.welch(values, rate_hz, nperseg=len(values) // 2)
    edges, lobe_hz, found = {edge for band in bands for edge in band}, 3 * frequency[1], []
    shared = {edge for edge in edges if sum(edge in band for band in bands) == 2}
    for low_hz, high_hz in bands:
        begin = low_hz - lobe_hz * (low_hz not in shared)
        end = high_hz + lobe_hz * (high_hz not in shared)
        found.append(density[(frequency >= begin) & (frequency < end)].sum() * frequency[1])
    return found


@pytest.mark.one_python
@cases("source", [name for name in SPECTRA if name != "band"])
def test_each_band_of_a_source_has_its_power(source):
    spectrum = SPECTRA[source]
    axes = (*spectrum.translation_m, *spectrum.rotation_deg)
    highest_hz = max(band[1] for axis in axes for band in axis.bands)
    narrowest_hz = min(high - low for axis in axes for low, high, _ in axis.bands)
    rate_hz = 3 * highest_hz
    times_s = np.arange(0, 50 / narrowest_hz, 1 / rate_hz)  # 50 times as long as the band takes to forget
    found = {}
    for seed in range(4):
        shift_m, turn = vibration.signals(vibration.Vibration(source=source), context(seed))
        drawn = {"translation_m": shift_m.at(times_s)[0], "rotation_deg": np.degrees(turn.at(times_s)[0])}
        for part, axis in ((part, axis) for part in drawn for axis in range(3)):
            bands = [band[:2] for band in getattr(spectrum, part)[axis].bands]
            found.setdefault((part, axis), []).append(band_powers(drawn[part][:, axis], rate_hz, bands))
    for (part, axis), powers in found.items():
        wanted = getattr(spectrum, part)[axis]
        shares = [share * wanted.rms**2 for *_, share in wanted.bands]
        np.testing.assert_allclose(np.mean(powers, axis=0), shares, rtol=0.2)


def test_an_open_band_is_flat_inside_its_limits():
    axis = limited(AxisSpectrum(1.0, ((0.5, 20.0, 1.0),)), 2.0, 10.0, open_band=True)
    times_s = np.arange(10_000) / 50
    bands = [(2.3, 3.7), (4.3, 5.7), (6.3, 7.7), (8.3, 9.7)]
    signal = pytest.importorskip("scipy.signal", reason="scipy is not installed")
    densities = []
    for seed in range(10):
        values = drawn_sines((axis,) * 3, -1.0, np.random.default_rng(seed)).at(times_s)[0][:, 0]
        frequency, density = signal.welch(values, 50, nperseg=500)
        densities.append([density[(frequency >= low) & (frequency < high)].mean() for low, high in bands])
    np.testing.assert_allclose(np.mean(densities, axis=0), 1 / 8, rtol=0.1)


def test_limits_cut_bands_and_keep_the_root_mean_square():
    cut = limited(AxisSpectrum(2.0, ((1.0, 3.0, 0.5), (3.0, 5.0, 0.5))), 2.0, 4.0)
    assert cut == AxisSpectrum(2.0, ((2.0, 3.0, 0.5), (3.0, 4.0, 0.5)))
    assert limited(AxisSpectrum(2.0, ((1.0, 3.0, 1.0),)), 3.0, 9.0).bands == ()
    refused(
        vibration.signals,
        vibration.Vibration(low_hz=30.0),
        context(),
        names=("vibration: ", "walk", "low_hz 30", "high_hz -1"),
        error=NoisyWorldError,
    )


@cases("values", [{"translation_m": 0.03}, {"rotation_deg": 2.0}, {"translation_m": 0.0}, {"strength": 3.0}])
def test_root_mean_squares_are_those_asked_for(values):
    parameters = vibration.Vibration(source="walk", **values)
    path = still(5_001)
    found = deviations(path, vibration.apply(path, parameters, context()))
    own = SPECTRA["walk"]
    wanted_m = values.get("translation_m", sum(axis.rms**2 for axis in own.translation_m) ** 0.5 * parameters.strength)
    wanted_deg = values.get("rotation_deg", sum(axis.rms**2 for axis in own.rotation_deg) ** 0.5 * parameters.strength)
    assert np.sqrt((found[:, :3, 3] ** 2).sum(axis=1).mean()) == pytest.approx(wanted_m, rel=0.03)
    turned = np.degrees(rotvec_from_rotation(found[:, :3, :3]))
    assert np.sqrt((turned**2).sum(axis=1).mean()) == pytest.approx(wanted_deg, rel=0.03)


@pytest.mark.one_python
def test_drift_is_slow_and_as_large_as_asked_for():
    path = still(10_001)
    shifts = [
        deviations(path, drift.apply(path, drift.Drift(period_s=5.0), context(seed)))[:, :3, 3] for seed in range(5)
    ]
    assert np.sqrt((np.array(shifts) ** 2).sum(axis=-1).mean()) == pytest.approx(0.02, rel=0.1)
    fastest = np.abs(np.diff(shifts, axis=1)).max() * 20
    assert fastest < 0.02 * 6 * 2 * np.pi / 5


# --- continuity ---


@cases("kind", SMOOTH)
def test_derivatives_are_those_of_the_poses(kind):
    path = lively_path()
    moved = kind.apply(path, kind.parameters(), context())
    arm = np.eye(4)
    arm[:3, 3] = 0.2, -0.1, 0.3
    curve, step_s = MountedCurve(moved.continuous, arm), 2e-5
    times_s = np.random.default_rng(3).uniform(0.1, 7.9, 300)
    before, now, after = (curve.pose_at(times_s + shift) for shift in (-step_s, 0.0, step_s))
    motion = motion_of(curve, times_s)
    np.testing.assert_allclose(motion.velocity_m_s, (after - before)[:, :3, 3] / (2 * step_s), atol=1e-5)
    pulled = (after - 2 * now + before)[:, :3, 3] / step_s**2
    np.testing.assert_allclose(motion.acceleration_m_s2, pulled, atol=5e-3 * np.abs(pulled).max())
    back, on = (
        rotvec_from_rotation(a[:, :3, :3].swapaxes(1, 2) @ b[:, :3, :3]) / step_s
        for a, b in ((before, now), (now, after))
    )
    np.testing.assert_allclose(motion.rate_rad_s, (back + on) / 2, atol=1e-5)
    turned = (on - back) / step_s
    np.testing.assert_allclose(motion.angular_acceleration_rad_s2, turned, atol=5e-3 * np.abs(turned).max())


@cases("kind", SMOOTH)
def test_a_frame_alone_is_that_of_the_run_and_between_frames_nothing_jumps(kind):
    path = lively_path()
    parameters = kind.parameters()
    moved = kind.apply(path, parameters, context())
    for frame in (0, 7, 160):
        np.testing.assert_allclose(moved.continuous.pose_at(path.stamps_s[frame]), moved.c2w[frame], atol=1e-12)
    part = kind.apply(path.at(slice(0, 50), path.stamps_s[:50]), parameters, context())
    np.testing.assert_allclose(part.c2w, moved.c2w[:50], atol=1e-12)
    times_s = np.arange(0, 8, 1e-3)
    poses, motion = moved.continuous.pose_at(times_s), motion_of(moved.continuous, times_s)
    fastest = np.linalg.norm(motion.velocity_m_s, axis=1).max()
    assert np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).max() <= 1e-3 * fastest * 1.001
    quickest = np.linalg.norm(motion.rate_rad_s, axis=1).max()
    assert rotation_angle_rad(poses[1:, :3, :3], poses[:-1, :3, :3]).max() <= 1e-3 * quickest * 1.001
    assert (moved.c2w != path.c2w).any()


@cases("kind", SMOOTH)
def test_other_seeds_deviate_otherwise_and_severities_are_their_size(kind):
    path = still()
    first, second = (kind.apply(path, kind.parameters(), context(seed)) for seed in (1, 2))
    assert (first.c2w != second.c2w).any()
    sizes = [np.abs(deviations(path, kind.apply(path, kind.at_severity(k), context()))[:, :3, 3]).max() for k in (1, 5)]
    assert sizes[1] == pytest.approx(16 * sizes[0], rel=1e-6)


def test_independent_poses_stay_so():
    moved = vibration.apply(replace(still(), independent="each by itself"), vibration.Vibration(), context())
    assert moved.independent
    assert moved.curve is None


# --- jerk ---


def test_shocks_are_as_many_and_as_far_as_asked_for_and_end():
    parameters = jerk.Jerk(per_minute=30, duration_s=0.2, translation_m=0.05, rotation_deg=0)
    path = still(20 * 600 + 1)
    middle_s = jerk.moments(parameters, 600.0, context())
    assert abs(len(middle_s) - 300) < 3 * 300**0.5
    longer = jerk.moments(parameters, 900.0, context())
    np.testing.assert_array_equal(longer[: len(middle_s)], middle_s)
    curve = jerk.apply(path, parameters, context()).continuous
    apart = (np.diff(middle_s, prepend=-1) > 0.2) & (np.diff(middle_s, append=1e9) > 0.2)
    lone = middle_s[apart]
    np.testing.assert_allclose(np.linalg.norm(curve.pose_at(lone)[:, :3, 3], axis=1), 0.05, rtol=1e-9)
    for end_s in (lone - 0.1, lone + 0.1):
        motion = motion_of(curve, end_s)
        assert np.abs(motion.position_m).max() < 1e-9
        assert np.abs(motion.acceleration_m_s2).max() < 1e-6
    pull = motion_of(curve, lone).acceleration_m_s2
    np.testing.assert_allclose(np.linalg.norm(pull, axis=1), 8 * 0.05 / 0.1**2, rtol=1e-6)
    assert not jerk.moments(jerk.Jerk(per_minute=0), 600.0, context()).size


# --- with an IMU ---


def test_an_imu_feels_the_vibration():
    path = vibration.apply(still(401), vibration.Vibration(source="rotors", rotation_deg=0), context())
    found = measure(path, Imu(np.eye(4), ImuModel(), rate_hz=1000), 0, (1, "box"))
    sines, _ = vibration.signals(vibration.Vibration(source="rotors", rotation_deg=0), context())
    wanted = np.sqrt((sines.amplitude**2 * sines.angular_hz**4 / 2).sum())
    felt = found.force_m_s2 - [0, 0, 9.81]
    assert np.sqrt((felt**2).sum(axis=1).mean()) == pytest.approx(wanted, rel=0.03)
    assert np.abs(found.rate_rad_s).max() < 1e-12
