# SPDX-License-Identifier: GPL-3.0-or-later
"""Import a mesh file into an empty file and write what Blender made of it into a folder.

It runs in a process of its own: the importers put all they make into the file that is open, and may end the process
where a file is damaged.
"""

import contextlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import InputError
from ...core.messages import Message
from ...core.scenes.beside import is_inside
from ...core.scenes.imported import FACES_EXCLUDED, ImportedScene, write_imported
from ...core.scenes.turning import Up
from ...core.utf8_names import utf8_name
from ..scene_objects import numbered_objects
from .base_colour import surface_of
from .compressed import compression_problem
from .finite import NonFiniteMeshError, check_finite, finite_gltf
from .images import ImageFiles, UnusablePictureError, located
from .lit import save_lit
from .parts import TooManyError, imported_parts
from .usd_layers import UsdInspection, inspect_usd

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
    module, operator = _OPERATORS[form]
    if operator not in dir(getattr(bpy.ops, module)):
        raise _RefusedError(f"this Blender is built without an importer of {form}; export the mesh as PLY or glTF")
    inspected = inspect_usd(path) if form == "USD" else UsdInspection(_UP[form], (), ())
    if inspected.missing:
        raise _RefusedError(f"refers to {inspected.missing[0][:200]!r}, which is not there")
    if problem := compression_problem(wanted["compression"]):
        raise _RefusedError(problem)
    _IMPORTERS[form](str(path), wanted["webp"], wanted["blend"] is not None)
    excluded = _validate_meshes()
    notes = _still()
    if excluded and form in ("USD", "FBX"):  # of other formats, the file says how many faces there are
        notes += (f"{excluded} {FACES_EXCLUDED}",)
    beside = _beside(path.parent, inspected) if form == "USD" else ()
    if wanted["blend"] is not None:
        if problem := save_lit(Path(wanted["blend"]), inspected.up, wanted["asked"], path.parent):
            raise _RefusedError(problem)
        return ImportedScene((), (), (), inspected.up, beside, notes, numbered_objects(bpy.data.objects))
    images = ImageFiles(folder, path.parent)
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


def _gltf(path: str, webp: bool, _lit: bool) -> None:
    with finite_gltf():
        bpy.ops.import_scene.gltf(
            filepath=utf8_name(path),
            import_webp_texture=webp,
            disable_bone_shape=True,
            import_select_created_objects=False,
        )


def _obj(path: str, _webp: bool, _lit: bool) -> None:
    bpy.ops.wm.obj_import(filepath=utf8_name(path), forward_axis="Y", up_axis="Z", validate_meshes=False)  # as stored


def _stl(path: str, _webp: bool, _lit: bool) -> None:
    bpy.ops.wm.stl_import(filepath=utf8_name(path), use_mesh_validate=False)  # as stored


def _fbx(path: str, _webp: bool, _lit: bool) -> None:
    bpy.ops.wm.fbx_import(filepath=utf8_name(path), use_anim=False, validate_meshes=False)


def _usd(path: str, _webp: bool, lit: bool) -> None:
    bpy.ops.wm.usd_import(filepath=utf8_name(path), import_cameras=False, import_lights=lit, validate_meshes=False)


_IMPORTERS: dict[str, Callable[[str, bool, bool], None]] = {
    "glTF": _gltf,
    "OBJ": _obj,
    "STL": _stl,
    "FBX": _fbx,
    "USD": _usd,
}

_OPERATORS = {
    "glTF": ("import_scene", "gltf"),
    "OBJ": ("wm", "obj_import"),
    "STL": ("wm", "stl_import"),
    "FBX": ("wm", "fbx_import"),
    "USD": ("wm", "usd_import"),
}
_UP: dict[str, Up | None] = {"glTF": "y", "OBJ": "z", "STL": "z", "FBX": None, "USD": None}

if __name__ == "__main__":
    sys.exit(main(sys.argv[-1]))
