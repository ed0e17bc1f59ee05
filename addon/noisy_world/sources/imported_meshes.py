# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of the formats that Blender's importers read, imported in a process of its own.

The importers replace or fill the file that is open, and may end the process where a file is damaged. The process is
this Blender where there is one, else this Python with the bpy package.
"""

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, MissingDependencyError
from ..core.extras import blender_missing
from ..core.regular_files import read_text
from ..core.scenes.beside import link_notes
from ..core.scenes.gltf_file import read_gltf_header
from ..core.scenes.imported import FACES_EXCLUDED, ImportedScene, ImportedSurface, read_imported
from ..core.scenes.joining import joined, listed
from ..core.scenes.mesh import NEUTRAL_GREY, Mesh
from ..core.scenes.mesh_files import (
    check_mesh,
    check_numbers,
    declared_faces,
    files_beside,
    imported_format,
    odd_number,
)
from ..core.scenes.obj_file import materials_of_obj, missing_libraries
from ..core.scenes.scene_object import SceneObject
from ..core.scenes.srgb import decoded
from ..core.scenes.textures import read_picture
from ..core.scenes.turning import Up, turned
from ..core.scratch import ScratchFolder
from ..core.utf8_names import utf8_name
from .blender_process import as_installed, processor_limit_s, run_blender

REFUSED, NOT_FINITE, REFUSAL = 4, 5, "refused.txt"  # as blender.importing.program ends, and where it says why
_ROOM_FOR_EACH_BYTE = 8  # chosen: arrays in scratch memory take more than the file


@dataclass(frozen=True)
class Imported:
    """A mesh that was imported, and the files beside its own that were read for it and only the importer knows."""

    mesh: Mesh
    beside: tuple[Path, ...]


def import_mesh(path: Path, up: Up | None = None) -> Imported:
    """Import a mesh file that is not a PLY, Z up. up: the axis of the file that does; None is what it declares.

    Raises InputError where the file is missing, damaged, no mesh, packed in a way that this Blender cannot read, or
    lacks a texture; MissingDependencyError where there is no Blender.
    """
    scratch = ScratchFolder(_ROOM_FOR_EACH_BYTE * path.stat().st_size)
    try:
        scene = _import(path, scratch.path)
        pictures: dict[int, NDArray[np.uint8]] = {}

        def picture(number: int) -> NDArray[np.uint8]:
            if number not in pictures:
                with _named(path, scene.images[number].name):
                    pictures[number] = read_picture(scratch.path / scene.images[number].file)[0]
            return pictures[number]

        scene = _with_grey(path, scene)
        mesh = joined(path, scene, picture)
        beside = tuple(map(Path, scene.beside))
        lines = [*link_notes(path, [*files_beside(path), *beside]), *_excluded(path, mesh)]
        mesh = replace(mesh, notes=(*mesh.notes, *lines))
        return Imported(mesh if up is None else _turned(path, mesh, scene, up), beside)
    finally:
        scratch.remove()


def _with_grey(path: Path, scene: ImportedScene) -> ImportedScene:
    """Return a scene in which what no MTL file defines is neutral grey, with a note; Blender has a white of its own."""
    found = imported_format(path)
    if found is None or found.name != "OBJ":
        return scene
    defined = materials_of_obj(path)
    grey = [surface for surface in scene.surfaces if surface.name not in defined]
    if not grey:
        return scene
    light = float(decoded(np.float64(NEUTRAL_GREY)))
    surfaces = tuple(
        surface if surface.name in defined else ImportedSurface(surface.name, (light, light, light))
        for surface in scene.surfaces
    )
    missing = missing_libraries(path)
    if missing:
        what = f"its materials {missing[0].name[:200]!r} are missing in {str(missing[0].parent)[:300]}"
    else:
        what = f"no MTL file defines its materials {listed([surface.name for surface in grey])}"
    return replace(scene, surfaces=surfaces, notes=(*scene.notes, f"{what}: neutral grey is shown for them"))


def _excluded(path: Path, mesh: Mesh) -> list[str]:
    """Return a note where Blender left faces of a file out."""
    listed = declared_faces(path)
    if listed is None or listed <= len(mesh.face_starts):
        return []
    return [f"{listed - len(mesh.face_starts)} of {listed} {FACES_EXCLUDED}"]


def write_lit_file(path: Path, blend: Path, up: Up | None = None) -> tuple[tuple[str, ...], tuple[SceneObject, ...]]:
    """Import a mesh file that is not a PLY, and save what Blender made of it, lights and materials too, as a .blend.

    Returns what a user should know, and its objects. Raises as import_mesh does, and InputError where the file holds no
    lights.
    """
    scene = _import(path, blend.parent, blend=str(blend), asked=up)
    return (*scene.notes, *link_notes(path, [*files_beside(path), *map(Path, scene.beside)])), scene.objects


def _import(path: Path, folder: Path, **more: object) -> ImportedScene:
    """Import a file in another process, which writes into a folder. more: of the order."""
    found = imported_format(path)
    assert found is not None, "we read PLY"
    check_mesh(path)
    check_numbers(path)
    header = read_gltf_header(path) if found.name == "glTF" else None
    order = {
        "path": utf8_name(path.absolute()),
        "folder": utf8_name(folder),
        "format": found.name,
        "compression": "" if header is None else header.compression,
        "webp": header is not None and header.webp,
        "blend": None,
        "limit_s": processor_limit_s((path, *files_beside(path))),
        **more,
    }
    return _run(path, order, folder)


def _turned(path: Path, mesh: Mesh, scene: ImportedScene, up: Up) -> Mesh:
    if scene.up is None:
        problem = "states its own axes, and is turned by them, so up cannot be said of it"
        raise InputError(path, problem, remedy="leave up out, or export the mesh as glTF")
    return turned(mesh, scene.up, up)


def _run(path: Path, order: dict[str, object], folder: Path) -> ImportedScene:
    """Have another process import the file; return what it wrote. Raises InputError where it did not."""
    asked = _asked(order)
    said = folder / REFUSAL
    if asked.returncode == NOT_FINITE and said.is_file():
        raise odd_number(path, read_text(said))
    if asked.returncode == REFUSED and said.is_file():
        raise InputError(path, _one_sentence(read_text(said)))
    scene = read_imported(folder)
    if asked.returncode == 0 and scene is not None:
        return scene
    raise RuntimeError(f"importing {path} ended with status {asked.returncode}\n{asked.stdout}\n{asked.stderr}")


def _asked(order: dict[str, object]) -> subprocess.CompletedProcess[str]:
    """Have another process carry out an order. Raises InputError where it goes over a limit, or a signal ends it."""
    limit_s = int(str(order["limit_s"]))
    command, path = _command(json.dumps(order), limit_s), Path(str(order["path"]))
    return run_blender(command, path, who=f"Blender's importer of {order['format']}", limit_s=limit_s)


def _one_sentence(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()] or ["it says nothing"]
    if "Traceback" in lines[0]:  # an importer written in Python fails where it did not expect to
        last = next(line for line in reversed(lines) if not line.startswith("Location:"))
        return f"Blender's importer fails on it: {last[:200]}; the file is damaged: export it again"
    return lines[0].removeprefix("Error: ")[:400]


def _command(order: str, limit_s: int) -> list[str]:
    """Return the command of the process that imports. Raises MissingDependencyError where there is no Blender."""
    package = Path(__file__).resolve().parents[1]
    program = (
        f"import sys; sys.path.append({str(package.parent)!r})\n"
        f"from {as_installed('noisy_world.core.machine')} import limit_process\n"
        f"limit_process({limit_s})\n"
        f"from {as_installed('noisy_world.blender.importing.program')} import main\n"
        f"sys.exit(main({order!r}))"
    )
    binary = sys.modules["bpy"].app.binary_path if sys.modules.get("bpy") is not None else ""
    if binary:
        return [binary, "-b", "--factory-startup", "--python-exit-code", "1", "--python-expr", program]
    if problem := blender_missing("a mesh that Blender's importers read", otherwise="export the mesh as PLY"):
        raise MissingDependencyError(problem)
    return [sys.executable, "-c", program]


@contextlib.contextmanager
def _named(path: Path, name: str) -> Iterator[None]:
    """Say of an image's error which image of which mesh it is, rather than the name of a scratch file."""
    try:
        yield
    except InputError as error:
        raise InputError(path, f"its texture {name[:200]!r} {error.problem}", remedy=error.remedy) from error
