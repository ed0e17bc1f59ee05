# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset made by a Ray cluster of two nodes, one of which is killed, equals that of one process to the byte."""

import json
import os
import signal
import sys
import threading
import time

import fake_session
import pytest
from worlds import content, generate_here
from runs import run
from written import world

from noisy_world.executors import ray_cluster

pytestmark = pytest.mark.long

SETTINGS = [
    {"name": "clean"},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 3}}]},
    {"name": "early", "perturb": [{"desync": {"offset": -1, "edge": "drop"}}]},
    {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]},
    {"name": "holes", "perturb": [{"depth_random_missing": {"severity": 2}}]},
]

# Read by each Python that starts; the third kind waits until its node is killed.
MISHAPS = """
import os, signal, sys, time
folder = os.environ["MISHAPS"]

def first(name):
    try:
        os.close(os.open(os.path.join(folder, name), os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return False
    return True

if "--worker" in sys.orig_argv:
    if os.path.exists(os.path.join(folder, "victim")):
        if open(os.path.join(folder, "victim")).read() == os.environ["RAY_RAYLET_PID"] and first("waits"):
            time.sleep(60)
    if first("the command ends"):
        os._exit(7)
    if first("the worker ends"):
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(60)
"""


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """Two nodes of one processor each; the second has another address, so that the driver belongs to the first."""
    folder = tmp_path / "mishaps"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(MISHAPS)
    monkeypatch.setenv("MISHAPS", str(folder))
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("RAY_worker_niceness", "0")  # beside other tests, workers at 15 get next to no time
    monkeypatch.setenv("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")  # else Ray replaces 127.0.0.1 by an outer address
    cluster_utils = pytest.importorskip("ray.cluster_utils", reason="ray is not installed")
    node = {"num_cpus": 1, "object_store_memory": 80 * 2**20}
    made = cluster_utils.Cluster(
        initialize_head=True, head_node_args={**node, "node_ip_address": "127.0.0.1", "include_dashboard": False}
    )
    try:
        made.victim = made.add_node(**node, node_ip_address="127.0.0.2")
        yield made
    finally:
        made.shutdown()


def when(condition, do, timeout_s=100):
    """Do something in another thread as soon as a condition holds; nothing later, when the test may have ended."""

    def wait():
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s:
            if condition():
                do()
                return
            time.sleep(0.05)

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    return thread


@pytest.fixture
def preset(tmp_path, monkeypatch):
    """A recording of 12 frames as a scene: no Blender is needed."""
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    run(world(tmp_path / "w", "replica", frames=12, output={"image": "png"}), tmp_path / "source")
    path = tmp_path / "preset.json"
    scene = {"name": "box", "sequence": str(tmp_path / "source/clean/box")}
    path.write_text(
        json.dumps({"seed": 3, "scenes": [scene], "render": {"backend": "reference"}, "settings": SETTINGS})
    )
    return path


def test_a_cluster_that_loses_a_command_a_worker_and_a_node(tmp_path, cluster, preset):
    generate_here(preset, "--out", tmp_path / "here")
    out, mishaps = tmp_path / "out", tmp_path / "mishaps"
    (mishaps / "victim").write_text(str(cluster.victim.all_processes["raylet"][0].process.pid))
    command = [preset, "--out", out, "--ray", cluster.address, "--shards", "6", "--cpus", "1"]

    killing = when((mishaps / "waits").exists, lambda: cluster.remove_node(cluster.victim, allow_graceful=False))

    counts = []

    def merged():
        """A shard was merged after a command had ended: by then it has been told."""
        if (mishaps / "the command ends").exists():
            journals = (out / ".noisy_world").glob("merged*.jsonl")
            counts.append(sum(len(path.read_text().splitlines()) for path in journals))
        return bool(counts) and counts[-1] > counts[0] and not killing.is_alive()

    when(merged, lambda: os.kill(os.getpid(), signal.SIGINT))
    stopped = generate_here(*command, check=False)
    assert stopped.returncode == 130, stopped.stderr
    assert "--ray" in stopped.stderr.splitlines()[-1]
    done = generate_here(*command)
    assert done.returncode == 0
    assert {path.name for path in mishaps.iterdir()} >= {"the command ends", "the worker ends", "waits"}
    said = stopped.stderr + done.stderr
    assert "ended with status 7: it said nothing; it is run again" in said
    assert content(out) == content(tmp_path / "here")
    assert not (out / ".noisy_world").exists()

    pytest.importorskip("fsspec", reason="fsspec is not installed")
    here, packed = (f"file://{tmp_path}/{place}/packed" for place in ("local", "ray"))
    generate_here(preset, "--out", here)
    generate_here(preset, "--out", packed, "--ray", cluster.address, "--shards", "2", "--cpus", "1")
    assert content(tmp_path / "ray/packed") == content(tmp_path / "local/packed")


@pytest.mark.parametrize("stopping", [True, False])
def test_a_task_that_fails_as_it_is_stopped_was_stopped_and_else_has_a_bug(monkeypatch, stopping):
    """Ray's worker raises this where it is cancelled while it reads a task's arguments."""
    ray = pytest.importorskip("ray", reason="ray is not installed")
    error = TypeError("'Handlers' object is not callable")

    def fails(_):
        told = f"Traceback (most recent call last):\nTypeError: {error}"
        raise ray.exceptions.RayTaskError("in_ray", told, error, proctitle="", pid=1, ip="").as_instanceof_cause()

    monkeypatch.setattr(ray, "get", fails)
    if stopping:
        assert ray_cluster._outcome(None, None, stopping) == (None, "")
    else:
        with pytest.raises(TypeError, match="Handlers"):
            ray_cluster._outcome(None, None, stopping)
