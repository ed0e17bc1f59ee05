# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of estimators beside an EuRoC sequence, read as the estimators read them: by OpenCV, and as YAML."""

import cv2
import numpy as np
import pytest
import yaml
from cases import cases
from test_imu_files import IMU, RIG, felt
from runs import run
from written import extrinsics

from noisy_world.layouts.estimator_settings import settings_texts
from noisy_world.core.geometry import Intrinsics
from noisy_world.trajectories.rig import Imu, ImuModel
from noisy_world.core.lens import Distortion

pytestmark = pytest.mark.usefixtures("no_blender")

FISHEYE = Distortion("equidistant", (0.1, -0.02, 0.003, -0.0004))
BARREL = Distortion("radial-tangential", (-0.28, 0.07, 1e-5, -2e-4))


def opened(text):
    storage = cv2.FileStorage(text, cv2.FileStorage_READ | cv2.FileStorage_MEMORY)
    assert storage.isOpened()
    return storage


def parsed(text):
    header, _, rest = text.partition("\n")
    assert header == "%YAML:1.0"
    return yaml.safe_load(rest)


def texts_of(imu, distortion=None):
    camera, pose = Intrinsics(640, 480, 500.0, 501.0, 319.5, 239.25), np.eye(4)
    pose[:3, 3] = 0.1, -0.02, 3e-5
    found = settings_texts(camera, distortion, imu, pose, rate_hz=20.0, depth_scale_per_m=5000.0)
    return {name.removeprefix("settings/"): text for name, text in found.items()}, pose


def test_a_sequence_has_them_with_the_numbers_of_its_rig(tmp_path):
    run(felt(tmp_path / "w", "euroc", rig={**RIG, "imu": {**IMU, "time_offset_s": 0.02}}), tmp_path / "out")
    folder = tmp_path / "out/clean/box"
    body_from_rgb = extrinsics(folder / "mav0/cam0/sensor.yaml")
    orb = opened((folder / "settings/orb_slam3_rgbd_inertial.yaml").read_text())
    assert orb.getNode("IMU.T_b_c1").mat().dtype == np.float32
    np.testing.assert_allclose(orb.getNode("IMU.T_b_c1").mat(), body_from_rgb, atol=1e-7)
    assert orb.getNode("RGBD.DepthMapFactor").real() == 5000
    assert orb.getNode("IMU.NoiseGyro").real() == 1.6968e-4
    assert orb.getNode("Camera.width").real() == 8
    chain = parsed((folder / "settings/kalibr_imucam_chain.yaml").read_text())["cam0"]
    np.testing.assert_allclose(np.linalg.inv(chain["T_cam_imu"]), body_from_rgb, atol=1e-12)
    assert chain["timeshift_cam_imu"] == 0.02
    vins = opened((folder / "settings/vins_fusion.yaml").read_text())
    np.testing.assert_allclose(vins.getNode("body_T_cam0").mat(), body_from_rgb, atol=1e-12)
    assert vins.getNode("acc_n").real() == pytest.approx(2e-3 * 200**0.5)
    assert vins.getNode("td").real() == 0.02
    run(felt(tmp_path / "x", "euroc", rig=RIG), tmp_path / "out", overwrite=True)
    assert not (folder / "settings").exists()


@cases("distortion", [None, BARREL, FISHEYE])
def test_lenses_are_told_in_each_estimators_words(distortion):
    texts, pose = texts_of(Imu(np.eye(4), ImuModel()), distortion)
    values = (0.0,) * 4 if distortion is None else distortion.coefficients
    fisheye = distortion is FISHEYE
    orb, camera = (opened(texts[name]) for name in ("orb_slam3_mono_inertial.yaml", "vins_fusion_cam0.yaml"))
    assert orb.getNode("Camera.type").string() == ("KannalaBrandt8" if fisheye else "PinHole")
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2")
    assert [orb.getNode(f"Camera1.{name}").real() for name in names] == list(values)
    assert orb.getNode("RGBD.DepthMapFactor").empty()
    chain = parsed(texts["kalibr_imucam_chain.yaml"])["cam0"]
    assert chain["distortion_model"] == ("equidistant" if fisheye else "radtan")
    assert chain["distortion_coeffs"] == list(values)
    assert chain["intrinsics"] == [500.0, 501.0, 319.5, 239.25]
    seen = camera.getNode("projection_parameters")
    if fisheye:
        assert [seen.getNode(name).real() for name in ("k2", "k3", "k4", "k5", "mu", "v0")] == [*values, 500.0, 239.25]
    else:
        lens = camera.getNode("distortion_parameters")
        assert [lens.getNode(name).real() for name in names] == list(values)
        assert seen.getNode("fy").real() == 501.0
    np.testing.assert_allclose(np.array(chain["T_cam_imu"]) @ pose, np.eye(4), atol=1e-15)


def test_an_ideal_imu_has_noises_that_can_be_divided_by_and_a_bent_one_its_matrices():
    model = ImuModel(gyro_scale_error=(0.01, 0.0, -0.02), accel_misalignment_deg=(1.0, 0.0, 0.0))
    texts, _ = texts_of(Imu(np.eye(4), model, rate_hz=400.0))
    chain = parsed(texts["kalibr_imu_chain.yaml"])["imu0"]
    assert chain["update_rate"] == 400
    assert chain["gyroscope_noise_density"] == 1e-6
    np.testing.assert_allclose(chain["Tw"], np.diag([1.01, 1.0, 0.98]))
    np.testing.assert_allclose(chain["Ta"], model.accel_matrix)
    orb = opened(texts["orb_slam3_mono_inertial.yaml"])
    assert orb.getNode("IMU.AccWalk").real() == 1e-6
    assert orb.getNode("IMU.Frequency").real() == 400


@cases(("count", "told"), [(5, 3), (8, 1)])
def test_an_estimator_that_cannot_be_told_a_lens_has_no_file(count, told):
    texts, _ = texts_of(Imu(np.eye(4), ImuModel()), Distortion("radial-tangential", (0.01,) * count))
    assert len(texts) == told
    if count == 5:
        assert opened(texts["orb_slam3_mono_inertial.yaml"]).getNode("Camera1.k3").real() == 0.01
