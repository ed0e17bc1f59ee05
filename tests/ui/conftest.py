# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on, or the part of it that its previews need, registered in a new file."""

import math

import pytest


@pytest.fixture
def registered():
    """The panel's properties, without its buttons."""
    bpy = pytest.importorskip("bpy", reason="bpy is not installed")
    from noisy_world.panel import drawn_paths, preview, properties

    bpy.ops.wm.read_factory_settings(use_empty=True)
    for module in (properties, drawn_paths, preview):
        module.register()
    yield
    for module in (preview, drawn_paths, properties):
        module.unregister()


@pytest.fixture
def scene(registered):
    """An empty scene of ten small frames."""
    import bpy
    from preview_tools import IDENTIFIERS, SIZE

    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.compositor_precision = "FULL"
    scene.render.compositor_device = "CPU"
    scene.frame_start, scene.frame_end = 0, 9
    settings = scene.noisy_world
    settings.camera.width = SIZE[0]
    settings.seed, settings.scene.name, settings.setting.name = IDENTIFIERS
    return scene


@pytest.fixture
def add_on():
    """The whole add-on in a new file."""
    bpy = pytest.importorskip("bpy", reason="bpy is not installed")
    import noisy_world

    bpy.ops.wm.read_factory_settings(use_empty=False)
    noisy_world.register()
    yield
    noisy_world.unregister()


@pytest.fixture
def room(scene):
    """A box, seen by a camera that turns."""
    from analytic import box_mesh
    from preview_tools import cycles_scene

    from noisy_world.render.mesh_session import add_mesh

    cycles_scene((0, 0, 0))
    add_mesh(scene, box_mesh((-2, -3, 0), (2, 3, 2.5)), "Room", decoding="shader")
    scene.camera.location = (0, 0, 1.5)
    scene.camera.rotation_euler = (1.5, 0, 0.3)
    scene.camera.keyframe_insert("rotation_euler", frame=0)
    scene.camera.rotation_euler = (1.5, 0, 1.3)
    scene.camera.keyframe_insert("rotation_euler", frame=9)
    return scene


@pytest.fixture
def editor():
    """An image editor in Blender's default window."""
    import bpy

    bpy.ops.wm.read_factory_settings()
    area = max(bpy.context.window.screen.areas, key=lambda area: area.width * area.height)
    area.type = "IMAGE_EDITOR"
    return area


@pytest.fixture
def hall(add_on, tmp_path):
    """A lit room of a floor and a cube that moves, seen by a camera on a parent that turns."""
    import bpy
    from panel_tools import settings

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=8)
    bpy.ops.mesh.primitive_cube_add(location=(0, 0, 1))
    cube = bpy.context.object
    cube.keyframe_insert("location", frame=1)
    cube.location.x = 1.0
    cube.keyframe_insert("location", frame=5)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    rig = bpy.data.objects.new("Rig", None)
    camera = bpy.data.objects.new("Mine", bpy.data.cameras.new("Mine"))
    for item in (sun, rig, camera):
        scene.collection.objects.link(item)
    camera.parent, camera.location, camera.rotation_euler = rig, (0, -5, 2), (math.radians(80), 0, 0)
    rig.keyframe_insert("rotation_euler", frame=1)
    rig.rotation_euler.z = 0.4
    rig.keyframe_insert("rotation_euler", frame=5)
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 2
    scene.render.resolution_x, scene.render.resolution_y = 40, 30
    scene.frame_start, scene.frame_end, scene.frame_step = 1, 5, 2
    item = settings()
    item.mesh_source, item.scene.name, item.output_folder = "SCENE", "hall", str(tmp_path / "out")
    item.output.image, item.output.depth_scale_per_m = "png", 1000.0
    return scene
