# SPDX-License-Identifier: GPL-3.0-or-later
"""An IMU's files in a dataset, read by the rules of Basalt's and ORB-SLAM3's readers and by parsers of our own."""

import json

import numpy as np
import pytest
from refusals import refused
import yaml
from cases import cases
from inertial_paths import GRAVITY_M_S2
from worlds import path_poses
from runs import run
from written import RIG, SHAKY, extrinsics, matrix_of, names_in, replica_poses, rows_of, states, world

from noisy_world.layouts import find_sequence
from noisy_world.core.errors import StorageError
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan, plan_notes

pytestmark = pytest.mark.usefixtures("no_blender")

IMU = {"translation_m": [0.02, -0.03, 0.05], "rotation_euler_deg": [10.0, 0.0, 90.0], "device": "adis16448"}


def felt(folder, layout, rig=None, **keys):
    scenes = [{"name": "box", "mesh": "mesh.ply", "trajectory": {"file": "traj.txt", "axes": "robot"}}]
    return world(folder, layout, frames=12, rig=rig or {**RIG, "imu": IMU}, scenes=scenes, **keys)


def as_orb_slam3_reads(path):
    """Stamps in seconds, gyro and accelerometer: lines between LF, cut at commas, `#` skipped, seven numbers each."""
    rows = [line for line in path.read_bytes().decode().split("\n") if line and not line.startswith("#")]
    numbers = [[float(cell) for cell in row.split(",")] for row in rows]
    assert {len(row) for row in numbers} == {7}
    return np.array(numbers)


def as_basalt_reads(path):
    """Unsigned whole nanoseconds, then numbers each after one character, to the line's end."""
    found = []
    for line in path.read_bytes().decode().splitlines():
        if line[0] == "#":
            continue
        stamp, _, rest = line.partition(",")
        assert stamp.isdecimal()
        assert int(stamp) < 2**63
        found.append([int(stamp), *map(float, rest.split(","))])
    return found


def test_euroc_is_whole(tmp_path):
    run(felt(tmp_path / "w", "euroc"), tmp_path / "out")
    folder = tmp_path / "out/clean/box/mav0"
    samples = as_orb_slam3_reads(folder / "imu0/data.csv")
    assert rows_of(folder / "imu0/data.csv")[0][0] == "0" * 19
    frames_ns = [int(row[0]) for row in rows_of(folder / "cam0/data.csv")]
    # ORB-SLAM3 looks for the last sample before or at the first image, and for one after the last.
    assert samples[0, 0] <= frames_ns[0]
    assert samples[-1, 0] >= frames_ns[-1]
    assert set(np.diff(samples[:, 0])) == {5e6}
    about = yaml.safe_load((folder / "imu0/sensor.yaml").read_text())
    assert about["sensor_type"] == "imu"
    assert about["rate_hz"] == 200
    assert about["gyroscope_noise_density"] == 1.6968e-4
    assert about["accelerometer_random_walk"] == 3e-3
    assert np.array_equal(extrinsics(folder / "imu0/sensor.yaml"), np.eye(4))
    assert yaml.safe_load((folder / "body.yaml").read_text())["comment"] == "the IMU"
    truth = as_basalt_reads(folder / "state_groundtruth_estimate0/data.csv")
    assert {len(row) for row in truth} == {17}
    stamps_ns = [row[0] for row in truth]
    assert stamps_ns == sorted(set(stamps_ns))
    assert set(frames_ns) <= set(stamps_ns)
    assert len(truth) == len(samples)


