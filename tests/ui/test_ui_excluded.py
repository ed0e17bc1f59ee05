# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a scene the dataset does not show is said before it is made, and pictures of it are not called the dataset's.

What is expected is written by hand from what each change does to a render.
"""

import math

import bpy
import pytest
from calls import calls_made
from panel_tools import settings, use_files
from worlds import write_box_ply

pytestmark = pytest.mark.usefixtures("add_on")


def names():
    from noisy_world.panel.exclusions import excluded

    bpy.context.view_layer.update()
    return excluded(bpy.context.scene)


def shows_dataset():
    from noisy_world.panel.exclusions import shows_dataset

    bpy.context.view_layer.update()
    return shows_dataset(bpy.context.scene)


@pytest.fixture
def loaded(tmp_path):
    """The panel's mesh and path, and nothing else."""
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    use_files(tmp_path)
    settings().scene.name = "square"
    assert bpy.ops.noisy_world.load_scene() == {"FINISHED"}
    assert bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
    return bpy.context.scene


def add(name, data=None, collection=None):
    item = bpy.data.objects.new(name, data)
    (collection or bpy.context.scene.collection).objects.link(item)
    return item


def mesh():
    data = bpy.data.meshes.new("Triangle")
    data.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    return data


def test_blenders_startup_scene_is_named(add_on):
    assert names() == ("Cube", "Light", "Camera")
    assert not shows_dataset()


def test_an_empty_scene_and_what_no_render_shows_are_not_named():
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    assert names() == ()
    add("Axes")
    add("Bones", bpy.data.armatures.new("Bones"))
    add("Second camera", bpy.data.cameras.new("Second camera"))
    add("Hidden", mesh()).hide_render = True
    for name, setting in (("Off", "hide_render"), ("Excluded", "exclude")):
        collection = bpy.data.collections.new(name)
        bpy.context.scene.collection.children.link(collection)
        add(f"In {name}", mesh(), collection)
        layer = bpy.context.view_layer.layer_collection.children[name]
        setattr(collection if setting == "hide_render" else layer, setting, True)
    assert names() == ()


def test_what_a_render_shows_is_named_by_kind():
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    lamp = add("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    add("Line", bpy.data.curves.new("Line", "CURVE"))
    chairs = bpy.data.collections.new("Chairs")
    add("Chair", mesh(), chairs)  # a library of things that is itself in no scene
    instance = add("Chairs here")
    instance.instance_type, instance.instance_collection = "COLLECTION", chairs
    assert names() == ("Line", "Chairs here", "Lamp")
    bpy.context.scene.collection.children.link(chairs)
    assert names() == ("Chair", "Line", "Chairs here", "Lamp")
    lamp.hide_render = True
    assert names() == ("Chair", "Line", "Chairs here")
    behind = bpy.data.scenes.new("Behind")
    behind.collection.objects.link(bpy.data.objects.new("Mountain", mesh()))
    bpy.context.scene.background_set = behind
    assert "Mountain" in names()


def test_the_loaded_dataset_is_not_named(loaded):
    assert names() == ()
    assert shows_dataset()
    settings().deviation_rotation = math.radians(2.0)
    settings().camera.fx = 321.5
    settings().steps.add().perturbation = "fog"
    settings().preview = True  # a chain of ours is no compositing of theirs
    loaded.frame_set(4)
    assert names() == ()
    assert shows_dataset()


def moved(scene):
    scene.objects["square"].location.x = 0.25


def modified(scene):
    scene.objects["square"].modifiers.new("Bend", "SIMPLE_DEFORM")


def edited(scene):
    scene.objects["square"].data.clear_geometry()
    scene.objects["square"].data.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])


def copied(scene):
    scene.collection.objects.link(scene.objects["square"].copy())


def another_mesh(_):
    settings().mesh_source = "ROOM"


def another_path(_):
    settings().trajectory_source = "HANDHELD"


def rekeyed(scene):
    scene.camera.location = (0, 0, 9)
    scene.camera.keyframe_insert("location", frame=3)


def followed(scene):
    scene.camera.constraints.new("TRACK_TO")


def zoomed(scene):
    scene.camera.data.lens = 85


def resized(scene):
    scene.render.resolution_x += 1


def other_camera(scene):
    scene.camera = add("Mine", bpy.data.cameras.new("Mine"))


