# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of visual-inertial estimators for a sequence, from the numbers of its camera and its IMU.

For ORB-SLAM3 (with depth and without), for OpenVINS (Kalibr's chains) and for VINS-Fusion. The body is the IMU.
"""

import math
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics, invert_pose
from ..core.lens import Distortion
from ..trajectories.rig import Imu
from .asl import yaml_number, yaml_row
from .layout import lines

FOLDER = "settings"
ORB = ("orb_slam3_rgbd_inertial.yaml", "orb_slam3_mono_inertial.yaml")
CHAINS = ("kalibr_imu_chain.yaml", "kalibr_imucam_chain.yaml", "vins_fusion.yaml", "vins_fusion_cam0.yaml")
NAMES = (*ORB, *CHAINS)
HEADER = "%YAML:1.0"  # OpenCV's: PyYAML reads what follows it
LEAST = 1e-6  # of noises that are 0, by which estimators divide

# As the estimators' own examples have them: EuRoC's and TUM1's of ORB-SLAM3, and EuRoC's of VINS-Fusion.
_ORB = """Stereo.ThDepth: 40.0
Stereo.b: 0.0745
ORBextractor.nFeatures: 1000
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7
Viewer.KeyFrameSize: 0.05
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 0.9
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.08
Viewer.CameraLineWidth: 3.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -0.7
Viewer.ViewpointZ: -3.5
Viewer.ViewpointF: 500.0
"""
_VINS = """imu: 1
num_of_cam: 1
imu_topic: "/imu0"
image0_topic: "/cam0/image_raw"
output_path: "."
cam0_calib: "vins_fusion_cam0.yaml"
multiple_thread: 1
max_cnt: 150
min_dist: 30
freq: 10
F_threshold: 1.0
show_track: 0
flow_back: 1
max_solver_time: 0.04
max_num_iterations: 8
keyframe_parallax: 10.0
estimate_extrinsic: 0
estimate_td: 0
load_previous_pose_graph: 0
pose_graph_save_path: "."
save_image: 0
"""

Values: TypeAlias = Mapping[str, float | int | str]


def settings_texts(
    camera: Intrinsics,
    distortion: Distortion | None,
    imu: Imu,
    imu_from_rgb: NDArray[np.float64],
    *,
    rate_hz: float,
    depth_scale_per_m: float,
) -> dict[str, str]:
    """Return the settings by file name. imu_from_rgb: (4, 4). rate_hz: of the frames.

    What an estimator cannot be told of a lens has no file for it: ORB-SLAM3 knows five coefficients, the others four.
    """
    count = 0 if distortion is None else len(distortion.coefficients)
    texts = (
        [_imu_chain(imu)]
        if count > 4
        else [
            *(_imu_chain(imu), _camera_chain(camera, distortion, imu, imu_from_rgb)),
            *(_vins(camera, imu, imu_from_rgb), _vins_camera(camera, distortion)),
        ]
    )
    found = dict(zip(CHAINS, texts, strict=False))
    if count <= 5:
        orb = _orb_slam3(camera, distortion, imu, imu_from_rgb, rate_hz)
        with_depth = f"{orb}RGBD.DepthMapFactor: {yaml_number(depth_scale_per_m)}\n"
        found |= dict(zip(ORB, (with_depth, orb), strict=True))
    return {f"{FOLDER}/{name}": text for name, text in found.items()}


def _orb_slam3(
    camera: Intrinsics, distortion: Distortion | None, imu: Imu, imu_from_rgb: NDArray[np.float64], rate_hz: float
) -> str:
    """Return ORB-SLAM3's settings of a camera and an IMU; without depth. Densities and walks are continuous ones."""
    fisheye = distortion is not None and distortion.model == "equidistant"
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    coefficients = (0.0,) * 4 if distortion is None else distortion.coefficients
    lens = {f"Camera1.{name}": value for name, value in zip(names, coefficients, strict=False)}
    text = _settings(
        {
            "File.version": '"1.0"',
            "Camera.type": '"KannalaBrandt8"' if fisheye else '"PinHole"',
            **{
                f"Camera1.{name}": value for name, value in zip(("fx", "fy", "cx", "cy"), _pinhole(camera), strict=True)
            },
            **lens,
            "Camera.width": camera.width_px,
            "Camera.height": camera.height_px,
            "Camera.fps": max(1, round(rate_hz)),
            "Camera.RGB": 1,
            "IMU.NoiseGyro": max(imu.model.gyro_noise_density, LEAST),
            "IMU.NoiseAcc": max(imu.model.accel_noise_density, LEAST),
            "IMU.GyroWalk": max(imu.model.gyro_random_walk, LEAST),
            "IMU.AccWalk": max(imu.model.accel_random_walk, LEAST),
            "IMU.Frequency": imu.rate_hz,
            "IMU.InsertKFsWhenLost": 0,
        }
    )
    return text + _opencv_matrix("IMU.T_b_c1", imu_from_rgb, "f") + _ORB


def _imu_chain(imu: Imu) -> str:
    """Return Kalibr's chain of an IMU, as OpenVINS reads it: Tw and Ta are what its axes measure of the true ones."""
    turns = {"R_IMUtoGYRO": np.eye(3), "R_IMUtoACC": np.eye(3), "Tg": np.zeros((3, 3))}
    matrices = {"Tw": imu.model.gyro_matrix, "Ta": imu.model.accel_matrix, **turns}
    rows = [
        *(HEADER, "imu0:", "  T_i_b:", *_rows(np.eye(4), 4)),
        f"  accelerometer_noise_density: {yaml_number(max(imu.model.accel_noise_density, LEAST))}",
        f"  accelerometer_random_walk: {yaml_number(max(imu.model.accel_random_walk, LEAST))}",
        f"  gyroscope_noise_density: {yaml_number(max(imu.model.gyro_noise_density, LEAST))}",
        f"  gyroscope_random_walk: {yaml_number(max(imu.model.gyro_random_walk, LEAST))}",
        *("  model: kalibr", "  rostopic: /imu0", "  time_offset: 0.0"),
        f"  update_rate: {yaml_number(imu.rate_hz)}",
    ]
    for name, matrix in matrices.items():
        rows += [f"  {name}:", *_rows(matrix, 4)]
    return lines(rows)


def _camera_chain(
    camera: Intrinsics, distortion: Distortion | None, imu: Imu, imu_from_rgb: NDArray[np.float64]
) -> str:
    """Return Kalibr's chain of a camera: T_cam_imu takes points from the IMU; t_imu = t_cam + timeshift_cam_imu."""
    lens = distortion or Distortion("radial-tangential", (0.0, 0.0, 0.0, 0.0))
    model = "equidistant" if lens.model == "equidistant" else "radtan"
    return lines(
        [
            *(HEADER, "cam0:", "  T_cam_imu:", *_rows(invert_pose(imu_from_rgb), 4)),
            *("  cam_overlaps: []", "  camera_model: pinhole"),
            f"  distortion_coeffs: {yaml_row(lens.coefficients)}",
            f"  distortion_model: {model}",
            f"  intrinsics: {yaml_row(_pinhole(camera))}",
            f"  resolution: [{camera.width_px}, {camera.height_px}]",
            "  rostopic: /cam0/image_raw",
            f"  timeshift_cam_imu: {yaml_number(imu.time_offset_s)}",
        ]
    )


def _vins(camera: Intrinsics, imu: Imu, imu_from_rgb: NDArray[np.float64]) -> str:
    """Return VINS-Fusion's settings. Its noises are of a sample: densities times sqrt(rate)."""
    root = math.sqrt(imu.rate_hz)
    text = _settings(
        {
            "image_width": camera.width_px,
            "image_height": camera.height_px,
            "acc_n": max(imu.model.accel_noise_density, LEAST) * root,
            "gyr_n": max(imu.model.gyro_noise_density, LEAST) * root,
            "acc_w": max(imu.model.accel_random_walk, LEAST) * root,
            "gyr_w": max(imu.model.gyro_random_walk, LEAST) * root,
            "g_norm": imu.gravity_m_s2,
            "td": imu.time_offset_s,
        }
    )
    return text + _VINS + _opencv_matrix("body_T_cam0", imu_from_rgb, "d")


def _vins_camera(camera: Intrinsics, distortion: Distortion | None) -> str:
    """Return the camera as VINS-Fusion's camodocal reads it."""
    fx, fy, cx, cy = _pinhole(camera)
    fisheye = distortion is not None and distortion.model == "equidistant"
    head = _settings(
        {
            "model_type": "KANNALA_BRANDT" if fisheye else "PINHOLE",
            "camera_name": "cam0",
            "image_width": camera.width_px,
            "image_height": camera.height_px,
        }
    )
    coefficients = (0.0,) * 4 if distortion is None else distortion.coefficients
    if fisheye:
        seen: Values = dict(zip(("k2", "k3", "k4", "k5"), coefficients, strict=True))
        return head + _section("projection_parameters", {**seen, "mu": fx, "mv": fy, "u0": cx, "v0": cy})
    lens: Values = dict(zip(("k1", "k2", "p1", "p2"), coefficients, strict=True))
    pinhole = _section("projection_parameters", {"fx": fx, "fy": fy, "cx": cx, "cy": cy})
    return head + _section("distortion_parameters", lens) + pinhole


def _pinhole(camera: Intrinsics) -> tuple[float, float, float, float]:
    return float(camera.fx_px), float(camera.fy_px), float(camera.cx_px), float(camera.cy_px)


def _settings(values: Values) -> str:
    return lines([HEADER, *(f"{name}: {_text(value)}" for name, value in values.items())])


def _section(name: str, values: Values) -> str:
    return lines([f"{name}:", *(f"   {key}: {_text(value)}" for key, value in values.items())])


def _text(value: float | str) -> str:
    return yaml_number(value) if isinstance(value, float) else str(value)


def _rows(matrix: NDArray[np.float64], indent: int) -> list[str]:
    return [f"{' ' * indent}- {yaml_row(row)}" for row in matrix]


def _opencv_matrix(name: str, matrix: NDArray[np.float64], kind: str) -> str:
    """Return a matrix (4, 4) as OpenCV's files have it. kind: f or d."""
    return lines(
        [
            f"{name}: !!opencv-matrix",
            *("   rows: 4", "   cols: 4", f"   dt: {kind}"),
            f"   data: {yaml_row(matrix.ravel())}",
        ]
    )
