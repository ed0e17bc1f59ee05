# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes of the file that is open, as they are evaluated, and where they stand."""

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.scenes.imported import ImportedPart

# Chosen: a hundred times what is rendered here in one piece. Files multiply: copies of copies take a line each.
MOST_COPIES, MOST_CORNERS = 2**20, 2**28


class TooManyError(Exception):
    """A file holds more with all its copies than is read; the message says what."""


def imported_parts(materials: dict[str, int]) -> tuple[ImportedPart, ...]:
    """Return the meshes that a render shows, each once, in the order of their names, with all their copies.

    materials: the numbers of materials by their names. Raises TooManyError.
    """
    copies = corners = 0
    graph = bpy.context.evaluated_depsgraph_get()
    placements: dict[int, list[NDArray[np.float64]]] = {}
    shown: dict[int, tuple[str, bpy.types.Object]] = {}
    for copy in graph.object_instances:
        item = copy.object
        if item is None or item.type != "MESH" or item.hide_render or not copy.show_self:
            continue
        assert isinstance(item.data, bpy.types.Mesh)
        copies, corners = copies + 1, corners + len(item.data.loops)
        if copies > MOST_COPIES or corners > MOST_CORNERS:
            most = f"{MOST_COPIES} copies of meshes or {MOST_CORNERS} corners of faces"
            raise TooManyError(f"holds more than {most}, which are the most that is read; split it")
        key = hash((item.data.as_pointer(), tuple(slot.name for slot in item.material_slots)))
        shown.setdefault(key, (item.name_full, item))
        placements.setdefault(key, []).append(np.array(copy.matrix_world, dtype=np.float64))
    # An instance ends with its step of the loop, and the evaluated objects stay.
    order = sorted(shown, key=lambda each: shown[each][0])
    return tuple(_part(shown[key][1], np.stack(placements[key]), materials) for key in order)


def _part(item: bpy.types.Object, placements: NDArray[np.float64], materials: dict[str, int]) -> ImportedPart:
    data = item.data
    assert isinstance(data, bpy.types.Mesh)
    vertices_m = np.empty((len(data.vertices), 3), np.float32)
    data.vertices.foreach_get("co", vertices_m.ravel())
    corner_vertices = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", corner_vertices)
    face_starts = np.empty(len(data.polygons), np.int32)
    data.polygons.foreach_get("loop_start", face_starts)
    slots = np.empty(len(data.polygons), np.int32)
    data.polygons.foreach_get("material_index", slots)
    return ImportedPart(
        vertices_m,
        corner_vertices,
        face_starts,
        _surfaces(item, slots, materials),
        placements,
        _uv(data),
        _colours(data, corner_vertices),
    )


def _surfaces(item: bpy.types.Object, slots: NDArray[np.int32], materials: dict[str, int]) -> NDArray[np.int32]:
    """Return the numbers of the faces' materials; -1 where a slot is empty or missing."""
    of_slots = [materials[slot.material.name] if slot.material is not None else -1 for slot in item.material_slots]
    table = np.array([*of_slots, -1], np.int32)
    # As Blender does, a face whose slot is beyond the last has the last one's material.
    return table[np.clip(slots, 0, max(len(of_slots) - 1, 0))]


def _uv(data: bpy.types.Mesh) -> dict[str, NDArray[np.float32]]:
    """Return the texture coordinates by name, the one that is rendered first."""
    found: dict[str, NDArray[np.float32]] = {}
    for layer in sorted(data.uv_layers, key=lambda each: not each.active_render):
        values = np.empty((len(data.loops), 2), np.float32)
        layer.uv.foreach_get("vector", values.ravel())
        found[layer.name] = values
    return found


def _colours(data: bpy.types.Mesh, corner_vertices: NDArray[np.int32]) -> dict[str, NDArray[np.float32]]:
    """Return the colours of corners in linear light, by name, those that are rendered first."""
    listed = list(data.color_attributes)
    first = data.color_attributes.render_color_index
    if first is not None and 0 <= first < len(listed):
        listed.insert(0, listed.pop(first))
    found: dict[str, NDArray[np.float32]] = {}
    for layer in listed:
        if layer.domain not in ("POINT", "CORNER"):
            continue
        assert isinstance(layer, bpy.types.FloatColorAttribute | bpy.types.ByteColorAttribute)
        values = np.empty((len(layer.data), 4), np.float32)
        layer.data.foreach_get("color", values.ravel())
        rgb = np.ascontiguousarray(values[:, :3])
        found[layer.name] = rgb[corner_vertices] if layer.domain == "POINT" else rgb
    return found
