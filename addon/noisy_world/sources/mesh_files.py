# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of a mesh and its path, as a preset's entry names them."""

from pathlib import Path

from ..core.home import path_in
from ..core.presets.preset import Preset
from ..core.presets.scene_keys import SceneSpec, TrajectorySpec
from ..core.scenes.mesh_files import check_mesh
from ..core.schema import Place, shown
from .mesh import MeshSource, read_path


def mesh_scene(
    preset: Preset,
    place: Place,
    spec: SceneSpec,
    name: str,
    mesh_path: Path | None,
    *,
    parts: tuple[str, ...] = (),
    path_file: Path | None = None,
    room: int = 0,
) -> MeshSource:
    """Return the source of a mesh and its path.

    mesh_path: None is the embedded room of the number `room`. parts: what the entry's wildcards matched. path_file:
    that of the path, where the entry does not name it. Raises InputError where a file is missing or wrong.
    """
    assert spec.trajectory is not None
    if mesh_path is not None:
        check_mesh(mesh_path)  # the header only: its errors need not wait until earlier scenes are rendered
    seed, where = preset.spec.seed, place.at("trajectory")
    if path_file is None and spec.trajectory.file is None:
        return MeshSource(name, place, mesh_path, spec.trajectory, None, None, seed, room, spec.up)
    path = path_file or path_file_of(preset, where, spec.trajectory, parts)
    chosen, read_as = read_path(path, spec.trajectory, where, preset.spec.mesh_camera.intrinsics)
    return MeshSource(name, place, mesh_path, read_as, path, chosen, seed, room, spec.up)


def path_file_of(preset: Preset, place: Place, spec: TrajectorySpec, parts: tuple[str, ...]) -> Path:
    """Return the file of poses that a trajectory names. parts: what the entry's wildcards matched."""
    text = spec.file or ""
    return found_path(preset, place, filled(text, parts, place) if "*" in text else text, folder=None)


def found_path(preset: Preset, place: Place, text: str, *, folder: bool | None = False) -> Path:
    """Return the path of a file or a folder that exists; folder: None where it may be either. Raises InputError."""
    path = path_in(preset.folder, text, place)
    kind = "folder" if folder else "file"
    try:
        there = path.is_dir() if folder else path.is_file() or (folder is None and path.is_dir())
    except OSError as error:  # a name that is too long, for instance
        raise place.error(f"{shown(text)} cannot be a {kind}: {error.strerror}") from error
    if not there:
        relative_to = "the preset" if preset.spec.data is None else f"data, {preset.folder}"
        raise place.error(f"no such {kind}: {path}", f"paths are relative to {relative_to}")
    return path


def filled(template: str, parts: tuple[str, ...], place: Place) -> str:
    """Replace each wildcard of a text by what the mesh's wildcards matched, in order. Raises InputError."""
    if template.count("*") > len(parts):
        raise place.error(f"{template!r} has more * than mesh has wildcards")
    for part in parts:
        template = template.replace("*", part, 1)
    return template
