# SPDX-License-Identifier: GPL-3.0-or-later
"""Run by a Blender program that has no add-on: append every group of a library into an empty scene and use it.

blender -b --factory-startup -P append_groups.py -- LIBRARY.blend FRAME.npy VALUES.json OUT
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np

library, frame, values, out = (Path(word) for word in sys.argv[sys.argv.index("--") + 1 :])
bpy.ops.wm.read_factory_settings(use_empty=True)
with bpy.data.libraries.load(str(library), link=False) as (source, target):
    target.node_groups = [name for name in source.node_groups if name in json.loads(values.read_text())]
rgb = np.load(frame)
height, width = rgb.shape[:2]
image = bpy.data.images.new("frame", width, height, alpha=False, float_buffer=True)
image.colorspace_settings.name = "Non-Color"
rgba = np.ones((height, width, 4), np.float32)
rgba[..., :3] = rgb[::-1]
image.pixels.foreach_set(rgba.ravel())
image.update()
scene = bpy.context.scene
tree = scene.compositing_node_group = bpy.data.node_groups.new("Empty", "CompositorNodeTree")
scene.render.resolution_x, scene.render.resolution_y = width, height
scene.render.compositor_device, scene.render.compositor_precision = "CPU", "FULL"
scene.frame_set(0)
shown = tree.nodes.new("CompositorNodeImage")
shown.image = image
file = tree.nodes.new("CompositorNodeOutputFile")
file.directory, file.file_name = str(out), "groups"
file.format.media_type, file.format.file_format = "MULTI_LAYER_IMAGE", "OPEN_EXR_MULTILAYER"
file.format.color_depth, file.format.exr_codec = "32", "NONE"
file.format.use_exr_interleave = True
for group in target.node_groups:
    file.file_output_items.new("VECTOR", group.name.replace(" ", "_"))
for place, group in enumerate(target.node_groups):
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree = group
    for name, value in json.loads(values.read_text())[group.name].items():
        node.inputs[name].default_value = value
    tree.links.new(shown.outputs["Image"], node.inputs["Image"])
    if "Depth" in node.inputs:
        node.inputs["Depth"].default_value = 2.0
    tree.links.new(node.outputs["Image"], file.inputs[place])
bpy.ops.render.render()
assets = [group.name for group in target.node_groups if group.asset_data is not None]
print("appended", len(target.node_groups), len(assets))
