# SPDX-License-Identifier: GPL-3.0-or-later
"""An IMU that was recorded beside the frames passes through, and says where it sits."""

import numpy as np
import pytest
import yaml
from recorded_layouts import WRITTEN
from recorded_presets import preset_of
from refusals import refused
from runs import run

from noisy_world.layouts import find_sequence

RNG = np.random.default_rng(3)
FIRST_NS = 1403636579763555584
SAMPLES = [[str(FIRST_NS + 5_000_001 * k), *map(repr, RNG.normal(size=6).tolist())] for k in range(40)]
MEASURED = [[int(row[0]), *map(float, row[1:])] for row in SAMPLES]
BODY_FROM_IMU = np.array([[0.0, -1.0, 0.0, 0.02], [1.0, 0.0, 0.0, -0.1], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.0, 1.0]])


def with_imu(folder, layout="euroc"):
    WRITTEN[layout](folder)
    imu = folder / "mav0/imu0"
    imu.mkdir()
    (imu / "data.csv").write_text("#timestamp [ns],w,a\n" + "".join(",".join(row) + "\n" for row in SAMPLES))
    described = {"T_BS": BODY_FROM_IMU.ravel().tolist(), "rate_hz": 200, "gyroscope_noise_density": 1.7e-4}
    (imu / "sensor.yaml").write_text(yaml.safe_dump(described))
    return folder


def made(folder, layout, imu=None, **setting):
    scene = {"name": "box", "sequence": str(with_imu(folder / "recording")), **({"imu": imu} if imu else {})}
    settings = [{"name": "noise", "perturb": [{"gaussian_noise": {"severity": 1}}, *setting.values()]}]
    run(preset_of(folder / "p", scene, settings=settings, output={"layout": layout}), folder / "out")
    return folder / "out/noise/box"


def numbers(path):
    rows = [line.split(",") for line in path.read_text().splitlines()[1:]]
    return [[int(row[0]), *map(float, row[1:])] for row in rows]


def matrix(values):
    return np.reshape(values["data"] if isinstance(values, dict) else values, (4, 4))


def test_samples_come_back_to_the_bit_and_poses_stay(tmp_path):
    sequence = made(tmp_path, "euroc")
    assert numbers(sequence / "mav0/imu0/data.csv") == MEASURED
    before, after = find_sequence(tmp_path / "recording"), find_sequence(sequence)
    assert np.abs(before.trajectory.c2w - after.trajectory.c2w).max() < 1e-9
    # The body is the IMU now: what was between the two sensors is between them still.
    camera = matrix(yaml.safe_load((sequence / "mav0/cam0/sensor.yaml").read_text())["T_BS"])
    was = before.imu.rig.rgb.robot_from_sensor
    np.testing.assert_allclose(camera, np.linalg.inv(BODY_FROM_IMU) @ was, rtol=0, atol=1e-12)
    described = yaml.safe_load((sequence / "mav0/imu0/sensor.yaml").read_text())
    assert described["gyroscope_noise_density"] == 1.7e-4
    np.testing.assert_array_equal(matrix(described["T_BS"]), np.eye(4))


def test_every_layout_has_it(tmp_path):
    sequence = made(tmp_path, "tum")
    assert numbers(sequence / "imu.csv") == MEASURED
    was = find_sequence(tmp_path / "recording").imu.rig.rgb.robot_from_sensor
    rgb_from_imu = yaml.safe_load((sequence / "imu.yaml").read_text())["T_cam_imu"]
    np.testing.assert_allclose(rgb_from_imu, np.linalg.inv(was) @ BODY_FROM_IMU, rtol=0, atol=1e-8)
    assert not (sequence / "imu_states.csv").exists()  # which nobody knows


def test_frames_that_are_skipped_have_another_path_and_no_imu(tmp_path):
    assert not (made(tmp_path, "tum", motion={"faster_motion": {"factor": 2}}) / "imu.csv").exists()


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("data.csv", "#t\n1,2,3\n", "seven numbers"),
        ("data.csv", "#t\n", "seven numbers"),
        ("data.csv", "#t\n5,1,1,1,1,1,nan\n", "no finite number"),
        ("data.csv", "#t\n-5,1,1,1,1,1,1\n", "negative time stamp"),
        ("data.csv", "#t\nx,1,1,1,1,1,1\n", "no list of samples"),
        ("sensor.yaml", "gyroscope_noise_density: much\n", "number from 0 on"),
        ("sensor.yaml", "rate_hz: 200\n", "T_BS"),
    ],
)
def test_a_damaged_imu_is_one_line(tmp_path, name, text, said):
    (with_imu(tmp_path) / "mav0/imu0" / name).write_text(text)
    refused(find_sequence, tmp_path, names=(name, said))


