# SPDX-License-Identifier: GPL-3.0-or-later
"""`evaluate --ray`: each case is a task that a node carries out by the same command; Ray itself is not needed here."""

import contextlib

import pytest
from study_tools import evaluate, small_world, told, write_systems

from noisy_world.executors import ray_cluster
from noisy_world.executors.jobs import TaskOutcome
from noisy_world.executors.worker_process import carry_out

pytest.importorskip("embreex", reason="embreex comes with an extra")
pytest.importorskip("tabulate", reason="tabulate comes with an extra")

SETTINGS = [{"name": "clean"}, {"name": "bright", "perturb": [{"brightness": {"severity": 3}}]}]


@pytest.fixture
def nodes(monkeypatch):
    """What Ray does with tasks, in this process: one after another, as a node does them."""
    tasks = []

    def run(cluster, job, hear, ended, stop):
        for task in ray_cluster._node_tasks(job, cluster.cpus):
            tasks.append(task)
            done = carry_out(task, hear)
            ended(TaskOutcome(task.name, done["status"], done["line"], done["machine"], done["report"]))

    there = contextlib.nullcontext
    monkeypatch.setattr(ray_cluster, "ray_cluster", lambda _, cpus: there(ray_cluster.RayCluster(cpus)))
    monkeypatch.setattr(ray_cluster.RayCluster, "run", run)
    return tasks


def test_the_results_are_the_same(tmp_path, nodes):
    preset = small_world(tmp_path / "world", settings=SETTINGS)
    systems = write_systems(tmp_path / "systems", "half")
    assert evaluate(preset, "--systems", systems, "--out", tmp_path / "ray", "--ray", "local", "--cpus", 2) == 0
    assert evaluate(preset, "--systems", systems, "--out", tmp_path / "here", "--jobs", 1) == 0
    assert told(tmp_path / "ray") == told(tmp_path / "here")
    assert [task.name for task in nodes] == ["box/clean/seed-3", "box/bright/seed-3"]
    assert {task.environment["OMP_NUM_THREADS"] for task in nodes} == {"2"}


def test_a_node_that_sees_another_folder_says_so(tmp_path, nodes, capfd, monkeypatch):
    preset = small_world(tmp_path / "world", settings=SETTINGS)
    systems = write_systems(tmp_path / "systems", "half")
    monkeypatch.setattr(ray_cluster, "sha256_of_file", lambda path: "0" * 64)
    assert evaluate(preset, "--systems", systems, "--out", tmp_path / "out", "--ray", "local") == 1
    said = capfd.readouterr().err.splitlines()[-1]
    assert "2 of 2 sequences could not be evaluated; box/clean/seed-3: " in said
    assert "sees another file at" in said
