# SPDX-License-Identifier: GPL-3.0-or-later
"""The same preset in a real Blender program and under the bpy package.

Needs NOISY_WORLD_BLENDER, the path of a Blender program for which `make blender-env` was run.
"""

import os
import shutil
import signal
import subprocess
import time

import cv2
import numpy as np
import pytest
from worlds import GENERATE, ROOT, generate, write_world

BLENDER = os.environ.get("NOISY_WORLD_BLENDER", "")
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not BLENDER, reason="NOISY_WORLD_BLENDER names no Blender program"),
]


def blender(*arguments, before=(), **options):
    command = [BLENDER, "-b", "--factory-startup", *before, "-P", str(GENERATE), "--", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, cwd=ROOT, **options)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    return write_world(tmp_path_factory.mktemp("world"), frames=4, size=(320, 240))


@pytest.fixture(scope="module")
def by_package(world, tmp_path_factory):
    """The frames under the bpy package."""
    out = tmp_path_factory.mktemp("wheel") / "out"
    generate(world, "--out", out)
    return out


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_same_frames(world, by_package, tmp_path, jobs):
    inside = blender(world, "--out", tmp_path / "blender", "--jobs", jobs)
    assert inside.returncode == 0, inside.stderr
    assert "4 frames rendered" in inside.stdout
    for k in range(4):
        name = f"clean/box/results/depth{k:06d}.png"
        depth = [
            cv2.imread(str(out / name), cv2.IMREAD_UNCHANGED).astype(int) for out in (tmp_path / "blender", by_package)
        ]
        assert (depth[0] > 0).all()
        assert np.abs(depth[0] - depth[1]).max() <= 1
        name = f"clean/box/results/frame{k:06d}.png"
        colour = [cv2.imread(str(out / name)).astype(int) for out in (tmp_path / "blender", by_package)]
        assert np.abs(colour[0] - colour[1]).max() <= 1


def test_the_same_options_and_exit_statuses(world, tmp_path):
    text = blender("--help")
    assert text.returncode == 0
    assert "--dry-run" in text.stdout
    wrong = blender(world, "--set", "render.sampels=1")
    assert wrong.returncode == 1
    assert "did you mean 'samples'" in wrong.stderr
    assert "Traceback" not in wrong.stderr
    assert blender(world, "--jobs", "none").returncode == 2


def test_interrupted_and_resumed(tmp_path):
    preset = write_world(tmp_path / "world", frames=40, size=(320, 240))
    out = tmp_path / "out"
    command = [BLENDER, "-b", "--factory-startup", "-P", str(GENERATE), "--", str(preset), "--out", str(out)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    results = out / "clean/box/results"
    while process.poll() is None and not (results.is_dir() and len(list(results.iterdir())) > 4):
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "the same command continues from there" in errors
    assert 0 < len(list(results.glob("depth*"))) < 40
    again = subprocess.run(command, capture_output=True, text=True, check=True)
    assert " kept" in again.stdout
    assert len(list(results.glob("depth*"))) == 40


def test_a_missing_package_is_named_with_the_command(world, tmp_path):
    # A copy of the project without the packages that were installed beside it.
    for name in ("addon", "headless"):
        shutil.copytree(ROOT / name, tmp_path / "copy" / name)
    command = [BLENDER, "-b", "--factory-startup", "-P", str(tmp_path / "copy/headless/generate.py"), "--", str(world)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert result.returncode == 1
    lines = [line for line in result.stderr.splitlines() if line.startswith("generate.py: ")]
    assert len(lines) == 1
    assert "opencv-contrib-python-headless" in lines[0]
    assert "make -C" in lines[0]
    assert "blender-env BLENDER=" in lines[0]