def test_what_lies_beside_the_images_is_read_again(tmp_path):
    made(tmp_path, "tum")
    before, after = find_sequence(tmp_path / "recording").imu, find_sequence(tmp_path / "out/noise/box").imu
    for name in ("stamps_ns", "rate_rad_s", "force_m_s2"):
        np.testing.assert_array_equal(getattr(after.samples, name), getattr(before.samples, name))

    def rgb_from_imu(imu):
        return np.linalg.inv(imu.rig.rgb.robot_from_sensor) @ imu.samples.imu.robot_from_sensor

    np.testing.assert_allclose(rgb_from_imu(after), rgb_from_imu(before), rtol=0, atol=1e-8)
    (tmp_path / "out/noise/box/imu.csv").write_text("time,gx\n1,2\n")  # somebody else's
    assert find_sequence(tmp_path / "out/noise/box").imu is None


def test_its_clock_may_be_late_fast_and_lossy(tmp_path):
    clock = {"time_offset_s": 0.02, "clock_drift_ppm": 1000}
    sequence = made(tmp_path / "a", "tum", clock)
    found = numbers(sequence / "imu.csv")
    first_ns = find_sequence(tmp_path / "a/recording").stamps.rgb.ns[0]
    expected_ns = [row[0] + 20_000_000 + round((row[0] - first_ns) / 1000) for row in MEASURED]
    assert np.abs(np.array([row[0] for row in found]) - expected_ns).max() <= 1
    assert [row[1:] for row in found] == [row[1:] for row in MEASURED]
    said = yaml.safe_load((sequence / "imu.yaml").read_text())
    assert (said["time_offset"], said["clock_drift"]) == (0.02, 1000)
    lossy = numbers(made(tmp_path / "b", "tum", {"stamp_jitter_s": 0.001, "dropped_share": 0.25}) / "imu.csv")
    stamps = np.array([row[0] for row in lossy])
    assert (np.diff(stamps) > 0).all()
    by_values = {tuple(row[1:]): row[0] for row in MEASURED}
    off_s = np.array([row[0] - by_values[tuple(row[1:])] for row in lossy]) / 1e9
    assert 20 <= len(lossy) <= 38  # of 40: 30 +- 3 standard deviations
    assert 5e-4 < off_s.std() < 1.6e-3
    again = made(tmp_path / "c", "tum", {"stamp_jitter_s": 0.001, "dropped_share": 0.25}) / "imu.csv"
    assert numbers(again) == lossy


def test_deviations_of_no_imu_are_refused(tmp_path):
    WRITTEN["tum"](tmp_path)
    for imu, said in (({"time_offset_s": 1}, ("scenes.0.imu", "has no IMU")), ({"offset": 1}, "unknown key")):
        path = preset_of(tmp_path / "p", {"name": "box", "sequence": str(tmp_path), "imu": imu})
        refused(run, path, tmp_path / "out", names=said)


def test_a_described_recording_has_one(tmp_path):
    made(tmp_path, "tum")
    folder = tmp_path / "out/noise/box"
    told = {"rgb": {"list": "rgb.txt"}, "depth": {"list": "depth.txt", "scale_per_m": 5000}, "imu": "imu.csv"}
    camera = {"width": 64, "height": 48, "fx": 58.0, "fy": 57.0, "cx": 31.25, "cy": 23.75}
    scene = {"name": "box", "sequence": {"folder": str(folder), **told, "poses": "groundtruth.txt"}}
    run(preset_of(tmp_path / "q", scene, camera=camera, output={"layout": "euroc"}), tmp_path / "again")
    assert numbers(tmp_path / "again/clean/box/mav0/imu0/data.csv") == MEASURED


def test_recorded_exposures_are_written_again(tmp_path):
    WRITTEN["tum_vi"](tmp_path / "r")
    names = [path.stem for path in find_sequence(tmp_path / "r").rgb_files]
    exposed_ms = dict(zip(names, ("1.5002", "0.0512345", "0", "33.3"), strict=True))
    (tmp_path / "r/dso/cam0").mkdir(parents=True)
    text = "".join(f"{name} {int(name) / 1e9:.9f} {exposed_ms[name]}\n" for name in names)
    (tmp_path / "r/dso/cam0/times.txt").write_text("# id stamp exposure\n" + text)
    scene = {"name": "box", "sequence": str(tmp_path / "r")}
    fast = {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]}
    run(
        preset_of(tmp_path / "p", scene, settings=[{"name": "clean"}, fast], output={"layout": "tum_vi"}),
        tmp_path / "o",
    )

    def again(setting):
        lines = (tmp_path / f"o/{setting}/box/dso/cam0/times.txt").read_text().splitlines()[1:]
        return [line.split()[2] for line in lines]

    assert again("clean") == list(exposed_ms.values())
    assert again("fast") == [exposed_ms[name] for name in names[::2]]
    (tmp_path / "r/dso/cam0/times.txt").write_text(f"{names[0]} 1 long\n")
    refused(find_sequence, tmp_path / "r", names=("times.txt", "line 1", "no exposure"))
