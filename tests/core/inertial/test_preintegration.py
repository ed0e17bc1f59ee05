# SPDX-License-Identifier: GPL-3.0-or-later
"""gtsam's preintegrated factors between true states: an implementation that is not ours finds the same motion."""

import numpy as np
import pytest
from inertial_paths import lively_path

from noisy_world.core.inertial.devices import ImuModel
from noisy_world.core.inertial.imu import Imu, imu_motion, measure

gtsam = pytest.importorskip("gtsam", reason="gtsam is not installed")

RATE_HZ = 200
STEP_S = 1 / RATE_HZ
DENSITIES = {"gyro_noise_density": 1.7e-4, "accel_noise_density": 2e-3}
WALKS = {"gyro_random_walk": 2e-5, "accel_random_walk": 3e-3}


def residuals(model, path, duration_s=1.0):
    """The errors of CombinedImuFactor between true states a duration apart: (N, 15), and their covariances."""
    imu = Imu(np.eye(4), model, rate_hz=RATE_HZ)
    found = measure(path, imu, 0, (3, "box"))
    motion = imu_motion(path, imu, found.passed_s)
    parameters = gtsam.PreintegrationCombinedParams.MakeSharedU(9.81)
    parameters.setGyroscopeCovariance(np.eye(3) * max(model.gyro_noise_density, 1e-9) ** 2)
    parameters.setAccelerometerCovariance(np.eye(3) * max(model.accel_noise_density, 1e-9) ** 2)
    parameters.setIntegrationCovariance(np.eye(3) * 1e-16)
    parameters.setBiasOmegaCovariance(np.eye(3) * max(model.gyro_random_walk, 1e-9) ** 2)
    parameters.setBiasAccCovariance(np.eye(3) * max(model.accel_random_walk, 1e-9) ** 2)
    count = round(duration_s * RATE_HZ)
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
            measured.integrateMeasurement(force, rate, STEP_S)
        factor = gtsam.CombinedImuFactor(0, 1, 2, 3, 4, 5, measured)
        states = []
        for row in (begin, begin + count):
            states += [gtsam.Pose3(gtsam.Rot3(motion.rotation[row]), motion.position_m[row]), motion.velocity_m_s[row]]
        errors.append(factor.evaluateError(*states, *bias))
        covariances.append(measured.preintMeasCov())
    return np.array(errors), np.array(covariances)


def test_an_ideal_imu_leaves_less_than_a_millimetre_a_second():
    errors, _ = residuals(ImuModel(), lively_path(duration_s=12.0))
    assert len(errors) == 12
    assert np.abs(errors[:, :3]).max() < 1e-3  # rad
    assert np.abs(errors[:, 3:6]).max() < 1e-3  # m
