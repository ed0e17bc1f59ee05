# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on in a Blender's window, installed into a clean profile and used as a person would.

Needs NOISY_WORLD_BLENDER, the path of a Blender program that opens its window somewhere where ImageMagick's `import`
can photograph it. NOISY_WORLD_PICTURES names a folder that the pictures are kept in.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from analytic import look_at
from worlds import ROOT, write_box_ply

BLENDER = os.environ.get("NOISY_WORLD_BLENDER", "")
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not BLENDER, reason="NOISY_WORLD_BLENDER names no Blender program"),
]
FRAMES = 5
PICTURES = (
    "panel_top", "tried", "paths", "menu", "perturbations", "preview", "chain", "nodes", "generating", "stopped",
    "generated", "tracked", "this_scene",
)  # fmt: skip


def blender(folder, *arguments, timeout_s=900):
    """Run Blender with a profile of its own in a folder."""
    profile = folder / "profile"
    places = {"BLENDER_USER": str(profile), "BLENDER_USER_RESOURCES": str(profile), "SCREEN": "1280x800x24"}
    command = [BLENDER, *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=timeout_s, check=False, cwd=folder, env=os.environ | places
    )


def install(folder, archive):
    """Install the extension into a clean profile in a folder; it is not enabled."""
    told = blender(folder, "--command", "extension", "install-file", "-r", "user_default", archive)
    assert told.returncode == 0, told.stdout + told.stderr


def poses():
    """A path (5, 4, 4) on a bow through a box room, camera-to-world, OpenCV axes, looking outwards."""
    angles = np.deg2rad(np.linspace(-30, 210, FRAMES))
    out = np.stack([np.cos(angles), np.sin(angles), np.zeros(FRAMES)], axis=-1)
    eyes = out + np.stack([np.full(FRAMES, -0.7), np.full(FRAMES, -0.3), 1.5 + 0.1 * np.sin(2 * angles)], axis=-1)
    return np.stack([look_at(eye, eye + way - [0, 0, 0.15]) for eye, way in zip(eyes, out, strict=True)])


@pytest.fixture(scope="module")
def archive(tmp_path_factory, building):
    """The extension's zip."""
    folder = tmp_path_factory.mktemp("zip")
    wheels = ROOT / "dist" / "wheels"
    if not wheels.is_dir():
        pytest.skip("dist/wheels is not there; run: make extension")
    build = [sys.executable, str(ROOT / "headless/tools/package.py"), "--platform", "linux-x64", "--out", str(folder)]
    with building():
        subprocess.run([*build, "--wheels", str(wheels)], check=True, capture_output=True, text=True)
    (path,) = folder.glob("*.zip")
    return path


@pytest.fixture(scope="module")
def used(archive, tmp_path_factory):
    """The folder after the work of drive.py, in a profile in which the extension was installed."""
    folder = tmp_path_factory.mktemp("add_on")
    install(folder, archive)
    write_box_ply(folder / "mesh.ply")
    np.savetxt(folder / "trajectory.txt", poses().reshape(FRAMES, 16))
    told = blender(folder, "--enable-event-simulate", "-P", ROOT / "tests/ui/window/drive.py", "--", folder)
    if pictures := os.environ.get("NOISY_WORLD_PICTURES"):
        Path(pictures).mkdir(parents=True, exist_ok=True)
        for path in (*folder.glob("*.png"), *folder.glob("remarks.txt")):
            shutil.copy(path, pictures)
    result = folder / "result.json"
    assert result.is_file(), told.stdout + told.stderr
    content = json.loads(result.read_text())
    assert content["status"] == "done", content["error"] + told.stdout
    assert "Traceback" not in told.stderr, told.stderr
    (folder / "said.txt").write_text(told.stdout)
    return folder


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
        assert len(list((used / "dataset" / setting / "room" / "results").iterdir())) == 2 * FRAMES
    changed = [used / "dataset" / setting / "room/results/frame000002.jpg" for setting in ("clean", "perturbed")]
    assert changed[0].read_bytes() != changed[1].read_bytes()


