# SPDX-License-Identifier: GPL-3.0-or-later
"""A scanned room on its real path, against Embree through Open3D: another reader, another ray caster."""

import subprocess

import cv2
import numpy as np
import pytest
import yaml
from worlds import ROOT, generate

DATA = ROOT.parent / "shared" / "data" / "real_room"
PEER = ROOT / ".venv-peer" / "bin" / "python"
FRAMES = (0, 111, 222, 333, 444, 555, 666, 777, 888, 999)

pytestmark = [
    pytest.mark.skipif(not DATA.is_dir(), reason="no scanned room beside the project"),
    pytest.mark.skipif(not PEER.exists(), reason="no Open3D: run make peer-env, with a Python 3.11"),
]
pytest.importorskip("bpy", reason="bpy is not installed")


def cast(mesh, out):
    camera = ["1200", "680", "600", "600", "599.5", "339.5"]
    command = [
        str(PEER),
        "tests/peer/raycast.py",
        str(mesh),
        str(DATA / "traj.txt"),
        str(out),
        *camera,
        *map(str, FRAMES),
    ]
    subprocess.run(command, check=True, cwd=ROOT)
    return np.load(out)


def render(mesh, tmp_path, trajectory="traj.txt"):
    scene = {"name": "real", "mesh": str(mesh), "trajectory": {"file": str(DATA / trajectory), "every": 111}}
    preset = tmp_path / "real.yaml"
    preset.write_text(yaml.safe_dump({"scenes": [scene], "output": {"image": "png"}}))
    generate(preset, "--out", tmp_path / "out")
    folder = tmp_path / "out/clean/real/results"
    frames = range(len(FRAMES))
    steps = np.stack([cv2.imread(str(folder / f"depth{k:06d}.png"), cv2.IMREAD_UNCHANGED) for k in frames])
    return steps, np.stack([cv2.imread(str(folder / f"frame{k:06d}.png"))[..., ::-1] for k in frames])


def test_against_embree(tmp_path):
    steps, images = render(DATA / "real_room.ply", tmp_path)
    peer = cast(DATA / "real_room.ply", tmp_path / "peer.npz")
    for k in range(len(FRAMES)):
        expected = peer["depth_m"][k].astype(float) * 6553.5
        expected[expected > 65535] = 0
        seen = expected > 0
        assert np.mean((steps[k] > 0) != seen) < 5e-4
        both = seen & (steps[k] > 0)
        error = np.abs(steps[k].astype(float) - expected)[both]
        assert np.mean(error <= 0.5) >= 0.99
        colour_error = (images[k].astype(float) - peer["rgb"][k])[both]
        assert 10 * np.log10(255**2 / (colour_error**2).mean()) >= 50


def test_all_four_files_read_alike(tmp_path):
    # Three small files of one mesh, in three formats; and TUM's poses are those of the Replica file.
    results = {}
    for name, trajectory in (("_ascii", "traj.txt"), ("_be", "traj_tum.txt"), ("_quads", "traj.txt")):
        (tmp_path / name).mkdir()
        results[name] = render(DATA / f"real_room{name}.ply", tmp_path / name, trajectory)
    for name in ("_be", "_quads"):
        for mine, other in zip(results["_ascii"], results[name], strict=True):
            differ = np.abs(mine.astype(int) - other.astype(int)) > 2
            assert differ.mean() < 0.01  # ASCII holds six decimals; a quad may be split along its other diagonal
    assert (results["_ascii"][0] > 0).mean() > 0.5