def test_true_states_samples_and_cameras_agree(tmp_path):
    run(felt(tmp_path / "w", "euroc", rig={**RIG, "imu": {**IMU, "device": "ideal"}}), tmp_path / "out")
    run(felt(tmp_path / "r", "replica"), tmp_path / "replica")
    folder = tmp_path / "out/clean/box/mav0"
    truth = np.array(as_basalt_reads(folder / "state_groundtruth_estimate0/data.csv"))
    samples = as_orb_slam3_reads(folder / "imu0/data.csv")
    poses = np.array([matrix_of([str(int(row[0])), *map(repr, row[1:8].tolist())]) for row in truth])
    frames = np.isin(truth[:, 0], [int(row[0]) for row in rows_of(folder / "cam0/data.csv")])
    for sensor, name in (("cam0", "traj.txt"), ("depth0", "traj_depth.txt")):
        wanted = replica_poses(tmp_path / "replica/clean/box" / name)
        body_from_sensor = extrinsics(folder / sensor / "sensor.yaml")
        np.testing.assert_allclose(poses[frames] @ body_from_sensor, wanted, atol=6e-9)  # both are rounded
    # Between samples, velocity changes the position and the force changes the velocity: in the world, with gravity.
    force = (poses[:, :3, :3] @ samples[:, 4:, None])[..., 0] + GRAVITY_M_S2
    velocity, dt_s = truth[:, 8:11], 0.005
    moved = dt_s * (velocity[:-1] + velocity[1:]) / 2 - dt_s**2 * np.diff(force, axis=0) / 12
    np.testing.assert_allclose(np.diff(poses[:, :3, 3], axis=0), moved, atol=1e-8)
    np.testing.assert_allclose(np.diff(velocity, axis=0), dt_s * (force[:-1] + force[1:]) / 2, atol=2e-5)
    assert not truth[:, 11:].any()


def test_it_is_read_back_as_the_colour_cameras_sequence(tmp_path):
    run(felt(tmp_path / "w", "euroc"), tmp_path / "out")
    run(felt(tmp_path / "r", "replica"), tmp_path / "replica")
    stored = find_sequence(tmp_path / "out/clean/box")
    wanted = replica_poses(tmp_path / "replica/clean/box/traj.txt")
    np.testing.assert_allclose(stored.trajectory.c2w, wanted, atol=6e-9)
    assert len(stored.trajectory) == 12


@cases("layout", ["replica", "tum", "vslamlab"])
def test_other_layouts_have_it_beside(tmp_path, layout):
    tmp_path /= layout
    run(felt(tmp_path / "e", "euroc"), tmp_path / "euroc")
    run(felt(tmp_path / "w", layout), tmp_path / "out")
    folder, mav = tmp_path / "out/clean/box", tmp_path / "euroc/clean/box/mav0"
    assert (folder / "imu.csv").read_bytes() == (mav / "imu0/data.csv").read_bytes()
    assert (folder / "imu_states.csv").read_bytes() == (mav / "state_groundtruth_estimate0/data.csv").read_bytes()
    about = yaml.safe_load((folder / "imu.yaml").read_text())
    np.testing.assert_allclose(np.linalg.inv(about["T_cam_imu"]), extrinsics(mav / "cam0/sensor.yaml"), atol=1e-12)
    run(felt(tmp_path / "x", layout, rig=RIG), tmp_path / "out", overwrite=True)
    assert not names_in(folder) & {"imu.csv", "imu.yaml", "imu_states.csv"}


def test_tum_vi_has_it_in_mav0_and_in_dso(tmp_path):
    rig = {**RIG, "imu": {**IMU, "time_offset_s": 0.02}}
    run(felt(tmp_path / "e", "euroc", rig=rig), tmp_path / "euroc")
    run(felt(tmp_path / "w", "tum_vi", rig=rig), tmp_path / "out")
    folder, mav = tmp_path / "out/clean/box", tmp_path / "euroc/clean/box/mav0"
    assert (folder / "mav0/imu0/data.csv").read_bytes() == (mav / "imu0/data.csv").read_bytes()
    samples = as_orb_slam3_reads(folder / "mav0/imu0/data.csv")
    spaced = [line.split(" ") for line in (folder / "dso/imu.txt").read_text().splitlines()[1:]]
    np.testing.assert_array_equal(np.array(spaced, float), samples)
    truth = as_basalt_reads(mav / "state_groundtruth_estimate0/data.csv")
    assert as_basalt_reads(folder / "mav0/mocap0/data.csv") == [row[:8] for row in truth]
    assert (folder / "imu_states.csv").read_bytes() == (mav / "state_groundtruth_estimate0/data.csv").read_bytes()
    # As VSLAM-LAB and others read Kalibr's files: plain YAML.
    chain = yaml.safe_load((folder / "dso/camchain.yaml").read_text())["cam0"]
    np.testing.assert_allclose(np.linalg.inv(chain["T_cam_imu"]), extrinsics(mav / "cam0/sensor.yaml"), atol=1e-12)
    assert chain["intrinsics"] == [4.0, 4.0, 3.5, 2.5]
    noise = yaml.safe_load((folder / "dso/imu_config.yaml").read_text())
    assert noise["gyroscope_noise_density"] == 1.6968e-4
    assert noise["update_rate"] == 200
    assert not (folder / "mav0/state_groundtruth_estimate0").exists()
    np.testing.assert_allclose(
        find_sequence(folder).trajectory.c2w, find_sequence(tmp_path / "euroc/clean/box").trajectory.c2w, atol=1e-12
    )
    run(felt(tmp_path / "x", "tum_vi", rig=RIG), tmp_path / "out", overwrite=True)
    assert not names_in(folder) & {"dso/imu.txt", "dso/camchain.yaml", "dso/imu_config.yaml", "imu_states.csv"}


