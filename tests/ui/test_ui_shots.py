# SPDX-License-Identifier: GPL-3.0-or-later
"""Shots of the open scene: each is what Generate makes where the scene and the panel say what it says."""

import json
import math
import sys
import time
from pathlib import Path

import pytest
from refusals import refused
from panel_tools import settings
from worlds import ROOT, content

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

from noisy_world.perturbations.parsing import parse_settings
from noisy_world.preset.keys import read_preset
from noisy_world.core.progress import MARK
from noisy_world.core.errors import to_content
from noisy_world.dataset.folder_state import other_dataset
from noisy_world.perturbations import registry
from noisy_world.panel import entries, runs, shots
from noisy_world.panel.background import BackgroundRun
from noisy_world.panel.background import BackgroundSeries, SeriesTask
from noisy_world.panel.document import to_document
from noisy_world.panel.shots import preset_of_shot, with_rate

pytestmark = pytest.mark.usefixtures("add_on")

TALK = f"import json, sys, time\ndef tell(**message): print({MARK!r} + json.dumps(message), flush=True)\n"
START = "tell(start={'label': 'rendering', 'total': 2, 'done': 0})\ntell(advance=1)\n"


@pytest.fixture
def stage(tmp_path):
    """A lit plane seen by two cameras that move, in a collection as Blender's own new ones are."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=8)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    scene.collection.objects.link(sun)
    collection = bpy.data.collections.new("Collection")
    scene.collection.children.link(collection)
    for name, x in (("Wide", -1.0), ("Close", 1.0)):
        camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
        collection.objects.link(camera)
        camera.location, camera.rotation_euler = (x, -4, 2), (math.radians(65), 0, 0)
        camera.keyframe_insert("location", frame=1)
        camera.location.x = 0.0
        camera.keyframe_insert("location", frame=9)
    scene.camera = bpy.data.objects["Wide"]
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    scene.frame_start, scene.frame_end = 1, 2
    item = settings()
    item.mesh_source, item.scene.name, item.output_folder = "SCENE", "stage", str(tmp_path / "out")
    item.output.image = "png"
    bpy.ops.noisy_world.add_step(perturbation="gaussian_noise")
    return scene


def add(scene, **values):
    assert bpy.ops.noisy_world.add_shot() == {"FINISHED"}
    shot = settings().shots[-1]
    for name, value in values.items():
        setattr(shot, name, value)
    return shot


def stand_in(monkeypatch, tmp_path, text):
    """Let this text take the generator's place; `out` is the folder that it is given."""
    script = tmp_path / "stand_in.py"
    script.write_text(TALK + "out = sys.argv[sys.argv.index('--out') + 1]\n" + text)
    monkeypatch.setattr(runs, "generator_script", lambda: script)


def test_a_shot_is_what_generate_makes_where_the_scene_and_the_panel_say_the_same(stage, tmp_path):
    add(stage)
    close = bpy.data.objects["Close"]
    add(stage, name="close", camera=close, frame_start=4, frame_end=5, seed=9, output_folder=str(tmp_path / "close"))
    settings().steps[0].severity = 5.0  # after the lists were kept
    settings().shots[0].enabled = False
    assert bpy.ops.noisy_world.generate_shots() == {"FINISHED"}
    assert (stage.camera.name, stage.frame_start, stage.frame_end) == ("Wide", 1, 2)
    assert [end.phase for end in shots.series_of(stage).ended] == ["finished"]
    assert bpy.ops.noisy_world.show_shot() == {"FINISHED"}
    assert (stage.camera.name, stage.frame_start, stage.frame_end, stage.frame_current) == ("Close", 4, 5, 4)
    assert (settings().seed, settings().steps[0].severity) == (9, 3.0)
    settings().output_folder = str(tmp_path / "again")
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    made, again = (content(tmp_path / name) for name in ("close", "again"))
    frames = [name for name in made if "/results/" in name]
    assert len(frames) == 4
    assert {name: made[name] for name in frames} == {name: again[name] for name in frames}


