# SPDX-License-Identifier: GPL-3.0-or-later
"""Import a mesh file into an empty file and write what Blender made of it into a folder.

It runs in a process of its own: the importers put all they make into the file that is open, and may end the process
where a file is damaged.
"""

import contextlib
import importlib.util
import json
import math
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, Message
from ..core.file_access import utf8_name
from ..nodes.datablocks import cycles, get_value, inputs, node_tree
from ..scenes.imported_mesh import FACES_EXCLUDED, ImportedPart, ImportedScene, write_imported
from ..scenes.mesh_formats import check_no_pipe, is_inside, leads_out
from ..scenes.polygon_mesh import Up
from .imported_materials import (
    ImportedImages,
    NonFiniteMeshError,
    UnusablePictureError,
    check_finite,
    check_image,
    finite_gltf,
    located,
    surface_of,
)
from .own_view import numbered_objects
from .scene_dependencies import add_library_folders

# Whether this Blender can read compressed glTF: the libraries for it are missing in the bpy package.


_BRIDGES = {"Draco": "bf_extern_draco", "meshopt": "bf_intern_meshopt_bridge"}


def compression_problem(kind: str) -> str:
    """Return the problem with reading meshes of a compression, Draco or meshopt; empty where there is none."""
    if not kind:
        return ""
    library = import_module("io_scene_gltf2.io.com.library")
    path = library.dll_path(_BRIDGES[kind], kind)
    if path is not None and path.is_file():
        return ""
    return f"its meshes are compressed with {kind}, which this Blender cannot read; export it without compression"


# What was imported, saved as a .blend with the lights and materials of its file.


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


# The meshes of the file that is open, as they are evaluated, and where they stand.


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


# The files that a USD file refers to, found by Pixar's library, which comes with Blender.


@dataclass(frozen=True)
class UsdInspection:
    """What is known of a USD file before it is imported.

    up: the axis that points up, None where that is not known. beside: the files that it reads beside itself, sorted.
    missing: those that are not there. unknown: why nothing is known; empty where it is.
    """

    up: Up | None
    beside: tuple[str, ...]
    missing: tuple[str, ...]
    unknown: str = ""


def inspect_usd(path: Path) -> UsdInspection:
    """Look at a USD file. Raises RuntimeError where it cannot be opened, InputError where layers lie elsewhere."""
    add_library_folders()
    if importlib.util.find_spec("pxr") is None:
        unknown = (
            "this Blender lacks the module pxr: of what the file refers to, only pictures are told apart by content"
        )
        return UsdInspection(None, (), (), unknown)
    from pxr import Tf, Usd, UsdGeom, UsdUtils  # pyright: ignore[reportMissingImports]  # found only now

    try:
        _check_layers(path)
        stage = Usd.Stage.Open(utf8_name(path))
        layers, assets, missing = UsdUtils.ComputeAllDependencies(utf8_name(path))
    except Tf.ErrorException as error:
        # Its own words may be bytes that are no text, and name files of the machine that built it.
        raise RuntimeError("USD's library cannot open it; the file is damaged: export it again") from error
    files = {layer.realPath for layer in layers} | set(assets)
    beside = {name for name in files if Path(name).is_file() and not path.samefile(name)}
    up: Up = "y" if UsdGeom.GetStageUpAxis(stage) == "Y" else "z"
    return UsdInspection(up, tuple(sorted(beside)), tuple(sorted(missing)))


def _check_layers(path: Path) -> None:
    """Raise InputError where a layer lies outside the folder of the first, or anything named is a pipe.

    Pictures that lie outside are left to their reader, who looks for them beside the mesh.
    """
    from pxr import Ar, Sdf, UsdUtils  # pyright: ignore[reportMissingImports]  # found only now

    waiting, seen = [str(path)], set[str]()
    while waiting:
        layer = waiting.pop()
        if layer in seen:
            continue
        seen.add(layer)
        sublayers, others, payloads = UsdUtils.ExtractExternalReferences(utf8_name(layer))
        for name in (*sublayers, *others, *payloads):
            outer = Ar.SplitPackageRelativePathOuter(name)[0]
            place = Path(os.path.normpath(Path(layer).parent / outer.removeprefix("file://").removeprefix("file:")))
            is_layer = name in sublayers or name in payloads or Sdf.FileFormat.FindByExtension(place.suffix) is not None
            if is_layer and not is_inside(path.parent, place):
                raise leads_out(path, "layer", name)
            check_no_pipe(path, "layer" if is_layer else "texture", place)
            if is_layer and place.is_file():
                waiting.append(str(place))


REFUSED = 4  # the exit status where the importer refuses
NOT_FINITE = 5  # where a coordinate is not finite
REFUSAL = "refused.txt"  # then says why, in the folder


class _RefusedError(Exception):
    """The file is refused; the message says why."""


def main(order: str) -> int:
    """Carry out an order; return the exit status.

    order: JSON with path, format, folder, compression and webp; blend, a file to save with the lights or null, and
    then asked, the axis that points up or null.
    """
    wanted = json.loads(order)
    folder = Path(wanted["folder"])
    try:
        write_imported(folder, _imported(wanted, Path(wanted["path"]), folder))
    except NonFiniteMeshError as error:
        return _refused(folder, str(error), NOT_FINITE)
    except InputError as error:
        return _refused(folder, Message(error.problem, error.remedy))
    except (_RefusedError, TooManyError, UnusablePictureError, RuntimeError) as error:  # the last is Blender's own
        return _refused(folder, str(error))
    return 0


