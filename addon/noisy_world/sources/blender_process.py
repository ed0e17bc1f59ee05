# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that Blender reads in a process of its own, within limits: meshes of other formats, and a .blend's scene.

The one way in which Blender reads a file that somebody gave: in a process of its own, within limits.

Its readers may end the process where a file is damaged, take hours, more memory than there is, or wait for what never
comes. Each of these is a line that names the file. The process is this Blender where there is one, else this Python
with the bpy package.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, MissingDependencyError
from ..core.file_access import ScratchFolder, check_regular, read_text, utf8_name
from ..core.packages import blender_missing
from ..core.schema import ConfigPath
from ..core.srgb import exact_light
from ..preset.names import FrameRange
from ..scenes.blend_scene import OwnScene
from ..scenes.gltf import read_gltf_header
from ..scenes.imported_mesh import FACES_EXCLUDED, ImportedScene, ImportedSurface, joined, listed, read_imported
from ..scenes.mesh_files import (
    check_mesh,
    check_numbers,
    declared_faces,
    imported_format,
    materials_of_obj,
    missing_libraries,
    odd_number,
    referenced_files,
)
from ..scenes.mesh_formats import link_notes
from ..scenes.polygon_mesh import NEUTRAL_GREY, Mesh, SceneObject, Up, turned
from ..scenes.textures import read_picture

# Chosen: twenty times what a file of a million triangles takes.
LIMIT_S, LIMIT_FOR_EACH_MB_S = 120, 5
IDLE_S = 30.0  # chosen: a process that does nothing for so long waits for a pipe, or a disk that is gone
_LOOK_S = 2.0
DAMAGED = "the file is damaged, or takes more memory than there is: export or save it again"


def processor_limit_s(files: Iterable[Path]) -> int:
    """Return how many seconds of a processor Blender may take to read files."""
    return LIMIT_S + LIMIT_FOR_EACH_MB_S * sum(file.stat().st_size for file in files) // 10**6


