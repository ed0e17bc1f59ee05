# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh as a Blender object that shows exactly its colours, unlit."""

from typing import Any, Literal, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.scenes.mesh import NEUTRAL_GREY, Mesh, Texture
from .materials import (
    COLOUR_ATTRIBUTE,
    UV_ATTRIBUTE,
    new_image,
    tell_attribute,
    texture_material,
    vertex_colour_material,
)
from .render import FACE_ATTRIBUTE, FACE_OUTPUT, FACE_STEP

ORIGIN_PROPERTY = "noisy_world_origin_m"
Domain: TypeAlias = Literal["POINT", "CORNER"]
"""What of a mesh has colours, in Blender's words."""
Decoding: TypeAlias = Literal["none", "shader", "attribute"]
"""Where display-encoded colours are converted to linear light: nowhere, in the material, or before they are stored."""


def empty_scene() -> bpy.types.Scene:
    """Start from Blender's own startup file with nothing in it, so that no setting of the user affects a pixel."""
    # Not read_factory_settings: it disables extensions too, and Blender then deletes their packages from the profile.
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    # Vertex colours are display values already, so no filmic curve may change them.
    scene.view_settings.view_transform = "Standard"
    scene.render.dither_intensity = 0.0
    return scene


def set_origin(scene: bpy.types.Scene, origin_m: NDArray[np.float64]) -> None:
    """Store which point of the world (3,) float64, metres, is at Blender's origin.

    Blender computes in float32, whose spacing is 1 mm at 10 km, so a scene far away is rendered around this point.
    Custom properties are float64.
    """
    scene[ORIGIN_PROPERTY] = [float(value) for value in origin_m]


def get_origin(scene: bpy.types.Scene) -> NDArray[np.float64]:
    """Return the point (3,) float64, metres, set by set_origin; the world's own origin where none was set."""
    return np.array(scene.get(ORIGIN_PROPERTY, (0.0, 0.0, 0.0)), dtype=np.float64)


def add_mesh(
    scene: bpy.types.Scene, mesh: Mesh, name: str, *, decoding: Decoding, by_texels: bool = False
) -> bpy.types.Object:
    """Link the mesh to the scene, moved so that the scene's origin (set_origin) is Blender's.

    by_texels: whether the material interpolates between a texture's texels, rather than the engine.
    """
    data = bpy.data.meshes.new(name)
    vertices_m = (mesh.vertices_m - get_origin(scene)).astype(np.float32)
    # Attributes copy an array of their own type at once; the vertices' "co" and the loops' "vertex_index" take it value
    # by value, a second for a million.
    data.vertices.add(len(vertices_m))
    _set_attribute(data.attributes["position"], "vector", vertices_m.ravel())
    data.loops.add(len(mesh.corner_vertices))
    _set_attribute(data.attributes[".corner_vert"], "value", np.ascontiguousarray(mesh.corner_vertices, np.int32))
    data.polygons.add(len(mesh.face_starts))
    data.polygons.foreach_set("loop_start", mesh.face_starts)
    data.update(calc_edges=True)
    _add_colours(data, mesh, decoded=decoding == "attribute")
    material = vertex_colour_material(decode_colours=decoding == "shader")
    grey = NEUTRAL_GREY if decoding == "none" else float(_decoded(np.float64(NEUTRAL_GREY)))
    rgba: Any = (grey, grey, grey, 1.0)
    material.diffuse_color = rgba  # of the faces that Workbench shows beside textures
    data.materials.append(material)
    if mesh.texture is not None:
        _add_texture(data, mesh.texture, decoding, by_texels=by_texels)
    result = bpy.data.objects.new(name, data)
    scene.collection.objects.link(result)
    return result


def tell_faces(shown: bpy.types.Object) -> None:
    """Let the materials of a mesh's object write each face's number into FACE_OUTPUT, in two parts, and a 1."""
    data = shown.data
    assert isinstance(data, bpy.types.Mesh)
    numbers = np.arange(len(data.polygons), dtype=np.int64)
    parts = np.stack([numbers % FACE_STEP, numbers // FACE_STEP, np.ones_like(numbers)], axis=1).astype(np.float32)
    _set_attribute(data.attributes.new(FACE_ATTRIBUTE, "FLOAT_VECTOR", "FACE"), "vector", parts.ravel())
    for material in data.materials:
        assert material is not None
        tell_attribute(material, FACE_ATTRIBUTE, FACE_OUTPUT)


def rgba_of(mesh: Mesh) -> tuple[Domain, NDArray[np.float32]]:
    """Return whether colours are those of vertices or of corners, and these (N, 4); grey where there are none."""
    rgb = mesh.rgb if mesh.corner_rgb is None else mesh.corner_rgb
    rgba = np.ones((len(mesh.vertices_m if mesh.corner_rgb is None else mesh.corner_rgb), 4), dtype=np.float32)
    rgba[:, :3] = NEUTRAL_GREY if rgb is None else rgb
    return "POINT" if mesh.corner_rgb is None else "CORNER", rgba


def _add_texture(data: bpy.types.Mesh, texture: Texture, decoding: Decoding, *, by_texels: bool) -> None:
    """Give each picture a material after that of the vertices' colours, and the faces with a picture its material."""
    layer = data.attributes.new(UV_ATTRIBUTE, "FLOAT2", "CORNER")
    _set_attribute(layer, "vector", np.ascontiguousarray(texture.corner_uv, np.float32).ravel())
    slots = data.attributes.new("material_index", "INT", "FACE")
    _set_attribute(slots, "value", np.ascontiguousarray(texture.face_pictures + 1, np.int32))
    for name, picture in zip(texture.names, texture.pictures, strict=True):
        image = new_image(name, picture, decoded=decoding == "attribute")
        decode = decoding == "shader"
        data.materials.append(texture_material(image, decode_colours=decode, by_texels=by_texels))


def _add_colours(data: bpy.types.Mesh, mesh: Mesh, *, decoded: bool) -> None:
    domain, rgba = rgba_of(mesh)
    if decoded:
        rgba[:, :3] = _decoded(rgba[:, :3])
    # FLOAT_COLOR keeps the display-encoded values. BYTE_COLOR would be decoded before it is interpolated, and colours
    # between vertices would differ from what other viewers of such files show.
    attribute = data.color_attributes.new(COLOUR_ATTRIBUTE, "FLOAT_COLOR", domain)
    _set_attribute(attribute, "color", rgba.ravel())
    data.color_attributes.active_color = attribute
    data.color_attributes.render_color_index = data.color_attributes.active_color_index or 0


def _decoded(encoded: Any) -> Any:
    """Convert display-encoded colours to linear light (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def _set_attribute(attribute: bpy.types.Attribute, field: str, values: NDArray[np.float32] | NDArray[np.int32]) -> None:
    kinds = (
        bpy.types.FloatVectorAttribute,
        bpy.types.FloatColorAttribute,
        bpy.types.IntAttribute,
        bpy.types.Float2Attribute,
    )
    assert isinstance(attribute, kinds)
    attribute.data.foreach_set(field, values)
