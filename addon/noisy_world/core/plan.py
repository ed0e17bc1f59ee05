# SPDX-License-Identifier: GPL-3.0-or-later
"""From a preset to what is to be done: every sequence, and every render that several sequences may share."""

import glob
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError, NoisyWorldError
from .geometry import Intrinsics
from .handheld import handheld_path
from .layouts import Layout
from .mesh import Mesh
from .ply import check_ply, read_ply
from .preset import EMBEDDED_ROOM, Preset, SceneSpec, SensorSpec, TrajectorySpec
from .rig import Rig, Sensor, sensor_from_extrinsics, sensor_trajectory
from .room import build_room
from .schema import Place
from .storage import sha256_of_file
from .trajectory import Trajectory, evenly_stamped, resample, subsample
from .trajectory_files import read_trajectory

# Measured on two cores: what a ray, a pixel and a scene cost, and what a pixel weighs. An estimate for --dry-run.
SECONDS_PER_SAMPLE = 3.5e-7
SECONDS_PER_PIXEL = 1.0e-7
SECONDS_PER_RENDER = 4.0
BYTES_PER_PIXEL = {"jpg": 0.8, "png": 1.2, "depth": 0.5}


@dataclass(frozen=True)
class Scene:
    """A scene of the preset, its files found.

    mesh_path: None is the embedded room. trajectory: None where the path is made from the mesh (handheld).
    """

    name: str
    spec: SceneSpec
    place: Place
    mesh_path: Path | None
    trajectory_path: Path | None
    trajectory: Trajectory | None
    frame_count: int


@dataclass(frozen=True)
class Sequence:
    """One setting of one scene: a folder of the dataset."""

    setting: str
    scene: str

    @property
    def folder(self) -> str:
        """The sequence's folder inside the dataset, with forward slashes."""
        return f"{self.setting}/{self.scene}"


@dataclass(frozen=True)
class Render:
    """What is rendered once for all the sequences that show it."""

    scene: Scene
    frames: range
    sequences: tuple[Sequence, ...]


@dataclass(frozen=True)
class Plan:
    """All of it."""

    preset: Preset
    camera: Intrinsics
    layout: Layout
    rig: Rig | None
    renders: tuple[Render, ...]

    @property
    def sequences(self) -> tuple[Sequence, ...]:
        """Every sequence, in the order of the renders."""
        return tuple(sequence for render in self.renders for sequence in render.sequences)

    @property
    def frame_count(self) -> int:
        """How many frames are rendered."""
        return sum(len(render.frames) for render in self.renders)


@dataclass(frozen=True)
class Estimate:
    """A rough guess of what a plan takes on two cores."""

    bytes_written: int
    seconds: float


def make_plan(preset: Preset, frames: slice | None = None) -> Plan:
    """Find every file of the preset and lay out the work.

    frames: which frames of each trajectory, start and stop only; they keep their numbers.
    Raises InputError for files that are missing or wrong.
    """
    spec = preset.spec
    camera = spec.camera
    scenes = [scene for index, item in enumerate(spec.scenes) for scene in _find_scenes(preset, index, item)]
    names = [scene.name for scene in scenes]
    for scene in scenes:
        if names.count(scene.name) > 1:
            raise scene.place.at("name").error(f"{scene.name!r} names two scenes", "give each a name of its own")
    return Plan(
        preset=preset,
        camera=Intrinsics(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy),
        layout=Layout(
            spec.output.layout,
            spec.output.image or ("jpg" if spec.output.layout == "replica" else "png"),
            spec.output.modalities,
        ),
        rig=_rig(preset, {scene.spec.trajectory.axes for scene in scenes}),
        renders=tuple(
            Render(
                scene,
                _chosen(scene, frames, preset),
                tuple(Sequence(setting.name, scene.name) for setting in spec.settings),
            )
            for scene in scenes
        ),
    )


