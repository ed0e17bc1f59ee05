# SPDX-License-Identifier: GPL-3.0-or-later
"""Run SLAM, without a window: the embedded system on frames on disk, and its path in the scene."""

import os
import subprocess
import sys
from pathlib import Path

import box_room
import numpy as np
import pytest
from refusals import refused

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

import noisy_world
from noisy_world import panel as ui
from noisy_world.render.mesh_session import set_origin
from noisy_world.core.progress import MARK
from noisy_world.panel import drawn_paths, exclusions, generating, runs
from noisy_world.panel.drawn_paths import TrackedPath

POSES = box_room.path(30, turn_deg=40.0)[:6]


@pytest.fixture
def scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    ui.register()
    yield bpy.context.scene
    ui.unregister()


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """The sequences of two settings; in the second the last three frames are black and without depth."""
    folder = tmp_path_factory.mktemp("dataset")
    box_room.write_sequence(folder / "clean/box", POSES)
    box_room.write_sequence(
        folder / "foggy/box",
        POSES,
        change=lambda number, colour, depth_m: (colour * 0, depth_m * 0) if number >= 3 else (colour, depth_m),
    )
    return folder


def prepare(scene, folder):
    panel = scene.noisy_world
    panel.output_folder, panel.scene.name, panel.setting.name = str(folder), "box", "foggy"
    return panel


def stand_in(monkeypatch, tmp_path, text):
    """Let this text take the tracker's place."""
    script = tmp_path / "stand_in.py"
    script.write_text(f"import json, sys, time\ndef tell(**m): print({MARK!r} + json.dumps(m), flush=True)\n{text}")
    monkeypatch.setattr(runs, "tracker_script", lambda: script)


def points(collection, part):
    """The positions of each spline of a part."""
    (item,) = (item for item in collection.objects if item["noisy_world"] == part)
    return [np.array([point.co[:3] for point in spline.points]) for spline in item.data.splines]


def test_the_estimated_path_is_drawn_beside_the_true_one(scene, dataset):
    prepare(scene, dataset)
    set_origin(scene, np.array([10.0, 0.0, -1.0]))
    assert bpy.ops.noisy_world.track() == {"FINISHED"}
    foggy, clean = drawn_paths.shown(scene)
    assert foggy["noisy_world_sentence"].startswith("foggy: ATE ")
    assert "3 of 6 frames tracked, lost once" in foggy["noisy_world_sentence"]
    assert "6 of 6 frames tracked" in clean["noisy_world_sentence"]
    true = POSES[:, :3, 3] - [10.0, 0.0, -1.0]
    (tracked,), (lost,) = points(foggy, "true"), points(foggy, "lost")
    assert np.abs(tracked - true[:3]).max() < 1e-5
    assert np.abs(lost - true[2:]).max() < 1e-5
    (estimated,) = points(clean, "near")
    assert estimated.shape == (6, 3)
    assert np.abs(estimated - true).max() < 0.01
    assert not runs.tracking_of(scene).folder.exists()
    # Nothing renders them, and Generate does not speak of them.
    items = [*foggy.objects, *clean.objects]
    assert all(item.hide_render and not item.visible_camera for item in items)
    assert not any("box" in name for name in exclusions.excluded(scene))


def drawn(scene, name, positions):
    drawn_paths.show(scene, [TrackedPath(name, f"{name} said", {"true": [positions], "far": [positions[:1]]})])


def test_the_next_run_replaces_the_paths_and_a_button_removes_them(scene):
    mine = bpy.data.objects.new("Mine", None)
    drawn(scene, "clean/box", np.eye(3))
    drawn_paths.shown(scene)[0].objects.link(mine)
    drawn(scene, "foggy/box", np.eye(3))
    (collection,) = drawn_paths.shown(scene)
    assert collection["noisy_world_sentence"] == "foggy/box said"
    assert drawn_paths.parts_of([collection]) == ["true", "far"]
    assert len(bpy.data.curves) == len(bpy.data.materials) == 2
    (dot,) = points(collection, "far")
    assert len(dot) == 2  # a single frame is seen too
    assert bpy.ops.noisy_world.track_remove() == {"FINISHED"}
    assert drawn_paths.shown(scene) == []
    assert [len(kind) for kind in (bpy.data.curves, bpy.data.materials, bpy.data.collections)] == [0, 0, 0]
    assert list(scene.objects) == [mine]


def test_each_scene_has_its_own_paths(scene):
    other = bpy.data.scenes.new("Other")
    drawn(scene, "clean/box", np.eye(3))
    drawn(other, "foggy/box", np.eye(3))
    drawn_paths.remove(scene)
    assert [item.name for item in drawn_paths.shown(other)] == ["foggy/box"]


def test_why_nothing_can_be_run(scene, dataset, tmp_path, monkeypatch):
    panel = prepare(scene, tmp_path / "none")
    assert not bpy.ops.noisy_world.track.poll()
    assert generating._problem(scene).endswith("none: holds no frames of this scene yet; press Generate")
    panel.output_folder = str(dataset)
    assert bpy.ops.noisy_world.track.poll()
    panel.output.modalities = {"rgb"}
    assert generating._problem(scene) == "The embedded system needs color and depth"
    panel.output.modalities = {"rgb", "depth"}
    stand_in(monkeypatch, tmp_path, "tell(start={'label': 'tracking', 'total': 4, 'done': 0})\ntime.sleep(60)")
    run = runs.start_tracking(scene, dataset, ("clean/box",))
    assert not bpy.ops.noisy_world.track.poll()
    assert not bpy.ops.noisy_world.generate.poll()
    assert bpy.ops.noisy_world.generate_cancel() == {"FINISHED"}
    run.background.wait()
    run.tidy()
    assert runs.summary(run) == runs.NOT_TRACKED
    assert bpy.ops.noisy_world.track.poll()


def test_what_goes_wrong_is_a_line_and_the_paths_stay(scene, dataset, tmp_path, monkeypatch):
    prepare(scene, dataset)
    drawn(scene, "clean/box", np.eye(3))
    stand_in(monkeypatch, tmp_path, "tell(error='frame000003.png: is no image; make it again')\nsys.exit(1)")
    refused(bpy.ops.noisy_world.track, names=["frame000003.png: ", "make it again"], error=RuntimeError)
    stand_in(monkeypatch, tmp_path, "sys.exit('out of luck')")
    refused(bpy.ops.noisy_world.track, names=["status 1", "out of luck"], error=RuntimeError)
    assert [item.name for item in drawn_paths.shown(scene)] == ["clean/box"]


def test_nothing_of_the_evaluation_is_loaded_before_it_is_asked_for():
    asked = "loaded = [name for name in sys.modules if '.evaluation' in name]; assert not loaded, loaded"
    code = f"import sys, noisy_world; noisy_world.register(); {asked}; noisy_world.unregister()"
    environment = {**os.environ, "PYTHONPATH": str(Path(noisy_world.__file__).parents[1])}
    # What Blender itself says on standard output, of a machine without /etc/mtab for instance, is not asked for.
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
