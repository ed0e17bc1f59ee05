# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups from the shelf look at the camera of the scene that is composited: as by hand with Blender's own numbers."""

import math

import bpy
import numpy as np
import pytest
from group_tools import by_groups, described, picture

from noisy_world.perturbations.groups import OVERRIDE_CAMERA, looks_at_scene
from noisy_world.perturbations.kinds import ColourPerturbation
from noisy_world.perturbations import registry

COLOUR = {item.name: item for item in registry().values() if isinstance(item, ColourPerturbation) and item.nodes}
NAMES = [name for name, item in COLOUR.items() if looks_at_scene(item)]
SIZE_PX = {"wide": (48, 32), "tall": (32, 48)}
FRAME = 7
GIVEN = {
    "fog_depth": {"Override Severity": True, "Falloff": 3.0, "Unevenness": 0.5},  # what of fog is in the world
    "vignetting": {"Override Severity": True, "Cosine Power": 4.0},
    "lens_frost": {"Override Severity": True, "Coverage": 0.5, "Growth": 0.2},
    "lens_drops": {"Override Severity": True, "Coverage": 0.5},
}


def own_camera(scene, **data):
    """A camera that moves on a parent which is turned and scaled, in a scene of 29.97 frames a second."""
    scene.render.fps, scene.render.fps_base = 30, 1.001
    camera = bpy.data.objects.new("Own", bpy.data.cameras.new("Own"))
    rig = bpy.data.objects.new("Rig", None)
    for item in (camera, rig):
        scene.collection.objects.link(item)
    camera.parent, rig.scale, rig.rotation_euler = rig, (2, 2, 2), (0.1, -0.2, 0.7)
    camera.rotation_euler = (1.2, 0.1, 0.3)
    for frame, x in ((1, 0.0), (11, 1.0)):
        camera.location = (x, -0.5, 0.8)
        camera.keyframe_insert("location", frame=frame)
    for name, value in data.items():
        setattr(camera.data, name, value)
    scene.camera = camera
    return camera


def by_hand(scene, camera):
    """The values of all sockets by Blender's own frame of the view and its matrix."""
    scene.frame_set(FRAME)
    corners = np.array([tuple(corner) for corner in camera.data.view_frame(scene=scene)])
    (left, low, _), (right, high, _) = corners.min(0), corners.max(0)
    matrix = camera.evaluated_get(scene.view_layers[0].depsgraph).matrix_world
    return {
        "View": 2 * math.atan((right - left) / 2 / -corners[0, 2]),
        "Axis Across": -left / (right - left),
        "Axis Down": high / (high - low),
        "Frame Rate": 30 / 1.001,
        "Camera Location": tuple(matrix.to_translation()),
        "Camera Rotation": tuple(matrix.to_euler("XYZ")),
    }


@pytest.mark.parametrize(
    ("size", "aspect", "data"),
    [
        ("wide", 1.0, {"lens": 50.0}),
        ("tall", 1.3, {"lens": 35.0, "shift_x": 0.1, "shift_y": -0.07}),
        ("wide", 1.2, {"lens": 20.0, "sensor_fit": "VERTICAL", "sensor_height": 20.0, "shift_y": 0.2}),
        ("tall", 1.0, {"lens": 60.0, "sensor_fit": "HORIZONTAL", "shift_x": -0.1}),
    ],
)
def test_groups_see_the_scene_s_camera_without_a_hand(size, aspect, data, tmp_path):
    width, height = SIZE_PX[size]
    image, expected = picture(height, width), {}

    def set_up(scene):
        scene.render.pixel_aspect_y = aspect
        expected.update(by_hand(scene, own_camera(scene, **data)))

    first = bpy.data.scenes.new("First")  # as the values are needed before the groups have a scene
    first.render.resolution_x, first.render.resolution_y = width, height
    set_up(first)
    nodes = {}
    for name in NAMES:
        sockets = {item.name for item in described(name).inputs}
        given = GIVEN.get(name, {})
        told = {socket: value for socket, value in expected.items() if socket in sockets}
        nodes[f"{name} follows"] = name, given
        nodes[f"{name} told"] = name, given | told | {OVERRIDE_CAMERA: True}
        nodes[f"{name} alone"] = name, given | {OVERRIDE_CAMERA: True}
    depth_m = np.repeat(np.linspace(0.5, 9, height, dtype=np.float32)[:, None], width, axis=1)
    made = by_groups(nodes, image, tmp_path, frame=FRAME, depth_m=depth_m, set_up=set_up)
    for name in NAMES:
        follows, told, alone = (made[f"{name} {how}"] for how in ("follows", "told", "alone"))
        apart = np.sort(np.abs(follows - told).max(axis=2), axis=None)
        off = apart[-3]  # by the last bit of a rotation, a streak's edge lies on the other side of a pixel or two
        assert off < 2e-4, name
        assert apart[-1] < 0.02, name
        if name != "chromatic_aberration" or "shift_x" in data:  # which looks at the axis alone
            assert np.abs(alone - told).max() > 20 * off, name


def test_a_frame_without_depth_passes_groups_by_depth_unchanged(tmp_path):
    image, names = picture(24, 32), [name for name in NAMES if COLOUR[name].needs_depth]
    names += [name for name, item in COLOUR.items() if item.needs_depth and name not in names]
    assert {"snow_depth", "fog_depth", "defocus_depth"} <= set(names)
    nodes = {name: (name, GIVEN.get(name, {"Severity": 5.0})) for name in names}
    somewhere = np.zeros(image.shape[:2], np.float32)
    somewhere[0, 0] = 3.0  # a frame whose depth is void but for a pixel has depth
    without = by_groups(nodes, image, tmp_path, depth_m=np.zeros_like(somewhere))
    for depth_m in (somewhere, None):  # None: nothing is linked, and the socket's number counts
        made = by_groups(nodes, image, tmp_path, depth_m=depth_m)
        for name in names:
            assert np.array_equal(without[name], image), name
            assert np.abs(made[name] - image).max() > 0 or name == "defocus_depth", name