def _beside(mesh_folder: Path, inspected: UsdInspection) -> tuple[str, ...]:
    """Return the files that a USD file reads, sorted: layers, and pictures where they are taken from."""
    found = {name for name in inspected.beside if is_inside(mesh_folder, Path(name))}
    for image in bpy.data.images:
        if image.source == "FILE" and image.packed_file is None:
            with contextlib.suppress(UnusablePictureError):  # which is said where it is shown
                found.add(str(located(mesh_folder, image)))
    return tuple(sorted(found))


def _refused(folder: Path, why: str, status: int = REFUSED) -> int:
    # Not on standard output, where Blender leaves lines unended.
    (folder / REFUSAL).write_text(why, encoding="utf-8", errors="backslashreplace")
    return status


def _imported(wanted: dict[str, Any], path: Path, folder: Path) -> ImportedScene:
    """Return what Blender made of a file, without its parts where it was saved with its lights."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    for world in list(bpy.data.worlds):
        bpy.data.worlds.remove(world)  # of which only the file's own is to shine
    form = wanted["format"]
    how = _FORMATS[form]
    module, _, operator = how.operator.partition(".")
    if operator not in dir(getattr(bpy.ops, module)):
        raise _RefusedError(f"this Blender is built without an importer of {form}; export the mesh as PLY or glTF")
    inspected = inspect_usd(path) if form == "USD" else UsdInspection(how.up, (), ())
    if inspected.missing:
        raise _RefusedError(f"refers to {inspected.missing[0][:200]!r}, which is not there")
    if problem := compression_problem(wanted["compression"]):
        raise _RefusedError(problem)
    asked = {name: (wanted | {"lit": wanted["blend"] is not None})[key] for name, key in how.ordered.items()}
    with finite_gltf() if form == "glTF" else contextlib.nullcontext():
        getattr(getattr(bpy.ops, module), operator)(filepath=utf8_name(path), **how.options, **asked)
    excluded = _validate_meshes()
    notes = _still()
    if excluded and form in ("USD", "FBX"):  # of other formats, the file says how many faces there are
        notes += (f"{excluded} {FACES_EXCLUDED}",)
    beside = _beside(path.parent, inspected) if form == "USD" else ()
    if wanted["blend"] is not None:
        if problem := save_lit(Path(wanted["blend"]), inspected.up, wanted["asked"], path.parent):
            raise _RefusedError(problem)
        return ImportedScene((), (), (), inspected.up, beside, notes, numbered_objects(bpy.data.objects))
    images = ImportedImages(folder, path.parent)
    materials = sorted(bpy.data.materials, key=lambda each: each.name)
    parts = imported_parts({material.name: number for number, material in enumerate(materials)})
    used = {number for part in parts for number in part.face_surfaces.tolist()}
    surfaces = tuple(
        surface_of(material, images.number_of if number in used else lambda _: 0)
        for number, material in enumerate(materials)
    )
    all_notes = (*notes, *images.notes, *([inspected.unknown] if inspected.unknown else []))
    return ImportedScene(parts, surfaces, tuple(images.images), inspected.up, beside, all_notes)


def _validate_meshes() -> int:
    """Repair the meshes as the importers would, once it is sure that they are finite: a repair puts 0 for what is not.

    Returns how many faces went. glTF's importer validates each mesh itself, and is watched while it does.
    """
    for mesh in bpy.data.meshes:
        check_finite(mesh)
    count = sum(len(mesh.polygons) for mesh in bpy.data.meshes)
    for mesh in bpy.data.meshes:
        mesh.validate(clean_customdata=False)
    return count - sum(len(mesh.polygons) for mesh in bpy.data.meshes)


def _still() -> tuple[str, ...]:
    """Take the animation away, so that all stands as the file places it; return the note that says so."""
    moving = [item for item in bpy.data.objects if item.animation_data is not None]
    for item in moving:
        item.animation_data_clear()
    return (f"{len(moving)} of its objects are animated: shown as they stand without that",) if moving else ()


@dataclass(frozen=True)
class _Format:
    """How Blender imports files of a format: vertices as they are stored, unless it has to know better.

    operator: of `bpy.ops`. up: the axis that is taken for up, None where the file itself decides. options: of the
    operator. ordered: those that are as the order says.
    """

    operator: str
    up: Up | None
    options: Mapping[str, Any]
    ordered: Mapping[str, str] = field(default_factory=dict)


_FORMATS = {
    "glTF": _Format(
        "import_scene.gltf",
        "y",
        {"disable_bone_shape": True, "import_select_created_objects": False},
        {"import_webp_texture": "webp"},
    ),
    "OBJ": _Format("wm.obj_import", "z", {"forward_axis": "Y", "up_axis": "Z", "validate_meshes": False}),
    "STL": _Format("wm.stl_import", "z", {"use_mesh_validate": False}),
    "FBX": _Format("wm.fbx_import", None, {"use_anim": False, "validate_meshes": False}),
    "USD": _Format(
        "wm.usd_import", None, {"import_cameras": False, "validate_meshes": False}, {"import_lights": "lit"}
    ),
}

if __name__ == "__main__":
    sys.exit(main(sys.argv[-1]))
