# SPDX-License-Identifier: GPL-3.0-or-later
"""Sources of clean frames, one file for each; `core.planning.source` is their protocol.

Here: the scenes of a preset, whose files are found and checked before anything is loaded.
"""

import glob
import re
from pathlib import Path

from ..core.home import located, path_in
from ..core.planning.source import Scene, Source
from ..core.presets.preset import Preset, SceneSpec
from ..core.scenes.embedded import EMBEDDED_ROOM, MEANT, is_embedded, room_name, room_seeds
from ..core.scenes.ply import check_ply
from ..core.schema import Place, shown
from .mesh import MeshSource, read_path
from .recording import read_recording
from .wildcards import matched_parts


def find_scenes(preset: Preset) -> list[Scene]:
    """Return the scenes of a preset; an entry is one scene, or as many as its wildcards match.

    Raises InputError for files that are missing or wrong.
    """
    return [scene for index, spec in enumerate(preset.spec.scenes) for scene in _find(preset, index, spec)]


def _find(preset: Preset, index: int, spec: SceneSpec) -> list[Scene]:
    place = preset.place(f"scenes.{index}")
    if spec.mesh is not None and is_embedded(spec.mesh):
        return _embedded(preset, place, spec, spec.mesh)
    kind, kinds = ("mesh", "meshes") if spec.sequence is None else ("sequence", "sequences")
    pattern = spec.mesh if spec.sequence is None else spec.sequence
    assert pattern is not None
    make = _mesh_scene if kind == "mesh" else _recorded_scene
    if not glob.has_magic(pattern) or path_in(preset.path.parent, pattern, place.at(kind)).exists():
        path = _found(preset, place.at(kind), pattern, folder=kind == "sequence")
        return [make(preset, place, spec, spec.name or path.stem, path)]
    folder, pattern = located(preset.path.parent, pattern, place.at(kind))
    found = sorted(glob.glob(pattern, root_dir=folder))  # noqa: PTH207 - takes absolute patterns too
    if kind == "sequence":  # files lie beside sequences: cam_params.json, manifest.json, overview.png
        found = [text for text in found if not (folder / text).is_file()]
    if not found:
        raise place.at(kind).error(f"no {'file' if kind == 'mesh' else 'folder'} matches {pattern!r} beside the preset")
    if spec.name and "*" not in spec.name and len(found) > 1:
        raise place.at("name").error(f"is {spec.name!r}, but {len(found)} {kinds} match", "put a * where they differ")
    scenes = []
    for text in found:
        parts = matched_parts(pattern, text)
        name = _filled(spec.name, parts, place.at("name")) if spec.name else "_".join(parts)
        scenes.append(make(preset, place, spec, name, folder / text, parts=parts))
    return scenes


def _embedded(preset: Preset, place: Place, spec: SceneSpec, mesh: str) -> list[Scene]:
    try:
        seeds = room_seeds(mesh)
    except ValueError as error:
        raise place.at("mesh").error(str(error), MEANT) from error
    if spec.name and "*" not in spec.name and len(seeds) > 1:
        raise place.at("name").error(f"is {spec.name!r}, but {len(seeds)} rooms match", "put a * where they differ")
    scenes = []
    for seed in seeds:
        parts = () if mesh == EMBEDDED_ROOM else (str(seed),)
        name = _filled(spec.name, parts, place.at("name")) if spec.name else room_name(mesh, seed)
        scenes.append(_mesh_scene(preset, place, spec, name, None, parts=parts, room=seed))
    return scenes


def _recorded_scene(
    preset: Preset, place: Place, spec: SceneSpec, name: str, path: Path, *, parts: tuple[str, ...] = ()
) -> Scene:
    del preset, parts
    return _scene(name, place, read_recording(path, place, spec.rate_hz))


def _mesh_scene(
    preset: Preset,
    place: Place,
    spec: SceneSpec,
    name: str,
    mesh_path: Path | None,
    *,
    parts: tuple[str, ...] = (),
    room: int = 0,
) -> Scene:
    _check_name(name, place)
    assert spec.trajectory is not None
    if mesh_path is not None:
        check_ply(mesh_path)  # the header only: its errors need not wait until earlier scenes are rendered
    seed, where = preset.spec.seed, place.at("trajectory")
    if spec.trajectory.file is None:
        return _scene(name, place, MeshSource(name, place, mesh_path, spec.trajectory, None, None, seed, room))
    text = _filled(spec.trajectory.file, parts, where) if "*" in spec.trajectory.file else spec.trajectory.file
    path = _found(preset, where, text, folder=None)
    chosen, read_as = read_path(path, spec.trajectory, where, preset.spec.mesh_camera.intrinsics)
    return _scene(name, place, MeshSource(name, place, mesh_path, read_as, path, chosen, seed, room))


def _scene(name: str, place: Place, source: Source) -> Scene:
    _check_name(name, place)
    return Scene(name, place, source)


def _check_name(name: str, place: Place) -> None:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name):
        raise place.at("name").error(f"{name!r} cannot name a folder", "give a name")


def _found(preset: Preset, place: Place, text: str, *, folder: bool | None = False) -> Path:
    """Return the path of a file or a folder that exists; folder: None where it may be either."""
    path = path_in(preset.path.parent, text, place)
    kind = "folder" if folder else "file"
    try:
        there = path.is_dir() if folder else path.is_file() or (folder is None and path.is_dir())
    except OSError as error:  # a name that is too long, for instance
        raise place.error(f"{shown(text)} cannot be a {kind}: {error.strerror}") from error
    if not there:
        raise place.error(f"no such {kind}: {path}", "paths are relative to the preset")
    return path


def _filled(template: str, parts: tuple[str, ...], place: Place) -> str:
    """Replace each wildcard of a text by what the mesh's wildcards matched, in order."""
    if template.count("*") > len(parts):
        raise place.error(f"{template!r} has more * than mesh has wildcards")
    for part in parts:
        template = template.replace("*", part, 1)
    return template
