# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake Exposure: what a camera decides frame by frame, keyed as the generator's own records have it."""

import json
import math

import bpy
import cv2
import numpy as np
import pytest
from refusals import refused
from panel_tools import settings

from noisy_world.nodes.chain_scene import shown_chain
from noisy_world.nodes.node_trees import ensure_group
from noisy_world.render.own_stills import read_metered
from noisy_world.perturbations.groups import build_group
from noisy_world.perturbations import registry
from noisy_world.panel import bake_exposure, frame_preview, preview, runs
from noisy_world.panel.generating import run_of

pytestmark = pytest.mark.usefixtures("add_on")

FRAMES = range(1, 7)
WITHIN = 2e-6  # of stops and turns: keys are float32


@pytest.fixture
def lamps(tmp_path):
    """A floor under a sun that goes up eightfold and turns red, with automatics that follow late, at 24 frames/s."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=8)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    camera = bpy.data.objects.new("Mine", bpy.data.cameras.new("Mine"))
    for item in (sun, camera):
        scene.collection.objects.link(item)
    camera.location, camera.rotation_euler = (0, -2, 2), (math.radians(40), 0, 0)
    for frame, energy, colour in ((1, 0.5, (1, 1, 1)), (3, 4.0, (1, 0.6, 0.4))):
        sun.data.energy, sun.data.color = energy, colour
        sun.data.keyframe_insert("energy", frame=frame)
        sun.data.keyframe_insert("color", frame=frame)
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 2
    scene.cycles.use_denoising = False
    scene.render.resolution_x, scene.render.resolution_y = 192, 108
    scene.frame_start, scene.frame_end = FRAMES.start, FRAMES.stop - 1
    item = settings()
    item.mesh_source, item.scene.name, item.output_folder = "SCENE", "lamps", str(tmp_path / "out")
    item.output.image = "png"
    for name, values in (
        ("auto_exposure", {"lag_s": 0.1, "light_stops": -1.0}),
        ("white_balance", {"lag_s": 0.05}),
        ("flicker", {"mains_hz": 60.0, "readout_ms": 5.0}),
    ):
        bpy.ops.noisy_world.add_step(perturbation=name)
        step = next(step for step in item.steps if step.perturbation == name)
        step.use_severity = False
        for key, value in values.items():
            setattr(getattr(step, name), key, value)
    return scene


def recorded(scene, tmp_path):
    """What the generator's record says of each frame, in the sockets' units."""
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    assert run_of(scene) is not None
    lines = (tmp_path / "out/perturbed/lamps/frames.jsonl").read_text().splitlines()
    found = [json.loads(line)["perturbed"]["camera"] for line in lines]
    assert len(found) == len(FRAMES)
    stops = [math.log2(each["exposure_ms"] / 10.0) + each["gain_db"] / (20 * math.log10(2)) - 1.0 for each in found]
    gains = {name: [math.log2(each[f"{name.lower()}_gain"]) for each in found] for name in ("Red", "Green", "Blue")}
    return {"Exposure": stops, **{f"{name} Gain": values for name, values in gains.items()}}, [
        each["flicker"] for each in found
    ]


def keyed(scene, node, name):
    """The values of a socket over the scene's frames, as Blender plays them."""
    found = []
    for frame in FRAMES:
        scene.frame_set(frame)
        tree = node.id_data.evaluated_get(bpy.context.evaluated_depsgraph_get())
        found.append(tree.nodes[node.name].inputs[name].default_value)
    return np.array(found)


def middle_line(scene, node):
    """The light of an image's middle line, by the definition of the sockets."""
    swing, phase = (keyed(scene, node, name) for name in ("Swing", "Phase"))
    return 1 + swing * np.cos(2 * math.pi * phase)


def added(tree, name):
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree = ensure_group(build_group(registry()[name]))
    node.name = name
    return node


def own_groups(scene):
    """The groups in a compositor of the artist's own, one of them inside a group of his."""
    tree, inner = (bpy.data.node_groups.new(name, "CompositorNodeTree") for name in ("Compositing", "Own"))
    scene.compositing_node_group = tree
    tree.nodes.new("CompositorNodeGroup").node_tree = inner
    return {
        "auto_exposure": added(tree, "auto_exposure"),
        "white_balance": added(inner, "white_balance"),
        "flicker": added(tree, "flicker"),
    }


