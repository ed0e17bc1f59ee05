# SPDX-License-Identifier: GPL-3.0-or-later
"""From a preset to what is to be done: every sequence, and every render that several sequences may share."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ..datasets.layouts import OutputFormat
from ..datasets.storage import sha256_of_file
from ..errors import InputError, NoisyWorldError
from ..geometry import Intrinsics
from ..perturbing.mixture import Identifiers, Registry, Setting, Step, paired_depth, parse_settings, perturb_motion
from ..presets.preset import EMBEDDED_ROOM, Preset, SensorSpec
from ..scenes.mesh import Mesh
from ..schema import Place
from ..trajectories.handheld import handheld_path
from ..trajectories.rig import Rig, Sensor, sensor_from_extrinsics, sensor_trajectory
from ..trajectories.trajectory import Trajectory
from .scenes import Scene, check_existing, chosen_poses, find_scenes, load_mesh

# Measured on two cores: what a ray, a pixel and a scene cost, and what a pixel weighs. An estimate for --dry-run.
SECONDS_PER_SAMPLE = 3.5e-7
SECONDS_PER_PIXEL = 1.0e-7
SECONDS_PER_RENDER = 4.0
SECONDS_PER_PERTURBED_PIXEL = 6e-8
SECONDS_PER_COMPOSITED_PIXEL = 1.6e-7
BYTES_PER_PIXEL = {"jpg": 0.8, "png": 1.2, "depth": 0.5}


@dataclass(frozen=True)
class Sequence:
    """One setting of one scene: a folder of the dataset.

    identifiers: name its random streams. every: its frame i shows frame every * i of the render. depth_of: for each of
    its frames the one whose depth goes with it; None where that is the same. frames: those that are to be made.
    """

    setting: Setting
    scene: str
    identifiers: Identifiers
    every: int
    depth_of: tuple[int, ...] | None
    frames: tuple[int, ...]

    @property
    def folder(self) -> str:
        """The sequence's folder inside the dataset, with forward slashes."""
        return f"{self.setting.name}/{self.scene}"

    def rgb_source(self, frame: int) -> int:
        """Return the frame of the render whose colour a frame shows."""
        return self.every * frame

    def depth_source(self, frame: int) -> int:
        """Return the frame of the render whose depth a frame shows."""
        return self.every * (frame if self.depth_of is None else self.depth_of[frame])

    @cached_property
    def depth_shown_by(self) -> dict[int, list[int]]:
        """The frames that show the depth of a frame of the render."""
        shown: dict[int, list[int]] = {}
        for frame in self.frames:
            shown.setdefault(self.depth_source(frame), []).append(frame)
        return shown

    @cached_property
    def rgb_shown_by(self) -> dict[int, int]:
        """The frame that shows the colour of a frame of the render."""
        return {self.rgb_source(frame): frame for frame in self.frames}

    def sources(self, modalities: tuple[str, ...]) -> set[int]:
        """Return the frames of the render that it needs."""
        rgb = self.rgb_shown_by if "rgb" in modalities else ()
        return {*rgb, *(self.depth_shown_by if "depth" in modalities else ())}


@dataclass(frozen=True)
class Render:
    """What is rendered (or read) once for all the sequences that show it.

    deviation: what is done to the trajectory, with the names of its streams.
    """

    name: str
    scene: Scene
    frames: tuple[int, ...]
    sequences: tuple[Sequence, ...]
    deviation: tuple[Step, Identifiers] | None = None


@dataclass(frozen=True)
class Plan:
    """All of it."""

    preset: Preset
    camera: Intrinsics
    format: OutputFormat
    rig: Rig | None
    settings: tuple[Setting, ...]
    renders: tuple[Render, ...]

    @property
    def sequences(self) -> tuple[Sequence, ...]:
        """Every sequence, in the order of the renders; --frames may leave it without a frame."""
        return tuple(sequence for render in self.renders for sequence in render.sequences)

    @property
    def renders_anything(self) -> bool:
        """Whether anything is rendered, and not only read."""
        return any(render.scene.existing is None for render in self.renders)

    @property
    def composites(self) -> bool:
        """Whether anything is perturbed in Blender's compositor."""
        return "rgb" in self.format.modalities and any(setting.composited for setting in self.settings)

    @property
    def needs_blender(self) -> bool:
        """Whether anything is rendered, or perturbed in the compositor."""
        return self.renders_anything or self.composites

    @property
    def frame_count(self) -> int:
        """How many frames are rendered."""
        return sum(len(render.frames) for render in self.renders)


