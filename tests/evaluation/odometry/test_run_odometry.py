"""`noisy-world run-odometry`: the embedded system on the sequences of a folder."""

import json

import box_room
import numpy as np
import pytest

from noisy_world.cli import command
from noisy_world.cli.command import own_entry
from noisy_world.core.progress import read_message

POSES = box_room.path(30, turn_deg=40.0)[:6]


def track(*arguments):
    return command.run("run-odometry", list(map(str, arguments)), own_entry("run-odometry"))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """A clean sequence, and one whose last three frames are black and without depth."""
    folder = tmp_path_factory.mktemp("dataset")
    box_room.write_sequence(folder / "clean/box", POSES)
    box_room.write_sequence(
        folder / "blind/box",
        POSES,
        change=lambda number, colour, depth_m: (colour * 0, depth_m * 0) if number >= 3 else (colour, depth_m),
    )
    return folder


def test_a_line_and_a_folder_for_each_sequence(dataset, tmp_path, capfd):
    assert track(dataset, tmp_path / "out") == 0
    told = capfd.readouterr().out.splitlines()
    assert [line.partition(",")[0] for line in told] == [
        "blind/box: 3 of 6 frames tracked",
        "clean/box: 6 of 6 frames tracked",
    ]
    found = np.loadtxt(tmp_path / "out/clean/box/estimate.txt")
    assert box_room.ate_rmse_m(found[:, 1:4], POSES[:, :3, 3]) < 0.005
    assert len(np.loadtxt(tmp_path / "out/blind/box/estimate.txt")) == 3
    # The system is told of no true pose.
    index = json.loads((tmp_path / "out/clean/box/frames.json").read_text())
    assert set(index) == {"camera", "depth_scale_per_m", "inverse_depth", "frames"}
    assert set(index["frames"][0]) == {"index", "stamp_s", "colour", "depth", "depth_stamp_s"}


def test_some_of_the_sequences_told_to_a_program(dataset, tmp_path, capfd):
    assert track(dataset, tmp_path / "out", "--only", "blind/*", "--progress", "json") == 0
    messages = [read_message(line) for line in capfd.readouterr().out.splitlines()]
    assert {"start": {"label": "tracking", "total": 6, "done": 0}} in messages
    assert sum(message.get("advance", 0) for message in messages) == 6
    assert messages[-1]["result"].startswith("blind/box: 3 of 6 frames tracked")
    assert not (tmp_path / "out/clean").exists()


def test_what_is_not_there_is_a_line(dataset, tmp_path, capfd):
    assert track(dataset, tmp_path / "out", "--only", "fog/*") == 1
    assert "matches none of 2 sequences" in capfd.readouterr().err
    assert track(tmp_path / "none", tmp_path / "out", "--progress", "json") == 1
    told = capfd.readouterr()
    assert "no such folder" in told.err
    assert "no such folder" in read_message(told.out.splitlines()[-1])["error"]