@cases(
    ("distortion", "line"),
    [
        ({"model": "radial-tangential", "k1": 0.1, "p1": 1e-3}, "RadTan 4.0 4.0 3.5 2.5 0.1 0.0 0.001 0.0"),
        ({"model": "equidistant", "k1": 0.1}, "EquiDistant 4.0 4.0 3.5 2.5 0.1 0.0 0.0 0.0"),
        ({"model": "radial-tangential", "k1": 0.1, "k3": 0.01}, None),
        (None, "Pinhole 4.0 4.0 3.5 2.5 0.0"),
    ],
)
def test_a_lens_as_dso_has_it(distortion, line):
    from noisy_world.layouts.tum_vi import _dso_lens
    from noisy_world.core.lens import Distortion

    values = None if distortion is None else [distortion.get(name, 0.0) for name in ("k1", "k2", "p1", "p2")]
    if distortion is not None and distortion["model"] == "equidistant":
        values = [distortion.get(f"k{k}", 0.0) for k in (1, 2, 3, 4)]
    if distortion is not None and "k3" in distortion and distortion["model"] != "equidistant":
        values = [*values, distortion["k3"]]
    lens = None if distortion is None else Distortion(distortion["model"], tuple(values))
    model, found = _dso_lens(lens)
    said = None if model is None else " ".join([model, "4.0 4.0 3.5 2.5", *map(repr, found)])
    assert said == line


def test_vslamlab_has_it_in_its_calibration(tmp_path):
    run(felt(tmp_path / "e", "euroc"), tmp_path / "euroc")
    run(felt(tmp_path / "w", "vslamlab"), tmp_path / "out")
    folder, mav = tmp_path / "out/clean/box", tmp_path / "euroc/clean/box/mav0"
    header, *rows = (folder / "imu_0.csv").read_text().splitlines()
    assert header == "ts (ns),wx (rad s^-1),wy (rad s^-1),wz (rad s^-1),ax (m s^-2),ay (m s^-2),az (m s^-2)"
    numbers = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    np.testing.assert_array_equal(numbers, as_orb_slam3_reads(mav / "imu0/data.csv"))
    told = yaml.safe_load((folder / "calibration.yaml").read_text().partition("---\n")[2])
    (camera,), (imu,) = told["cameras"], told["imus"]
    # VSLAM-LAB's sequences have the IMU as the body, and T_BS is a sensor's pose in the body's frame.
    assert imu["T_BS"] == np.eye(4).ravel().tolist()
    np.testing.assert_allclose(np.reshape(camera["T_BS"], (4, 4)), extrinsics(mav / "cam0/sensor.yaml"), atol=1e-12)
    keys = "a_max g_max sigma_g_c sigma_gw_c sigma_a_c sigma_aw_c sigma_bg sigma_ba g fps"
    assert all(isinstance(imu[name], float) for name in keys.split())
    assert (imu["sigma_g_c"], imu["sigma_aw_c"], imu["fps"]) == (1.6968e-4, 3e-3, 200.0)
    assert imu["g_max"] == pytest.approx(np.radians(1000))
    stored = find_sequence(folder)
    np.testing.assert_allclose(
        stored.trajectory.c2w, find_sequence(tmp_path / "euroc/clean/box").trajectory.c2w, atol=6e-9
    )


