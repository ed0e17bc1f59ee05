# SPDX-License-Identifier: GPL-3.0-or-later
"""A lit scene whose lamps are brighter than white, and datasets of it."""

import bpy
from own_scenes import new_scene, save
from runs import run


LAMPS = (4.0, 20.0, 100.0)


def lit_hall(folder, *, denoising=True, lamps=LAMPS, lighting=True):
    """The hall with three lamps in view, each a ball that emits as many times white, shown by AgX.

    lighting: whether they light the hall, too.
    """
    scene = new_scene(samples=2)
    scene.cycles.use_denoising = denoising
    for place, strength in enumerate(lamps):
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.15, location=(place - 1, 3, 0.6))
        material = bpy.data.materials.new(f"Lamp {strength:g}")
        shader = material.node_tree.nodes["Principled BSDF"]
        shader.inputs["Emission Color"].default_value = (1, 1, 1, 1)
        shader.inputs["Emission Strength"].default_value = strength
        bpy.context.object.data.materials.append(material)
        bpy.context.object.visible_diffuse = bpy.context.object.visible_glossy = lighting
    scene.view_settings.view_transform = "AgX"
    scene.frame_end = 1
    return save(folder, "lit")


def write_preset(folder, settings, *, backend="reference", output="image: png, modalities: [rgb]"):
    """Write a preset of the hall beside it; return its path."""
    path = folder / "lit.yaml"
    path.write_text(
        "scenes: [{name: hall, blend: lit.blend}]\n"
        f"settings: [{{name: clean}}, {settings}]\n"
        f"render: {{backend: {backend}}}\noutput: {{{output}}}\n"
    )
    return path


def make(preset, out, **several):
    """Make the dataset of a preset; return its folder."""
    run(preset, out, **several)
    return out
