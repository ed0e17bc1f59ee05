# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world bag`: a bag of ROS 2 that rosbags reads back, with what the sequence holds."""

import numpy as np
import pytest
import yaml
from cases import cases
from inertial_paths import GRAVITY_M_S2
from runs import run
from written import RIG, rows_of, world

from noisy_world.cli import command
from noisy_world.cli.entry import Entry
from noisy_world.layouts import find_sequence

pytestmark = pytest.mark.usefixtures("no_blender")

ENTRY = Entry("noisy-world bag", ("noisy-world", "bag"))
IMU = {"translation_m": [0.02, -0.03, 0.05], "device": "adis16448", "time_offset_s": 0.02}


def sequence(folder, imu=True, **output):
    scenes = [{"name": "box", "mesh": "mesh.ply", "trajectory": {"file": "traj.txt", "axes": "robot"}}]
    rig = {**RIG, **({"imu": IMU} if imu else {})}
    run(world(folder / "w", "euroc", frames=6, rig=rig, scenes=scenes, output=output), folder / "out")
    return folder / "out/clean/box"


def messages(path):
    reading = pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed")
    found = {}
    with reading.AnyReader([path]) as reader:
        for connection, stamp_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp_ns, message))
    return found


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


@cases("storage", ["mcap", "sqlite3"])
def test_a_bag_holds_the_sequence(tmp_path, storage):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    folder = sequence(tmp_path / storage)
    out = tmp_path / storage / "bag"
    assert command.run("bag", [str(folder), str(out), "--storage", storage], ENTRY) == 0
    found, stored = messages(out), find_sequence(folder)
    assert (
        yaml.safe_load((out / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["storage_identifier"]
        == storage
    )
    images = found["/cam0/image_raw"]
    assert [stamp_of(message) for _, message in images] == list(stored.stamps.rgb.ns)
    depths = found["/depth0/image_raw"]
    for number, ((_, image), (_, depth)) in enumerate(zip(images, depths, strict=True)):
        assert image.encoding == "mono8"
        frame = stored.frame(number)
        np.testing.assert_array_equal(image.data.reshape(image.height, image.width), np.asarray(frame.rgb)[..., 0])
        assert depth.encoding == "32FC1"
        values = np.frombuffer(depth.data.tobytes(), np.float32).reshape(depth.height, depth.width)
        np.testing.assert_array_equal(values, frame.depth_m)
    camera = found["/cam0/camera_info"][0][1]
    assert camera.k.tolist() == [4.0, 0, 3.5, 0, 4.0, 2.5, 0, 0, 1]
    rows = rows_of(folder / "mav0/imu0/data.csv")
    samples = found["/imu0"]
    assert [stamp_of(message) for _, message in samples] == [int(row[0]) for row in rows]
    first = samples[0][1]
    force = [first.linear_acceleration.x, first.linear_acceleration.y, first.linear_acceleration.z]
    assert force == [float(cell) for cell in rows[0][4:]]
    assert np.linalg.norm(force) > 0.5 * np.linalg.norm(GRAVITY_M_S2)
    times = [stamp_ns for topic in found.values() for stamp_ns, _ in topic]
    assert min(times) == 0
    static = {item.child_frame_id: item for item in found["/tf_static"][0][1].transforms}
    assert static.keys() == {"cam0", "depth0"}
    assert len(found["/tf"]) == len(rows_of(folder / "mav0/state_groundtruth_estimate0/data.csv"))
    # The colour camera's first pose, by both transforms.
    world_from_body, body_from_cam = (
        matrix(item.transform) for item in (found["/tf"][0][1].transforms[0], static["cam0"])
    )
    np.testing.assert_allclose(world_from_body @ body_from_cam, stored.trajectory.c2w[0], atol=1e-9)


def matrix(transform):
    x, y, z, w = (getattr(transform.rotation, axis) for axis in "xyzw")
    moved = [getattr(transform.translation, axis) for axis in "xyz"]
    turned = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.block([[np.array(turned), np.array(moved)[:, None]], [np.array([[0, 0, 0, 1.0]])]])


def test_without_an_imu_and_in_colour(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    folder = sequence(tmp_path, imu=False, colour="rgb")
    assert command.run("bag", [str(folder), str(tmp_path / "bag")], ENTRY) == 0
    found = messages(tmp_path / "bag")
    assert "/imu0" not in found
    assert found["/cam0/image_raw"][0][1].encoding == "rgb8"


def test_what_cannot_be_is_refused_in_a_line(tmp_path, capsys):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    (tmp_path / "there").mkdir()
    assert command.run("bag", [str(tmp_path), str(tmp_path / "there")], ENTRY) != 0
    assert "there: is there already" in capsys.readouterr().err
    assert command.run("bag", [str(tmp_path / "there"), str(tmp_path / "bag")], ENTRY) != 0
    assert "holds no mav0; name a sequence of the layout euroc" in capsys.readouterr().err
    assert [item.name for item in tmp_path.iterdir()] == ["there"]
