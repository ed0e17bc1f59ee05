# SPDX-License-Identifier: GPL-3.0-or-later
"""A spinning lidar in a room of planes, on a path that turns and goes steadily: `noisy-world scan`."""

import re

import numpy as np
import pytest
import yaml
from cases import cases
from worlds import HIGH, LOW, WALLS, write_replica, write_world

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")
from steady_camera import poses_at

from noisy_world.cli import command
from noisy_world.cli.entry import Entry
from noisy_world.layouts.robot_files import CV_FROM_LIDAR
from noisy_world.core.geometry import pose

RATE_HZ, COUNT = 20.0, 9  # four turns of 0.1 s
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("i", "<f4"), ("t", "<f8"), ("ring", "<u2")])


def world(folder, **keys):
    preset = write_world(folder, **{"render": {"engine": "embree", "backend": "reference"}, **keys})
    write_replica(folder / "traj.txt", poses_at(np.arange(COUNT) / RATE_HZ))
    document = yaml.safe_load(preset.read_text())
    document["scenes"][0]["trajectory"] = {"file": "traj.txt", "rate_hz": RATE_HZ}
    preset.write_text(yaml.safe_dump(document))
    return preset


def scan(preset, out, *words):
    return command.run("scan", [str(preset), str(out), *map(str, words)], Entry("scan", ("scan",)))


def cloud(out, number):
    head, _, rows = (out / f"box/points/{number:06d}.ply").read_bytes().partition(b"end_header\n")
    assert head.startswith(b"ply\nformat binary_little_endian 1.0\n")
    found = np.frombuffer(rows, POINT)
    assert f"element vertex {len(found)}\n".encode() in head
    return found


def from_walls_m(points_m):
    """How far points (N, 3) are from the room's nearest wall."""
    return np.abs(np.concatenate([points_m - LOW, points_m - HIGH], axis=1)).min(axis=1)


def in_world(found, times_s):
    at = poses_at(times_s) @ CV_FROM_LIDAR
    local = np.stack([found["x"], found["y"], found["z"], np.ones(len(found))], axis=-1).astype(np.float64)
    return np.einsum("nij,nj->ni", np.broadcast_to(at, (len(found), 4, 4)), local)[:, :3]


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans")
    preset = world(folder / "world")
    assert scan(preset, folder / "moving", "--noise", 0) == 0
    assert scan(preset, folder / "instant", "--noise", 0, "--instant") == 0
    return preset, folder


def test_each_point_lies_on_a_wall_from_where_the_lidar_was_by_then(scans):
    _, folder = scans
    times_s = np.loadtxt(folder / "moving/box/times.txt")
    np.testing.assert_allclose(times_s, 0.05 + 0.1 * np.arange(4), atol=1e-9)
    for number, stamp_s in enumerate(times_s):
        found = cloud(folder / "moving", number)
        assert len(found) > 0.9 * 16 * 1800
        off_m = from_walls_m(in_world(found, stamp_s + found["t"]))
        assert off_m.max() < 0.001 + 2e-5  # ranges are in steps of 2 mm
        assert np.quantile(from_walls_m(in_world(found, stamp_s)), 0.9) > 0.02  # the motion is in them