@dataclass(frozen=True)
class Estimate:
    """A rough guess of what a plan takes on two cores."""

    bytes_written: int
    seconds: float


def make_plan(preset: Preset, frames: slice | None = None, registry: Registry | None = None) -> Plan:
    """Find every file of the preset and lay out the work.

    frames: which frames of each sequence, start and stop only; they keep their numbers. registry: the perturbations
    that settings may name. Raises InputError for files that are missing or wrong.
    """
    spec = preset.spec
    camera = spec.camera
    settings = parse_settings(spec.settings, preset.place("settings"), registry or {}, spec.render.backend)
    _check_depth_aware(settings, preset)
    form = spec.output.format
    scenes = [scene for index, item in enumerate(spec.scenes) for scene in find_scenes(preset, index, item)]
    names = [scene.name for scene in scenes]
    for scene in scenes:
        if names.count(scene.name) > 1:
            raise scene.place.at("name").error(f"{scene.name!r} names two scenes", "give each a name of its own")
        if scene.existing is not None:
            check_existing(scene.existing, preset, scene.place.at("sequence"))
        if problem := form.layout.stamps_problem(scene.stamps_s):
            raise scene.place.error(problem, "mend the stamps, or choose another output.layout")
    return Plan(
        preset=preset,
        camera=Intrinsics(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy),
        format=form,
        rig=_rig(preset, {scene.spec.trajectory.axes for scene in scenes if scene.spec.trajectory}),
        settings=settings,
        renders=tuple(
            render for scene in scenes for render in _renders(preset, scene, settings, frames, form.modalities)
        ),
    )


def _renders(
    preset: Preset, scene: Scene, settings: tuple[Setting, ...], frames: slice | None, modalities: tuple[str, ...]
) -> list[Render]:
    """Group the settings of a scene by what has to be rendered: one for all that leave the path alone."""
    _check_chosen(scene, frames, preset)
    shared: list[Sequence] = []
    deviated: list[Render] = []
    for setting in settings:
        identifiers = (preset.spec.seed, scene.name, setting.name)
        sequence = lay_out(setting, scene.name, scene.frame_count, identifiers, frames)
        if frames is None and not sequence.frames:
            raise preset.place("settings").error(
                f"{setting.name}: desync leaves none of the {scene.frame_count} frames of {scene.name}",
                "use edge: clamp",
            )
        step = setting.named("motion_deviation")
        if step is None:
            shared.append(sequence)
            continue
        if scene.existing is not None:
            problem = (
                f"deviates from its path in {setting.name}, but an existing sequence cannot be seen from elsewhere"
            )
            raise scene.place.at("sequence").error(problem, "take that setting out, or render the scene's mesh")
        needed = tuple(sorted(sequence.sources(modalities)))
        name = f"{scene.name}@{setting.name}"
        deviated.append(Render(name, scene, needed, (sequence,), (step, identifiers)))
    if shared:
        needed = tuple(sorted(set().union(*(sequence.sources(modalities) for sequence in shared))))
        deviated.insert(0, Render(scene.name, scene, needed, tuple(shared)))
    return deviated


