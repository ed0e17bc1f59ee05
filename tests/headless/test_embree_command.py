# SPDX-License-Identifier: GPL-3.0-or-later
"""`engine: embree` as a user types it: without Blender, refused in a line where it cannot be, and no less checked."""

import json
import shlex
import subprocess
import sys

import cv2
import numpy as np
import pytest
from analytic import box_depth
from worlds import GENERATE, HIGH, LOW, content, generate_here, path_poses, write_world

from noisy_world.core.geometry import Intrinsics

EMBREE = {"engine": "embree", "samples": 1, "backend": "reference"}
SIZE = (64, 48)


@pytest.fixture
def world(tmp_path):
    return write_world(tmp_path / "world", frames=4, size=SIZE, render=EMBREE, settings=[
        {"name": "clean"}, {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 2}}]},
        {"name": "deviated", "perturb": [{"motion_deviation": {"rotation_deg": 1.0, "translation_m": 0.02}}]},
    ])  # fmt: skip


def without(modules, *arguments):
    """Run the command in a Python in which these modules cannot be imported."""
    code = (
        f"import runpy, sys\nsys.modules.update(dict.fromkeys({modules!r}))\n"
        f"sys.argv = [{str(GENERATE)!r}, *{[str(item) for item in arguments]!r}]\n"
        f"runpy.run_path({str(GENERATE)!r}, run_name='__main__')"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=300)


def test_a_dataset_without_blender(world, tmp_path):
    pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    result = without(["bpy"], world, "--out", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    camera = Intrinsics(*SIZE, 32.0, 32.0, 31.5, 23.5)
    for index, pose in enumerate(path_poses(4)):
        steps = cv2.imread(str(tmp_path / f"out/clean/box/results/depth{index:06d}.png"), cv2.IMREAD_UNCHANGED)
        expected, sure = box_depth(camera, pose, LOW, HIGH)
        assert np.abs(steps / 6553.5 - expected)[sure].max() < 1.01 / 6553.5 / 2
    identity = json.loads((tmp_path / "out/manifest.json").read_text())["identity"]
    assert identity["render"] == {"engine": "embree", "device": "cpu", "samples": 1}
    assert "embreex" in identity["versions"]
    assert "blender" not in identity["versions"]
    other = generate_here(world, "--out", tmp_path / "out", "--set", "render.engine=cycles", check=False)
    assert other.returncode == 1
    assert "engine" in other.stderr.splitlines()[-1]


def test_a_path_that_sees_nothing_ends_the_run(world, tmp_path):
    pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    poses = path_poses(4, shift_m=(0.0, 0.0, 90.0))
    text = "\n".join(" ".join(map(repr, map(float, pose.ravel()))) for pose in poses)
    (world.parent / "traj.txt").write_text(text)
    result = generate_here(world, "--out", tmp_path / "out", check=False)
    assert result.returncode == 1
    assert "frames 0 to 2 of traj.txt see nothing of mesh.ply" in result.stderr


def test_where_embreex_is_missing_one_line_says_so(world, tmp_path):
    result = without(["bpy", "embreex"], world, "--out", tmp_path / "out")
    assert result.returncode == 1
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    install = shlex.join([sys.executable, "-m", "pip", "install", f"{GENERATE.parents[1]}[embree]"])
    assert result.stderr == (
        f"generate.py: render.engine is embree, but embreex is missing in this Python {version}; "
        f"run: {install}, or use render.engine: cycles\n"
    )
    dry = without(["bpy", "embreex"], world, "--out", tmp_path / "out", "--dry-run")
    assert (dry.returncode, dry.stderr) == (1, result.stderr)
    assert "8 frames in all" in dry.stdout
    assert not (tmp_path / "out").exists()


def test_where_blender_is_missing_one_line_names_the_extra_and_what_does_without(world, tmp_path):
    words = [world, "--out", tmp_path / "out", "--set", "render.engine=cycles"]
    script = without(["bpy"], *words)
    assert script.returncode == 1
    (line,) = script.stderr.splitlines()
    assert line.startswith(f"generate.py: bpy: missing in this Python 3.{sys.version_info.minor} ")
    assert f"run: make -C {GENERATE.parents[1]} venv" in line
    assert line.endswith("; or add --set render.engine=embree, which needs no Blender but the extra embree")
    code = (
        f"import sys\nsys.modules['bpy'] = None\nsys.path.insert(0, {str(GENERATE.parents[1] / 'addon')!r})\n"
        "from noisy_world.cli.command import main\nsys.exit(main())"
    )
    command = [sys.executable, "-c", code, "generate", *map(str, words), "render.backend=compositor"]
    told = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert told.returncode == 1
    (line,) = told.stderr.splitlines()
    assert f"{GENERATE.parents[1]}[blender]" in line
    assert line.endswith(
        "--set render.engine=embree render.backend=reference, which needs no Blender but the extra embree"
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("render.samples=2", "render.samples: is 2; embree knows 1, 4, 9, 16, 25, 36, 49, 64"),
        (
            "render.device=gpu",
            "render.device: is gpu, but embree casts its rays on the processor; leave it out, or use cycles",
        ),
    ],
)
def test_what_embree_cannot_do_is_refused(world, tmp_path, change, told):
    result = generate_here(world, "--out", tmp_path / "out", "--set", change, check=False)
    assert result.returncode == 1
    assert result.stderr.strip() == f"generate.py: {world}: {told}"


def test_more_samples_are_the_same_bytes_for_any_jobs_and_their_rays_are_told(world, tmp_path):
    pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    reports = []
    for jobs in (1, 2):
        out = tmp_path / f"{jobs}"
        said = generate_here(world, "--out", out, "--set", "render.samples=9", "--jobs", jobs)
        assert content(out) == content(tmp_path / "1")
        reports.append(json.loads((out / "run.json").read_text()))
        assert f"{reports[-1]['colour_rays'] / reports[-1]['colour_pixels']:.2f} rays a pixel" in said.stdout
    told = [{name: report[name] for name in ("colour_rays", "colour_pixels", "rays_per_px")} for report in reports]
    assert told[0] == told[1]
    assert told[0]["colour_pixels"] == 8 * SIZE[0] * SIZE[1]  # two paths of four frames
    assert 1 < told[0]["rays_per_px"] < 9
    depth, colour = (tmp_path / f"1/clean/box/results/{name}" for name in ("depth000000.png", "frame000000.png"))
    one = tmp_path / "one"
    generate_here(world, "--out", one)
    assert (one / depth.relative_to(tmp_path / "1")).read_bytes() == depth.read_bytes()
    assert (one / colour.relative_to(tmp_path / "1")).read_bytes() != colour.read_bytes()
    assert "rays_per_px" not in json.loads((one / "run.json").read_text())
