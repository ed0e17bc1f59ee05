# SPDX-License-Identifier: GPL-3.0-or-later
"""Sources of clean frames, one file for each; `core.planning.source` is their protocol.

Here: the scenes of a preset, whose files are found and checked before anything is loaded.
"""

import glob
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.datasets.layouts.recorded import MILLIMETRES
from ..core.home import located, path_in
from ..core.planning.source import Scene, Source
from ..core.presets.preset import Preset
from ..core.presets.scene_keys import SceneSpec, TrajectorySpec
from ..core.presets.selection import selected
from ..core.scenes.embedded import EMBEDDED_ROOM, MEANT, is_embedded, room_name, room_seeds
from ..core.scenes.replica import replica_names
from ..core.schema import Place
from .blend import blend_scene
from .lit_mesh import lit_mesh
from .mesh_files import filled, found_path, mesh_scene
from .recording import read_recording
from .replica import ReplicaScene, check_replica, replica_scene
from .video import read_video_source
from .wildcards import matched_parts

KINDS = {"mesh": "meshes", "sequence": "sequences", "video": "videos", "blend": "files"}
"""The keys that name a scene's file or folder, with the word for several."""


@dataclass(frozen=True)
class _Candidate:
    """A scene that a preset's entry stands for. find: finds and checks its files; raises InputError."""

    name: str
    place: Place
    find: Callable[[], Source]
    replica: ReplicaScene | None = None


def find_scenes(preset: Preset) -> list[Scene]:
    """Return the scenes of a preset that are wanted; an entry is one scene, or as many as its wildcards match.

    Raises InputError for files that are missing or wrong.
    """
    found = [scene for index, spec in enumerate(preset.spec.scenes) for scene in _candidates(preset, index, spec)]
    wanted = set(selected([item.name for item in found], preset.spec.only.scenes, preset.place("only.scenes")))
    chosen = [item for item in found if item.name in wanted]
    check_replica([item.replica for item in chosen if item.replica is not None], preset)
    return [_found(item) for item in chosen]


def _found(item: _Candidate) -> Scene:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", item.name):
        raise item.place.at("name").error(f"{item.name!r} cannot name a folder", "give a name")
    return Scene(item.name, item.place, item.find())


def _candidates(preset: Preset, index: int, spec: SceneSpec) -> list[_Candidate]:
    place = preset.place(f"scenes.{index}")
    if spec.replica is not None:
        return _of_replica(preset, place, spec, spec.replica)
    if spec.mesh is not None and is_embedded(spec.mesh):
        return _embedded(preset, place, spec, spec.mesh)
    kind = next(name for name in KINDS if getattr(spec, name) is not None)
    kinds, pattern = KINDS[kind], getattr(spec, kind)
    if not glob.has_magic(pattern) or path_in(preset.folder, pattern, place.at(kind)).exists():
        path = path_in(preset.folder, pattern, place.at(kind))
        return [_candidate(preset, place, spec, spec.name or path.stem, pattern)]
    folder, pattern = located(preset.folder, pattern, place.at(kind))
    found = sorted(glob.glob(pattern, root_dir=folder))  # noqa: PTH207 - takes absolute patterns too
    if kind == "sequence":  # files lie beside sequences: cam_params.json, manifest.json, overview.png
        found = [text for text in found if not (folder / text).is_file()]
    if not found:
        raise place.at(kind).error(
            f"no {'folder' if kind == 'sequence' else 'file'} matches {pattern!r} {_beside(preset)}"
        )
    _check_one_name(spec, place, len(found), kinds)
    scenes = []
    for text in found:
        parts = matched_parts(pattern, text)
        name = filled(spec.name, parts, place.at("name")) if spec.name else "_".join(parts)
        scenes.append(_candidate(preset, place, spec, name, folder / text, parts=parts))
    return scenes


def _candidate(
    preset: Preset, place: Place, spec: SceneSpec, name: str, path: str | Path, *, parts: tuple[str, ...] = ()
) -> _Candidate:
    """Return a scene of a file or folder; a text is relative to the preset's folder, and may not be there."""
    kind = next(item for item in KINDS if getattr(spec, item) is not None)

    def find() -> Source:
        whole = path if isinstance(path, Path) else found_path(preset, place.at(kind), path, folder=kind == "sequence")
        if kind == "video":
            depth = None if spec.depth is None else filled(spec.depth, parts, place.at("depth"))
            beside = None if depth is None else found_path(preset, place.at("depth"), depth, folder=True)
            return read_video_source(whole, place, beside, spec.depth_scale_per_m or MILLIMETRES)
        if kind == "sequence":
            return read_recording(
                whole, place, spec.rate_hz, spec.poses, undistort=spec.undistort, register=spec.register
            )
        if kind == "blend":
            return blend_scene(preset, place, spec, whole, parts=parts)
        plain = mesh_scene(preset, place, spec, name, whole, parts=parts)
        return plain if spec.light == "none" else lit_mesh(preset, plain)

    return _Candidate(name, place, find)


def _embedded(preset: Preset, place: Place, spec: SceneSpec, mesh: str) -> list[_Candidate]:
    try:
        seeds = room_seeds(mesh)
    except ValueError as error:
        raise place.at("mesh").error(str(error), MEANT) from error
    _check_one_name(spec, place, len(seeds), "rooms")

    def candidate(seed: int) -> _Candidate:
        parts = () if mesh == EMBEDDED_ROOM else (str(seed),)
        name = filled(spec.name, parts, place.at("name")) if spec.name else room_name(mesh, seed)
        return _Candidate(name, place, lambda: mesh_scene(preset, place, spec, name, None, parts=parts, room=seed))

    return [candidate(seed) for seed in seeds]


def _of_replica(preset: Preset, place: Place, spec: SceneSpec, pattern: str) -> list[_Candidate]:
    names = replica_names(pattern)
    _check_one_name(spec, place, len(names), "scenes of Replica")

    def candidate(scene: str) -> _Candidate:
        name = filled(spec.name, (scene,), place.at("name")) if spec.name else scene
        files = replica_scene(preset, spec, scene)

        def find() -> Source:
            given = replace(spec, trajectory=spec.trajectory or TrajectorySpec())
            path = None if files.path is None else files.path.found[0]
            return mesh_scene(preset, place, given, name, files.mesh.found[0], parts=(scene,), path_file=path)

        return _Candidate(name, place, find, files)

    return [candidate(scene) for scene in names]


def _check_one_name(spec: SceneSpec, place: Place, count: int, what: str) -> None:
    if spec.name and "*" not in spec.name and count > 1:
        raise place.at("name").error(f"is {spec.name!r}, but {count} {what} match", "put a * where they differ")


def _beside(preset: Preset) -> str:
    return "beside the preset" if preset.spec.data is None else f"in {preset.folder}"
