# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh with vertex colours as a Blender object that shows exactly those colours, unlit."""

from typing import Literal

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.scenes.mesh import Mesh
from .typed import cycles, inputs, new_node, node_tree, outputs, set_value

COLOUR_ATTRIBUTE = "Col"
MATERIAL = "Noisy World vertex colours"
ORIGIN_PROPERTY = "noisy_world_origin_m"
type Decoding = Literal["none", "shader", "attribute"]
"""Where display-encoded colours become linear light: nowhere, in the material's nodes, or before they are stored."""

type _Operation = Literal["POWER", "MULTIPLY_ADD", "MULTIPLY", "CEIL", "SUBTRACT"]

NEUTRAL_GREY = 128 / 255  # display-encoded; what a mesh without colours shows


def empty_scene() -> bpy.types.Scene:
    """Start from Blender's own startup file with nothing in it, so that nothing of the user's reaches a pixel."""
    # Factory settings would disable the extensions too, whose packages Blender then deletes from the user's profile.
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    # Vertex colours are meant for a display as they are: no filmic curve over them.
    scene.view_settings.view_transform = "Standard"
    scene.render.dither_intensity = 0.0
    return scene


def set_origin(scene: bpy.types.Scene, origin_m: NDArray[np.float64]) -> None:
    """Remember which point of the world (3,) float64, metres, lies at Blender's origin.

    Blender computes in float32, whose spacing is 1 mm at 10 km: a scene far away is rendered around this point instead.
    Custom properties are float64.
    """
    scene[ORIGIN_PROPERTY] = [float(value) for value in origin_m]


def get_origin(scene: bpy.types.Scene) -> NDArray[np.float64]:
    """Return the point (3,) float64, metres, set by set_origin; the world's own origin where none was set."""
    return np.array(scene.get(ORIGIN_PROPERTY, (0.0, 0.0, 0.0)), dtype=np.float64)


def add_mesh(scene: bpy.types.Scene, mesh: Mesh, name: str, *, decoding: Decoding) -> bpy.types.Object:
    """Link the mesh to the scene, moved so that the scene's origin (set_origin) is Blender's."""
    data = bpy.data.meshes.new(name)
    vertices_m = (mesh.vertices_m - get_origin(scene)).astype(np.float32)
    # An attribute takes an array of its own type as a whole; the vertices' "co" and the loops' "vertex_index" take a
    # value after the other, a second for a million.
    data.vertices.add(len(vertices_m))
    _set_attribute(data.attributes["position"], "vector", vertices_m.ravel())
    data.loops.add(len(mesh.corner_vertices))
    _set_attribute(data.attributes[".corner_vert"], "value", np.ascontiguousarray(mesh.corner_vertices, np.int32))
    data.polygons.add(len(mesh.face_starts))
    data.polygons.foreach_set("loop_start", mesh.face_starts)
    data.update(calc_edges=True)
    _add_colours(data, mesh, decoded=decoding == "attribute")
    data.materials.append(vertex_colour_material(decode_colours=decoding == "shader"))
    result = bpy.data.objects.new(name, data)
    scene.collection.objects.link(result)
    return result


def _add_colours(data: bpy.types.Mesh, mesh: Mesh, *, decoded: bool) -> None:
    rgba = np.ones((len(mesh.vertices_m), 4), dtype=np.float32)
    rgba[:, :3] = NEUTRAL_GREY if mesh.rgb is None else mesh.rgb
    if decoded:
        low = rgba[:, :3] <= 0.04045
        rgba[:, :3] = np.where(low, rgba[:, :3] / 12.92, ((rgba[:, :3] + 0.055) / 1.055) ** 2.4)
    # FLOAT_COLOR keeps the display-encoded values untouched; BYTE_COLOR would be decoded before it is interpolated,
    # and colours between vertices would differ from what every viewer of such files shows.
    attribute = data.color_attributes.new(COLOUR_ATTRIBUTE, "FLOAT_COLOR", "POINT")
    _set_attribute(attribute, "color", rgba.ravel())
    data.color_attributes.active_color = attribute
    data.color_attributes.render_color_index = data.color_attributes.active_color_index or 0


def _set_attribute(attribute: bpy.types.Attribute, field: str, values: NDArray[np.float32] | NDArray[np.int32]) -> None:
    kinds = (bpy.types.FloatVectorAttribute, bpy.types.FloatColorAttribute, bpy.types.IntAttribute)
    assert isinstance(attribute, kinds)
    attribute.data.foreach_set(field, values)


def vertex_colour_material(*, decode_colours: bool) -> bpy.types.Material:
    """Build the unlit material: the colour attribute, interpolated as stored, as emission.

    decode_colours True emits linear light (IEC 61966-2-1), which is what a view transform and the averaging of several
    samples need. False emits the display-encoded values themselves: exact for a single sample, and a fifth faster.
    """
    name = MATERIAL if decode_colours else f"{MATERIAL} (encoded)"
    material = bpy.data.materials.new(name)
    tree = node_tree(material)
    tree.nodes.clear()
    attribute = new_node(tree, bpy.types.ShaderNodeAttribute)
    attribute.attribute_name = COLOUR_ATTRIBUTE
    emission = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    colour = outputs(attribute)["Color"]
    if decode_colours:
        colour = _linear_from_srgb(tree, colour)
    tree.links.new(colour, emission.inputs["Color"])
    tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
    _spread(tree)
    # Two million emissive triangles as lights cost seconds, and nothing here is lit by anything.
    cycles(material).emission_sampling = "NONE"
    return material


def _linear_from_srgb(tree: bpy.types.NodeTree, encoded: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Add the nodes of the sRGB decoding, a channel a component: a line below 0.04045, a power above."""

    def vector_math(operation: _Operation, *operands: bpy.types.NodeSocket | float) -> bpy.types.NodeSocket:
        node = new_node(tree, bpy.types.ShaderNodeVectorMath)
        node.operation = operation
        for socket, operand in zip(inputs(node), operands, strict=False):
            if isinstance(operand, bpy.types.NodeSocket):
                tree.links.new(operand, socket)
            else:
                set_value(socket, (operand,) * 3)
        return outputs(node)["Vector"]

    power = vector_math("POWER", vector_math("MULTIPLY_ADD", encoded, 1 / 1.055, 0.055 / 1.055), 2.4)
    line = vector_math("MULTIPLY", encoded, 1 / 12.92)
    # Colours lie in [0, 1], so the ceiling of the difference is 0 up to the threshold and 1 above.
    above = vector_math("CEIL", vector_math("SUBTRACT", encoded, 0.04045))
    return vector_math("MULTIPLY_ADD", vector_math("SUBTRACT", power, line), above, line)


def _spread(tree: bpy.types.NodeTree) -> None:
    for column, node in enumerate(tree.nodes):
        node.location = (200.0 * column, 0.0)
