# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel generates, without a window: the same as the command line from the saved preset."""

import json
import math
import shlex
import subprocess
import time
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from refusals import refused
from recorded_layouts import WRITERS
from worlds import ROOT, content, generate, generate_here, path_poses, write_box_ply, write_replica

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

from noisy_world import panel
from noisy_world.core.progress import MARK
from noisy_world.panel import generating
from noisy_world.panel import runs
from noisy_world.panel.background import BackgroundRun
from noisy_world.panel.document import open_preset, to_document


@pytest.fixture
def scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    panel.register()
    yield bpy.context.scene
    panel.unregister()


def prepare(scene, folder, name="out", *, frames=3):
    """Describe a box, which is loaded sooner than the room is built, in the panel; the dataset goes to folder/name."""
    settings = scene.noisy_world
    write_box_ply(folder / "mesh.ply")
    write_replica(folder / "traj.txt", path_poses(frames))
    settings.mesh_source = settings.trajectory_source = "FILE"
    settings.of_mesh.mesh, settings.scene.trajectory.file = str(folder / "mesh.ply"), str(folder / "traj.txt")
    settings.scene.name = "box"
    settings.camera.width, settings.camera.height = 96, 54
    settings.camera.fx = settings.camera.fy = 48
    settings.camera.cx, settings.camera.cy = 47.5, 26.5
    settings.deviation_rotation = math.radians(1.3)
    settings.output.image = "png"
    settings.seed = 7
    settings.output_folder = str(folder / name)
    for perturbation in ("fog", "gaussian_noise"):
        settings.steps.add().perturbation = perturbation
    settings.steps[1].severity = 1.7
    return settings


def save(settings, path):
    path.write_text(json.dumps(to_document(settings)), encoding="utf-8")
    settings.preset_path = str(path)


def stand_in(monkeypatch, tmp_path, text):
    """Let this text take the generator's place."""
    script = tmp_path / "stand_in.py"
    script.write_text(f"import json, sys, time\ndef tell(**m): print({MARK!r} + json.dumps(m), flush=True)\n{text}")
    monkeypatch.setattr(runs, "generator_script", lambda: script)


WORK = "tell(start={'label': 'rendering', 'total': 4, 'done': 0})\ntell(advance=1)\n"


def test_the_same_frames_as_the_command_on_the_saved_preset(scene, tmp_path):
    settings = prepare(scene, tmp_path, "panel")
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    run = runs.run_of(scene)
    assert runs.summary(run).startswith("6 frames rendered")
    assert not run.folder.exists()
    (tmp_path / "elsewhere").mkdir()
    save(settings, tmp_path / "elsewhere" / "mine.yaml")
    generate(tmp_path / "elsewhere" / "mine.yaml", "--out", tmp_path / "shell")
    assert content(tmp_path / "panel") == content(tmp_path / "shell")
    assert len(list((tmp_path / "panel").glob("perturbed/box/results/frame*.png"))) == 3


