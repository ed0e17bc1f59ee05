# SPDX-License-Identifier: GPL-3.0-or-later
"""Unlit materials: the colours of a mesh's vertices, corners or texture as emission."""

from typing import Literal, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from .typed import cycles, inputs, new_node, node_tree, outputs, set_pixels, set_value, size_px, use_as_data

COLOUR_ATTRIBUTE = "Col"
UV_ATTRIBUTE = "UVMap"
MATERIAL = "Noisy World vertex colours"
TEXTURE_MATERIAL = "Noisy World texture"

_Operation: TypeAlias = Literal["POWER", "MULTIPLY_ADD", "MULTIPLY", "CEIL", "SUBTRACT", "FLOOR"]
_Operand: TypeAlias = bpy.types.NodeSocket | float | tuple[float, float, float]


def vertex_colour_material(*, decode_colours: bool) -> bpy.types.Material:
    """Build the unlit material: the colour attribute, interpolated as stored, as emission.

    decode_colours: True emits linear light (IEC 61966-2-1), which a view transform and the averaging of several samples
    need. False emits the display-encoded values themselves, which is exact for a single sample and a fifth faster.
    """
    name = MATERIAL if decode_colours else f"{MATERIAL} (encoded)"
    material, tree = _empty_material(name)
    attribute = new_node(tree, bpy.types.ShaderNodeAttribute)
    attribute.attribute_name = COLOUR_ATTRIBUTE
    _emit(material, tree, outputs(attribute)["Color"], decode_colours=decode_colours)
    return material


def texture_material(image: bpy.types.Image, *, decode_colours: bool, by_texels: bool) -> bpy.types.Material:
    """Build the unlit material of an image: its colours, interpolated as stored, as emission.

    decode_colours: as of vertex_colour_material. by_texels: whether nodes interpolate between the four texels around a
    point; if not, the engine does.
    """
    material, tree = _empty_material(f"{TEXTURE_MATERIAL} {image.name}")
    if by_texels:
        colour = _interpolated(tree, image)
    else:
        texture = _image_node(tree, image, "Linear")
        tree.nodes.active = texture  # Workbench shows the active image
        colour = outputs(texture)["Color"]
    _emit(material, tree, colour, decode_colours=decode_colours)
    return material


def _image_node(
    tree: bpy.types.NodeTree, image: bpy.types.Image, interpolation: Literal["Linear", "Closest"]
) -> bpy.types.ShaderNodeTexImage:
    node = new_node(tree, bpy.types.ShaderNodeTexImage)
    node.image = image
    node.interpolation = interpolation
    node.extension = "REPEAT"
    return node


def _interpolated(tree: bpy.types.NodeTree, image: bpy.types.Image) -> bpy.types.NodeSocket:
    """Add the nodes that interpolate linearly between texels, whose centres are at whole numbers and a half."""
    width, height = size_px(image)
    place = new_node(tree, bpy.types.ShaderNodeUVMap)
    place.uv_map = UV_ATTRIBUTE
    texels = _vector_math(tree, "MULTIPLY_ADD", outputs(place)["UV"], (width, height, 1.0), (-0.5, -0.5, 0.0))
    corner = _vector_math(tree, "FLOOR", texels)
    across = new_node(tree, bpy.types.ShaderNodeSeparateXYZ)
    tree.links.new(_vector_math(tree, "SUBTRACT", texels, corner), inputs(across)["Vector"])

    def texel(column: int, row: int) -> bpy.types.NodeSocket:
        scale, middle = (1 / width, 1 / height, 1.0), ((column + 0.5) / width, (row + 0.5) / height, 0.0)
        node = _image_node(tree, image, "Closest")
        tree.links.new(_vector_math(tree, "MULTIPLY_ADD", corner, scale, middle), inputs(node)["Vector"])
        return outputs(node)["Color"]

    def between(first: _Operand, second: _Operand, share: _Operand) -> bpy.types.NodeSocket:
        return _vector_math(tree, "MULTIPLY_ADD", _vector_math(tree, "SUBTRACT", second, first), share, first)

    lower, upper = (between(texel(0, row), texel(1, row), outputs(across)["X"]) for row in (0, 1))
    return between(lower, upper, outputs(across)["Y"])


def new_image(name: str, rgb: NDArray[np.uint8], *, decoded: bool) -> bpy.types.Image:
    """Make an image of (H, W, 3) uint8, display-encoded, the top row first.

    decoded: whether Blender converts it to linear light where it is read; if not, its bytes are taken as they are.
    """
    height, width = rgb.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=False)
    if not decoded:
        use_as_data(image)
    rgba = np.full((height, width, 4), 255, dtype=np.uint8)
    for channel in range(3):  # one by one: all at once takes four times as long
        rgba[..., channel] = rgb[::-1, :, channel]
    set_pixels(image, np.divide(rgba, np.float32(255), dtype=np.float32))
    return image


def tell_attribute(material: bpy.types.Material, attribute: str, name: str) -> None:
    """Let a material write an attribute of three numbers, as it is, into the pass of a name."""
    tree = node_tree(material)
    attribute_node = new_node(tree, bpy.types.ShaderNodeAttribute)
    attribute_node.attribute_name = attribute
    into = new_node(tree, bpy.types.ShaderNodeOutputAOV)
    into.aov_name = name
    tree.links.new(outputs(attribute_node)["Vector"], inputs(into)["Color"])


def _empty_material(name: str) -> tuple[bpy.types.Material, bpy.types.NodeTree]:
    material = bpy.data.materials.new(name)
    tree = node_tree(material)
    tree.nodes.clear()
    return material, tree


def _emit(
    material: bpy.types.Material, tree: bpy.types.NodeTree, colour: bpy.types.NodeSocket, *, decode_colours: bool
) -> None:
    emission = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    if decode_colours:
        colour = _linear_from_srgb(tree, colour)
    tree.links.new(colour, emission.inputs["Color"])
    tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
    _spread(tree)
    # Nothing is lit here, and preparing two million emissive triangles as lights takes seconds.
    cycles(material).emission_sampling = "NONE"


def _vector_math(tree: bpy.types.NodeTree, operation: _Operation, *operands: _Operand) -> bpy.types.NodeSocket:
    """Add a node that calculates by component; a single number stands for three."""
    node = new_node(tree, bpy.types.ShaderNodeVectorMath)
    node.operation = operation
    for socket, operand in zip(inputs(node), operands, strict=False):
        if isinstance(operand, bpy.types.NodeSocket):
            tree.links.new(operand, socket)
        else:
            set_value(socket, operand if isinstance(operand, tuple) else (operand,) * 3)
    return outputs(node)["Vector"]


def _linear_from_srgb(tree: bpy.types.NodeTree, encoded: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Add the nodes that decode sRGB (IEC 61966-2-1), by component: linear up to 0.04045, a power above."""

    power = _vector_math(tree, "POWER", _vector_math(tree, "MULTIPLY_ADD", encoded, 1 / 1.055, 0.055 / 1.055), 2.4)
    line = _vector_math(tree, "MULTIPLY", encoded, 1 / 12.92)
    # Colours are in [0, 1], so the ceiling of the difference is 0 up to the threshold and 1 above it.
    above = _vector_math(tree, "CEIL", _vector_math(tree, "SUBTRACT", encoded, 0.04045))
    return _vector_math(tree, "MULTIPLY_ADD", _vector_math(tree, "SUBTRACT", power, line), above, line)


def _spread(tree: bpy.types.NodeTree) -> None:
    for column, node in enumerate(tree.nodes):
        node.location = (200.0 * column, 0.0)
