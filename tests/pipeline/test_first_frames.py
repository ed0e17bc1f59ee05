# SPDX-License-Identifier: GPL-3.0-or-later
"""A path that begins with frames that see nothing ends the run, whoever renders them, and leaves nothing behind."""

import json

import fake_session
import pytest
from refusals import refused
from cases import cases
from shard_workers import workers_here
from worlds import write_world
import runs


pytestmark = pytest.mark.usefixtures("no_blender")
RENDER = {"engine": "cycles", "samples": 1, "backend": "reference"}


@pytest.fixture
def see_nothing(monkeypatch):
    def these(frames):
        monkeypatch.setattr(fake_session.Session, "empty", set(frames))
        fake_session.Session.rendered.clear()

    return these


def run(path, out, *, frames=None, jobs=1):
    """Run a preset; of several jobs the last shard is made first, as if its process were the fastest."""
    workers = workers_here(path, out, frames=frames, order=lambda shards: shards[::-1])
    return runs.run(path, out, frames=frames, jobs=jobs, workers=workers)


@cases("jobs", [1, 3])
@cases("modalities", [["rgb"], ["depth"]])
def test_a_path_elsewhere_ends_the_run(tmp_path, see_nothing, jobs, modalities):
    see_nothing(range(8))
    output = {"layout": "replica", "image": "png", "modalities": modalities}
    path = write_world(tmp_path / "world", frames=8, size=(8, 6), output=output)
    names = [f"{path}: scenes.0.trajectory: frames 0 to 2 of traj.txt", "mesh.ply", "pose (c2w)", "axes (opencv)"]
    refused(run, path, tmp_path / "out", jobs=jobs, names=[*names, "render.allow_empty: true"])
    assert not (tmp_path / "out").exists()


@cases("jobs", [1, 8])
@cases("empty", [{3, 4, 5, 6, 7}, {0, 1}, {0, 1, 3, 4, 5, 6, 7}, {0, 2}])
def test_void_later_or_in_between_goes_on(tmp_path, see_nothing, jobs, empty):
    see_nothing(empty)
    out = tmp_path / f"out {jobs} {sorted(empty)}"
    run(write_world(tmp_path / "world", frames=8, size=(8, 6)), out, jobs=jobs)
    assert json.loads((out / "manifest.json").read_text())["frames"] == {"clean/box": 8}


def test_the_key_goes_on(tmp_path, see_nothing):
    see_nothing(range(4))
    path = write_world(tmp_path / "world", frames=4, size=(8, 6), render={**RENDER, "allow_empty": True})
    run(path, tmp_path / "out", jobs=2)
    assert fake_session.Session.rendered == [3, 2, 1, 0]
    assert json.loads((tmp_path / "out/manifest.json").read_text())["frames"] == {"clean/box": 4}


@cases(("count", "names"), [(1, "frame 0 of traj.txt"), (2, "frames 0 to 1 of traj.txt")])
def test_a_shorter_path(tmp_path, see_nothing, count, names):
    see_nothing(range(count))
    refused(run, write_world(tmp_path / "world", frames=count, size=(8, 6)), tmp_path / "out", names=names)


def test_the_first_frames_are_those_that_are_made(tmp_path, see_nothing):
    path = write_world(tmp_path / "world", frames=12, size=(8, 6))
    see_nothing({0, 1, 2, 3})
    run(path, tmp_path / "out", frames=slice(4, 8))
    see_nothing({4, 5, 6})
    refused(run, path, tmp_path / "other", frames=slice(4, 8), names="frames 4 to 6 of traj.txt")


def test_nothing_is_rendered_twice_where_the_first_frame_sees_something(tmp_path, see_nothing):
    see_nothing(())
    path = write_world(tmp_path / "world", frames=4, size=(8, 6))
    run(path, tmp_path / "out")
    assert fake_session.Session.rendered == [0, 1, 2, 3]


def test_a_run_that_is_taken_up_again_does_not_ask_again(tmp_path, see_nothing):
    see_nothing({1, 2, 3})
    path = write_world(tmp_path / "world", frames=4, size=(8, 6))
    run(path, tmp_path / "out")
    for file in (tmp_path / "out/clean/box/results").glob("*00000[123].png"):
        file.unlink()
    see_nothing({0, 1, 2, 3})
    run(path, tmp_path / "out")
    assert fake_session.Session.rendered == [1, 2, 3]
