# SPDX-License-Identifier: GPL-3.0-or-later
"""Sequences that exist: perturbed as rendered frames are, without Blender, and what is said of broken ones."""

import json
import subprocess
import sys

import cv2
import numpy as np
import pytest
from refusals import refused
from runs import run
from many_settings import COUNT, SETTINGS, image, records
from worlds import ROOT


pytestmark = pytest.mark.usefixtures("no_blender")


def existing(tmp_path, source, **keys):
    camera = {"width": 40, "height": 32, "fx": 20.0, "fy": 20.0, "cx": 19.5, "cy": 15.5}
    render = {"backend": "reference"}
    preset = {"seed": 3, "scenes": [{"name": "box", "sequence": str(source)}], "camera": camera, "render": render}
    preset |= keys
    path = tmp_path / "existing.yaml"
    path.write_text(json.dumps(preset))
    return path


def test_an_existing_sequence_is_perturbed_as_rendered_frames_are(out, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", None)  # importing it would fail
    settings = [item for item in SETTINGS if item.get("name") not in ("shaky", "mixed")]
    preset = existing(tmp_path, out / "clean" / "box", settings=settings, output={"image": "png"})
    report = run(preset, tmp_path / "again")
    assert report.frames_rendered == COUNT
    for setting in ("clean", "late", "early", "fast"):
        for path in (out / setting / "box/results").iterdir():
            other = tmp_path / "again" / setting / "box/results" / path.name
            assert other.read_bytes() == path.read_bytes()
            assert other.stat().st_ino in {item.stat().st_ino for item in (out / "clean/box/results").iterdir()}
    # The rendered frame was float before the noise, the stored one bytes: half a step apart at most, before rounding.
    for frame in range(COUNT):
        a, b = (
            cv2.imread(str(image(place, "noise", "frame", frame))).astype(int) for place in (out, tmp_path / "again")
        )
        assert np.abs(a - b).max() <= 1
    identity = json.loads((tmp_path / "again/manifest.json").read_text())["identity"]
    assert "blender" not in identity["versions"]
    assert len(identity["scenes"]["box"]["inputs"]["sequence_sha256"]) == 64


def test_a_tum_sequence_is_read_by_its_stamps(out, tmp_path):
    preset = existing(tmp_path, out / "clean" / "box", output={"layout": "tum"})
    run(preset, tmp_path / "tum")
    folder = tmp_path / "tum/clean/box"
    # Depth starts late and is listed out of step by less than the tolerance.
    lines = (folder / "depth.txt").read_text().splitlines()
    shifted = [
        line if line.startswith("#") else f"{float(line.split()[0]) + 0.01:.6f} {line.split()[1]}" for line in lines
    ]
    (folder / "depth.txt").write_text("\n".join(shifted[:3] + shifted[5:]) + "\n")
    path = existing(tmp_path, folder, output={"image": "png"})
    run(path, tmp_path / "back")
    assert len(records(tmp_path / "back", "clean")) == COUNT - 2
    for frame in range(COUNT - 2):
        back = cv2.imread(str(image(tmp_path / "back", "clean", "frame", frame)))
        assert np.array_equal(back, cv2.imread(str(image(out, "clean", "frame", frame + 2))))
        # 5000 steps a metre and back to 6553.5: half a step of each.
        steps = [
            cv2.imread(str(image(place, "clean", "depth", frame + extra)), cv2.IMREAD_UNCHANGED).astype(float)
            for place, extra in ((tmp_path / "back", 0), (out, 2))
        ]
        assert np.abs(steps[0] - steps[1]).max() <= 0.5 * 6553.5 / 5000 + 1.0


@pytest.mark.parametrize(
    ("break_it", "words"),
    [
        (lambda folder: (folder / "traj.txt").unlink(), "traj.txt"),
        (lambda folder: (folder / "results/depth000003.png").unlink(), "do not match"),
        (lambda folder: (folder / "results/frame000000.png").write_bytes(b"no image"), "frame000000.png"),
        (lambda folder: (folder.parent / "cam_params.json").write_text("{}"), "cam_params.json"),
        (lambda folder: (folder / "traj.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n"), "1 poses for 8 frames"),
    ],
)
def test_a_broken_sequence_is_one_line_that_names_the_file(out, tmp_path, break_it, words):
    break_it(out / "clean/box")
    preset = existing(tmp_path, out / "clean" / "box")
    refused(run, preset, tmp_path / "again", names=words)


def test_what_an_existing_sequence_cannot_do(out, tmp_path):
    shaky = existing(tmp_path, out / "clean/box", settings=[{"name": "s", "perturb": [{"motion_deviation": None}]}])
    refused(run, shaky, tmp_path / "x", names=["scenes.0.sequence: s deviates from the path"])
    small = existing(tmp_path, out / "clean/box", camera={"width": 4, "height": 3, "fx": 1, "fy": 1, "cx": 1, "cy": 1})
    refused(run, small, tmp_path / "x", names="40 x 32")
    refused(run, existing(tmp_path, tmp_path / "nowhere"), tmp_path / "x", names=["scenes.0.sequence", "nowhere"])
    empty = tmp_path / "empty"
    empty.mkdir()
    refused(run, existing(tmp_path, empty), tmp_path / "x", names=[f"{empty}: ", "Replica or TUM"])
    gone = existing(
        tmp_path, out / "clean/box", settings=[{"name": "s", "perturb": [{"desync": {"offset": 99, "edge": "drop"}}]}]
    )
    refused(run, gone, tmp_path / "x", names=["desync", "8 frames"])


def generate_without_blender(*arguments):
    script = (
        "import sys; sys.modules['bpy'] = None\n"
        "sys.path[:0] = sys.argv[1:2]\n"
        "from noisy_world.cli.command import main\n"
        "sys.exit(main(['generate', *sys.argv[2:]]))"
    )
    command = [sys.executable, "-c", script, str(ROOT / "addon"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_perturbing_a_sequence_by_the_reference_imports_no_blender(out, tmp_path):
    preset = existing(tmp_path, out / "clean" / "box", settings=SETTINGS[:3])
    result = generate_without_blender(preset, "--out", tmp_path / "b")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "b/noise/box/results/frame000007.jpg").exists()


def test_the_compositor_is_never_replaced_where_there_is_none(out, tmp_path, monkeypatch):
    preset = existing(tmp_path, out / "clean" / "box", settings=SETTINGS[:2], render={})
    result = generate_without_blender(preset, "--out", tmp_path / "b")
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert "bpy" in line
    assert "render.backend=reference" in line
    assert not (tmp_path / "b").exists()
    # A setting may say for itself; and what leaves colour alone needs no compositor.
    settings = [{**SETTINGS[1], "backend": "reference"}, SETTINGS[3]]
    preset = existing(tmp_path, out / "clean" / "box", settings=settings, render={})
    monkeypatch.setitem(sys.modules, "bpy", None)
    assert run(preset, tmp_path / "b").frames_rendered == COUNT