def estimate(plan: Plan) -> Estimate:
    """Guess the bytes and the time of a plan from what a pixel cost where it was measured."""
    pixels = plan.camera.width_px * plan.camera.height_px
    kinds = [plan.layout.image if modality == "rgb" else "depth" for modality in plan.layout.modalities]
    per_frame = pixels * sum(BYTES_PER_PIXEL[kind] for kind in kinds)
    seconds = pixels * (plan.preset.spec.render.samples * SECONDS_PER_SAMPLE + SECONDS_PER_PIXEL)
    loading = len(plan.renders) * SECONDS_PER_RENDER
    return Estimate(int(plan.frame_count * per_frame), loading + plan.frame_count * seconds)


def load_mesh(scene: Scene) -> Mesh:
    """Read the scene's mesh, or make the embedded room."""
    return build_room() if scene.mesh_path is None else read_ply(scene.mesh_path)


def load_trajectory(plan: Plan, scene: Scene, mesh: Mesh | None = None) -> Trajectory:
    """Return the trajectory of a scene: the one read, or the one made in the mesh, which is loaded if not given."""
    if scene.trajectory is not None:
        return scene.trajectory
    spec = scene.spec.trajectory.handheld
    assert spec is not None
    try:
        path = handheld_path(
            load_mesh(scene) if mesh is None else mesh,
            seed=plan.preset.spec.seed if spec.seed is None else spec.seed,
            frames=spec.frames,
            rate_hz=spec.rate_hz,
            speed_m_s=spec.speed_m_s,
            clearance_m=spec.clearance_m,
        )
    except NoisyWorldError as error:
        raise scene.place.at("trajectory").at("handheld").error(str(error)) from error
    return _chosen_poses(path, scene.spec.trajectory, scene.place.at("trajectory"))


def sensor_trajectories(plan: Plan, trajectory: Trajectory) -> dict[str, Trajectory]:
    """Return where each thing goes: "" the colour sensor, and with a rig the "robot" and, if elsewhere, "depth"."""
    if plan.rig is None:
        return {"": trajectory}
    paths = {"": sensor_trajectory(trajectory, plan.rig.rgb), "robot": trajectory}
    if plan.rig.depth is not None:
        paths["depth"] = sensor_trajectory(trajectory, plan.rig.depth)
    return paths


def input_hashes(plan: Plan) -> dict[str, dict[str, Any]]:
    """Return what each scene was made from: the names as the preset has them, and the SHA-256 of the files."""
    inputs: dict[str, dict[str, Any]] = {}
    for render in plan.renders:
        scene = render.scene
        inputs[scene.name] = {
            "mesh": EMBEDDED_ROOM if scene.mesh_path is None else scene.mesh_path.name,
            "mesh_sha256": None if scene.mesh_path is None else sha256_of_file(scene.mesh_path),
            "trajectory": "handheld" if scene.trajectory_path is None else scene.trajectory_path.name,
            "trajectory_sha256": None if scene.trajectory_path is None else sha256_of_file(scene.trajectory_path),
        }
    return inputs


def _find_scenes(preset: Preset, index: int, spec: SceneSpec) -> list[Scene]:
    place = preset.place(f"scenes.{index}")
    if spec.mesh == EMBEDDED_ROOM:
        return [_scene(preset, place, spec, spec.name or "room", None)]
    if spec.mesh.startswith("embedded:"):
        raise place.at("mesh").error(f"there is no {spec.mesh!r}", f"did you mean {EMBEDDED_ROOM!r}?")
    if not glob.has_magic(spec.mesh):
        path = _existing(preset, place.at("mesh"), spec.mesh)
        return [_scene(preset, place, spec, spec.name or path.stem, path)]
    found = sorted(glob.glob(spec.mesh, root_dir=preset.path.parent))  # noqa: PTH207 - takes absolute patterns too
    if not found:
        raise place.at("mesh").error(f"no file matches {spec.mesh!r} beside the preset")
    if spec.name and "*" not in spec.name and len(found) > 1:
        raise place.at("name").error(f"is {spec.name!r}, but {len(found)} meshes match", "put a * where they differ")
    scenes = []
    for text in found:
        parts = _matched_parts(spec.mesh, text)
        name = _filled(spec.name, parts, place.at("name")) if spec.name else "_".join(parts)
        scenes.append(_scene(preset, place, spec, name, preset.path.parent / text, parts=parts))
    return scenes


