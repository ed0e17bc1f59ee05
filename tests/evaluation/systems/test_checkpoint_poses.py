# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses of checkpoints that torch saves, read by the Python that has torch: NOISY_WORLD_TORCH_PYTHON, or this one."""

import importlib.util
import json
import os
import subprocess
import sys

import numpy as np
import pytest

from noisy_world.evaluate.estimates import read_estimate
from noisy_world.evaluate.system_runs import PROGRAMS

PYTHON = os.environ.get("NOISY_WORLD_TORCH_PYTHON", sys.executable)
with_torch = pytest.mark.skipif(
    "NOISY_WORLD_TORCH_PYTHON" not in os.environ and importlib.util.find_spec("torch") is None,
    reason="no torch is here; NOISY_WORLD_TORCH_PYTHON names a Python that has it",
)
INDEX = {"frames": [{"stamp_s": 0.05 * k, "colour": f"{k}.png"} for k in range(6)]}
# Saves what NICE-SLAM's Logger and Co-SLAM's save_ckpt save, as from a GPU; then what no system saves.
SAVES = """
import json, os, sys
import torch
poses = torch.tensor(json.loads(sys.argv[1]))
torch.serialization.location_tag = lambda storage: "cuda:0"
os.makedirs("nice_slam/ckpts"), os.makedirs("co_slam")
keyframes = {3: [{"idx": 0, "gt_c2w": poses[0], "est_c2w": poses[0]}]}
every = {"c": {"grid": torch.zeros(1, 2)}, "gt_c2w_list": poses, "estimate_c2w_list": poses.clone(), "idx": 4,
         "keyframe_list": [0, torch.tensor(3)], "selected_keyframes": keyframes}
every["estimate_c2w_list"][5] = 0
torch.save(every, "nice_slam/ckpts/00004.tar", _use_new_zipfile_serialization=False)
open("nice_slam/ckpts/00003.tar", "w").write("an older one")
relative = {0: torch.eye(4), **{k: poses[k] @ poses[0].inverse() for k in (1, 2)}}
model = torch.nn.Linear(1, 2).half().state_dict()
torch.save({"pose": {k: poses[k] for k in range(6)}, "pose_rel": relative, "model": model}, "co_slam/checkpoint5.pt")
torch.save({"estimate_c2w_list": poses.bool()[0], "idx": 0}, "flat.tar")
class Runs:
    def __reduce__(self):
        return os.mkdir, ("ran",)
torch.save({"estimate_c2w_list": Runs()}, "runs.tar")
"""


def poses():
    """Poses of 6 frames; camera-to-world, OpenCV's axes."""
    k = np.arange(6)
    c2w = np.tile(np.eye(4), (6, 1, 1))
    c2w[:, 0, 0] = c2w[:, 1, 1] = np.cos(0.3 * k)
    c2w[:, 1, 0] = np.sin(0.3 * k)
    c2w[:, 0, 1] = -c2w[:, 1, 0]
    c2w[:, :3, 3] = np.stack([0.25 * k, -0.5 * k, 0.125 * k * k], axis=1)
    return c2w


def run(folder, *words, python=PYTHON):
    command = [python, str(PROGRAMS / "checkpoint_poses.py"), *map(str, words)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@with_torch
def test_what_torch_saves(tmp_path):
    wanted = poses()
    opengl = (wanted @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist()
    subprocess.run([PYTHON, "-c", SAVES, json.dumps(opengl)], cwd=tmp_path, check=True)
    for kind, checkpoints, count in (("nice_slam", "ckpts", 5), ("co_slam", ".", 6)):
        folder = tmp_path / kind
        ended = run(folder, kind, folder / checkpoints, folder)
        assert (ended.returncode, ended.stderr) == (0, "")
        for name in ("poses.npz", *(["relative_poses.npz"] if kind == "co_slam" else [])):
            found = read_estimate("array", folder / name, INDEX, axes="opengl")
            assert found.stamps_s.tolist() == [0.05 * k for k in range(count)]  # frame 5 of NICE-SLAM is not estimated
            assert np.allclose(found.c2w, wanted[:count], atol=1e-5)
    whole = (tmp_path / "nice_slam/ckpts/00004.tar").read_bytes()
    (tmp_path / "cut.tar").write_bytes(whole[: len(whole) // 2])
    for name, words in (
        ("runs.tar", "torch cannot load it: "),
        ("cut.tar", "torch cannot load it: "),
        ("flat.tar", "holds no poses as nice_slam saves them: numbers of (4, 4), which are no matrices of 4 x 4"),
        ("co_slam/checkpoint5.pt", "holds no poses as nice_slam saves them: 'estimate_c2w_list'"),
    ):
        ended = run(tmp_path, "nice_slam", name, tmp_path)
        (line,) = ended.stderr.splitlines()
        assert (ended.returncode, line.startswith(f"{name}: {words}")) == (1, True), line
    assert not (tmp_path / "ran").exists()
    assert not (tmp_path / "poses.npz").exists()


def test_lengths_of_imap_become_metres(monkeypatch):
    monkeypatch.syspath_prepend(str(PROGRAMS))
    import checkpoint_poses

    scaled = poses()
    scaled[:, :3, 3] *= 0.1  # as its configuration has `scale`
    held = {"estimate_c2w_list": scaled, "idx": 4}
    ((_, found),) = checkpoint_poses.of_imap(held).values()
    assert np.allclose(found, poses()[:5], atol=1e-12)


def test_what_happens_before_a_checkpoint_is_read(tmp_path):
    system = tmp_path / "system.py"
    system.write_text(
        "import os, sys\nsys.exit(7) if sys.argv[1] == 'fails' else sys.argv[1] == 'ends' or os.kill(os.getpid(), 9)"
    )
    assert run(tmp_path, "co_slam", tmp_path, tmp_path, system, "fails", python=sys.executable).returncode == 7
    assert run(tmp_path, "co_slam", tmp_path, tmp_path, system, "is killed", python=sys.executable).returncode == -9
    # NICE-SLAM ends with status 0 when its mapper has died.
    for program in ((), (system, "ends")):
        ended = run(tmp_path, "co_slam", tmp_path, tmp_path, *program, python=sys.executable)
        assert (ended.returncode, ended.stderr) == (1, f"{tmp_path}: holds no checkpoint of co_slam\n")
    (tmp_path / "torch.py").write_text("__version__ = '1.10.1'\ndef load(path, map_location): raise ValueError\n")
    (tmp_path / "checkpoint5.pt").write_bytes(b"")
    shim = tmp_path / "python"
    shim.write_text(f'#!/bin/sh\nPYTHONPATH={tmp_path} exec {sys.executable} "$@"\n')
    shim.chmod(0o755)
    ended = run(tmp_path, "co_slam", tmp_path, tmp_path, python=str(shim))
    assert ended.stderr == "torch 1.10.1 may run what a checkpoint names; read it with torch 1.13 or newer\n"
    (tmp_path / "torch.py").write_text("raise ImportError('libtorch is gone')")
    ended = run(tmp_path, "co_slam", tmp_path, tmp_path, python=str(shim))
    assert ended.stderr == f"{sys.executable} has no torch, which reads checkpoints: libtorch is gone\n"