def test_the_preview_and_the_scene_s_own_groups_are_keyed_as_the_generator_decides(lamps, tmp_path):
    groups = own_groups(lamps)
    settings().preview = True
    preview.flush()
    chain = shown_chain(lamps)
    before = keyed(lamps, chain.nodes["Auto-exposure"], "Exposure")
    assert np.ptp(before) == 0, "without metered frames it follows mid-grey"
    assert frame_preview.follows_grey(lamps)
    assert bpy.ops.noisy_world.bake_exposure(size="FULL") == {"FINISHED"}
    assert bpy.ops.noisy_world.bake_groups(size="FULL") == {"FINISHED"}
    wanted, flicker = recorded(lamps, tmp_path)
    chain = shown_chain(lamps)
    assert np.ptp(wanted["Exposure"]) > 0.5
    for shown in (
        {name: chain.nodes[name] for name in ("Auto-exposure", "White Balance", "Flicker")},
        dict(zip(("Auto-exposure", "White Balance", "Flicker"), groups.values(), strict=True)),
    ):
        np.testing.assert_allclose(keyed(lamps, shown["Auto-exposure"], "Exposure"), wanted["Exposure"], atol=WITHIN)
        for name in ("Red Gain", "Green Gain", "Blue Gain"):
            np.testing.assert_allclose(keyed(lamps, shown["White Balance"], name), wanted[name], atol=WITHIN)
        np.testing.assert_allclose(middle_line(lamps, shown["Flicker"]), flicker, atol=1e-5)
    assert not preview.is_chain_edited(lamps)
    written = cv2.imread(str(tmp_path / "out/perturbed/lamps/results/frame000003.png"))[..., ::-1]
    picture, _ = frame_preview.draw_colour(lamps, 3)
    assert np.abs(written.astype(int) - picture).max() <= 1
    small = bpy.ops.noisy_world.bake_groups(size="SMALL")
    assert small == {"FINISHED"}
    assert np.abs(keyed(lamps, groups["auto_exposure"], "Exposure") - wanted["Exposure"]).max() < 0.03


def test_what_is_metered_is_kept_so_that_a_slider_needs_no_rendering(lamps, tmp_path):
    settings().preview = True
    assert bpy.ops.noisy_world.bake_exposure() == {"FINISHED"}
    exposure = shown_chain(lamps).nodes["Auto-exposure"]
    late = keyed(lamps, exposure, "Exposure")
    step = next(step for step in settings().steps if step.perturbation == "auto_exposure")
    step.auto_exposure.lag_s = 0.0
    preview.flush()
    at_once = keyed(lamps, exposure, "Exposure")
    # With no lag a frame has what the frame before it asks for: 0.18 of white, at a light that the picture shows.
    lights = frame_preview.lights_of(lamps, frame_preview.sequence_of(lamps)[0])
    mean = [float(light.astype(float).mean(axis=(0, 1)) @ (0.2126, 0.7152, 0.0722)) for light in lights]
    np.testing.assert_allclose(at_once[1:], np.log2(0.18 / np.array(mean[:-1])), atol=2e-3)
    assert abs(late[3] - at_once[3]) > 0.5
    assert not frame_preview.follows_grey(bpy.context.scene)
    lamps.frame_end += 1
    preview.touch(lamps, ("preview",))
    preview.flush()
    assert frame_preview.follows_grey(lamps), "a frame was added that nobody has metered, and the tab says so"
    lamps.frame_end -= 1
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    scene = bpy.context.scene
    preview.touch(scene, ("preview",))
    preview.flush()
    np.testing.assert_array_equal(keyed(scene, shown_chain(scene).nodes["Auto-exposure"], "Exposure"), at_once)


def test_an_artist_s_own_keys_stay_and_are_named_and_ours_are_keyed_anew(lamps):
    node = own_groups(lamps)["auto_exposure"]
    (told,) = (group for group in bake_exposure.groups_of(lamps) if group.perturbation.name == "auto_exposure")
    for slope in (1.0, 0.5):
        values = [slope * frame for frame in FRAMES]
        assert bake_exposure.bake(told, FRAMES, {"exposure": values}) == []
        np.testing.assert_array_equal(keyed(lamps, node, "Exposure"), values)
    assert bake_exposure.bake(told, FRAMES, {"exposure": [3.0] * len(FRAMES)}) == []
    assert node.id_data.animation_data is None, "what does not change is no curve"
    for frame, value in ((1, 0.5), (6, 2.0)):
        node.inputs["Exposure"].default_value = value
        node.inputs["Exposure"].keyframe_insert("default_value", frame=frame)
    own = keyed(lamps, node, "Exposure")
    assert bake_exposure.bake(told, FRAMES, {"exposure": values}) == ["auto_exposure > Exposure"]
    np.testing.assert_array_equal(keyed(lamps, node, "Exposure"), own)
    node.id_data.animation_data_clear()
    assert bake_exposure.bake(told, FRAMES, {"exposure": values}) == []
    node.id_data.animation_data.action.layers[0].strips[0].channelbags[0].fcurves[0].keyframe_points[2].co.y = 9.0
    assert bake_exposure.bake(told, FRAMES, {"exposure": values}) == ["auto_exposure > Exposure"], "he has moved a key"


