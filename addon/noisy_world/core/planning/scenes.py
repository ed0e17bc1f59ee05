# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes of a preset: which files each one is, found and checked before anything is loaded."""

import glob
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..datasets.layouts import find_sequence
from ..datasets.stored import StoredSequence
from ..presets.preset import EMBEDDED_ROOM, Preset, SceneSpec, TrajectorySpec
from ..scenes.mesh import Mesh
from ..scenes.ply import check_ply, read_ply
from ..scenes.room import build_room
from ..schema import Place
from ..trajectories.files import read_trajectory
from ..trajectories.trajectory import Trajectory, evenly_stamped, resample, subsample

INTRINSICS_TOLERANCE_PX = 1e-3  # what people round away when they copy intrinsics


@dataclass(frozen=True)
class Scene:
    """A scene of the preset, its files found.

    mesh_path: None is the embedded room, or an existing sequence. trajectory: None where the path is made from the
    mesh (handheld). stamps_s: (N,) float64, the time stamps of its frames, seconds: known before the path is made. A
    setting's i-th frame has the i-th of them.
    """

    name: str
    spec: SceneSpec
    place: Place
    mesh_path: Path | None
    trajectory_path: Path | None
    trajectory: Trajectory | None
    stamps_s: NDArray[np.float64] = field(compare=False)
    existing: StoredSequence | None = None

    @property
    def frame_count(self) -> int:
        """How many frames it has."""
        return len(self.stamps_s)


def load_mesh(scene: Scene) -> Mesh:
    """Read the scene's mesh, or make the embedded room."""
    return build_room() if scene.mesh_path is None else read_ply(scene.mesh_path)


def find_scenes(preset: Preset, index: int, spec: SceneSpec) -> list[Scene]:
    """Return what one entry of the preset's scenes stands for: one scene, or as many as its wildcards match.

    Raises InputError for files that are missing or wrong.
    """
    place = preset.place(f"scenes.{index}")
    if spec.mesh == EMBEDDED_ROOM:
        return [_scene(preset, place, spec, spec.name or "room", None)]
    if spec.mesh is not None and spec.mesh.startswith("embedded:"):
        raise place.at("mesh").error(f"there is no {spec.mesh!r}", f"did you mean {EMBEDDED_ROOM!r}?")
    kind, kinds = ("mesh", "meshes") if spec.sequence is None else ("sequence", "sequences")
    pattern = spec.mesh if spec.sequence is None else spec.sequence
    assert pattern is not None
    make = _scene if kind == "mesh" else _existing_scene
    if not glob.has_magic(pattern):
        path = _existing(preset, place.at(kind), pattern, folder=kind == "sequence")
        return [make(preset, place, spec, spec.name or path.stem, path)]
    found = sorted(glob.glob(pattern, root_dir=preset.path.parent))  # noqa: PTH207 - takes absolute patterns too
    if not found:
        raise place.at(kind).error(f"no {'file' if kind == 'mesh' else 'folder'} matches {pattern!r} beside the preset")
    if spec.name and "*" not in spec.name and len(found) > 1:
        raise place.at("name").error(f"is {spec.name!r}, but {len(found)} {kinds} match", "put a * where they differ")
    scenes = []
    for text in found:
        parts = _matched_parts(pattern, text)
        name = _filled(spec.name, parts, place.at("name")) if spec.name else "_".join(parts)
        scenes.append(make(preset, place, spec, name, preset.path.parent / text, parts=parts))
    return scenes


def _existing_scene(
    preset: Preset, place: Place, spec: SceneSpec, name: str, path: Path, *, parts: tuple[str, ...] = ()
) -> Scene:
    del preset, parts
    _check_name(name, place)
    existing = find_sequence(path)
    return Scene(
        name, spec, place, None, existing.trajectory_path, existing.trajectory, existing.trajectory.stamps_s, existing
    )


