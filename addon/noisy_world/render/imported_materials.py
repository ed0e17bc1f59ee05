# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender's importers make of a file's materials: base colours and images, checked to be finite."""

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import read_bytes, utf8_name
from ..nodes.datablocks import get_value, inputs, node_tree, outputs
from ..scenes.imported_mesh import ImportedImage, ImportedPicture, ImportedSurface, Wrap
from ..scenes.mesh_formats import is_file, is_inside
from ..scenes.textures import check_size_px, header_size_px
from .scene_dependencies import size_by_library

# Checks that imported coordinates are finite, before Blender replaces those that are not by 0.


class NonFiniteMeshError(Exception):
    """A value of a mesh is NaN or infinite; the message says which."""


def check_finite(mesh: bpy.types.Mesh, *, uv: bool = False) -> None:
    """Raise NotFiniteError where a vertex is not finite. uv: or a texture coordinate."""
    vertices_m = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", vertices_m.ravel())
    if not np.isfinite(vertices_m).all():
        raise NonFiniteMeshError("a coordinate is NaN or infinite")
    for layer in mesh.uv_layers if uv else ():
        values = np.empty((len(mesh.loops), 2), np.float32)
        layer.uv.foreach_get("vector", values.ravel())
        if not np.isfinite(values).all():
            raise NonFiniteMeshError("a texture coordinate is NaN or infinite")


@contextlib.contextmanager
def finite_gltf() -> Iterator[None]:
    """Have glTF's importer, which is a script, look at each mesh before it validates it.

    Raises NotFiniteError at the end, for the importer makes a text of every error.
    """
    module: Any = import_module("io_scene_gltf2.blender.imp.mesh")
    smooth, found = module.set_poly_smoothing, list[NonFiniteMeshError]()

    def looked_at(gltf: Any, pymesh: Any, mesh: bpy.types.Mesh, *rest: Any) -> None:  # the last step before
        try:
            check_finite(mesh, uv=True)
        except NonFiniteMeshError as error:
            found.append(error)
            raise
        smooth(gltf, pymesh, mesh, *rest)

    module.set_poly_smoothing = looked_at
    try:
        yield
    except RuntimeError:
        if not found:
            raise
    finally:
        module.set_poly_smoothing = smooth
    if found:
        raise found[0]


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


# The image files of imported materials, unchanged, so that they are read like any texture.


class UnusablePictureError(Exception):
    """An image that cannot be used: missing, outside the mesh's folder, too large; the message says so."""


def image_name(image: bpy.types.Image) -> str:
    """Return what an image is called in messages: its file's name."""
    return Path(image.filepath.replace("\\", "/")).name or image.name


def located(mesh_folder: Path, image: bpy.types.Image) -> Path:
    """Return where the file of an image lies that is not packed: as it is named, or beside the mesh, never elsewhere.

    Raises UnfitImageError.
    """
    path = Path(bpy.path.abspath(image.filepath))
    if is_inside(mesh_folder, path):
        if not is_file(path):
            raise UnusablePictureError(f"its texture {(image.filepath or image.name)[:200]!r} is missing")
        return path
    beside = mesh_folder / image_name(image)
    if is_file(beside):
        return beside
    problem = f"its texture {image.filepath[:200]!r} leads out of the mesh's folder"
    raise UnusablePictureError(f"{problem}; put it beside the mesh, and name it so")


def check_image(mesh_folder: Path, image: bpy.types.Image, scratch: Path) -> bytes:
    """Return the bytes of an image's file, which is not too large to be decoded. Raises UnfitImageError.

    scratch: a file that may be written.
    """
    data = _data(image, None if image.packed_file is not None else located(mesh_folder, image))
    try:
        try:
            size_px = header_size_px(data)
        except ValueError:
            return data  # which its reader refuses
        if size_px is None:
            scratch.write_bytes(data)
            size_px = size_by_library(scratch)
        check_size_px("", size_px or (0, 0))
    except InputError as error:
        problem = f"its texture {image_name(image)[:200]!r} {error.problem}; {error.remedy}"
        raise UnusablePictureError(problem) from error
    return data


def _data(image: bpy.types.Image, path: Path | None) -> bytes:
    if path is None:
        assert image.packed_file is not None
        return bytes(image.packed_file.data)
    try:
        return read_bytes(path)
    except OSError as error:
        raise UnusablePictureError(
            f"its texture {image_name(image)[:200]!r} cannot be read: {error.strerror}"
        ) from error


class ImportedImages:
    """The images, numbered as they are asked for, with their files in a folder."""

    def __init__(self, folder: Path, mesh_folder: Path) -> None:
        """Begin without any. folder: where their files are written. mesh_folder: where they may lie."""
        self._folder = folder
        self._mesh_folder = mesh_folder
        self.notes: list[str] = []
        self._numbers: dict[str, int] = {}
        self.images: list[ImportedImage] = []

    def number_of(self, image: bpy.types.Image) -> int:
        """Return an image's number; its file is written when it is asked for first. Raises UnfitImageError."""
        if image.name not in self._numbers:
            self._numbers[image.name] = len(self.images)
            self.images.append(self._write(image, len(self.images)))
        return self._numbers[image.name]

    def _write(self, image: bpy.types.Image, number: int) -> ImportedImage:
        file = self._folder / f"image{number}"
        data = check_image(self._mesh_folder, image, file)
        if image.packed_file is None:
            self._note_place(image)
        space = image.colorspace_settings
        linear = space is not None and space.name in ("Non-Color", "Linear Rec.709")
        if _read_by_us(data):
            file.write_bytes(data)
        else:  # Blender knows more formats than OpenCV; the pixels stay as they are
            file.unlink(missing_ok=True)
            if image.file_format != "PNG":  # to ask has it decoded
                image.file_format = "PNG"
            with contextlib.suppress(RuntimeError):
                image.save(filepath=utf8_name(file), save_copy=True)
            if not file.is_file():
                file.write_bytes(data)  # which then says what is wrong
        return ImportedImage(image_name(image), file.name, linear)

    def _note_place(self, image: bpy.types.Image) -> None:
        named, path = bpy.path.abspath(image.filepath), located(self._mesh_folder, image)
        if Path(named) != path:
            self.notes.append(f"its texture is named {named[:200]!r}: {path.name} beside the mesh was taken")
            image.filepath = utf8_name(path)
            image.reload()


def _read_by_us(data: bytes) -> bool:
    with contextlib.suppress(ValueError):
        return header_size_px(data) is not None
    return True  # damaged, which its reader says