def _scene(
    preset: Preset, place: Place, spec: SceneSpec, name: str, mesh_path: Path | None, *, parts: tuple[str, ...] = ()
) -> Scene:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name):
        raise place.at("name").error(f"{name!r} cannot name a folder", "give a name")
    if mesh_path is not None:
        check_ply(mesh_path)  # what the header tells need not wait until the scenes before are rendered
    where = place.at("trajectory")
    if spec.trajectory.file is None:
        assert spec.trajectory.handheld is not None
        count = _planned_frames(spec.trajectory, where)
        return Scene(name, spec, place, mesh_path, None, None, count)
    text = _filled(spec.trajectory.file, parts, where) if "*" in spec.trajectory.file else spec.trajectory.file
    path = _existing(preset, where, text)
    whole = read_trajectory(
        path, direction=spec.trajectory.pose, axes=spec.trajectory.axes, rate_hz=spec.trajectory.rate_hz
    )
    trajectory = _chosen_poses(whole, spec.trajectory, where)
    return Scene(name, spec, place, mesh_path, path, trajectory, len(trajectory))


def _planned_frames(spec: TrajectorySpec, place: Place) -> int:
    """Count the poses of a path that is not made yet, by choosing from one that stands still."""
    assert spec.handheld is not None
    still = evenly_stamped(np.broadcast_to(np.eye(4), (spec.handheld.frames, 4, 4)), spec.handheld.rate_hz)
    return len(_chosen_poses(still, spec, place))


def _chosen_poses(trajectory: Trajectory, spec: TrajectorySpec, place: Place) -> Trajectory:
    if spec.resample_hz is not None:
        trajectory = resample(trajectory, spec.resample_hz)
    try:
        return subsample(trajectory, spec.start, spec.stop, spec.every)
    except ValueError as error:
        raise place.error(str(error)) from error


def _existing(preset: Preset, place: Place, text: str) -> Path:
    path = preset.path.parent / text
    if not path.is_file():
        raise place.error(f"no such file: {path}", "paths are relative to the preset")
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


def _chosen(scene: Scene, frames: slice | None, preset: Preset) -> range:
    chosen = range(scene.frame_count)[frames or slice(None)]
    if not chosen:
        assert frames is not None
        raise InputError(
            preset.path,
            f"--frames {frames.start or 0}:{frames.stop or ''} chooses none of the {scene.frame_count} "
            f"frames of {scene.name}",
            remedy=f"choose from 0:{scene.frame_count}",
        )
    return chosen


def _rig(preset: Preset, axes: set[str]) -> Rig | None:
    spec = preset.spec.rig
    if spec is None:
        return None
    place = preset.place("rig")
    if len(axes) > 1:
        raise place.error(f"the scenes' trajectories declare different axes ({', '.join(sorted(axes))})", "use one")
    (robot_axes,) = axes
    depth = None if spec.depth is None else _sensor(spec.depth, robot_axes, place.at("depth"))
    return Rig(_sensor(spec.rgb, robot_axes, place.at("rgb")), depth)


def _sensor(spec: SensorSpec, robot_axes: Any, place: Place) -> Sensor:
    given = {"quat_wxyz": spec.quat_wxyz, "rotation_euler_deg": spec.rotation_euler_deg, "matrix": spec.matrix}
    if spec.matrix is None:
        given["translation_m"] = spec.translation_m
    try:
        return sensor_from_extrinsics(**given, robot_axes=robot_axes)
    except ValueError as error:
        raise place.error(str(error)) from error