def test_keys_of_the_artist_in_the_preview_s_chain_stay_too(lamps):
    settings().preview = True
    preview.flush()
    socket = shown_chain(lamps).nodes["Auto-exposure"].inputs["Exposure"]
    for frame, value in ((1, 0.5), (6, 2.0)):
        socket.default_value = value
        socket.keyframe_insert("default_value", frame=frame)
    own = keyed(lamps, shown_chain(lamps).nodes["Auto-exposure"], "Exposure")
    assert bpy.ops.noisy_world.bake_exposure() == {"FINISHED"}
    chain = shown_chain(lamps)
    np.testing.assert_array_equal(keyed(lamps, chain.nodes["Auto-exposure"], "Exposure"), own)
    assert np.ptp(keyed(lamps, chain.nodes["White Balance"], "Red Gain")) > 0.05
    kept = bake_exposure.kept_by_user(chain, frame_preview.sequence_of(lamps)[0].setting.rgb)
    assert kept == ["Auto-exposure > Exposure"]


def test_it_is_undone(lamps):
    node = own_groups(lamps)["auto_exposure"]
    tree, name = node.id_data.name, node.name
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.noisy_world.bake_groups() == {"FINISHED"}
    assert bpy.data.node_groups[tree].animation_data.action is not None
    bpy.ops.ed.undo_push(message="Bake Exposure of Groups")
    bpy.ops.ed.undo()
    assert bpy.data.node_groups[tree].animation_data is None
    assert bpy.data.node_groups[tree].nodes[name].inputs["Exposure"].default_value == 1.0


def test_what_a_small_render_shows_a_meter_is_what_the_whole_frame_does(lamps):
    """Rendered by another process, within a hundredth."""
    request = bake_exposure.request_of(lamps, {0, 4})
    run = runs.start_still(lamps, bake_exposure.replace(request, meter_px=64))
    run.background.wait()
    assert run.background.phase == "finished", run.background.error
    seen = read_metered(run.folder)
    run.tidy()
    assert sorted(seen) == [0, 4]
    whole = frame_preview.still_of(lamps, 4).light.rgb
    assert seen[4].shape == (18, 32, 3)
    np.testing.assert_allclose(seen[4].mean(axis=(0, 1)), whole.mean(axis=(0, 1)), rtol=0.01)


def test_without_anything_to_key_the_buttons_say_why(lamps):
    settings().steps.clear()
    refused(bpy.ops.noisy_world.bake_exposure, names="list", error=RuntimeError)
    refused(bpy.ops.noisy_world.bake_groups, names="auto-exposure", error=RuntimeError)
    own_groups(lamps)
    lamps.camera = None
    refused(bpy.ops.noisy_world.bake_groups, names="camera", error=RuntimeError)


def test_flicker_alone_is_keyed_without_rendering(lamps, monkeypatch):
    for index, step in reversed(list(enumerate(settings().steps))):
        if step.perturbation != "flicker":
            settings().steps.remove(index)
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    lamps.compositing_node_group = tree
    node = added(tree, "flicker")
    monkeypatch.setattr(runs, "start_still", None)
    assert bpy.ops.noisy_world.bake_groups() == {"FINISHED"}
    # Lamps at 120 flashes a second, seen 24 times a second: 5 whole turns, so each frame has the same light.
    assert np.ptp(middle_line(lamps, node)) < 1e-5
    settings().steps[0].flicker.mains_hz = 50.0
    assert bpy.ops.noisy_world.bake_groups() == {"FINISHED"}
    turns = 2 * 50.0 * np.arange(len(FRAMES)) / 24
    light = middle_line(lamps, node) - 1
    swing = keyed(lamps, node, "Swing")[0]
    fitted = np.linalg.lstsq(np.stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)], 1), light, rcond=None)
    assert np.hypot(*fitted[0]) == pytest.approx(swing, rel=1e-4)
    assert np.abs(fitted[1]).max(initial=0) < 1e-9
