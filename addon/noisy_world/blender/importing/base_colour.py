# SPDX-License-Identifier: GPL-3.0-or-later
"""The base colour of a material, read back from the nodes that Blender's importers make of a file's material."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.scenes.imported import ImportedPicture, ImportedSurface, Wrap
from ..typed import get_value, inputs, node_tree, outputs
from .finite import NonFiniteMeshError

_COLOUR_INPUTS = ("Base Color", "Color")  # of the shaders that a surface may have
_EXTENSIONS: dict[str, Wrap] = {"REPEAT": "repeat", "EXTEND": "clamp", "MIRROR": "mirror", "CLIP": "black"}


class _UnreadError(Exception):
    """A node that is not understood; its kind is the message."""


@dataclass(frozen=True)
class _Product:
    """Colours that are multiplied: a factor in linear light, a picture, a colour attribute."""

    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    picture: ImportedPicture | None = None
    colours: str | None = None

    def times(self, other: "_Product") -> "_Product":
        """Return both together. Raises _UnreadError where that is two pictures or two attributes."""
        if (self.picture and other.picture) or (self.colours is not None and other.colours is not None):
            raise _UnreadError("Mix")
        red, green, blue = (mine * theirs for mine, theirs in zip(self.factor, other.factor, strict=True))
        colours = other.colours if self.colours is None else self.colours
        return _Product((red, green, blue), self.picture or other.picture, colours)


def surface_of(material: bpy.types.Material, number_of: Callable[[bpy.types.Image], int]) -> ImportedSurface:
    """Return what a material shows, unlit. number_of: gives an image's number."""
    name = material.name
    shader = _shader(material)
    if shader is None:
        return ImportedSurface(name, factor=_plain(material))
    see_through = _see_through(shader)
    try:
        base = _product(_colour_input(shader), number_of)
        if base.picture is None and base.colours is None and max(base.factor) == 0:
            base = _emission(shader, number_of) or base
    except _UnreadError as error:
        return ImportedSurface(name, _plain(material), see_through=see_through, unread=str(error))
    return ImportedSurface(name, base.factor, base.picture, base.colours, see_through)


def _plain(material: bpy.types.Material) -> tuple[float, float, float]:
    red, green, blue, _ = material.diffuse_color  # pyright: ignore[reportGeneralTypeIssues]  an array of four
    return red, green, blue


def _emission(shader: bpy.types.Node, number_of: Callable[[bpy.types.Image], int]) -> _Product | None:
    """Return the picture that a black surface emits: so files say unlit that have no word for it."""
    socket = inputs(shader).get("Emission Color")
    found = None if socket is None else _product(socket, number_of)
    return None if found is None or found.picture is None else replace(found, factor=(1.0, 1.0, 1.0))


def _shader(material: bpy.types.Material) -> bpy.types.Node | None:
    """Return the node whose colour is a material's base colour: the first behind its output that has one."""
    nodes = node_tree(material).nodes if material.node_tree is not None else []
    ends = [node for node in nodes if isinstance(node, bpy.types.ShaderNodeOutputMaterial) and node.is_active_output]
    waiting: list[bpy.types.NodeSocket] = [inputs(node)["Surface"] for node in ends]
    while waiting:
        node = _source(waiting.pop(0))
        if node is None or isinstance(node, bpy.types.ShaderNodeBsdfTransparent):
            continue
        if _has_colour(node):
            return node
        waiting += [socket for socket in inputs(node) if socket.type == "SHADER"]
    return None


def _has_colour(node: bpy.types.Node) -> bool:
    return any(name in inputs(node) for name in _COLOUR_INPUTS)


def _colour_input(shader: bpy.types.Node) -> bpy.types.NodeSocket:
    return next(inputs(shader)[name] for name in _COLOUR_INPUTS if name in inputs(shader))


def _see_through(shader: bpy.types.Node) -> bool:
    """Tell whether anything but opaque is meant: alpha, or a mixture with what is transparent."""
    alpha = inputs(shader).get("Alpha")
    if alpha is not None:
        return alpha.is_linked or get_value(alpha) < 1
    mixes = [link.to_node for socket in shader.outputs for link in socket.links or []]
    return any(isinstance(node, bpy.types.ShaderNodeMixShader) and _mixes_by_alpha(node) for node in _onward(mixes))


def _onward(nodes: list[Any]) -> list[Any]:
    """Return nodes and all that follow them."""
    found: list[Any] = []
    while nodes:
        node = nodes.pop()
        if node is not None and node not in found:
            found.append(node)
            nodes += [link.to_node for socket in node.outputs for link in socket.links]
    return found


def _mixes_by_alpha(node: bpy.types.Node) -> bool:
    factor = inputs(node)[0]
    return not isinstance(_source(factor), bpy.types.ShaderNodeLightPath) and (
        _source(factor) is not None or get_value(factor) < 1
    )


def _source(socket: bpy.types.NodeSocket) -> bpy.types.Node | None:
    """Return the node that feeds an input, through reroutes; None where it has a value of its own."""
    links = socket.links
    while links:
        node = links[0].from_node
        if not isinstance(node, bpy.types.NodeReroute):
            return node
        links = inputs(node)[0].links
    return None