def test_markers_become_shots_cut_where_they_bind_cameras(stage):
    """Frames by hand: markers at 3, 5 (a label), 6 and 20, of which 3 and 6 bind cameras; the scene is 1 to 9."""
    stage.frame_end = 9
    wide, close = bpy.data.objects["Wide"], bpy.data.objects["Close"]
    refused(bpy.ops.noisy_world.shots_from_markers, names="poll", error=RuntimeError)
    for name, frame in (("late", 20), ("door", 6), ("beat", 5), ("a/b", 3)):
        stage.timeline_markers.new(name, frame=frame)
    listed = stage.timeline_markers
    refused(shots.shots_from_markers, moved(stage, 30), names="no marker")
    moved(stage, -30)
    assert "3 shots are added" in shots.shots_from_markers(stage)  # no camera is bound, so each cuts
    assert [(shot.name, shot.frame_start, shot.frame_end) for shot in settings().shots] == [
        ("a/b", 3, 4), ("beat", 5, 5), ("door", 6, 9),
    ]  # fmt: skip
    assert {shot.camera for shot in settings().shots} == {wide}
    settings().shots[2].seed = 7
    listed["a/b"].camera, listed["door"].camera, listed["door"].frame = wide, close, 7
    said = shots.shots_from_markers(stage)
    assert "0 shots are added, 2 have" in said
    assert "frames 1 to 2" in said
    found = {shot.name: (shot.camera, shot.frame_start, shot.frame_end, shot.seed) for shot in settings().shots}
    assert found == {"a/b": (wide, 3, 6, 0), "beat": (wide, 5, 5, 0), "door": (close, 7, 9, 7)}
    settings().shots.remove(1)
    listed.new("door", frame=9).camera = wide
    assert bpy.ops.noisy_world.shots_from_markers() == {"FINISHED"}
    assert [shot.name for shot in settings().shots] == ["a/b", "door", "door_2"]
    folders = [Path(shot.output_folder).name for shot in shots.chosen_shots(settings())]
    assert folders == ["out_a_b", "out_door", "out_door_2"]
    assert preset_of_shot(stage, settings().shots[1]).document["scenes"][0]["camera"] == "Close"


def moved(scene, by):
    """The scene with all its markers moved by frames."""
    for marker in scene.timeline_markers:
        marker.frame += by
    return scene


def test_what_failed_is_a_line_and_the_others_are_kept_and_it_can_be_replaced(stage, tmp_path, monkeypatch):
    error = other_dataset(tmp_path / "two", "seed was 2").message
    sent = f"error={str(error)!r}, parts={ {'error': to_content(error)}!r}"
    refusing = "if out.endswith('two') and '--overwrite' not in sys.argv:\n"
    stand_in(monkeypatch, tmp_path, f"{refusing}    tell({sent})\n    sys.exit(1)\nopen(out, 'w').close()\n")
    for name, seed in (("one", 1), ("two", 2), ("three", 3)):
        add(stage, name=name, seed=seed, frame_end=1, output_folder=str(tmp_path / name))
    told("two: ", "another")
    series = shots.series_of(stage)
    assert [end.phase for end in series.ended] == ["finished", "failed", "finished"]
    assert series.phase == "failed"
    assert shots.ended_line(runs.shots_of(stage), series) == "2 of 3 shots are made"
    assert shots.replaceable(stage) == ["two"]
    assert [(tmp_path / name).is_file() for name in ("one", "two", "three")] == [True, False, True]
    assert bpy.ops.noisy_world.replace_shots() == {"FINISHED"}
    assert [end.task.name for end in shots.series_of(stage).ended] == ["two"]
    assert not bpy.ops.noisy_world.replace_shots.poll()


