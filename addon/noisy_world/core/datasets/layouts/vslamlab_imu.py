# SPDX-License-Identifier: GPL-3.0-or-later
"""An IMU as VSLAM-LAB has it: `imu_0.csv`, and its mapping in `calibration.yaml`.

Columns and keys are those of https://github.com/VSLAM-LAB/VSLAM-LAB: Datasets/dataset_files/dataset_euroc.py and
Datasets/DatasetVSLAMLab_calibration.py.
"""

from collections.abc import Sequence

import numpy as np

from ...inertial.imu import Imu, ImuSamples
from .imu_settings import LEAST
from .layout import lines

SAMPLES = "imu_0.csv"
COLUMNS = ("ts (ns)", *(f"w{axis} (rad s^-1)" for axis in "xyz"), *(f"a{axis} (m s^-2)" for axis in "xyz"))
# What VSLAM-LAB says of every IMU: how far its biases may be from 0 at first.
BIAS_PRIORS = {"sigma_bg": 0.01, "sigma_ba": 0.1}  # rad/s, m/s^2
BOUNDLESS = 1000.0  # of an IMU that saturates nowhere, rad/s and m/s^2


def vslamlab_samples(samples: ImuSamples) -> str:
    """Return what an IMU measured: t [ns] of its own clock, angular velocity, specific force."""
    values = (np.concatenate([samples.rate_rad_s, samples.force_m_s2], axis=1) + 0.0).tolist()
    rows = zip(samples.stamps_ns.tolist(), values, strict=True)
    return lines([",".join(COLUMNS), *(",".join([str(stamp_ns), *map(repr, row)]) for stamp_ns, row in rows)])


def vslamlab_imu(imu: Imu) -> list[str]:
    """Return the lines of an IMU that is the body. Noises that are 0 are the least that estimators divide by."""
    model = imu.model
    numbers = {
        "a_max": model.accel_range_m_s2 or BOUNDLESS,
        "g_max": float(np.radians(model.gyro_range_deg_s)) or BOUNDLESS,
        "sigma_g_c": max(model.gyro_noise_density, LEAST),
        "sigma_gw_c": max(model.gyro_random_walk, LEAST),
        "sigma_a_c": max(model.accel_noise_density, LEAST),
        "sigma_aw_c": max(model.accel_random_walk, LEAST),
        **BIAS_PRIORS,
    }
    entries = ["imu_name: imu_0", *(f"{name}: {number(value)}" for name, value in numbers.items())]
    entries += ["a0: [0.0, 0.0, 0.0]", "g0: [0.0, 0.0, 0.0]", f"g: {number(imu.gravity_m_s2)}", "s_a: [1.0, 1.0, 1.0]"]
    return braced([*entries, f"fps: {number(imu.rate_hz)}", f"T_BS: [{', '.join(map(number, np.eye(4).ravel()))}]"])


def braced(entries: Sequence[str]) -> list[str]:
    """Return an item of a list, a mapping broken into lines as VSLAM-LAB's own writer does it."""
    return ["  - {" + ",\n     ".join(entries), "    }"]


def number(value: float) -> str:
    """Return a number with a point: YAML 1.1 takes 1e-05 for a text."""
    digits, e, exponent = repr(float(value)).partition("e")
    return f"{digits}{'' if '.' in digits or not e else '.0'}{e}{exponent}"