def _product(socket: bpy.types.NodeSocket, number_of: Callable[[bpy.types.Image], int]) -> _Product:
    node = _source(socket)
    match node:
        case None:
            value = get_value(socket)
            return _Product((value[0], value[1], value[2]))
        case bpy.types.ShaderNodeTexImage():
            if node.image is None:
                raise _UnreadError("a texture without an image")
            return _Product(picture=_picture(node, number_of(node.image)))
        case bpy.types.ShaderNodeVertexColor():
            return _Product(colours=node.layer_name)
        case bpy.types.ShaderNodeAttribute() if node.attribute_type == "GEOMETRY":
            return _Product(colours=node.attribute_name)
        case bpy.types.ShaderNodeRGB():
            value = get_value(outputs(node)[0])
            return _Product((value[0], value[1], value[2]))
        case bpy.types.ShaderNodeMix() if node.data_type == "RGBA" and node.blend_type == "MULTIPLY":
            share, first, second = inputs(node)[0], inputs(node)[6], inputs(node)[7]
            if _source(share) is None and get_value(share) == 1:
                return _product(first, number_of).times(_product(second, number_of))
        case bpy.types.ShaderNodeVectorMath() if node.operation == "MULTIPLY":
            first, second = inputs(node)[0], inputs(node)[1]
            return _product(first, number_of).times(_product(second, number_of))
        case bpy.types.ShaderNodeVectorMath() if node.operation == "ADD" and _is_nothing(inputs(node)[1]):
            return _product(inputs(node)[0], number_of)
        case _:
            pass
    raise _UnreadError(node.bl_label)


def _is_nothing(socket: bpy.types.NodeSocket) -> bool:
    return _source(socket) is None and not any(get_value(socket))


def _picture(node: bpy.types.ShaderNodeTexImage, image: int) -> ImportedPicture:
    if node.projection != "FLAT":
        raise _UnreadError(f"{node.bl_label} ({node.projection.lower()})")
    wrap = _EXTENSIONS[node.extension]
    wraps: list[Wrap] = [wrap, wrap]
    matrix, vector = _mapped(_unwrapped(inputs(node)["Vector"], wraps))
    across, up = ((float(row[0]), float(row[1]), float(row[2])) for row in matrix[:2])
    nearest = node.interpolation == "Closest"
    return ImportedPicture(image, _uv_map(vector), (across, up), (wraps[0], wraps[1]), nearest)


def _unwrapped(vector: bpy.types.NodeSocket, wraps: list[Wrap]) -> bpy.types.NodeSocket:
    """Return what the nodes transform by which glTF's importer wraps each direction in its own way; fill in wraps."""
    combine = _source(vector)
    if not isinstance(combine, bpy.types.ShaderNodeCombineXYZ):
        return vector
    for axis in (0, 1):
        node = _source(inputs(combine)[axis])
        if isinstance(node, bpy.types.ShaderNodeMath):
            known: dict[str, Wrap] = {"WRAP": "repeat", "PINGPONG": "mirror"}
            if node.operation not in known:
                raise _UnreadError(f"{node.bl_label} ({node.operation.lower()})")
            wraps[axis] = known[node.operation]
            node = _source(inputs(node)[0])
        if not isinstance(node, bpy.types.ShaderNodeSeparateXYZ):
            raise _UnreadError(combine.bl_label)
        vector = inputs(node)[0]
    return vector


def _mapped(vector: bpy.types.NodeSocket) -> tuple[NDArray[np.float64], bpy.types.NodeSocket]:
    """Return the transformation (3, 3) of coordinates (u, v, 1) by mapping nodes, and what they transform."""
    matrix = np.eye(3)
    while isinstance(node := _source(vector), bpy.types.ShaderNodeMapping):
        sockets = inputs(node)
        moved, turned, scaled = (get_value(sockets[name]) for name in ("Location", "Rotation", "Scale"))
        if not all(map(math.isfinite, (*moved, *turned, *scaled))):
            raise NonFiniteMeshError("a texture's place is NaN or infinite")
        if any(abs(turned[axis]) > 0 for axis in (0, 1)) or node.vector_type not in ("POINT", "TEXTURE"):
            raise _UnreadError(node.bl_label)
        cos, sin = math.cos(turned[2]), math.sin(turned[2])
        step = np.array([[cos, -sin, moved[0]], [sin, cos, moved[1]], [0, 0, 1]]) @ np.diag([scaled[0], scaled[1], 1])
        if node.vector_type == "TEXTURE":
            if not scaled[0] or not scaled[1]:
                raise _UnreadError(node.bl_label)
            step = np.linalg.inv(step)
        matrix, vector = matrix @ step, sockets["Vector"]
    return matrix, vector


def _uv_map(vector: bpy.types.NodeSocket) -> str:
    """Return the name of the coordinates; empty for the mesh's own choice."""
    node = _source(vector)
    match node:
        case None:
            return ""
        case bpy.types.ShaderNodeUVMap():
            return node.uv_map
        case bpy.types.ShaderNodeAttribute():
            return node.attribute_name
        case bpy.types.ShaderNodeTexCoord() if vector.links and vector.links[0].from_socket.name == "UV":  # pyright: ignore[reportOptionalMemberAccess]
            return ""
        case _:
            raise _UnreadError(node.bl_label)
