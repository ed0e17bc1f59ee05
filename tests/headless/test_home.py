# SPDX-License-Identifier: GPL-3.0-or-later
"""~ at the beginning of a path is the home folder, wherever a path is given; no folder is ever called ~ by mistake."""

import pwd
from pathlib import Path

import pytest
from refusals import refused
from stored_sequences import write_euroc
from worlds import generate_here, write_box_ply, write_world

from noisy_world.cli import command
from noisy_world.cli.entry import Entry
from noisy_world.core.file_access import split_home, with_home
from noisy_world.preset.keys import read_preset
from noisy_world.sources import find_scenes

GONE = "~nobody-of-this-name/x"


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A home folder with odd letters that are a pattern's, and an empty working folder."""
    folder = tmp_path / "home [of] * me"
    folder.mkdir()
    monkeypatch.setenv("HOME", str(folder))
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    yield folder
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith("~")]


def test_what_a_path_means(home):
    own = pwd.getpwuid(0)
    assert with_home("~") == home
    assert with_home("~/a/b") == home / "a/b"
    assert with_home("~//a") == home / "a"
    assert with_home(f"~{own.pw_name}/x") == Path(own.pw_dir) / "x"
    for text in ("a/~/b", "/~", "x~", "", "./~/x", "C~1/x"):
        assert with_home(text) == Path(text)
    assert split_home("~/scans/*.ply") == (home, "scans/*.ply")
    for text in ("~nobody-of-this-name", "~nobody-of-this-name/x", "~.ply"):
        refused(with_home, text, names=["user", "./~"], error=LookupError)


def test_every_path_of_a_preset(home, tmp_path):
    for name in ("a", "b"):
        write_world(home / "scans" / name)
    write_euroc(home / "recorded" / "room0")
    preset = write_world(
        tmp_path / "presets",
        scenes=[
            {"name": "one", "mesh": "~/scans/a/mesh.ply", "trajectory": "~/scans/a/traj.txt"},
            {"name": "all_*", "mesh": "~/scans/*/mesh.ply", "trajectory": {"file": "~/scans/*/traj.txt"}},
            {"name": "still", "sequence": "~/recorded/room0"},
            {"name": "s_*", "sequence": "~/recorded/*"},
        ],
    )
    scenes = find_scenes(read_preset(preset, ["scenes.0.mesh=~/scans/b/mesh.ply"]))
    assert [scene.name for scene in scenes] == ["one", "all_a", "all_b", "still", "s_room0"]
    assert scenes[0].source.location == str(home / "scans/b/mesh.ply")
    assert scenes[2].source.path_file == home / "scans/b/traj.txt"


@pytest.mark.parametrize(
    ("scene", "key"),
    [
        ({"mesh": GONE, "trajectory": "traj.txt"}, "scenes.0.mesh"),
        ({"mesh": f"{GONE}/*.ply", "trajectory": "traj.txt"}, "scenes.0.mesh"),
        ({"mesh": "mesh.ply", "trajectory": GONE}, "scenes.0.trajectory"),
        ({"sequence": GONE}, "scenes.0.sequence"),
    ],
)
def test_a_user_who_is_not_there_is_an_error_at_the_key(home, tmp_path, scene, key):
    preset = write_world(tmp_path / "presets", scenes=[scene])
    refused(find_scenes, read_preset(preset), names=[f"preset.yaml: {key}: ", "'nobody-of-this-name'"])


def test_what_the_command_line_names(home, tmp_path, capsys):
    pytest.importorskip("bpy", reason="bpy is not installed")
    write_world(home, frames=1)
    done = generate_here("~/preset.yaml", "--out", "~/out", "--set", "scenes.0.trajectory.file=~/traj.txt")
    assert f"wrote {home}/out/clean/box" in done.stdout
    assert (home / "out/manifest.json").is_file()
    before = sorted(tmp_path.rglob("*"))
    for arguments in (["~/preset.yaml", "--out", GONE], [GONE], ["--set", "seed=1", GONE]):
        refused = generate_here(*arguments, check=False)
        assert refused.returncode == 2
        assert "there is no user 'nobody-of-this-name' here" in refused.stderr.splitlines()[-1]
    for arguments in ([GONE], ["--set", "seed=1", GONE]):
        with pytest.raises(SystemExit):
            command.main(["evaluate", "--systems", "rgbd_odometry", *arguments])
        assert "there is no user 'nobody-of-this-name' here" in capsys.readouterr().err.splitlines()[-1]
    assert sorted(tmp_path.rglob("*")) == before
    write_box_ply(home / "box.ply")
    assert command.run("export", ["~/box.ply", "~/copy.ply"], Entry("export_mesh.py", ())) == 0
    assert (home / "copy.ply").is_file()