def lay_out(
    setting: Setting, scene: str, frame_count: int, identifiers: Identifiers, frames: slice | None = None
) -> Sequence:
    """Return what a setting makes of a scene with so many frames. frames: which of its own, start and stop only."""
    faster, desync = setting.named("faster_motion"), setting.named("desync")
    every = faster.parameters(None).factor if faster else 1
    count = -(-frame_count // every)
    depth_of = tuple(paired_depth(desync, count, identifiers)) if desync else None
    chosen = range(count)[frames or slice(None)]
    kept = tuple(frame for frame in chosen if depth_of is None or depth_of[frame] >= 0)
    return Sequence(setting, scene, identifiers, every, depth_of, kept)


def estimate(plan: Plan) -> Estimate:
    """Guess the bytes and the time of a plan from what a pixel cost where it was measured."""
    pixels = plan.camera.width_px * plan.camera.height_px
    kinds = {modality: plan.format.image if modality == "rgb" else "depth" for modality in plan.format.modalities}
    clean = plan.frame_count * sum(BYTES_PER_PIXEL[kind] for kind in kinds.values())
    perturbed = [
        (kind, len(sequence.frames))
        for sequence in plan.sequences
        for modality, kind in kinds.items()
        if getattr(sequence.setting, modality)
    ]
    written = pixels * (clean + sum(BYTES_PER_PIXEL[kind] * count for kind, count in perturbed))
    seconds = sum(count for _, count in perturbed) * pixels * SECONDS_PER_PERTURBED_PIXEL
    if plan.composites:
        composited = sum(len(sequence.frames) for sequence in plan.sequences if sequence.setting.composited)
        seconds += composited * pixels * SECONDS_PER_COMPOSITED_PIXEL
    for render in plan.renders:
        if render.scene.existing is None:
            per_pixel = plan.preset.spec.render.samples * SECONDS_PER_SAMPLE + SECONDS_PER_PIXEL
            seconds += SECONDS_PER_RENDER + len(render.frames) * pixels * per_pixel
    return Estimate(int(written), seconds)


def load_trajectory(plan: Plan, scene: Scene, mesh: Mesh | None = None) -> Trajectory:
    """Return the trajectory of a scene: the one read, or the one made in the mesh, which is loaded if not given."""
    if scene.trajectory is not None:
        return scene.trajectory
    assert scene.spec.trajectory is not None
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
    return chosen_poses(path, scene.spec.trajectory, scene.place.at("trajectory"))


def render_trajectories(plan: Plan, render: Render, nominal: Trajectory) -> dict[str, Trajectory]:
    """Return where each thing goes in a render: as sensor_trajectories, after the deviation that there may be."""
    if render.deviation is None:
        return sensor_trajectories(plan, nominal)
    return sensor_trajectories(plan, perturb_motion(render.deviation[0], nominal, render.deviation[1]))


def written_trajectories(
    plan: Plan, render: Render, sequence: Sequence, true: Mapping[str, Trajectory], nominal: Trajectory
) -> dict[str, Trajectory]:
    """Return the trajectories of a sequence's own frames: the true ones and, where they deviate, the "nominal" one."""
    paths = dict(true)
    if render.deviation is not None:
        paths["nominal"] = sensor_trajectories(plan, nominal)[""]
    faster = sequence.setting.named("faster_motion")
    return {
        key: path if faster is None else perturb_motion(faster, path, sequence.identifiers)
        for key, path in paths.items()
    }


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
    for scene in {render.scene.name: render.scene for render in plan.renders}.values():
        made = {
            "trajectory": "handheld" if scene.trajectory_path is None else scene.trajectory_path.name,
            "trajectory_sha256": None if scene.trajectory_path is None else sha256_of_file(scene.trajectory_path),
        }
        if scene.existing is not None:
            digests = "".join(sha256_of_file(path) or "" for path in scene.existing.files)
            made |= {
                "sequence": scene.existing.folder.name,
                "files_sha256": hashlib.sha256(digests.encode()).hexdigest(),
            }
        else:
            made["mesh"] = EMBEDDED_ROOM if scene.mesh_path is None else scene.mesh_path.name
            made["mesh_sha256"] = None if scene.mesh_path is None else sha256_of_file(scene.mesh_path)
        inputs[scene.name] = made
    return inputs


def _check_depth_aware(settings: tuple[Setting, ...], preset: Preset) -> None:
    """Refuse what needs the depth of the colour's own place, where depth is measured elsewhere."""
    rig = preset.spec.rig
    for setting in settings:
        if setting.needs_depth and rig is not None and rig.depth is not None:
            raise preset.place("settings").error(
                f"{setting.name}: needs the depth that the colour camera sees, but rig.depth is another place",
                "take that setting out, or rig.depth",
            )


def _check_chosen(scene: Scene, frames: slice | None, preset: Preset) -> None:
    if frames is not None and not range(scene.frame_count)[frames]:
        raise InputError(
            preset.path,
            f"--frames {frames.start or 0}:{frames.stop or ''} chooses none of the {scene.frame_count} "
            f"frames of {scene.name}",
            remedy=f"choose from 0:{scene.frame_count}",
        )


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
