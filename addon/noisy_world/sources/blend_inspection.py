# SPDX-License-Identifier: GPL-3.0-or-later
"""Inspects a .blend in another process, so that this one keeps the file that it has open."""

import json
import sys
from pathlib import Path
from typing import Any

from ..core.errors import InputError, MissingDependencyError
from ..core.extras import blender_missing
from ..core.presets.frame_range import FrameRange
from ..core.regular_files import check_regular
from ..core.scenes.own_scene import OwnScene
from ..core.schema import ConfigPath
from ..core.utf8_names import utf8_name
from .blender_process import as_installed, processor_limit_s, run_blender

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
) -> OwnScene:
    """Return what a scene of a .blend says of itself; a look is remembered until a file of the scene changes.

    needs_path: whether its camera's path is asked for. lens_given: whether the preset gives the intrinsics. composited:
    whether the .blend's own compositor is kept. Raises InputError naming the preset's key where it cannot be a source.
    """
    chosen = None if frames is None else (frames.first, frames.last, frames.step)
    request = {
        "scene": scene,
        "camera": camera,
        "frames": chosen,
        "path": needs_path,
        "lens_given": lens_given,
        "composited": composited,
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
    return background_command("noisy_world.blender.scene_inspection")


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