def test_intensity_is_the_luminance_of_a_wall_s_colour_times_the_cosine_of_incidence(scans):
    """By BT.709's weights; the colours are those that the mesh's file gives the walls, some far more red than blue."""
    _, folder = scans
    found = cloud(folder / "instant", 2)
    points_m, sensor_m = in_world(found, 0.25), poses_at(0.25)[:3, 3]
    rays = (points_m - sensor_m) / np.linalg.norm(points_m - sensor_m, axis=1, keepdims=True)
    off_m = np.abs(np.stack([points_m - LOW, points_m - HIGH], axis=2)).reshape(-1, 6)  # x low, x high, y low, ...
    wall, inside = off_m.argmin(axis=1), np.sort(off_m, axis=1)[:, 1] > 0.02  # corners belong to two
    wanted = np.abs(rays[np.arange(len(rays)), wall // 2]) * (WALLS[wall] / 255 @ [0.2126, 0.7152, 0.0722])
    np.testing.assert_allclose(found["i"][inside], wanted[inside], rtol=0.01)
    assert len(np.unique(wall[inside])) >= 4


def test_an_instant_scan_is_not_distorted(scans):
    _, folder = scans
    found = cloud(folder / "instant", 2)
    assert not found["t"].any()
    assert from_walls_m(in_world(found, 0.25)).max() < 0.001 + 2e-5


def test_beams_are_the_devices_and_go_round_clockwise(scans):
    _, folder = scans
    found = cloud(folder / "moving", 0)
    elevation = np.degrees(np.arctan2(found["z"], np.hypot(found["x"], found["y"])))
    np.testing.assert_allclose(elevation, np.linspace(-15, 15, 16)[found["ring"]], atol=1e-3)
    azimuth = np.degrees(np.arctan2(-found["y"], found["x"]))  # to the right
    np.testing.assert_allclose(azimuth / 360, found["t"] / 0.1, atol=1e-5)
    assert (np.diff(found["t"]) >= 0).all()
    assert len(np.unique(found["t"])) == 1800


def test_kitti_files_say_the_same(scans):
    _, folder = scans
    found = cloud(folder / "moving", 1)
    rows = np.fromfile(folder / "moving/box/velodyne/000001.bin", np.float32).reshape(-1, 4)
    np.testing.assert_array_equal(rows, np.stack([found[name] for name in ("x", "y", "z", "i")], axis=-1))
    assert rows[:, 3].min() >= 0
    assert rows[:, 3].max() <= 1
    poses = np.loadtxt(folder / "moving/box/poses.txt").reshape(-1, 3, 4)
    np.testing.assert_allclose(poses, poses_at([0.05, 0.15, 0.25, 0.35])[:, :3], atol=1e-9)
    name, *values = (folder / "moving/box/calib.txt").read_text().split()
    assert name == "Tr:"
    np.testing.assert_array_equal(np.array(values, float).reshape(3, 4), CV_FROM_LIDAR[:3])


def test_noise_is_the_devices_and_the_same_in_every_run(scans, tmp_path):
    preset, folder = scans
    assert scan(preset, tmp_path / "a") == 0
    assert scan(preset, tmp_path / "b") == 0
    assert (tmp_path / "a/box/points/000003.ply").read_bytes() == (tmp_path / "b/box/points/000003.ply").read_bytes()
    noisy, exact = cloud(tmp_path / "a", 3), cloud(folder / "moving", 3)
    assert len(noisy) == len(exact)
    off_m = np.linalg.norm([noisy[k] for k in "xyz"], axis=0) - np.linalg.norm([exact[k] for k in "xyz"], axis=0)
    assert off_m.std() == pytest.approx(0.03, rel=0.03)
    assert abs(off_m.mean()) < 1e-3


def test_it_sits_where_the_rigs_depth_sensor_does(tmp_path):
    preset = world(tmp_path / "world", rig={"depth": {"translation_m": [0.2, 0.1, -0.1]}})
    assert scan(preset, tmp_path / "out", "--noise", 0, "--rate_hz", 5) == 0
    poses = np.loadtxt(tmp_path / "out/box/poses.txt").reshape(-1, 3, 4)
    moved = pose(np.eye(3), np.array([0.2, 0.1, -0.1]))
    np.testing.assert_allclose(poses, (poses_at([0.1, 0.3]) @ moved)[:, :3], atol=1e-9)


@cases(
    ("words", "message"),
    [
        (("--device", "velodyne_vlp61"), "unknown lidar 'velodyne_vlp61'; did you mean 'velodyne_vlp16'?"),
        (("--rate_hz", "2"), "less than one turn of 0.5 s"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, capsys, words, message):
    folder = tmp_path / words[0]
    assert scan(world(folder / "world"), folder / "out", *words) != 0
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (folder / "out").exists()


def test_where_it_cannot_be_written_is_said_in_one_line(scans, tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    assert scan(scans[0], tmp_path / "file/out") != 0
    said = capsys.readouterr().err
    assert re.search(r"file/out: cannot be written: .+; mend that, or name another place\n$", said)
    assert said.count("\n") == 1
    with pytest.raises(SystemExit):
        scan(scans[0], "s3://bucket/scans")
    assert "s3://bucket/scans is an address, and this is written on this machine" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_folder_that_is_there_is_left_alone(scans, capsys):
    preset, folder = scans
    before = sorted((folder / "moving").rglob("*"))
    assert scan(preset, folder / "moving") != 0
    assert "is there already" in capsys.readouterr().err
    assert sorted((folder / "moving").rglob("*")) == before