def test_esc_stops_the_shot_that_runs_and_starts_no_other(stage, tmp_path, monkeypatch):
    stand_in(
        monkeypatch, tmp_path, START + "open(out + '.begun', 'w').close()\ntime.sleep(60 if 'two' in out else 0)\n"
    )
    for name in ("one", "two", "three"):
        add(stage, name=name, output_folder=str(tmp_path / name))
    run = shots.start_shots(stage)
    assert not bpy.ops.noisy_world.generate_shots.poll()
    end_s = time.monotonic() + 300
    while len(run.background.ended) < 1 or run.background.done < 1:
        assert time.monotonic() < end_s
        run.background.poll()
        time.sleep(0.01)
    assert runs.summary(run).startswith("2 of 3, two: 1 of 2 frames")
    assert run.background.fraction == pytest.approx((1 + 0.5) / 3)
    assert bpy.ops.noisy_world.generate_cancel() == {"FINISHED"}
    run.background.wait()
    run.tidy()
    assert (run.background.phase, runs.summary(run)) == ("stopped", shots.STOPPED)
    assert sorted(path.name for path in tmp_path.glob("*.begun")) == ["one.begun", "two.begun"]
    assert runs.active_run() is None


def told(*names):
    return refused(bpy.ops.noisy_world.generate_shots, names=names, error=RuntimeError)


def test_what_cannot_be_made_is_told_before_anything_starts(stage, tmp_path):
    told("Shots: ")
    first, second = add(stage), add(stage)
    for name, value, *names in (
        ("camera", None, "shot_2 ", "camera", "choose one"),
        ("frame_end", 0, "shot_2 ", "frame 0"),
        ("name", "shot_1", "shot_1 ", "two shots"),
        ("name", " ", "no name"),
        ("output_folder", first.output_folder, "shot_2 ", "folder of shot_1", "choose another"),
        ("output_folder", "", "Shots > shot_2 > Output: "),
        ("own_list", "", "shot_2 ", "Keep List"),
        ("perturbations", "PRESET", "shot_2 ", "preset", "choose one"),
    ):
        before = getattr(second, name)
        setattr(second, name, value)
        told(*names)
        setattr(second, name, before)
    second.perturbations, second.preset = "PRESET", str(tmp_path / "none.yaml")
    told("none.yaml")
    second.preset, second.setting = str(ROOT / "presets/mixed.yaml"), "nowhere"
    told("nowhere")
    assert runs.shots_of(stage) is None
    settings().mesh_source = "ROOM"
    told("This Scene")


def test_a_presets_setting_of_a_sweep_and_one_that_is_clean(stage):
    shot = add(stage, perturbations="PRESET", preset=str(ROOT / "presets/noisy_replica.yaml"), setting="fog_s3_static")
    preset = preset_of_shot(stage, shot)
    (setting,) = parse_settings(preset.spec.settings, preset.setting_places, registry())
    theirs = read_preset(Path(shot.preset))
    found = parse_settings(theirs.spec.settings, theirs.setting_places, registry())
    (wanted,) = [item for item in found if item.name == "fog_s3_static"]
    drawn = [
        [(step.perturbation.name, step.severity, step.given, step.stream) for step in item.steps]
        for item in (setting, wanted)
    ]
    assert drawn[0] == drawn[1] != []
    assert (setting.name, setting.stream) == ("fog_s3_static", wanted.stream)
    shot.setting = "clean"
    assert preset_of_shot(stage, shot).document["settings"] == [{"name": "clean"}]


def test_a_keyed_severity_follows_the_frames_of_the_shot(stage):
    step = settings().steps[0]
    for frame, severity in ((1, 1.0), (9, 5.0)):
        step.severity = severity
        step.keyframe_insert("severity", frame=frame)
    shot = add(stage, frame_start=5, frame_end=9)
    assert shot.perturbations == "PANEL"  # a list that is kept has no timeline
    refused(bpy.ops.noisy_world.keep_list, names="Perturb By: Panel", error=RuntimeError)
    (setting,) = preset_of_shot(stage, shot).document["settings"]
    stage.frame_start, stage.frame_end = 5, 9
    assert [setting] == to_document(settings())["settings"]
    levels = setting["perturb"][0]["gaussian_noise"]["levels"]
    assert (levels[0], levels[-1], len(levels)) == (pytest.approx(3.0, abs=0.2), 5.0, 5)


