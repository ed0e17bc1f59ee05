# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera of a .blend that is named, wherever it lies: its path against closed forms, and its blur against its own."""

import math

import bpy
import numpy as np
import pytest

from own_scenes import LAST, key, new_scene, opened, save

from noisy_world.render.own_view import sampled_camera
from noisy_world.render.scene_inspection import inspect_scene, open_file
from noisy_world.core.geometry import rotation_from_euler_deg

FRAMES = range(1, LAST + 1)
ALONG = (np.array(FRAMES) - 1) / (LAST - 1)


def nested(scene, name):
    """An object's collection, two collections deep."""
    outer, inner = (bpy.data.collections.new(f"{name} {part}") for part in ("outer", "inner"))
    scene.collection.children.link(outer)
    outer.children.link(inner)
    return inner


def camera_in(collection, name):
    camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
    collection.objects.link(camera)
    return camera


def stage():
    """An own camera and four others that move by keys, by a parent, by a constraint and by a driver."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, LAST
    own, cameras, targets = (nested(scene, name) for name in ("own", "cameras", "targets"))
    scene.camera = camera_in(own, "Own")
    key(scene.camera, "location", {1: (0, 0, 0), LAST: (9, 0, 0)})
    key(camera_in(cameras, "Keyed"), "location", {1: (0, 0, 0), LAST: (0, -3, 1)})
    parented, rig = camera_in(cameras, "Parented"), bpy.data.objects.new("Rig", None)
    targets.objects.link(rig)
    parented.parent, parented.location = rig, (1, 2, 3)
    key(rig, "rotation_euler", {1: (0, 0, 0), LAST: (0, 0, 1)})
    target = bpy.data.objects.new("Target", None)
    targets.objects.link(target)
    key(target, "location", {1: (0, 0, 0), LAST: (4, 5, 6)})
    constraint = camera_in(cameras, "Constrained").constraints.new("COPY_LOCATION")
    constraint.target = target
    camera_in(cameras, "Driven").driver_add("location", 2).driver.expression = "frame * 0.5"
    return scene


EXPECTED = {
    "Keyed": ALONG[:, None] * [0, -3, 1],
    "Parented": np.array([rotation_from_euler_deg(0, 0, math.degrees(a)) @ [1.0, 2, 3] for a in ALONG]),
    "Constrained": ALONG[:, None] * [4, 5, 6],
    "Driven": np.array([[0, 0, frame * 0.5] for frame in FRAMES]),
}


def hide(how, camera):
    """Leave a camera out of what the view layer evaluates, in one of the ways that an artist has."""
    layer = bpy.context.view_layer.layer_collection
    outer = next(child for child in layer.children if child.name == "cameras outer")
    if how == "excluded":
        outer.exclude = True
    elif how == "hidden collection":
        outer.children[0].collection.hide_viewport = True
    elif how == "hidden object":
        camera.hide_viewport = True


@pytest.mark.parametrize("how", ["shown", "excluded", "hidden collection", "hidden object"])
@pytest.mark.parametrize("marked", [False, True])
def test_a_named_camera_moves_wherever_it_lies(how, marked, tmp_path):
    scene = stage()
    if marked:  # markers that switch the scene's camera on the way, to another one
        scene.timeline_markers.new("a", frame=1).camera = scene.camera
        scene.timeline_markers.new("b", frame=3).camera = scene.objects["Keyed"]
    for name in EXPECTED:
        hide(how, scene.objects[name])
    scene.frame_set(2)
    path = save(tmp_path)
    for name, expected_m in EXPECTED.items():
        open_file(str(path))
        sampled = inspect_scene(bpy.context.scene, name, None, alone=True).camera
        assert np.abs(sampled.matrices[:, :3, 3] - expected_m).max() < 1e-6, name
        assert {item.camera for item in sampled.parameters} == {name}


def test_looking_at_a_named_camera_leaves_the_scene_as_it_was():
    scene = stage()
    own = scene.camera
    scene.timeline_markers.new("b", frame=3).camera = scene.objects["Keyed"]
    scene.frame_set(2, subframe=0.25)
    before = scene.camera
    hide("excluded", None)
    sampled_camera(scene, scene.objects["Driven"], FRAMES)
    assert (scene.frame_current, scene.frame_subframe, scene.camera) == (2, 0.25, before)
    assert bpy.context.view_layer.layer_collection.children["cameras outer"].exclude
    assert own.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world[0][3] == pytest.approx(9 * 1.25 / 5)


def test_a_named_camera_of_a_library_moves_by_what_moves_it_there(tmp_path):
    stage()
    library = save(tmp_path, "library")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, LAST
    with bpy.data.libraries.load(str(library), link=True) as (_, linked):
        linked.collections = ["cameras outer"]
    shelf = nested(scene, "shelf")
    shelf.children.link(linked.collections[0])
    scene.camera = camera_in(shelf, "Own")
    path = save(tmp_path, "uses")
    for name, expected_m in EXPECTED.items():
        open_file(str(path))
        assert bpy.context.scene.objects[name].library is not None
        sampled = inspect_scene(bpy.context.scene, name, None, alone=True).camera
        assert np.abs(sampled.matrices[:, :3, 3] - expected_m).max() < 1e-6, name


def test_motion_blur_is_that_of_a_camera_that_the_view_layer_leaves_out(tmp_path):
    images = []
    for excluded in (False, True):
        scene = new_scene()
        scene.render.use_motion_blur, scene.cycles.use_denoising = True, False
        collection = nested(scene, "cameras")
        second = scene.camera.copy()
        second.name = "Second"
        collection.objects.link(second)
        scene.camera.parent = None
        if excluded:
            hide("excluded", second)
        path = save(tmp_path, f"blurred_{excluded}")
        with opened(path, depth=False, camera="Second") as (session, paths, _):
            images.append(session.frame(paths.request(2)).rgb)
    assert images[0].std() > 0.05
    assert np.abs(images[0] - images[1]).max() < 1e-3
