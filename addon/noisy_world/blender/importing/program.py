# SPDX-License-Identifier: GPL-3.0-or-later
"""Import a mesh file into an empty file and write what Blender made of it into a folder.

It runs in a process of its own: the importers put all they make into the file that is open, and may end the process
where a file is damaged.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import bpy

from ...core.scenes.imported import ImportedScene, write_imported
from ...core.scenes.turning import Up
from .base_colour import surface_of
from .compressed import compression_problem
from .images import ImageFiles, MissingImageError
from .lit import save_lit
from .parts import imported_parts
from .usd_layers import look_at

REFUSED = 4  # the exit status where the importer refuses
REFUSAL = "refused.txt"  # then says why, in the folder


def main(order: str) -> int:
    """Carry out an order; return the exit status.

    order: JSON with path, format, folder, compression and webp; blend, a file to save with the lights or null, and
    then asked, the axis that points up or null.
    """
    wanted = json.loads(order)
    path, folder = Path(wanted["path"]), Path(wanted["folder"])
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    for world in list(bpy.data.worlds):
        bpy.data.worlds.remove(world)  # of which only the file's own is to shine
    beside: tuple[str, ...] = ()
    up, look = _UP[wanted["format"]], None
    module, operator = _OPERATORS[wanted["format"]]
    if operator not in dir(getattr(bpy.ops, module)):
        return _refused(
            folder, f"this Blender is built without an importer of {wanted['format']}; export the mesh as PLY or glTF"
        )
    try:
        if wanted["format"] == "USD":
            look = look_at(path)
            if look.missing:
                return _refused(folder, f"refers to {look.missing[0][:200]!r}, which is not there")
            up, beside = look.up, look.beside
        if problem := compression_problem(wanted["compression"]):
            return _refused(folder, problem)
        _IMPORTERS[wanted["format"]](str(path), wanted["webp"], wanted["blend"] is not None)
        notes = _still()
        if wanted["blend"] is not None:
            if problem := save_lit(Path(wanted["blend"]), up, wanted["asked"]):
                return _refused(folder, problem)
            write_imported(folder, ImportedScene((), (), (), up, beside, notes))
            return 0
        images = ImageFiles(folder)
        materials = sorted(bpy.data.materials, key=lambda each: each.name)
        parts = imported_parts({material.name: number for number, material in enumerate(materials)})
        used = {number for part in parts for number in part.face_surfaces.tolist()}
        surfaces = [
            surface_of(material, images.number_of if number in used else lambda _: 0)
            for number, material in enumerate(materials)
        ]
        if look is not None and look.unknown:
            beside, notes = images.read, (*notes, look.unknown)
    except MissingImageError as error:
        return _refused(folder, f"its texture {str(error)[:200]!r} is missing")
    except RuntimeError as error:  # so Blender says that an operator failed
        return _refused(folder, str(error))
    write_imported(folder, ImportedScene(parts, tuple(surfaces), tuple(images.images), up, beside, notes))
    return 0


def _refused(folder: Path, why: str) -> int:
    # Not on standard output, where Blender leaves lines unended.
    (folder / REFUSAL).write_text(why, encoding="utf-8")
    return REFUSED


def _still() -> tuple[str, ...]:
    """Take the animation away, so that all stands as the file places it; return the note that says so."""
    moving = [item for item in bpy.data.objects if item.animation_data is not None]
    for item in moving:
        item.animation_data_clear()
    return (f"{len(moving)} of its objects are animated: shown as they stand without that",) if moving else ()


def _gltf(path: str, webp: bool, _lit: bool) -> None:
    bpy.ops.import_scene.gltf(
        filepath=path, import_webp_texture=webp, disable_bone_shape=True, import_select_created_objects=False
    )


def _obj(path: str, _webp: bool, _lit: bool) -> None:
    bpy.ops.wm.obj_import(filepath=path, forward_axis="Y", up_axis="Z")  # as stored


def _stl(path: str, _webp: bool, _lit: bool) -> None:
    bpy.ops.wm.stl_import(filepath=path)  # as stored


def _fbx(path: str, _webp: bool, _lit: bool) -> None:
    bpy.ops.wm.fbx_import(filepath=path, use_anim=False)


def _usd(path: str, _webp: bool, lit: bool) -> None:
    bpy.ops.wm.usd_import(filepath=path, import_cameras=False, import_lights=lit, validate_meshes=True)


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