def test_settings_on_one_path_share_samples_and_faster_ones_feel_more(tmp_path):
    settings = [
        {"name": "clean"},
        {"name": "noisy", "perturb": [{"gaussian_noise": {"severity": 2}}]},
        {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]},
    ]
    run(felt(tmp_path / "w", "euroc", settings=settings), tmp_path / "out")
    clean, noisy, fast = (tmp_path / f"out/{name}/box/mav0/imu0/data.csv" for name in ("clean", "noisy", "fast"))
    assert clean.read_bytes() == noisy.read_bytes()
    slow, quick = (np.abs(as_orb_slam3_reads(path)[:, 1:4]).max() for path in (clean, fast))
    assert quick > 1.5 * slow
    truth = np.array(as_basalt_reads(tmp_path / "out/fast/box/mav0/state_groundtruth_estimate0/data.csv"))
    speed = np.linalg.norm(np.gradient(truth[:, 1:4], truth[:, 0] / 1e9, axis=0), axis=1)
    np.testing.assert_allclose(np.linalg.norm(truth[:, 8:11], axis=1)[3:-3], speed[3:-3], rtol=0.02)


def test_the_same_bytes_whichever_frames_were_made_first(tmp_path):
    preset = felt(tmp_path / "w", "euroc")
    run(preset, tmp_path / "once")
    run(preset, tmp_path / "twice", frames=slice(0, 5))
    part = (tmp_path / "twice/clean/box/mav0/imu0/data.csv").read_bytes()
    run(preset, tmp_path / "twice")
    for name in ("imu0/data.csv", "imu0/sensor.yaml", "state_groundtruth_estimate0/data.csv"):
        first, second = (tmp_path / out / "clean/box/mav0" / name for out in ("once", "twice"))
        assert first.read_bytes() == second.read_bytes()
    assert part == (tmp_path / "once/clean/box/mav0/imu0/data.csv").read_bytes()


def test_without_an_imu_the_body_is_the_robot_as_before(tmp_path):
    run(felt(tmp_path / "w", "euroc", rig=RIG), tmp_path / "out")
    folder = tmp_path / "out/clean/box"
    assert not (folder / "mav0/imu0").exists()
    _, poses = states(folder)
    turned = poses @ extrinsics(folder / "mav0/cam0/sensor.yaml")
    stored = find_sequence(folder)
    np.testing.assert_allclose(stored.trajectory.c2w, turned, atol=1e-12)
    assert len(path_poses(12)) == len(poses)


@cases(
    ("override", "names"),
    [
        (f"settings=[{json.dumps(SHAKY)}]", "rig.imu: shaky: motion_deviation "),
        ("rig.imu.bandwidth_hz=0.1", ["rig.imu.bandwidth_hz: ", "0.1 Hz"]),
        ("rig.imu.time_offset_s=-0.01", ["rig.imu.time_offset_s: ", "box", "-0.01 s"]),
        ("rig.imu.device=adis16449", ["rig.imu.device: ", "'adis16449'", "'adis16448'"]),
        ("rig.imu.rate_hz=0", "rig.imu.rate_hz: "),
        ("rig.imu.gyro_noise_density=-1", "rig.imu.gyro_noise_density: "),
        ("rig.imu.quat_wxyz=[1, 0, 0, 0]", ["rig.imu: ", "rotation"]),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(tmp_path, override, names):
    preset = felt(tmp_path, "euroc")
    refused(lambda: make_plan(read_preset(preset, [override])), names=names)


@cases(
    ("override", "aliases"),
    [
        ("rig.imu.rate_hz=200", True),
        ("rig.imu.rate_hz=441", False),  # rotors shake at up to 220 Hz
        ("rig.imu.bandwidth_hz=64", False),
        ("rig.imu.bandwidth_hz=300", True),
        ("settings.0.perturb.0.vibration.high_hz=99", False),
        ("settings.0.perturb.0.vibration.severity=0", False),
    ],
)
def test_a_plan_says_what_an_imu_aliases(tmp_path, override, aliases):
    shaken = [{"name": "flown", "perturb": [{"vibration": {"source": "rotors", "high_hz": -1, "severity": 3}}]}]
    preset = felt(tmp_path, "euroc", settings=shaken)
    told = [text for text in plan_notes(make_plan(read_preset(preset, [override]))) if "rig.imu.bandwidth_hz" in text]
    assert len(told) == aliases


def test_another_imu_is_another_dataset(tmp_path):
    preset = felt(tmp_path / "w", "euroc")
    run(preset, tmp_path / "out")
    rate = ["rig.imu.rate_hz=100"]
    refused(run, preset, tmp_path / "out", overrides=rate, names="rig.imu.rate_hz was 200, is 100", error=StorageError)
