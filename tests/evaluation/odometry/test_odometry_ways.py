"""rgbd_odometry by depth alone and by colour alone, on a room in closed form: what each sees, and what it does not."""

import json

import box_room
import numpy as np
import pytest

from noisy_world.evaluate.odometry import main
from noisy_world.evaluate.systems import find_system

POSES = box_room.path(30, turn_deg=40.0)


def found(folder, by, name="out"):
    assert main([str(folder / "frames.json"), str(folder / name), "--by", by]) == 0
    return (folder / name / "estimate.txt").read_bytes()


def ate_m(estimate):
    poses = np.loadtxt(estimate.decode().splitlines(), ndmin=2)
    numbers = np.rint(poses[:, 0] * box_room.RATE_HZ).astype(int)
    return len(poses), box_room.ate_rmse_m(poses[:, 1:4], POSES[numbers, :3, 3])


@pytest.mark.parametrize("by", ["both", "depth", "colour"])
def test_each_way_finds_the_path(by, tmp_path):
    box_room.write(tmp_path, POSES)
    tracked, error_m = ate_m(found(tmp_path, by))
    assert tracked == len(POSES)
    assert error_m < 0.01  # of a path of half a metre


def test_depth_alone_sees_no_colour(tmp_path):
    file = box_room.write(tmp_path / "seen", POSES)
    box_room.write(tmp_path / "black", POSES, change=lambda _number, colour, depth_m: (colour * 0, depth_m))
    seen = found(tmp_path / "seen", "depth")
    assert found(tmp_path / "black", "depth") == seen
    index = json.loads(file.read_text())
    index["frames"] = [frame | {"colour": None} for frame in index["frames"]]  # as a system that reads depth is given
    file.write_text(json.dumps(index))
    assert found(tmp_path / "seen", "depth", "again") == seen


def test_colour_alone_is_lost_in_the_dark(tmp_path):
    def dark(number, colour, depth_m):
        return (colour * 0 if number >= 20 else colour), depth_m

    box_room.write(tmp_path, POSES, change=dark)
    assert ate_m(found(tmp_path, "colour"))[0] == 20
    assert ate_m(found(tmp_path, "depth"))[0] == len(POSES)


def test_without_colour_the_other_ways_say_so(tmp_path, capsys):
    file = box_room.write(tmp_path, POSES[:2])
    index = json.loads(file.read_text())
    index["frames"][1]["colour"] = None
    file.write_text(json.dumps(index))
    assert main([str(file), str(tmp_path / "out")]) == 1
    assert "frame 1: has no colour image; align by depth alone: --by depth" in capsys.readouterr().err


def test_what_each_system_is_given():
    ways = {name: find_system(name) for name in ("rgbd_odometry", "rgbd_odometry_depth", "rgbd_odometry_colour")}
    assert [system.reads.modalities for system in ways.values()] == [
        ("colour", "depth"), ("depth",), ("colour", "depth"),
    ]  # fmt: skip
    assert len({system.digest for system in ways.values()}) == 3
