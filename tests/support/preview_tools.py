# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene with the panel's properties and its previews, for the tests of these."""

import bpy
import numpy as np

from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry

SIZE = (60, 40)
IDENTIFIERS = (7, "room", "setting")


def steps_of(*items):
    return parse_steps(items, ConfigPath("test"), registry())


def add(scene, name, **values):
    step = scene.noisy_world.steps.add()
    step.perturbation = name
    for key, value in values.items():
        setattr(step, key, value)
    return step


def cycles_scene(colour):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.world = bpy.data.worlds.new("World")
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (*colour, 1)
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    return scene


def pixels(image):
    """The bytes (H, W, 3) of an image of Blender's, the top row first."""
    width, height = image.size
    values = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(values)
    return np.rint(255 * values.reshape(height, width, 4)[::-1, :, :3]).astype(np.uint8)
