# SPDX-License-Identifier: GPL-3.0-or-later
"""What was imported, saved as a .blend with the lights and materials of its file."""

import math
from pathlib import Path

import bpy
import mathutils

from ...core.scenes.turning import Up
from ...core.utf8_names import utf8_name
from ..typed import cycles, get_value, inputs, node_tree
from .images import check_image, located


def save_lit(blend: Path, stands: Up | None, asked: Up | None, mesh_folder: Path) -> str:
    """Save the open file, ready to be rendered lit; return why that cannot be, empty where it was.

    stands: the axis that was taken for up. asked: the one that should be, None for no other.
    mesh_folder: where its textures have to lie. Raises UnfitImageError. Colours are encoded for
    the display alone, without a look, and what no light reaches is black.
    """
    for image in sorted(bpy.data.images, key=lambda each: each.name):
        if image.source == "FILE":
            check_image(mesh_folder, image, blend.parent / "image")
            if image.packed_file is None:
                image.filepath = utf8_name(located(mesh_folder, image))
                image.pack()  # what lies beside the mesh may change
    if not _shines():
        return "holds no lights and nothing that shines, so it is black with light: scene; leave light out"
    if asked is not None and stands is None:
        return "states its own axes, and is turned by them, so up cannot be said of it; leave up out"
    if asked not in (None, stands):
        _turn(90.0 if asked == "y" else -90.0)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles(scene).use_denoising = False
    cycles(scene).use_adaptive_sampling = False
    scene.view_settings.view_transform = "Standard"
    bpy.ops.wm.save_as_mainfile(filepath=utf8_name(blend), copy=True)
    return ""


def _turn(angle_deg: float) -> None:
    """Turn everything about the X axis."""
    turn = mathutils.Matrix.Rotation(math.radians(angle_deg), 4, "X")
    for item in bpy.context.scene.objects:
        if item.parent is None:
            item.matrix_world = turn @ item.matrix_world


def _shines() -> bool:
    """Tell whether there is a light, a world that the file brought, or a material that emits."""
    world = bpy.context.scene.world
    return bool(bpy.data.lights) or world is not None or any(map(_emits, bpy.data.materials))


def _emits(material: bpy.types.Material) -> bool:
    for node in node_tree(material).nodes if material.node_tree is not None else ():
        if isinstance(node, bpy.types.ShaderNodeEmission):
            return True
        if "Emission Strength" not in inputs(node):
            continue
        strength, colour = inputs(node)["Emission Strength"], inputs(node)["Emission Color"]
        if (strength.is_linked or get_value(strength) > 0) and (colour.is_linked or any(get_value(colour)[:3])):
            return True
    return False
