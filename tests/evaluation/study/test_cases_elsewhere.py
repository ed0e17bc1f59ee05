# SPDX-License-Identifier: GPL-3.0-or-later
"""`evaluate --ray`: each case is a task that a node carries out by the same command; Ray itself is not needed here."""

import contextlib

import pytest
from study_tools import evaluate, small_world, told, write_systems

from noisy_world.cli import ray_cases
from noisy_world.cluster import remote
from noisy_world.cluster.ray_runner import TaskOutcome

pytest.importorskip("embreex", reason="embreex comes with an extra")
pytest.importorskip("tabulate", reason="tabulate comes with an extra")

SETTINGS = [{"name": "clean"}, {"name": "bright", "perturb": [{"brightness": {"severity": 3}}]}]


@pytest.fixture
def node(monkeypatch):
    """What Ray does with tasks, in this process: one after another, as a node does them."""
    tasks = []

    def run_tasks(orders, options, hear, ended, stop):
        for order in orders:
            tasks.append(order)
            done = remote.carry_out(order, hear)
            ended(TaskOutcome(order.name, done["node"], done["status"], done["line"], done["report"]))

    monkeypatch.setattr(ray_cases, "connected", lambda options: contextlib.nullcontext())
    monkeypatch.setattr(ray_cases, "run_tasks", run_tasks)
    return tasks


def test_the_results_are_the_same(tmp_path, node):
    preset = small_world(tmp_path / "world", settings=SETTINGS)
    systems = write_systems(tmp_path / "systems", "half")
    assert evaluate(preset, "--systems", systems, "--out", tmp_path / "ray", "--ray", "local", "--cpus", 2) == 0
    assert evaluate(preset, "--systems", systems, "--out", tmp_path / "here", "--jobs", 1) == 0
    assert told(tmp_path / "ray") == told(tmp_path / "here")
    assert [task.name for task in node] == ["box/clean/seed-3", "box/bright/seed-3"]
    assert {task.environment["OMP_NUM_THREADS"] for task in node} == {"2"}


def test_a_node_that_sees_another_folder_says_so(tmp_path, node, capfd, monkeypatch):
    preset = small_world(tmp_path / "world", settings=SETTINGS)
    systems = write_systems(tmp_path / "systems", "half")
    monkeypatch.setattr(ray_cases, "sha256_of_file", lambda path: "0" * 64)
    assert evaluate(preset, "--systems", systems, "--out", tmp_path / "out", "--ray", "local") == 1
    said = capfd.readouterr().err.splitlines()[-1]
    assert "2 of 2 sequences could not be evaluated; box/clean/seed-3: " in said
    assert "sees another file at" in said
