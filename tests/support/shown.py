# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scene's compositor shows, as an array, and arrays as Blender's images."""

import bpy
import numpy as np


def evaluate_scene(scene, folder):
    """What a scene's compositor shows, (H, W, 3) float32, through a file of its own."""
    import OpenEXR

    tree = scene.compositing_node_group
    end = next(node for node in tree.nodes if node.bl_idname == "NodeGroupOutput")
    file = tree.nodes.new("CompositorNodeOutputFile")
    file.directory, file.file_name = str(folder), "shown"
    file.format.media_type = "MULTI_LAYER_IMAGE"
    file.format.file_format = "OPEN_EXR_MULTILAYER"
    file.format.color_depth, file.format.exr_codec = "32", "NONE"
    file.file_output_items.new("VECTOR", "s")
    tree.links.new(end.inputs["Image"].links[0].from_socket, file.inputs[0])
    with bpy.context.temp_override(scene=scene):
        bpy.ops.render.render()
    tree.nodes.remove(file)
    with OpenEXR.File(str(folder / "shown.exr"), separate_channels=True) as layers:
        channels = {name: item.pixels for name, item in layers.channels().items()}
    return np.stack([channels[f"s.{axis}"] for axis in "XYZ"], axis=-1)


def image_of(values):
    image = bpy.data.images.new("frame", values.shape[1], values.shape[0], alpha=False, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    rgba = np.ones((*values.shape[:2], 4), np.float32)
    rgba[..., :3] = values[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    return image