def run_blender(
    command: list[str], file: Path, *, who: str, limit_s: int, order: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run a command that has Blender read a file, and return how it ended.

    who: what reads it, in words. limit_s: what the command has been told of its processor's time. order: goes to its
    standard input. Raises InputError where it went over a limit, or a signal ended it.
    """
    started = subprocess.Popen(  # noqa: S603 - this program
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
    )
    with started:
        try:
            out, err = _said(started, order)
        except BaseException as error:
            started.kill()
            if not isinstance(error, TimeoutError):
                raise
            problem = f"{who} waits for what never comes, a pipe or a disk that is away"
            raise InputError(file, problem, remedy="see that all it names are files that can be read") from None
    ended_by = -started.returncode if started.returncode < 0 else started.returncode - 128  # the latter by a shell
    if ended_by > 0:
        raise _ended(file, who, ended_by, limit_s)
    return subprocess.CompletedProcess(command, started.returncode, out, err)


@contextmanager
def last_words(file: Path, doing: str) -> Iterator[None]:
    """Have a line stand on standard error where this process is ended by a signal while Blender does something here.

    file: that it does it with. A shell waits for a word that says that all went on, or for the end of this process.
    """
    if os.name != "posix":
        yield
        return
    line = InputError(file, f"Blender was ended while it {doing}", remedy=DAMAGED)
    shell = ["/bin/sh", "-c", 'read -r word || printf "%s\\n" "$1" >&2', "sh", str(line)]
    watcher = subprocess.Popen(shell, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)  # noqa: S603 - text alone
    try:
        yield
    finally:
        watcher.communicate(b"goes on\n")


def _said(started: "subprocess.Popen[str]", order: str) -> tuple[str, str]:
    """Return what a process says until it ends. Raises TimeoutError where it does nothing any more."""
    spent, since = _spent(started.pid), time.monotonic()
    asked: str | None = order
    while True:
        try:
            return started.communicate(asked, timeout=_LOOK_S)
        except subprocess.TimeoutExpired:
            asked = None  # it has been told
        if (now := _spent(started.pid)) != spent:
            spent, since = now, time.monotonic()
        elif spent is not None and time.monotonic() - since > IDLE_S:
            raise TimeoutError


def _spent(number: int) -> tuple[int, int] | None:
    """Return the time of a processor that a process has taken, in ticks; None where the system does not tell."""
    try:
        words = read_text(Path(f"/proc/{number}/stat")).rpartition(")")[2].split()
        return int(words[11]), int(words[12])
    except (OSError, ValueError, IndexError):
        return None


def _ended(file: Path, who: str, number: int, limit_s: int) -> InputError:
    if hasattr(signal, "SIGXCPU") and number == signal.SIGXCPU:
        problem = f"{who} takes more than {limit_s} s of a processor for it"
        return InputError(file, problem, remedy="its copies may be too many: export it as one mesh")
    name = signal.Signals(number).name if number in set(signal.Signals) else f"signal {number}"
    problem = f"{who} was ended by {name}"
    if os.name == "posix" and number == signal.SIGKILL:
        return InputError(file, f"{problem}, perhaps for want of memory", remedy="run it where there is more memory")
    return InputError(file, problem, remedy=DAMAGED)


def as_installed(module: str) -> str:
    """Return the name under which a process finds a module of ours, whose package an extension names otherwise."""
    return ".".join([Path(__file__).resolve().parents[1].name, *module.split(".")[1:]])


# Meshes of the formats that Blender's importers read, imported in a process of its own.
#
# The importers replace or fill the file that is open, and may end the process where a file is damaged. The process is
# this Blender where there is one, else this Python with the bpy package.


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
        lines = [*link_notes(path, [*referenced_files(path), *beside]), *_excluded(path, mesh)]
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
    light = float(exact_light(np.float64(NEUTRAL_GREY)))
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
    return (*scene.notes, *link_notes(path, [*referenced_files(path), *map(Path, scene.beside)])), scene.objects


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
        "limit_s": processor_limit_s((path, *referenced_files(path))),
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
        f"from {as_installed('noisy_world.render.import_program')} import main\n"
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


# Inspects a .blend in another process, so that this one keeps the file that it has open.


MARK = "@scene "
PACKAGE = Path(__file__).resolve().parents[1]
# Last on the path, so that what the program brings comes first: this package, and those that it was given.
CODE = """
import sys
sys.path += [folder for folder in {folders!r} if folder not in sys.path]
import bpy
from {module} import main
main({argument})
"""


_INSPECTIONS: dict[tuple[Path, str], tuple[list[tuple[int, int] | None], dict[str, Any]]] = {}


def inspect_blend(
    path: Path,
    place: ConfigPath,
    *,
    scene: str | None,
    camera: str | None,
    frames: FrameRange | None,
    needs_path: bool,
    lens_given: bool,
    composited: bool = False,
    softened: bool = False,
) -> OwnScene:
    """Return what a scene of a .blend says of itself; a look is remembered until a file of the scene changes.

    needs_path: whether its camera's path is asked for. lens_given: whether the preset gives the intrinsics. composited:
    whether the .blend's own compositor is kept. softened: whether its sun lamps are. Raises InputError
    naming the preset's key where it cannot be a source.
    """
    chosen = None if frames is None else (frames.first, frames.last, frames.step)
    request = {
        "scene": scene,
        "camera": camera,
        "frames": chosen,
        "path": needs_path,
        "lens_given": lens_given,
        "composited": composited,
        "softened": softened,
    }
    answer = _inspected(path.absolute(), json.dumps(request))
    if "unreadable" in answer:
        raise place.at("blend").error(f"{path.name} is no file that Blender reads: {answer['unreadable']}")
    if "scenes" in answer:
        names = ", ".join(answer["scenes"])
        raise place.at("scene").error(f"{path.name} has no scene {scene!r}", f"its scenes: {names}")
    found = OwnScene.of(answer["found"])
    for file in found.files:
        utf8_name(file)
    for item in found.problems:
        raise place.at(item.key).error(f"{path.name}: {item.problem}", item.remedy)
    return found


def _inspected(path: Path, request: str) -> dict[str, Any]:
    if (kept := _INSPECTIONS.get((path, request))) is not None and kept[0] == _changed(path, kept[1]):
        return kept[1]
    try:
        check_regular(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    limit_s = processor_limit_s([path])
    asked = {**json.loads(request), "file": utf8_name(path), "limit_s": limit_s}
    ran = run_blender(inspection_command(), path, who="Blender", limit_s=limit_s, order=json.dumps(asked))
    answers = [line for line in ran.stdout.splitlines() if line.startswith(MARK)]
    if "No module named 'bpy'" in ran.stderr:
        raise MissingDependencyError(blender_missing("a .blend", otherwise="start this in a Blender program"))
    if ran.returncode != 0 or not answers:
        raise RuntimeError(f"the look at {path} ended with status {ran.returncode}: {ran.stderr[-2000:]}")
    answer = json.loads(answers[-1].removeprefix(MARK))
    if "found" in answer and not answer["found"]["problems"]:  # what was wrong may be mended elsewhere
        _INSPECTIONS[path, request] = (_changed(path, answer), answer)
    return answer


def _changed(path: Path, answer: dict[str, Any]) -> list[tuple[int, int] | None]:
    """Return when the .blend and each file of a look was changed, and its size; None for one that is gone."""
    stats = [file.stat() if file.exists() else None for file in (path, *map(Path, answer["found"]["files"]))]
    return [None if item is None else (item.st_mtime_ns, item.st_size) for item in stats]


def inspection_command() -> list[str]:
    """Return the command that looks at a .blend."""
    return background_command("noisy_world.render.scene_inspection")


def background_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs `main` of one of our modules: this program, without a person's preferences."""
    argument = ", ".join(map(repr, arguments))
    folders = [str(PACKAGE.parent), *filter(None, sys.path)]
    code = CODE.format(folders=folders, module=as_installed(module), argument=argument)
    bpy = sys.modules.get("bpy")
    binary = "" if bpy is None else bpy.app.binary_path
    if not binary:
        return [sys.executable, "-c", code]
    return [binary, "-b", "--factory-startup", "-Y", "--python-exit-code", "1", "--python-expr", code]