def test_the_dataset_follows_the_files_trajectory_and_deviates_from_it(used):
    wanted = poses()
    clean, perturbed, nominal = (
        np.loadtxt(used / "dataset" / name).reshape(-1, 4, 4)
        for name in ("clean/room/traj.txt", "perturbed/room/traj.txt", "perturbed/room/traj_nominal.txt")
    )
    assert np.abs(clean - wanted).max() < 3e-9  # rounded to a nanometre and 2e-9 rad
    assert np.abs(nominal - wanted).max() < 3e-9
    moved_m = np.linalg.norm((perturbed - wanted)[:, :3, 3], axis=1)
    turned = np.swapaxes(perturbed[:, :3, :3], 1, 2) @ wanted[:, :3, :3]
    turned_deg = np.degrees(np.arccos((np.trace(turned, axis1=1, axis2=2) - 1) / 2))
    # Root mean squares of three normals each of 0.1 m and 3 degrees: 0.17 m and 5.2 degrees, of five draws.
    assert 0.07 < np.sqrt((moved_m**2).mean()) < 0.35
    assert 2 < np.sqrt((turned_deg**2).mean()) < 10


def test_the_copied_command_goes_on_with_the_panels_dataset(used):
    program, *words = shlex.split((used / "command.txt").read_text())
    assert Path(program).name.startswith("blender")
    (script,) = (used / "profile").rglob("noisy_world/headless/generate.py")
    assert words[words.index("-P") + 1] == str(script)
    assert words[words.index("--") + 1 :] == [str(used / "preset.yaml"), "--out", str(used / "dataset")]
    before = content(used / "dataset")
    told = blender(used, *words)
    assert told.returncode == 0, told.stdout + told.stderr
    assert f"0 frames rendered, {2 * FRAMES} kept" in told.stdout, told.stdout
    assert content(used / "dataset") == before


def test_an_artists_own_scene_is_what_was_previewed_and_what_its_preset_gives(used):
    """From a file that was never saved: Generate, the preview of frame 2, and the saved preset without a window."""
    (script,) = (used / "profile").rglob("noisy_world/headless/generate.py")
    told = blender(used, "-b", "-P", script, "--", used / "own.yaml", "--out", used / "own_headless")
    assert told.returncode == 0, told.stdout + told.stderr
    made = content(used / "own")
    assert made == content(used / "own_headless")
    assert len([name for name in made if "perturbed/hall/results/frame" in name]) == FRAMES
    written = cv2.imread(str(used / "own/perturbed/hall/results/frame000002.png"))[..., ::-1]
    previewed = np.load(used / "own_preview.npy") * 255.0
    assert np.abs(written - previewed).max() <= 1.01


def test_enabling_and_reloading_leave_nothing(used):
    seen = json.loads((used / "leftovers.json").read_text())
    before, enabled = seen["before"], seen["enabled"]
    # What follows could not fail if nothing of the add-on were ever seen.
    assert any("noisy_world" in name.lower() for name in enabled["types"])
    assert "noisy_world" in enabled["properties"]["Scene"]
    assert any(enabled["handlers"].values())
    assert any(enabled["menus"].values())
    assert {"drawn_paths._draw", "views._begin", "views._end"} <= set(enabled["called while drawing"])
    assert not any("noisy" in name.lower() for name in before["types"])
    for kind in before:
        assert seen["disabled"][kind] == seen["after"][kind] == before[kind], kind
        assert seen["enabled again"][kind] == seen["reloaded"][kind] == enabled[kind], kind
    said, marker, _ = (used / "said.txt").read_text().partition("What an add-on leaves behind")
    assert marker
    wrong = r"Traceback|(?<!no )Error(?!: Not freed)|noisy.*warning"  # of a short path there is "no error"
    assert not re.search(wrong, said, re.IGNORECASE)
