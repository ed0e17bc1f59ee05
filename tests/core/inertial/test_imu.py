# SPDX-License-Identifier: GPL-3.0-or-later
"""What an IMU measures: closed forms, integration back to the path, and its errors by independent estimates."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from cases import cases
from inertial_paths import circle, integrated, lively_path, overlapping_allan_variance

from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.geometry import pose, rotation_from_euler_deg, rotation_from_rotvec, rotvec_from_rotation
from noisy_world.trajectories.rig import DEVICES, ImuModel
from noisy_world.trajectories.rig import Imu, ImuErrors, digital, imu_motion, measure
from noisy_world.core.streams import stream
from noisy_world.core.curve import BodyMotion, MountedCurve, motion_of
from noisy_world.perturbations.kinds import SequenceContext
from noisy_world.perturbations.shipped import vibration
from noisy_world.core.trajectory import Trajectory, evenly_stamped

ARM = pose(rotation_from_euler_deg(20, -30, 40), [0.3, -0.2, 0.1])


def ideal(*, bandwidth_hz=0.0, **changes):
    return Imu(np.eye(4), ImuModel(bandwidth_hz=bandwidth_hz), **changes)


def felt(path, imu):
    return measure(path, imu, 0, (3, "box"))


def still(turn=((1, 0, 0), (0, 1, 0), (0, 0, 1)), count=5):
    return evenly_stamped(np.tile(pose(turn, [1.0, 2.0, 3.0]), (count, 1, 1)))


def numeric(curve, times_s, step_s=1e-4):
    """Velocity, acceleration, rate and angular acceleration by central differences of poses."""
    before, now, after = (curve.pose_at(times_s + shift) for shift in (-step_s, 0.0, step_s))
    velocity = (after[:, :3, 3] - before[:, :3, 3]) / (2 * step_s)
    pull = (after[:, :3, 3] - 2 * now[:, :3, 3] + before[:, :3, 3]) / step_s**2
    back, on = (
        rotvec_from_rotation(a[:, :3, :3].swapaxes(1, 2) @ b[:, :3, :3]) / step_s
        for a, b in ((before, now), (now, after))
    )
    return velocity, pull, (back + on) / 2, (on - back) / step_s


@cases("path", [lively_path(), lively_path(4.0, seed=5).followed(np.arange(0, 80, 3)), circle()])
def test_derivatives_are_those_of_the_poses(path):
    curve = MountedCurve(path.continuous, ARM)
    times_s = path.stamps_s[0] + np.random.default_rng(2).uniform(0.1, 0.9, 200) * np.ptp(path.stamps_s)
    motion = motion_of(curve, times_s)
    wanted = numeric(curve, times_s)
    found = motion.velocity_m_s, motion.acceleration_m_s2, motion.rate_rad_s, motion.angular_acceleration_rad_s2
    for a, b, bound in zip(found, wanted, (1e-5, 2e-3, 1e-5, 2e-3), strict=True):
        assert np.abs(a - b).max() <= bound * max(1.0, np.abs(b).max())
    np.testing.assert_allclose(pose(motion.rotation, motion.position_m), curve.pose_at(times_s), atol=1e-12)


def test_beyond_its_ends_a_path_goes_on_without_acceleration():
    motion = motion_of(lively_path().continuous, np.array([-1.0, 9.0]))
    assert not motion.acceleration_m_s2.any()
    assert not motion.angular_acceleration_rad_s2.any()
    assert np.linalg.norm(motion.velocity_m_s, axis=1).min() > 0.01


def turning(rate_rad_s=2.0):
    times_s = np.arange(41) / 20
    return Trajectory(pose(rotation_from_rotvec(np.outer(times_s, [0, 0, rate_rad_s])), np.zeros((41, 3))), times_s)


AT_ARM = replace(ideal(), robot_from_sensor=pose(np.eye(3), [0.5, 0, 0]))


@cases(
    ("path", "imu", "rate_rad_s", "force_m_s2", "most_off"),
    [
        (still(), ideal(), [0, 0, 0], [0, 0, 9.81], 1e-14),  # gravity is on the axis that points up
        (still(rotation_from_euler_deg(180, 0, 0)), ideal(), [0, 0, 0], [0, 0, -9.81], 1e-14),
        (still(rotation_from_euler_deg(90, 0, 0)), ideal(), [0, 0, 0], [0, 9.81, 0], 1e-14),
        (still(count=1), ideal(), [0, 0, 0], [0, 0, 9.81], 1e-14),
        (
            circle(radius_m=2.0, rate_rad_s=1.5),
            ideal(),
            [0, 0, 1.5],
            [0, 4.5, 9.81],
            2e-4,
        ),  # h^2 w^4 r / 12 of a spline
        (turning(2.0), AT_ARM, [0, 0, 2.0], [-0.5 * 2.0**2, 0, 9.81], 1e-10),
    ],
)
def test_rest_circles_and_turns_are_felt_as_their_closed_forms_say(path, imu, rate_rad_s, force_m_s2, most_off):
    found = felt(path, imu)
    quarter = len(found.stamps_ns) // 4  # a circle's ends are straight, as a natural spline's
    middle = slice(quarter, len(found.stamps_ns) - quarter)
    assert np.abs(found.rate_rad_s[middle] - rate_rad_s).max() < 1e-9
    assert np.abs(found.force_m_s2[middle] - force_m_s2).max() <= most_off


def test_a_single_pose_has_one_sample():
    assert measure(still(count=1), ideal(), 7, (3, "box")).stamps_ns.tolist() == [7]


def off_after(path, imu, seconds, true_path=None):
    """By how much integration from the true state after 1 s is off: metres, radians."""
    found, rate = felt(path, imu), round(imu.rate_hz)
    part = slice(rate, rate + rate * seconds + 1)
    true = imu_motion(true_path or path, imu, found.passed_s[part])
    first = true.rotation[0], true.position_m[0], true.velocity_m_s[0]
    turns, places = integrated(found.rate_rad_s[part], found.force_m_s2[part], 1 / rate, first)
    turned = rotvec_from_rotation(turns[-1].T @ true.rotation[-1])
    return float(np.linalg.norm(places[-1] - true.position_m[-1])), float(np.linalg.norm(turned))


@cases("seed", [1, 2, 3, 4, 5])
def test_it_leads_back_to_the_path_within_a_millimetre(seed):
    imu = replace(ideal(), robot_from_sensor=ARM)
    moved_m, turned = off_after(lively_path(seed=seed, strength=0.15), imu, 5)  # 1.6 m/s^2 and 0.24 rad/s rms
    assert moved_m <= 1e-3
    assert turned <= 1e-4


def test_what_integration_lacks_is_the_rules_and_not_the_imus():
    path = lively_path(seed=2)  # which shakes at 12 m/s^2 and 2.2 rad/s
    coarse, fine = (off_after(path, ideal(rate_hz=rate_hz), 5)[0] for rate_hz in (200.0, 2000.0))
    assert fine <= 1e-4
    assert coarse / fine == pytest.approx(100, rel=0.05)  # an error of the second order


def test_independent_poses_and_curves_without_derivatives_are_refused():
    path = replace(lively_path(), independent="motion_deviation moves each pose by itself")
    with pytest.raises(NoisyWorldError, match="motion_deviation moves each pose by itself"):
        measure(path, ideal(), 0, (3, "box"))

    class Plain:
        def pose_at(self, times_s):
            return np.broadcast_to(np.eye(4), (*np.shape(times_s), 4, 4))

    with pytest.raises(NoisyWorldError, match="a path of Plain has no derivatives"):
        measure(replace(lively_path(), curve=Plain()), ideal(), 0, (3, "box"))


# --- the low-pass ---


def passed(share_hz, bandwidth_hz):
    """Which share of a sine passes: half of its power at the bandwidth, and a normal fall of .15 times that."""
    fall = 0.15 * bandwidth_hz
    edge = bandwidth_hz + 0.544952 * fall  # the normal quantile of the root of a half
    return 0.5 * (
        math.erf((edge - share_hz) / fall / math.sqrt(2)) - math.erf((-edge - share_hz) / fall / math.sqrt(2))
    )


@dataclass(frozen=True)
class Shaken:
    """A curve of continuous time: 1 m/s^2 across at a frequency, without a turn."""

    frequency_hz: float

    def pose_at(self, times_s):
        return np.broadcast_to(np.eye(4), (len(times_s), 4, 4))

    def motion_at(self, times_s):
        still = np.zeros((len(times_s), 3))
        pull = still.copy()
        pull[:, 0] = np.cos(2 * np.pi * self.frequency_hz * times_s)
        return BodyMotion(np.broadcast_to(np.eye(3), (len(times_s), 3, 3)), still, still, pull, still, still)


@cases("frequency_hz", [5.0, 50.0, 64.0, 80.0, 130.0, 390.0])
def test_a_sine_passes_by_the_response_that_is_told_and_is_not_delayed(frequency_hz):
    path = replace(still(count=21), curve=Shaken(frequency_hz))
    found = felt(path, ideal(bandwidth_hz=64.0))
    wanted = passed(frequency_hz, 64.0) * np.cos(2 * np.pi * frequency_hz * found.passed_s)
    np.testing.assert_allclose(found.force_m_s2[:, 0], wanted, atol=1e-5)
    np.testing.assert_allclose(found.force_m_s2[:, 2], 9.81, atol=1e-9)


@cases(("bandwidth_hz", "top_hz"), [(64.0, 45.0), (20.0, 14.0), (0.0, 100.0), (330.0, 100.0)])
def test_white_noise_keeps_its_density_in_the_band_and_loses_it_above(bandwidth_hz, top_hz):
    model = ImuModel(gyro_noise_density=1e-3, bandwidth_hz=bandwidth_hz)
    gyro, *_ = ImuErrors(model, 200.0, stream(2, "x")).added(*np.zeros((2, 2**17, 3)))
    power = np.square(np.abs(np.fft.rfft(gyro, axis=0))).mean(axis=1) / (200.0 * 2**17)  # of both sides
    hz = np.fft.rfftfreq(2**17, 1 / 200.0)
    assert np.sqrt(power[(hz > 0.1) & (hz < top_hz)].mean()) == pytest.approx(1e-3, rel=0.01)
    if top_hz < 100:
        assert power[hz > 2 * top_hz].max() < 1e-3 * power[1:1000].mean()


@cases("seed", [1, 2])
def test_rotors_do_not_alias_through_a_low_pass(seed):
    path = lively_path(seed=seed, strength=0.15)
    shaken = vibration.apply(path, vibration.Vibration(source="rotors"), SequenceContext(("flown", seed)))
    assert off_after(shaken, ideal(bandwidth_hz=30.0), 5, path)[0] < 2e-3  # 30 Hz leaves nothing of the shaking
    assert off_after(shaken, ideal(), 5, path)[0] > 1


# --- errors ---


RATE_HZ = 50.0
TAUS_S = np.array([0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200])


def fitted(values, *, white=True):
    """Noise density and random walk by a weighted fit of N^2 / tau + K^2 tau / 3 to the Allan variance of 3 axes."""
    variance = overlapping_allan_variance(values, RATE_HZ, TAUS_S).mean(axis=1)
    weight = (np.sqrt(7200 / TAUS_S) / variance)[:, None]
    terms = np.stack([1 / TAUS_S, TAUS_S / 3], axis=1)[:, slice(0 if white else 1, 2)]
    found, *_ = np.linalg.lstsq(terms * weight, variance * weight[:, 0], rcond=None)
    return np.sqrt(found)


@pytest.mark.one_python
@cases("device", ["adis16448", "bmi055"])
def test_densities_and_walks_come_back_from_two_hours(device):
    # Without digits: those of the BMI055's accelerometer, of 12 bits, add a tenth to its noise.
    model, zeros = (
        replace(DEVICES[device], gyro_step_deg_s=0, accel_step_m_s2=0),
        np.zeros((round(2 * 3600 * RATE_HZ), 3)),
    )
    gyro, accel, *biases = ImuErrors(model, RATE_HZ, stream(5, "hall")).added(zeros, zeros)
    for values, bias, density, walk in (
        (gyro, biases[0], model.gyro_noise_density, model.gyro_random_walk),
        (accel, biases[1], model.accel_noise_density, model.accel_random_walk),
    ):
        found = fitted(values)
        assert found[0] == pytest.approx(density, rel=0.1)
        if walk * np.sqrt(200 / 3) > density / np.sqrt(200):  # the longest mean time tells it from noise
            assert found[1] == pytest.approx(walk, rel=0.1)
        assert fitted(bias, white=False)[0] == pytest.approx(walk, rel=0.1)


def test_biases_are_the_sums_that_the_samples_hold():
    model = ImuModel(gyro_random_walk=0.1, accel_random_walk=0.2, gyro_bias_rad_s=(1, 2, 3), accel_bias_m_s2=(4, 5, 6))
    zeros = np.zeros((1000, 3))
    gyro, accel, gyro_bias, accel_bias = ImuErrors(model, 100.0, stream(1, "x")).added(zeros, zeros)
    np.testing.assert_allclose(gyro, gyro_bias, atol=1e-15)
    np.testing.assert_allclose(accel, accel_bias, atol=1e-15)
    np.testing.assert_array_equal([gyro_bias[0], accel_bias[0]], [[1, 2, 3], [4, 5, 6]])
    assert np.diff(gyro_bias, axis=0).std() == pytest.approx(0.1 / 10, rel=0.05)
    assert np.diff(accel_bias, axis=0).std() == pytest.approx(0.2 / 10, rel=0.05)


def test_scale_and_misalignment_mix_the_axes_as_kalibr_does():
    model = ImuModel(accel_scale_error=(0.1, 0.0, -0.2), accel_misalignment_deg=(30.0, 0.0, -30.0))
    _, force, *_ = ImuErrors(model, 200.0, stream(1)).added(np.zeros((1, 3)), np.array([[1.0, 2.0, 4.0]]))
    np.testing.assert_allclose(force, [[1.1, 2.0 + 0.5, 0.8 * 4 - 0.5 * 2]])


@cases(
    ("value", "step", "largest", "wanted"),
    [
        (5.0, 0.0, 0.0, 5.0),
        (5.0, 0.0, 2.0, 2.0),
        (-5.0, 0.0, 2.0, -2.0),
        (0.24, 0.1, 0.0, 0.2),
        (0.26, 0.1, 0.0, 0.3),
        (-0.26, 0.1, 0.0, -0.3),
        (9.0, 0.3, 1.0, 0.9),  # the last multiple inside the range
        (9.0, 0.1, 0.3, 0.3),  # 0.3 / 0.1 is a little less than 3 as float64
        (1e9, 0.04, 1000.0, 1000.0),
        (0.4, 1.0, 0.5, 0.0),  # no multiple but 0 is inside
    ],
)
def test_digits_and_range(value, step, largest, wanted):
    np.testing.assert_allclose(digital(np.array([value]), step, largest), [wanted], atol=1e-12)


def test_a_fast_turn_saturates_the_gyro_only():
    found = felt(turning(30.0), Imu(np.eye(4), ImuModel(gyro_range_deg_s=1000.0)))
    np.testing.assert_allclose(found.rate_rad_s[:, 2], np.radians(1000.0))
    assert np.abs(found.force_m_s2 - [0, 0, 9.81]).max() < 1e-9


# --- clocks and seeds ---


@cases(("offset_s", "ppm"), [(0.0, 0.0), (0.0123, 0.0), (-0.02, 0.0), (0.05, 200.0), (-0.05, -500.0)])
def test_stamps_are_those_of_its_own_clock_and_cover_the_frames(offset_s, ppm):
    path, first_ns = lively_path(), 10**18
    found = measure(path, ideal(time_offset_s=offset_s, clock_drift_ppm=ppm), first_ns, (3, "box"))
    assert found.stamps_ns[0] <= first_ns
    assert found.stamps_ns[-1] >= first_ns + 8 * 10**9
    assert found.passed_s[0] <= 1e-12
    assert found.passed_s[-1] >= 8.0 - 1e-9
    assert set(np.diff(found.stamps_ns)) == {5_000_000}
    told_s = (found.stamps_ns - first_ns) / 1e9
    np.testing.assert_allclose(told_s, found.passed_s + offset_s + ppm * 1e-6 * found.passed_s, atol=1e-9)
    wanted, _ = imu_motion(path, ideal(), found.passed_s).felt(9.81)
    np.testing.assert_allclose(found.rate_rad_s, wanted, rtol=0, atol=0.51e-9)  # nine decimals


def test_true_states_are_those_of_the_frames_and_the_samples():
    path, noisy = lively_path(rate_hz=30.0), Imu(ARM, DEVICES["adis16448"])
    found = measure(path, noisy, 0, (3, "box"))
    frames_ns = np.rint(path.stamps_s * 1e9).astype(np.int64)
    states = found.true_states(frames_ns)
    assert (np.diff(states.stamps_ns) > 1000).all()
    assert set(frames_ns) <= set(states.stamps_ns)
    assert len(states.stamps_ns) == len(frames_ns) + len(found.stamps_ns) - 81  # every second of 1/30 s and 1/200 s
    rows = np.searchsorted(states.stamps_ns, frames_ns)
    np.testing.assert_allclose(pose(states.motion.rotation, states.motion.position_m)[rows], path.c2w @ ARM, atol=1e-8)
    at_samples = np.isin(states.stamps_ns, found.stamps_ns)
    bias = found.gyro_bias_rad_s[np.isin(found.stamps_ns, states.stamps_ns)]
    np.testing.assert_allclose(states.gyro_bias_rad_s[at_samples], bias, atol=1e-12)


@cases("device", ["bmi055", "bmi055_filtered"])
def test_more_of_a_path_begins_with_the_same_draws_and_seeds_differ(device):
    noisy = Imu(np.eye(4), DEVICES[device])
    short, long = (measure(still(count=count), noisy, 0, (3, "box")) for count in (10, 30))
    count = len(short.stamps_ns)
    np.testing.assert_array_equal(short.force_m_s2, long.force_m_s2[:count])
    np.testing.assert_array_equal(short.gyro_bias_rad_s, long.gyro_bias_rad_s[:count])
    other = measure(still(count=10), noisy, 0, (4, "box"))
    assert (short.force_m_s2 != other.force_m_s2).any()
