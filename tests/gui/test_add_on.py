# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on in a Blender's window, installed into a clean profile and used as a person would.

Needs NOISY_WORLD_BLENDER, the path of a Blender program that opens its window somewhere where ImageMagick's `import`
can photograph it. NOISY_WORLD_PICTURES names a folder that the pictures are kept in.
"""

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from worlds import ROOT

BLENDER = os.environ.get("NOISY_WORLD_BLENDER", "")
pytestmark = pytest.mark.skipif(not BLENDER, reason="NOISY_WORLD_BLENDER names no Blender program")
PICTURES = ("panel_top", "paths", "menu", "perturbations", "preview", "generating", "stopped", "generated")


def blender(folder, *arguments):
    """Run Blender with a profile of its own in a folder."""
    profile = folder / "profile"
    places = {"BLENDER_USER": str(profile), "BLENDER_USER_RESOURCES": str(profile)}
    command = [BLENDER, *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=420, check=False, cwd=folder, env=os.environ | places
    )


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with a clean profile in which the extension is installed from its zip."""
    folder = tmp_path_factory.mktemp("add_on")
    wheels = ROOT / "dist" / "wheels"
    if not wheels.is_dir():
        pytest.skip("dist/wheels is not there; run: make extension")
    build = [sys.executable, str(ROOT / "headless/package.py"), "--platform", "linux-x64", "--out", str(folder / "zip")]
    subprocess.run([*build, "--wheels", str(wheels)], check=True, capture_output=True, text=True)
    (archive,) = (folder / "zip").glob("*.zip")
    told = blender(folder, "--command", "extension", "install-file", "-r", "user_default", "-e", archive)
    assert told.returncode == 0, told.stdout + told.stderr
    return folder


@pytest.fixture(scope="module")
def used(installed):
    """The folder after the work of drive.py."""
    told = blender(installed, "--enable-event-simulate", "-P", ROOT / "tests/gui/drive.py", "--", installed)
    if pictures := os.environ.get("NOISY_WORLD_PICTURES"):
        Path(pictures).mkdir(parents=True, exist_ok=True)
        for path in installed.glob("*.png"):
            shutil.copy(path, pictures)
    result = installed / "result.json"
    assert result.is_file(), told.stdout + told.stderr
    content = json.loads(result.read_text())
    assert content["status"] == "done", content["error"] + told.stdout
    assert "Traceback" not in told.stderr, told.stderr
    return installed


def content(folder):
    """Return the bytes of every file of a dataset by name, but for run.json, which holds timings."""
    files = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert files.pop("run.json", None)
    return files


def test_every_stage_was_photographed(used):
    for name in PICTURES:
        assert (used / f"{name}.png").stat().st_size > 50_000, name


def test_the_panels_dataset_is_that_of_the_saved_preset(used):
    """The installed generator, without a window and without variables, on the preset that the panel saved."""
    (script,) = (used / "profile").rglob("noisy_world/headless/generate.py")
    told = blender(used, "-b", "-P", script, "--", used / "preset.yaml", "--out", used / "headless")
    assert told.returncode == 0, told.stdout + told.stderr
    assert content(used / "dataset") == content(used / "headless")
    for setting in ("clean", "perturbed"):
        assert len(list((used / "dataset" / setting / "room" / "results").iterdir())) == 10
    changed = [used / "dataset" / setting / "room/results/frame000002.png" for setting in ("clean", "perturbed")]
    assert changed[0].read_bytes() != changed[1].read_bytes()


def test_the_copied_command_is_the_generators(used):
    program, *words = shlex.split((used / "command.txt").read_text())
    assert Path(program).name.startswith("blender")
    (script,) = (used / "profile").rglob("noisy_world/headless/generate.py")
    assert words == ["-b", "-P", str(script), "--", str(used / "preset.yaml"), "--out", str(used / "dataset")]
