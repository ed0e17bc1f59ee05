# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world score-map`, from files to numbers."""

import json

import numpy as np
import pytest
from seen_shapes import wall
from worlds import write_world

pytest.importorskip("scipy")
pytest.importorskip("embreex")

from noisy_world.cli.command import main
from noisy_world.cli.scoring import CULLINGS
from noisy_world.core.geometry import pose, rotation_from_euler_deg
from noisy_world.core.trajectory import Trajectory
from noisy_world.dataset.opening import open_path
from noisy_world.evaluate.map_metrics import moved
from noisy_world.evaluate.true_maps import Culling
from noisy_world.scenes.ply import read_ply
from noisy_world.scenes.ply_writer import write_ply
from noisy_world.trajectories.stamped_poses import tum_text

OFF = pose(rotation_from_euler_deg(10, 20, 30), (3.0, -1.0, 2.0))
"""The world of an estimate, in the true one."""


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """A turn through a box room with walls of one colour each, clean; the mesh is mesh.ply beside it."""
    folder = tmp_path_factory.mktemp("walk")
    preset = write_world(folder, frames=24, render={"engine": "embree", "samples": 1, "backend": "reference"})
    assert main(["generate", str(preset), "--out", str(folder / "out"), "--jobs", "1"]) == 0
    return folder / "out/clean/box"


@pytest.fixture
def room(sequence):
    """The mesh of the box room."""
    return sequence.parents[2] / "mesh.ply"


def _estimate(sequence, path, keep=slice(None)):
    """The true path in another world, as a system would write it."""
    frames = list(next(iter(open_path(sequence).values())))[keep]
    c2w = np.linalg.inv(OFF) @ np.array([frame.c2w for frame in frames])
    path.write_text(tum_text(Trajectory(c2w, np.array([frame.stamp_s for frame in frames]))))
    return path


def _values(capsys, *arguments):
    assert main(["score-map", *map(str, arguments), "--samples", "3000", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_path_alone_is_scored_by_the_map_along_it(sequence, room, tmp_path, capsys):
    estimate = _estimate(sequence, tmp_path / "estimate.txt")
    out = tmp_path / "map.ply"
    options = ("--sequence", sequence, "--voxel-m", "0.05", "--write-map", out)
    found = _values(capsys, estimate, room, *options)
    assert (found["truth"], found["culling"], found["failure"]) == ("mesh", "frustum_occlusion", "")
    assert found["values"]["accuracy_median_m"] < 0.01
    assert found["values"]["completion_ratio_5cm"] > 0.7
    assert found["values"]["depth_share"] > 0.8
    assert found["values"]["psnr_db"] > 15
    again = _values(capsys, out, sequence, "--voxel-m", "0.08")  # as it lies, against the fusion of the sequence itself
    assert again["truth"] == "fused"
    assert again["values"]["accuracy_median_m"] < 0.02


def test_a_run_s_own_map_is_moved_as_its_path_is(sequence, room, tmp_path, capsys):
    run = tmp_path / "run"
    run.mkdir()
    _estimate(sequence, run / "estimate.txt")
    write_ply(run / "map.ply", moved(read_ply(room), np.linalg.inv(OFF)))
    values = _values(capsys, run, room, "--sequence", sequence)["values"]
    assert values["accuracy_m"] < 1e-4
    assert values["completion_ratio_5cm"] == 1
    assert values["depth_l1_m"] < 1e-3
    assert values["psnr_db"] > 40
    same = _values(capsys, run / "map.ply", room, "--sequence", sequence, "--estimate", run)["values"]
    assert same == values


def test_a_path_that_fails_has_no_map(sequence, room, tmp_path, capsys):
    estimate = _estimate(sequence, tmp_path / "estimate.txt", slice(2))
    found = _values(capsys, estimate, room, "--sequence", sequence)
    assert found["failure"] == "too_few_poses"
    assert found["values"]["completion_ratio_5cm"] == 0
    assert found["values"]["accuracy_m"] is None


def test_two_meshes_alone(tmp_path, capsys):
    write_ply(tmp_path / "a.ply", wall(0.01))
    write_ply(tmp_path / "b.ply", wall(0.0))
    assert main(["score-map", str(tmp_path / "a.ply"), str(tmp_path / "b.ply"), "--samples", "1000"]) == 0
    told = capsys.readouterr()
    assert "nothing is culled" in told.err
    assert "compared: everything" in told.out
    row = next(line for line in told.out.splitlines() if line.endswith(" accuracy_m"))
    assert row.split()[:3] == ["accuracy", "0.01", "m"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.ply", "embedded:room"], "none.ply"),
        (["estimate.txt", "embedded:room"], "--sequence"),
        (["wall.ply", "embedded:roof"], "embedded:room"),
        (["wall.ply", "embedded:room?seed=*"], "name one of them"),
        (["wall.ply", "none.ply"], "none.ply"),
        (["wall.ply", "embedded:room", "--lpips", "none.onnx"], "is no file"),
        (["wall.ply", "empty"], "empty"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    write_ply(tmp_path / "wall.ply", wall(0.0))
    (tmp_path / "empty").mkdir()
    assert main(["score-map", *arguments, "--samples", "100"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert said in lines[-1]
    assert "Traceback" not in "".join(lines)


def test_the_cullings_are_those_of_the_code():
    assert set(CULLINGS) == {str(item) for item in Culling}
