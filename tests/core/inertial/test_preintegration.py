# SPDX-License-Identifier: GPL-3.0-or-later
"""gtsam's preintegrated factors between true states: an implementation that is not ours finds the same motion."""

import numpy as np
import pytest
from cases import cases
from inertial_paths import lively_path

from noisy_world.trajectories.rig import ImuModel
from noisy_world.trajectories.rig import Imu, imu_motion, measure
from noisy_world.core.trajectory import evenly_stamped

gtsam = pytest.importorskip("gtsam", reason="gtsam is not installed")

DENSITIES = {"gyro_noise_density": 1.7e-4, "accel_noise_density": 2e-3}
WALKS = {"gyro_random_walk": 2e-5, "accel_random_walk": 3e-3}


def residuals(model, path, rate_hz=200):
    """The errors of CombinedImuFactor between true states a second apart: (N, 15), and their covariances."""
    imu = Imu(np.eye(4), model, rate_hz=rate_hz)
    found = measure(path, imu, 0, (3, "box"))
    motion = imu_motion(path, imu, found.passed_s)
    parameters = gtsam.PreintegrationCombinedParams.MakeSharedU(9.81)
    parameters.setGyroscopeCovariance(np.eye(3) * max(model.gyro_noise_density, 1e-9) ** 2)
    parameters.setAccelerometerCovariance(np.eye(3) * max(model.accel_noise_density, 1e-9) ** 2)
    parameters.setIntegrationCovariance(np.eye(3) * 1e-16)
    parameters.setBiasOmegaCovariance(np.eye(3) * max(model.gyro_random_walk, 1e-9) ** 2)
    parameters.setBiasAccCovariance(np.eye(3) * max(model.accel_random_walk, 1e-9) ** 2)
    count = rate_hz
    errors, covariances = [], []
    for begin in range(0, len(found.passed_s) - count, count):
        bias = [
            gtsam.imuBias.ConstantBias(found.accel_bias_m_s2[row], found.gyro_bias_rad_s[row])
            for row in (begin, begin + count)
        ]
        measured = gtsam.PreintegratedCombinedMeasurements(parameters, bias[0])
        for row in range(begin, begin + count):
            # Two samples' mean is the rate in between, which gtsam takes as constant meanwhile.
            force = (found.force_m_s2[row] + found.force_m_s2[row + 1]) / 2
            rate = (found.rate_rad_s[row] + found.rate_rad_s[row + 1]) / 2
            measured.integrateMeasurement(force, rate, 1 / rate_hz)
        factor = gtsam.CombinedImuFactor(0, 1, 2, 3, 4, 5, measured)
        states = []
        for row in (begin, begin + count):
            states += [gtsam.Pose3(gtsam.Rot3(motion.rotation[row]), motion.position_m[row]), motion.velocity_m_s[row]]
        errors.append(factor.evaluateError(*states, *bias))
        covariances.append(measured.preintMeasCov())
    return np.array(errors), np.array(covariances)


@cases(("rate_hz", "strength"), [(200, 0.15), (1000, 0.3)])  # 1.6 and 3.1 m/s^2 rms; gtsam's rule is of first order
def test_an_ideal_imu_leaves_less_than_a_millimetre_a_second(rate_hz, strength):
    errors, _ = residuals(ImuModel(), lively_path(duration_s=12.0, strength=strength), rate_hz)
    assert len(errors) == 12
    assert np.abs(errors[:, :3]).max() < 1e-3  # rad
    assert np.abs(errors[:, 3:6]).max() < 1e-3  # m


def chi_square_p(errors, covariances):
    stats = pytest.importorskip("scipy.stats", reason="scipy is not installed")
    whitened = [error @ np.linalg.solve(matrix, error) for error, matrix in zip(errors, covariances, strict=True)]
    return float(stats.kstest(whitened, "chi2", args=(errors.shape[1],)).pvalue), float(np.mean(whitened))


def test_a_noisy_imus_whitened_residuals_are_chi_square():
    still = evenly_stamped(np.tile(np.eye(4), (4001, 1, 1)))
    errors, covariances = residuals(ImuModel(**DENSITIES, **WALKS), still)
    # gtsam's covariance is of the later bias minus the earlier one, and its error of the earlier minus the later one.
    errors[:, 9:] *= -1
    p, mean = chi_square_p(errors, covariances)
    assert p > 0.05
    assert mean == pytest.approx(15, rel=0.05)
    errors, covariances = residuals(ImuModel(**DENSITIES), still)
    p, mean = chi_square_p(errors[:, :9], covariances[:, :9, :9])
    assert p > 0.05
    assert mean == pytest.approx(9, rel=0.05)