def animated_camera(scene):
    other_camera(scene)
    scene.camera.keyframe_insert("location", frame=1)


def cut_to_camera(scene):
    scene.timeline_markers.new("Cut", frame=3).camera = add("Cut", bpy.data.cameras.new("Cut"))


def composited(scene):
    scene.compositing_node_group = bpy.data.node_groups.new("Glow", "CompositorNodeTree")


def composited_in_preview(scene):
    composited(scene)
    settings().preview = True


def pictured_world(scene):
    tree = bpy.data.worlds.new("Sky").node_tree
    tree.nodes.new("ShaderNodeTexSky")
    scene.world = bpy.data.worlds["Sky"]


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (moved, "changes of square"),
        (modified, "changes of square"),
        (edited, "changes of square"),
        (copied, "square.001"),
        (another_mesh, "square"),
        (another_path, "the path of Noisy World Camera"),
        (rekeyed, "changes of Noisy World Camera"),
        (followed, "changes of Noisy World Camera"),
        (zoomed, "changes of Noisy World Camera"),
        (resized, "changes of Noisy World Camera"),
        (other_camera, "Mine"),
        (animated_camera, "the motion of Mine"),
        (cut_to_camera, "Cut"),
        (composited, "the compositing"),
        (composited_in_preview, "the compositing"),
        (pictured_world, "the world"),
    ],
)
def test_what_was_changed_since_is_named(loaded, change, named):
    change(loaded)
    assert names() == (named,)
    assert not shows_dataset()


def test_a_seed_decides_a_hand_held_path_and_no_other(loaded, tmp_path):
    settings().seed = 5
    assert names() == ()
    write_box_ply(tmp_path / "box.ply")
    settings().of_mesh.mesh, settings().trajectory_source = str(tmp_path / "box.ply"), "HANDHELD"
    settings().scene.trajectory.handheld.frames = 3
    assert bpy.ops.noisy_world.load_scene() == {"FINISHED"}
    assert bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
    assert names() == ()
    settings().seed = 6
    assert names() == ("the path of Noisy World Camera",)


def test_a_scene_hidden_from_renders_is_not_the_datasets(loaded):
    loaded.objects["square"].hide_render = True
    assert names() == ()
    assert not shows_dataset()


def test_a_change_of_the_panel_does_not_hide_a_change_by_hand(loaded):
    loaded.camera.location = (0, 0, 9)
    loaded.camera.keyframe_insert("location", frame=3)
    settings().camera.fx = 77.0  # which sets the lens up again, not the keys
    assert names() == ("changes of Noisy World Camera",)
    settings().seed, settings().deviation_rotation = 3, math.radians(1.0)  # which keys the path again
    assert names() == ()


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (("Cube",), "Cube"),
        (("Cube", "Light"), "Cube and Light"),
        (("Cube", "Light", "Camera"), "Cube, Light and Camera"),
        (("Cube", "Light", *"abcdefghijkl"), "Cube, Light and 12 more"),
        (("x" * 60,), "x" * 23 + "…"),
    ],
)
def test_names_in_words(given, text):
    from noisy_world.panel.exclusions import enumerated

    assert enumerated(given) == text


def test_the_sentence_says_what_the_dataset_shows(loaded):
    from noisy_world.panel.exclusions import sentence

    assert sentence(loaded) == ""
    add("Chair", mesh())
    assert sentence(loaded) == "Not in the dataset: Chair. The dataset shows square.ply"
    settings().mesh_source = "ROOM"
    wanted = "Not in the dataset: Chair and square. The dataset shows the embedded room; choose another under Scene"
    assert sentence(loaded) in (wanted, wanted.replace("Chair and square", "square and Chair"))


def test_a_large_scene_costs_a_few_calls_an_object_and_a_large_mesh_none(loaded):
    from noisy_world.panel.exclusions import excluded

    data, counts = mesh(), {}
    for number in range(800):
        add(f"Leaf {number}", data)
        counts[number + 1] = calls_made(excluded, loaded) if number in (399, 799) else 0
    assert len(excluded(loaded)) == 800
    assert counts[800] - counts[400] <= 8 * 400
    loaded.objects["square"].data.vertices.add(1_000_000)
    assert calls_made(excluded, loaded) < counts[800] + 100