def test_the_copied_command_runs_as_pasted_and_goes_on_with_the_panels_dataset(scene, tmp_path):
    settings = prepare(scene, tmp_path, "a folder/it's here", frames=2)
    refused(runs.command_line, scene, names="save the preset")
    save(settings, tmp_path / "my preset.yaml")
    command = runs.command_line(scene)
    assert shlex.split(command)[-2:] == ["--out", str(tmp_path / "a folder" / "it's here")]
    result = subprocess.run(command, shell=True, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert "4 frames rendered" in result.stdout
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    assert "4 kept" in runs.summary(runs.run_of(scene))
    settings.seed = 8
    refused(runs.command_line, scene, names="save the preset")


@pytest.mark.parametrize("mesh", ["../mesh.ply", "{folder}/mesh.ply", "../sub/../mesh.ply"])
def test_a_preset_says_the_same_however_it_names_its_files(scene, tmp_path, mesh):
    settings = prepare(scene, tmp_path)
    document = to_document(settings)
    document["scenes"][0]["mesh"] = mesh.format(folder=tmp_path)
    (tmp_path / "sub").mkdir()
    path = tmp_path / "sub" / "preset.yaml"
    path.write_text(json.dumps(document), encoding="utf-8")
    settings.preset_path = str(path)
    assert runs.saved_preset(settings) == path
    document["scenes"][0]["mesh"] = "mesh.ply"
    path.write_text(json.dumps(document), encoding="utf-8")
    assert runs.saved_preset(settings) is None


def test_another_dataset_in_the_folder_is_refused_and_can_be_replaced(scene, tmp_path):
    settings = prepare(scene, tmp_path, frames=1)
    settings.steps.clear()
    bpy.ops.noisy_world.generate()
    settings.seed = 9
    refused(bpy.ops.noisy_world.generate, names="Replace Dataset", error=RuntimeError)
    assert bpy.ops.noisy_world.generate_anew() == {"FINISHED"}
    assert runs.run_of(scene).background.phase == "finished"


def test_an_error_is_the_command_lines_in_the_panels_words_and_not_finished(scene, tmp_path):
    settings = prepare(scene, tmp_path)
    settings.mesh_source = "FILE"
    settings.of_mesh.mesh = str(tmp_path / "none.ply")
    with pytest.raises(RuntimeError, match=r"none\.ply") as caught:
        bpy.ops.noisy_world.generate()
    save(settings, tmp_path / "preset.yaml")
    told = generate(tmp_path / "preset.yaml", "--out", tmp_path / "out", check=False).stderr
    problem = f"no such file: {tmp_path / 'none.ply'}"
    assert f"preset.yaml: scenes.0.mesh: {problem}; paths are relative to the preset" in told
    assert str(caught.value).strip() == f"Error: Scene > Mesh File: {problem}"
    assert runs.run_of(scene).background.phase == "failed"
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_made_is_told_before_anything_starts(scene, tmp_path, monkeypatch):
    settings = prepare(scene, tmp_path)
    settings.output_folder = "//here"
    refused(bpy.ops.noisy_world.generate, names="save it", error=RuntimeError)
    settings.output_folder = ""
    refused(bpy.ops.noisy_world.generate, names="choose one", error=RuntimeError)
    assert runs.run_of(scene) is None
    settings.output.modalities = set()
    assert not bpy.ops.noisy_world.generate.poll()


def test_one_run_at_a_time_and_each_scene_remembers_its_own(scene, tmp_path, monkeypatch):
    stand_in(monkeypatch, tmp_path, WORK + "time.sleep(60)")
    prepare(scene, tmp_path)
    other = bpy.data.scenes.new("Other")
    assert not bpy.ops.noisy_world.generate_cancel.poll()
    run = runs.start(scene)
    assert runs.active_run() is run
    with bpy.context.temp_override(scene=other):
        assert not bpy.ops.noisy_world.generate.poll()
    assert bpy.ops.noisy_world.generate_cancel() == {"FINISHED"}
    run.background.wait()
    assert runs.summary(run) == runs.STOPPED
    with bpy.context.temp_override(scene=other):
        assert bpy.ops.noisy_world.generate.poll()
    assert runs.run_of(other) is None
    assert runs.run_of(scene) is run


def test_cancelled_for_real_and_resumed(scene, tmp_path):
    prepare(scene, tmp_path, frames=60)  # more than are rendered while the run is told to stop
    run = runs.start(scene)
    while run.background.done < 3:
        assert run.background.active, run.background.error
        run.background.poll()
        time.sleep(0.02)
    assert runs.summary(run).startswith(f"{run.background.done} of 120 frames")
    bpy.ops.noisy_world.generate_cancel()
    run.background.wait()
    assert run.background.phase == "stopped"
    run.tidy()
    made = len(list((tmp_path / "out").glob("clean/box/results/depth*")))
    assert 3 <= made < 60
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    assert " kept" in runs.summary(runs.run_of(scene))
    assert len(list((tmp_path / "out").glob("*/box/results/depth*"))) == 120


@pytest.mark.parametrize("leave", ["load", "unregister"])
def test_no_process_is_left_behind(scene, tmp_path, monkeypatch, leave):
    stand_in(monkeypatch, tmp_path, WORK + "time.sleep(60)")
    prepare(scene, tmp_path)
    run = runs.start(scene)
    if leave == "load":
        bpy.ops.wm.read_homefile(use_factory_startup=True)
    else:
        runs.stop_all()
    assert run.background.phase == "stopped"
    assert runs.active_run() is None
    assert not run.folder.exists()


def test_the_generator_is_found_and_nothing_stays_registered(scene):
    assert runs.generator_script() == ROOT / "headless" / "generate.py"
    counts = [len(handlers) for handlers in generating.LEAVING]
    drawn = len(bpy.types.STATUSBAR_HT_header.draw._draw_funcs)
    panel.unregister()
    assert [len(handlers) for handlers in generating.LEAVING] == [count - 1 for count in counts]
    assert len(bpy.types.STATUSBAR_HT_header.draw._draw_funcs) == drawn - 2  # of the generator and of previewed frames
    panel.register()


def test_the_process_is_this_python(tmp_path):
    words = runs.generator_command(tmp_path / "a.yaml", tmp_path / "out")
    assert words[1:] == [str(runs.generator_script()), str(tmp_path / "a.yaml"), "--out", str(tmp_path / "out")]
    with pytest.raises(OSError, match="nothing-there"):
        BackgroundRun(["/nothing-there"])


def test_a_blender_program_leaves_the_users_other_add_ons_out(tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "bpy", SimpleNamespace(app=SimpleNamespace(binary_path="/opt/blender")))
    words = runs.generator_command(tmp_path / "a.yaml", tmp_path / "out", "--overwrite")
    assert words[:4] == ["/opt/blender", "-b", "--factory-startup", "-P"]
    assert words[5:] == ["--", str(tmp_path / "a.yaml"), "--out", str(tmp_path / "out"), "--overwrite"]


def test_a_script_is_told_what_is_not_in_the_dataset_and_goes_on(scene, tmp_path, monkeypatch, capfd):
    stand_in(monkeypatch, tmp_path, WORK + "tell(result='done')")
    prepare(scene, tmp_path)
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    assert "Not in the dataset" not in capfd.readouterr().out
    for name in ("Chair", "Table"):
        scene.collection.objects.link(bpy.data.objects.new(name, bpy.data.meshes.new(name)))
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    told = "Warning: Not in the dataset: Chair and Table. The dataset shows mesh.ply"
    assert told in capfd.readouterr().out.splitlines()


SETTINGS = (
    [{"fog": {"severity": 2, "temporal": "drift"}}],
    [{"gaussian_noise": {"severity": 3, "mode": "dynamic"}}, {"contrast": {"severity": 1}}],
)
RIG = {"depth": {"sensor": {"axial_noise": {"offset_m": 0.01}}}, "imu": {"device": "ideal", "rate_hz": 100.0}}


HOLD_PATHS = {"manifest.json", "preset.yaml"}  # which the panel gives as absolute ones


def documents(folder):
    """Ten presets of the sources that need no other Blender: meshes, recordings and videos, alone and beside others."""
    write_box_ply(folder / "mesh.ply")
    write_replica(folder / "traj.txt", path_poses(2))
    scan = folder / "scan"
    scan.mkdir()
    WRITERS["scannet"](scan)
    writer = cv2.VideoWriter(str(folder / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (32, 24))
    for level in (60, 200):
        writer.write(np.full((24, 32, 3), level, np.uint8))
    writer.release()
    mesh = {"name": "box", "mesh": "mesh.ply", "trajectory": {"file": "traj.txt"}}
    walked = mesh | {"name": "walked", "trajectory": {"handheld": {"frames": 2, "clearance_m": 0.1}}}
    read, video = {"name": "read", "sequence": "scan"}, {"name": "seen", "video": "film.avi"}
    camera = {"width": 24, "height": 18, "fx": 12, "fy": 12, "cx": 11.5, "cy": 8.5}
    lens = camera | {"fx": 24, "fy": 24, "distortion": {"k1": -0.1}}
    same = camera | {"width": 32, "height": 24}  # as the film
    first, second = ({"name": f"s{number}", "perturb": perturb} for number, perturb in enumerate(SETTINGS))
    moved = {"name": "moved", "perturb": [{"motion_deviation": {"rotation_deg": 1.0}}, {"desync": {"offset": 1}}]}
    sweep = {"sweep": {"perturb": ["contrast", "jpeg_compression"], "severities": [1, 4]}}
    clean, colour = {"name": "clean"}, {"output": {"modalities": ["rgb"]}}
    own = {"camera": camera, "seed": 2**61 + 1}
    return (
        own | {"scenes": [mesh], "settings": [clean, first]},
        own | {"scenes": [mesh], "settings": [moved, second], "output": {"layout": "tum", "image": "png"}},
        own | {"scenes": [mesh], "settings": [clean, sweep], "render": {"backend": "reference"}},
        own | {"scenes": [walked], "settings": [first], "rig": RIG, "output": {"layout": "euroc", "image": "png"}},
        {"scenes": [mesh, walked], "camera": lens, "settings": [second], "only": {"scenes": ["walked"]}},
        {"scenes": [read], "settings": [clean, first]},
        {"scenes": [read], "settings": [{"name": "late", "perturb": [{"desync": {"offset": 1}}]}]},
        {"scenes": [video], "settings": [second], **colour},
        {"scenes": [video, read], "settings": [clean, second], "data": str(folder), **colour},
        {"scenes": [video | {"name": "a"}, mesh | {"name": "b"}], "settings": [first], "camera": same, **colour},
    )


def test_of_ten_presets_of_all_sources_the_panel_makes_the_same_bytes(scene, tmp_path):
    pairs = []
    for number, document in enumerate(documents(tmp_path)):
        file = tmp_path / f"{number}.yaml"
        file.write_text(json.dumps(document))
        open_preset(scene.noisy_world, file)
        pairs.append((file, runs.temporary_preset(to_document(scene.noisy_world), tmp_path, f"panel{number}")))
    for preset, told in pairs:  # generating here leaves no scene
        made = {}
        for name, file in (("command", preset), ("panel", told)):
            generate_here(file, "--out", tmp_path / f"{preset.stem}_{name}")
            found = content(tmp_path / f"{preset.stem}_{name}")
            made[name] = {name: digest for name, digest in found.items() if name not in HOLD_PATHS}
        assert made["panel"] == made["command"], preset
        assert len(made["panel"]) >= 4