def test_the_list_is_saved_in_the_file_and_goes_with_its_scene(stage, tmp_path):
    add(stage, name="close", camera=bpy.data.objects["Close"], frame_start=4, frame_end=8, seed=3)
    add(stage, enabled=False)
    kept = settings().shots[0].own_list
    assert json.loads(kept)["perturb"] == [{"gaussian_noise": {"severity": 3.0, "coarse": True}}]
    assert bpy.ops.noisy_world.move_shot(by=-1) == {"FINISHED"}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "stage.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert len(settings().shots) == 0
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "stage.blend"))
    other, close = settings().shots
    assert (other.enabled, close.camera.name, close.frame_start, close.frame_end) == (False, "Close", 4, 8)
    assert (close.seed, close.own_list) == (3, kept)
    preset = preset_of_shot(bpy.context.scene, close)
    assert preset.document["scenes"][0]["blend"] == str(tmp_path / "stage.blend")
    assert (preset.document["scenes"][0]["camera"], preset.document["scenes"][0]["frames"]) == ("Close", "4:8")
    assert bpy.ops.noisy_world.remove_shot() == {"FINISHED"}
    assert [shot.name for shot in settings().shots] == ["close"]


def test_a_series_goes_on_after_a_task_that_cannot_be_started():
    def task(name, words):
        return SeriesTask(name, lambda: BackgroundRun(words), lambda error: f"told {error}")

    good = [sys.executable, "-c", TALK + START + "tell(result='2 frames')"]
    bad = [sys.executable, "-c", TALK + "tell(error='no')\nsys.exit(1)"]
    series = BackgroundSeries([task("a", bad), task("b", ["/nothing-there"]), task("c", good)])
    series.wait()
    assert (series.phase, series.fraction, series.active) == ("failed", 1.0, False)
    assert series.error.splitlines()[0] == "a: told no"
    assert "b: told cannot be started" in series.error
    assert series.result == "c: 2 frames"
    with pytest.raises(OSError, match="nothing-there"):
        BackgroundSeries([task("a", ["/nothing-there"])])


def test_an_error_names_the_shot(stage, tmp_path):
    shot = add(stage)
    shot.camera.data.type = "ORTHO"
    refused(preset_of_shot, stage, shot, names="shot_1")


def test_what_falls_has_the_rate_of_the_frames_that_the_scene_shows(stage):
    stage.render.fps, stage.frame_step = 24, 2
    bpy.ops.noisy_world.add_step(perturbation="snow_depth")
    step = next(item for item in settings().steps if item.perturbation == "snow_depth")
    assert (step.snow_depth.frame_rate_hz, entries.other_rate(settings(), step)) == (12.0, "")
    stage.frame_step = 1
    assert entries.other_rate(settings(), step).startswith("Moves 2 times as fast as in the scene")
    assert bpy.ops.noisy_world.take_rate() == {"FINISHED"}
    assert step.snow_depth.frame_rate_hz == 24.0
    step.temporal, step.snow_depth.frame_rate_hz = "fixed", 10.0
    assert entries.other_rate(settings(), step) == ""  # nothing moves
    single = ROOT / "presets/perturbations/rain_depth.yaml"
    bpy.ops.noisy_world.use_preset(filepath=str(single), part="PERTURBATIONS")
    rain = next(item for item in settings().steps if item.perturbation == "rain_depth")
    assert rain.rain_depth.frame_rate_hz == 24.0
    shot = add(stage, perturbations="PRESET", preset=str(single))
    (item,) = preset_of_shot(stage, shot).document["settings"][-1]["perturb"]
    assert item["rain_depth"]["frame_rate_hz"] == 24.0
    given = {"snow_depth": {"severity": 1, "frame_rate_hz": 5}}
    assert with_rate(settings(), given) == given
    assert with_rate(settings(), {"fog": {"severity": 1}}) == {"fog": {"severity": 1}}
    settings().mesh_source = "ROOM"
    assert entries.own_rate_hz(settings()) is None
