# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings and videos in the tab: named, told, previewed and written as the generator has them."""

import json
from pathlib import Path

import bpy
import cv2
import numpy as np
import pytest
from refusals import refused
from panel_tools import Drawn, settings
from recorded_layouts import WRITERS, rgbd_folders

from noisy_world.layouts import EVERY
from noisy_world.panel import source_views
from noisy_world.panel import document, frame_preview, exclusions, loading
from noisy_world.panel.generating import run_of
from noisy_world.panel.source_views import PANEL_SOURCES, shown

pytestmark = pytest.mark.usefixtures("add_on")


@pytest.fixture
def recording(tmp_path):
    """The panel naming a recording of ScanNet's layout, whose depth has a camera and a size of its own."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    folder = tmp_path / "scene0000_00"
    folder.mkdir()
    WRITERS["scannet"](folder)
    item = settings()
    item.mesh_source, item.of_sequence.sequence.folder, item.scene.name = "RECORDING", str(folder), "scan"
    item.output_folder, item.output.layout, item.render.backend = str(tmp_path / "out"), "tum", "reference"
    return item


def film(path, count=3):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (32, 24))
    for n in range(count):
        writer.write(np.full((24, 32, 3), 40 * n + 60, np.uint8))
    writer.release()
    return path


def test_a_recording_is_previewed_as_it_is_written(recording):
    scene = bpy.context.scene
    for name in ("fog_depth", "depth_gaussian_noise"):
        bpy.ops.noisy_world.add_step(perturbation=name)
    recording.output.image = "png"
    assert exclusions.excluded(scene) == ()
    assert bpy.ops.noisy_world.preview_frame.poll()
    assert not bpy.ops.noisy_world.load_scene.poll()
    assert not bpy.ops.noisy_world.load_trajectory.poll()
    assert document.intrinsics_of(recording).fx_px == 58.5
    assert document.to_document(recording)["render"] == {"backend": "reference"}
    scene.frame_set(1)
    picture, about = frame_preview.draw_colour(scene)
    assert about.startswith("Frame 1: fog_depth")
    depth, _ = frame_preview.draw_depth(scene)
    assert depth.shape == (24, 32, 3)
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    assert any("no valid pose" in note for note in run_of(scene).background.notes)
    written = cv2.imread(str(Path(recording.output_folder) / "perturbed/scan/rgb/000001.png"))[..., ::-1]
    assert np.abs(written.astype(int) - picture).max() <= 1
    clean = cv2.imread(str(Path(recording.output_folder) / "clean/scan/rgb/000001.png"))[..., ::-1]
    assert np.abs(written.astype(int) - clean).max() > 10


def test_a_pair_of_other_sizes_is_shown_side_by_side(recording):
    bpy.ops.noisy_world.add_step(perturbation="desync")
    picture, about = frame_preview.draw_depth(bpy.context.scene, 1)
    assert about.startswith("Color of frame 1, depth of frame ")
    assert picture.shape == (48, 128, 3)


def test_plain_images_are_previewed_as_they_are_written(tmp_path):
    folder = tmp_path / "plates"
    folder.mkdir()
    for n in range(3):
        cv2.imwrite(str(folder / f"shot.{n + 8}.png"), np.full((24, 32, 3), 40 * n + 60, np.uint8))
    item = settings()
    item.mesh_source, item.of_sequence.sequence.folder, item.scene.name = "RECORDING", str(folder), "plates"
    item.of_sequence.poses, item.of_sequence.layout, item.output.image = "keep", "images", "png"
    item.output_folder, item.render.backend = str(tmp_path / "out"), "reference"
    assert "depth" not in item.output.modalities
    assert document.to_document(item)["scenes"] == [
        {"name": "plates", "sequence": folder.as_posix(), "layout": "images"}
    ]
    bpy.ops.noisy_world.add_step(perturbation="gaussian_noise")
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    bpy.context.scene.frame_set(2)
    picture, _ = frame_preview.draw_colour(bpy.context.scene)
    (written,) = (tmp_path / "out/perturbed/plates").rglob("*000002.png")
    assert np.array_equal(cv2.imread(str(written))[..., ::-1], picture)
    refused(frame_preview.draw_depth, bpy.context.scene, names="depth")
    bpy.ops.noisy_world.add_step(perturbation="haze")
    refused(frame_preview.draw_colour, bpy.context.scene, names="Scene > Recording: ")
    item.steps.remove(next(place for place, step in enumerate(item.steps) if step.perturbation == "haze"))
    document.save_preset(item, tmp_path / "plates.yaml")
    item.of_sequence.layout = "auto"
    refused(bpy.ops.noisy_world.generate, names=["Scene > Layout: ", "Plain Images"], error=RuntimeError)
    document.open_preset(item, tmp_path / "plates.yaml")
    assert item.of_sequence.layout == "images"


def test_its_keys_come_back_from_a_preset(recording, tmp_path):
    recording.of_sequence.poses, recording.of_sequence.register, recording.of_sequence.rate_hz = "keep", True, 15.0
    recording.of_sequence.void, recording.of_sequence.depth_scale_per_m = "sky", 1000.5
    path = tmp_path / "scan.yaml"
    document.save_preset(recording, path)
    said = document.to_document(recording, tmp_path)
    assert said["scenes"] == [
        {
            "name": "scan",
            "sequence": "scene0000_00",
            "poses": "keep",
            "register": True,
            "void": "sky",
            "depth_scale_per_m": 1000.5,
            "rate_hz": 15.0,
        }
    ]
    assert "camera" not in said
    item = settings()
    item.mesh_source, item.of_sequence.sequence.folder, item.of_sequence.poses = "ROOM", "", "drop"
    item.of_sequence.register, item.of_sequence.void, item.of_sequence.depth_scale_per_m = False, "unmeasured", 1.0
    document.open_preset(item, path)
    assert document.to_document(item, tmp_path) == said
    film(tmp_path / "walk.avi")
    (tmp_path / "depth").mkdir()
    preset = {
        "seed": 1,
        "scenes": [{"video": "walk.avi", "depth": "depth", "depth_scale_per_m": 5000.0, "void": "sky"}],
        "camera": {"width": 32, "height": 24, "fx": 30.0, "fy": 30.0, "cx": 15.5, "cy": 11.5},
        "settings": [{"name": "clean"}],
    }
    (tmp_path / "video.json").write_text(json.dumps(preset))
    document.open_preset(item, tmp_path / "video.json")
    said = document.to_document(item, tmp_path)
    assert said["scenes"] == preset["scenes"]
    assert document.scene_name(item) == "walk"
    assert said["camera"].items() >= preset["camera"].items()
    item.of_video.depth = ""  # what was said of it goes with it: a preset that kept it would be refused
    assert document.to_document(item, tmp_path)["scenes"] == [{"video": "walk.avi"}]
    assert document.can_apply(path, "SCENE")
    assert not document.can_apply(path, "PATH")


def test_a_described_recording_comes_back_and_is_previewed(tmp_path):
    folder = tmp_path / "lab"
    folder.mkdir()
    rgbd_folders(folder)
    told = {
        "folder": "lab",
        "rgb": {"files": "rgb/*.png"},
        "depth": {"files": "depth/*.png", "scale_per_m": 500.0, "void": [65535]},
        "intrinsics": {"fx": 30.0, "fy": 29.0, "cx": 15.5, "cy": 12.25},
    }
    preset = {"seed": 1, "scenes": [{"name": "lab", "sequence": told}], "settings": [{"name": "clean"}]}
    preset |= {"render": {"backend": "reference"}, "output": {"layout": "tum"}}
    (tmp_path / "lab.yaml").write_text(json.dumps(preset))
    item = settings()
    document.open_preset(item, tmp_path / "lab.yaml")
    assert document.to_document(item, tmp_path)["scenes"] == preset["scenes"]
    shown(item).draw(Drawn(), item)
    stored = source_views.footage_of(document.preset_of(item)).source.stored
    assert stored.depth_scale_per_m == 500.0
    item.of_sequence.sequence.folder = str(folder)  # as by hand
    assert document.to_document(item, tmp_path)["scenes"][0]["sequence"] == told


def test_what_is_wrong_with_a_recording_is_said(recording, tmp_path):
    assert source_views.layout_names(recording.of_sequence.sequence.folder) == "ScanNet"
    assert source_views.layout_names(str(tmp_path)) == ""
    assert source_views.layout_names(str(tmp_path / "none")) == ""
    assert [label for label, _ in source_views.known_layouts()] == [layout.label for layout in EVERY.values()]
    recording.of_sequence.undistort = True
    refused(document.save_preset, recording, tmp_path / "a.yaml", names="lens")
    recording.of_sequence.undistort, recording.of_sequence.sequence.folder = False, str(tmp_path / "none")
    refused(bpy.ops.noisy_world.preview_frame, names="Scene > Folder: ", error=RuntimeError)


def test_a_video_is_previewed(recording, tmp_path):
    film(tmp_path / "walk.avi")
    scene = bpy.context.scene
    recording.mesh_source, recording.of_video.video = "VIDEO", str(tmp_path / "walk.avi")
    scene.frame_set(2)
    picture, about = frame_preview.draw_colour(scene)
    assert about == "Frame 2: clean"
    assert np.abs(picture.astype(int) - 140).max() <= 3
    refused(document.save_preset, recording, tmp_path / "a.yaml", names=["scan ", "depth"])
    names = ["depth: Depth", "Render and Output > Write: Color"]
    refused(bpy.ops.noisy_world.generate, names=names, error=RuntimeError)
    for name, draw in (("depth_gaussian_noise", frame_preview.draw_depth), ("fog_depth", frame_preview.draw_colour)):
        bpy.ops.noisy_world.add_step(perturbation=name)
        refused(draw, scene, names=["Scene > Video: ", "choose the folder"])
        recording.steps.clear()
    recording.output.modalities = {"rgb"}
    document.save_preset(recording, tmp_path / "a.yaml")
    assert loading.summary(scene) == ()


def test_each_source_draws_fields_that_there_are(recording):
    drawn = {}
    for name, source in PANEL_SOURCES.items():
        recording.mesh_source = name
        assert shown(recording) is source
        source.draw(layout := Drawn(), recording)
        source.draw_path(layout, recording)
        drawn[name] = layout.names
    assert drawn["ROOM"] == ["room_seed"]
    assert drawn["FILE"] == ["mesh"]
    assert drawn["SCENE"] == ["compositing", "depth_alpha", "soften_sun", "reflections"]
    assert drawn["RECORDING"][0] == "folder"
    assert [name for name in drawn["RECORDING"] if not name.startswith("use_")][-6:] == [
        "undistort", "register", "depth_scale_per_m", "void", "poses", "rate_hz",
    ]  # fmt: skip
    assert drawn["VIDEO"] == ["video", "depth"]
    assert {"replica", "trajectory"} & {*drawn["replica"]} == {"replica"}
    assert {"blend", "scene", "camera", "frames", "compositor", "depth_alpha"} <= {*drawn["blend"]}
