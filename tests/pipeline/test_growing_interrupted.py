# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset that is growing survives what a new one does: crashes, interruptions, several processes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import fake_session
import pytest
from cases import cases
from growing import stopped, CLEAN, FOG, LATE, NOISE, PATH, THREE, at_once, change, marks, world
from shard_workers import workers_here
from worlds import content, write_world
from runs import run

from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan

pytestmark = pytest.mark.usefixtures("no_blender")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_crash_at_every_step_of_growing_costs_nothing(tmp_path):
    preset = write_world(tmp_path / "world", frames=3, size=(8, 6))
    run(change(preset, {PATH: {"file": "traj.txt", "stop": 2}}), tmp_path / "finished")
    change(preset, {f"{PATH}.stop": 3, "settings": [CLEAN, {**NOISE, "perturb": NOISE["perturb"][:1]}]})
    run(preset, tmp_path / "whole")
    # In a process of its own, which has no threads yet and can be forked.
    script = Path(__file__).with_name("crash_every_step.py")
    command = [sys.executable, script, preset, tmp_path / "whole", tmp_path, tmp_path / "finished"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) > 60, "the steps were not counted"


@pytest.mark.parametrize("back", [False, True])
def test_a_run_that_was_stopped_while_growing_is_taken_up_by_either_preset(tmp_path, back):
    preset, out = world(tmp_path / "world"), tmp_path / "out"
    run(preset, out)
    before, old = marks(out), preset.read_text()
    change(preset, {"settings": [NOISE, *THREE]})
    stopped(preset, out, 3)
    assert {name: mark for name, mark in marks(out).items() if name in before} == before
    if back:
        new = preset.read_text()
        preset.write_text(old)
        report = run(preset, out)
        assert report.notes == ["what this preset does not name stays unfinished: noise/box"]
        assert set(json.loads((out / "manifest.json").read_text())["frames"]) == {"clean/box", "fog/box", "late/box"}
        preset.write_text(new)
    fake_session.Session.rendered.clear()
    run(preset, out)
    assert fake_session.Session.rendered == [3, 4, 5]
    assert content(out) == at_once(preset, tmp_path)
    assert {name: mark for name, mark in marks(out).items() if name in before} == before


def test_an_unfinished_dataset_grows_too(tmp_path):
    preset, out = world(tmp_path / "world", settings=[CLEAN, FOG]), tmp_path / "out"
    stopped(preset, out, 4)
    before = marks(out)
    change(preset, {"settings": [CLEAN, LATE], f"{PATH}.stop": 8})
    fake_session.Session.rendered.clear()
    report = run(preset, out)
    assert report.notes == ["what this preset does not name stays unfinished: fog/box"]
    images = {name: mark for name, mark in before.items() if "results" in name}
    assert {name: marks(out)[name] for name in images} == images
    run(change(preset, {"settings": [CLEAN, LATE, FOG]}), out)
    assert content(out) == at_once(preset, tmp_path)
    assert {name: marks(out)[name] for name in images} == images


@cases(
    "settings, number, source",
    [({"settings": [NOISE, *THREE]}, 3, 0), ({f"{PATH}.stop": 8}, 2, 6)],
)
def test_workers_make_only_what_is_missing(tmp_path, settings, number, source):
    folder = tmp_path / str(number)
    preset, out = world(folder / "world", settings=[CLEAN, FOG, {"name": "late", "perturb": []}]), folder / "out"
    run(preset, out)
    before = marks(out)
    change(preset, {**settings, **({"settings": [NOISE, CLEAN, FOG]} if "settings" in settings else {})})
    shards, plan = [], make_plan(read_preset(preset))
    workers = workers_here(preset, out, asked=shards)
    run(plan, out, jobs=2, workers=workers)
    assert min(shard.start for shard in shards) == source
    after = marks(out)
    texts = ("traj.txt", "frames.jsonl")
    assert {name for name in before if after[name] != before[name] and not name.endswith(texts)} == set()