def check_existing(existing: StoredSequence, preset: Preset, place: Place) -> None:
    """Hold an existing sequence against the preset: its size, and what is asked of it."""
    camera = preset.spec.camera
    if existing.size_px != (camera.width, camera.height):
        wide, high = existing.size_px
        raise place.error(
            f"its images are {wide} x {high}", f"say so in camera, which has {camera.width} x {camera.height}"
        )
    told = existing.camera
    if told is not None:
        theirs = np.array([told.fx_px, told.fy_px, told.cx_px, told.cy_px])
        if np.abs(theirs - [camera.fx, camera.fy, camera.cx, camera.cy]).max() > INTRINSICS_TOLERANCE_PX:
            values = f"fx {told.fx_px:g}, fy {told.fy_px:g}, cx {told.cx_px:g}, cy {told.cy_px:g}"
            raise place.error(f"its camera has {values}", "say so in camera, which has others")
    if preset.spec.rig is not None:
        raise place.error("is a sequence, which no rig can see otherwise", "leave rig out")


def _check_name(name: str, place: Place) -> None:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name):
        raise place.at("name").error(f"{name!r} cannot name a folder", "give a name")


def _scene(
    preset: Preset, place: Place, spec: SceneSpec, name: str, mesh_path: Path | None, *, parts: tuple[str, ...] = ()
) -> Scene:
    _check_name(name, place)
    assert spec.trajectory is not None
    if mesh_path is not None:
        check_ply(mesh_path)  # what the header tells need not wait until the scenes before are rendered
    where = place.at("trajectory")
    if spec.trajectory.file is None:
        assert spec.trajectory.handheld is not None
        stamps_s = _planned_stamps_s(spec.trajectory, where)
        return Scene(name, spec, place, mesh_path, None, None, stamps_s)
    text = _filled(spec.trajectory.file, parts, where) if "*" in spec.trajectory.file else spec.trajectory.file
    path = _existing(preset, where, text)
    whole = read_trajectory(
        path, direction=spec.trajectory.pose, axes=spec.trajectory.axes, rate_hz=spec.trajectory.rate_hz
    )
    trajectory = chosen_poses(whole, spec.trajectory, where)
    return Scene(name, spec, place, mesh_path, path, trajectory, trajectory.stamps_s)


def _planned_stamps_s(spec: TrajectorySpec, place: Place) -> NDArray[np.float64]:
    """Return the stamps of a path that is not made yet, by choosing from one that stands still."""
    assert spec.handheld is not None
    still = evenly_stamped(np.broadcast_to(np.eye(4), (spec.handheld.frames, 4, 4)), spec.handheld.rate_hz)
    return chosen_poses(still, spec, place).stamps_s


def chosen_poses(trajectory: Trajectory, spec: TrajectorySpec, place: Place) -> Trajectory:
    """Resample and subsample a trajectory as the preset says. Raises InputError where no pose is left."""
    if spec.resample_hz is not None:
        trajectory = resample(trajectory, spec.resample_hz)
    try:
        return subsample(trajectory, spec.start, spec.stop, spec.every)
    except ValueError as error:
        raise place.error(str(error)) from error


def _existing(preset: Preset, place: Place, text: str, *, folder: bool = False) -> Path:
    path = preset.path.parent / text
    if not (path.is_dir() if folder else path.is_file()):
        raise place.error(f"no such {'folder' if folder else 'file'}: {path}", "paths are relative to the preset")
    return path


def _matched_parts(pattern: str, text: str) -> tuple[str, ...]:
    """Return what each wildcard of a glob pattern matched."""
    wildcards = {"*": "([^/]*)", "?": "([^/])"}
    expression = "".join(wildcards.get(letter, re.escape(letter)) for letter in pattern.replace("\\", "/"))
    match = re.fullmatch(expression, text.replace("\\", "/"))
    return match.groups() if match else (Path(text).stem,)


def _filled(template: str, parts: tuple[str, ...], place: Place) -> str:
    """Put what the mesh's wildcards matched in the place of those of another text, in order."""
    if template.count("*") > len(parts):
        raise place.error(f"{template!r} has more * than mesh has wildcards")
    for part in parts:
        template = template.replace("*", part, 1)
    return template
