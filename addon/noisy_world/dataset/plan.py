# SPDX-License-Identifier: GPL-3.0-or-later
"""What a preset asks for: its sensors, sequences and renders, each checked before anything is made."""

from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from collections.abc import Sequence as Many
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..channels import pair_channels, surface_channels
from ..channels.passes import NAME as PASSES
from ..core.errors import InputError, Message, PresetKey, either
from ..core.frame_request import FrameRequest
from ..core.geometry import Intrinsics, invert_pose
from ..core.lens import PINHOLE, DepthCamera, Optics
from ..core.progress import counted
from ..core.schema import ConfigPath
from ..core.trajectory import NS_PER_S, Axes, FrameStamps, Stamps, Trajectory, rounded_poses
from ..images.measured_depth import Registration
from ..layouts import Modality, OutputFormat
from ..perturbations import registry
from ..perturbations.execution import chosen_poses, exposure_key, move, split_motion
from ..perturbations.kinds import DepthPerturbation, ExposurePerturbation, Identifiers, MotionPerturbation
from ..perturbations.parsing import Registry, check_device_part, is_sensor, parse_sensor, parse_settings
from ..perturbations.steps import Setting, Step, steps_of_kind
from ..preset.keys import DepthSensorSpec, EngineName, ImuSpec, Preset, SensorSpec
from ..preset.names import format_same_folder, selected
from ..render.source import (
    Motion,
    OpenSource,
    PreparedSource,
    RenderedFrame,
    Source,
    SourceCapabilities,
    SourceFrame,
    motion_between,
)
from ..scenes.polygon_mesh import Mesh
from ..sources import find_scenes
from ..sources.scene_kinds import Scene
from ..trajectories.rig import LEAST_BANDWIDTH_HZ, MOST_SAMPLES, Imu, Rig, Sensor, sensor_from_extrinsics
from .depth_reach import DepthReach, depth_reach
from .sequence import Numbers, PlannedSequence, array_of, lay_out, union

# The sensors of a robot in a plan: where they sit, what measures depth and when, and what cannot be combined.


def depth_sensor(preset: Preset, registry: Registry) -> tuple[Step[DepthPerturbation], ...]:
    """Return the step by which a rig's depth sensor measures; none where depth is exact."""
    rig = preset.spec.rig
    if rig is None or rig.depth is None or rig.depth.sensor is None:
        return ()
    return (parse_sensor(rig.depth.sensor, preset.place("rig").at("depth").at("sensor"), registry),)


def check_sensors(settings: tuple[Setting, ...], preset: Preset) -> None:
    """Refuse depth that is measured twice, and what needs colour and depth from one pose where the sensors have two."""
    rig = preset.spec.rig
    for setting in settings:
        own = steps_of_kind(setting.steps, DepthPerturbation)
        measured = [step.perturbation for step in (*setting.sensor, *own) if is_sensor(step.perturbation)]
        if setting.sensor and len(measured) > 1:
            problem = f"{setting.name}: {measured[1].name} measures depth, which rig.depth.sensor has measured"
            raise preset.place("settings").error(problem, "keep one of them")
    if rig is None or rig.depth is None or rig.depth.shares_place(rig.rgb):
        return
    if rig.depth.has_camera or rig.depth.registered:
        return  # what lies between the cameras is known, so each image can be had as the other camera sees it
    at_depth = preset.place("rig").at("depth")
    for setting in settings:
        for step in setting.sensor:
            if step.perturbation.needs_rgb:
                raise at_depth.at("sensor").error(
                    f"{step.perturbation.name} needs the colour that it sees, but rig.depth has another pose",
                    "give rig.depth the pose of rig.rgb, or registered: true",
                )
        if setting.needs_depth or setting.needs_rgb:
            seen = "depth that the colour camera" if setting.needs_depth else "colour that the depth sensor"
            raise preset.place("settings").error(
                f"{setting.name}: needs the {seen} sees, but rig.depth has another pose",
                "take that setting out, or rig.depth",
            )


def read_rig(preset: Preset, axes: set[Axes]) -> Rig | None:
    """Return the robot's sensors, None without a rig. axes: in which the scenes' trajectories are declared.

    Raises InputError where a pose is none, or axes differ.
    """
    spec = preset.spec.rig
    if spec is None:
        return None
    place = preset.place("rig")
    if len(axes) > 1:
        raise place.error(f"the scenes' trajectories declare different axes ({', '.join(sorted(axes))})", "use one")
    (robot_axes,) = axes
    apart = spec.depth is not None and not spec.depth.shares_place(spec.rgb)
    depth = _sensor(spec.depth, robot_axes, place.at("depth")) if spec.depth is not None and apart else None
    imu = None if spec.imu is None else _imu(spec.imu, robot_axes, place.at("imu"))
    return Rig(_sensor(spec.rgb, robot_axes, place.at("rgb")), depth, imu)


def check_imu(rig: Rig, settings: tuple[Setting, ...], scenes: Many[Scene], preset: Preset) -> None:
    """Refuse an IMU on paths that have no acceleration, and stamps before 0, which no file of a layout can say."""
    if rig.imu is None:
        return
    place = preset.place("rig").at("imu")
    for setting in settings:
        moving = [step.perturbation for step in setting.motion if step.severity != 0]
        for kind in moving:
            if kind.apply is not None and not kind.continuous:
                raise place.error(
                    f"{setting.name}: {kind.name} moves each pose by itself, so its path has no finite acceleration",
                    "take one of them out; vibration, drift and jerk deviate along a smooth path",
                )
    for scene in scenes:
        stamps_ns = FrameStamps.of(scene.source.frame_stamps).rgb.ns
        numbers = rig.imu.sample_numbers((stamps_ns[-1] - stamps_ns[0]) / NS_PER_S)
        if (first_ns := stamps_ns[0] + round(numbers.start / rig.imu.rate_hz * NS_PER_S)) < 0:
            problem = f"puts the IMU's first stamp on {scene.name} at {first_ns / NS_PER_S:g} s, before 0"
            raise place.at("time_offset_s").error(problem, "use 0 or more, or a path with later stamps")
        if len(numbers) > MOST_SAMPLES:
            problem = f"makes {len(numbers):,} samples along {scene.name}, more than {MOST_SAMPLES:,}"
            raise place.at("rate_hz").error(problem, "use a lower one")


def _imu(spec: ImuSpec, robot_axes: Axes, place: ConfigPath) -> Imu:
    if 0 < spec.model.bandwidth_hz < LEAST_BANDWIDTH_HZ:
        problem = (
            f"is {spec.model.bandwidth_hz:g} Hz, less than {LEAST_BANDWIDTH_HZ:g}, and a sample would last seconds"
        )
        raise place.at("bandwidth_hz").error(problem, "use a higher one; 0 is no low-pass")
    turned = spec.quat_wxyz or spec.rotation_euler_deg or spec.matrix
    with_axes = spec if turned else replace(spec, quat_wxyz=(1.0, 0.0, 0.0, 0.0))  # the robot's
    return Imu(
        _sensor(with_axes, robot_axes, place).robot_from_sensor,
        spec.model,
        spec.rate_hz,
        spec.gravity_m_s2,
        spec.time_offset_s,
        spec.clock_drift_ppm,
    )


def _sensor(spec: SensorSpec, robot_axes: Axes, place: ConfigPath) -> Sensor:
    given: dict[str, Any] = {
        "quat_wxyz": spec.quat_wxyz,
        "rotation_euler_deg": spec.rotation_euler_deg,
        "matrix": spec.matrix,
    }
    if spec.matrix is None:
        given["translation_m"] = spec.translation_m
    try:
        found = sensor_from_extrinsics(**given, robot_axes=robot_axes)
    except ValueError as error:
        raise place.error(str(error)) from error
    return Sensor(rounded_poses(found.robot_from_sensor))


# A rig's depth sensor that is a device of its own: another camera than colour's, another clock, registered or raw.


Float64 = NDArray[np.float64]
_SAME_POSE = 1e-12


@dataclass(frozen=True)
class DepthClock:
    """When a depth sensor exposes, on colour's clock, which is that of all stamps.

    rate_hz: its exposures a second of its own clock; None for one with each frame. delay_s: how much later than
    colour's first frame its first exposure is. drift_ppm: how much faster its clock goes.
    """

    rate_hz: float | None = None
    delay_s: float = 0.0
    drift_ppm: float = 0.0

    def exposures_s(self, stamps_s: Float64) -> Float64:
        """(N,) stamps of frames -> (N,) when the depth that each shows was exposed, in whole microseconds.

        With a rate that is the exposure which is nearest in time; of two the earlier one, and none before the first.
        """
        first_s, faster = float(stamps_s[0]), 1.0 + self.drift_ppm * 1e-6
        passed_s = stamps_s - first_s
        if self.rate_hz is None:
            return np.round(first_s + passed_s / faster + self.delay_s, 6)
        rate_hz = self.rate_hz * faster
        numbers = np.maximum(np.ceil((passed_s - self.delay_s) * rate_hz - 0.5 - 1e-9), 0.0)
        return np.round(first_s + self.delay_s + numbers / rate_hz, 6)


@dataclass(frozen=True)
class DepthUnit:
    """A rig's depth sensor.

    camera: where it is not colour's, None where it is. registered: whether its depth is laid into colour's pixels after
    it was measured. clock: None where it exposes with colour.
    """

    camera: DepthCamera | None = None
    registered: bool = False
    clock: DepthClock | None = None

    @property
    def raw(self) -> DepthCamera | None:
        """Its camera, where its depth is written as it was measured."""
        return None if self.registered else self.camera


def depth_unit(spec: DepthSensorSpec | None, rig: Rig | None, colour: Intrinsics) -> DepthUnit | None:
    """Return a rig's depth sensor; None where it has neither a camera nor a clock of its own. colour: the camera's."""
    if spec is None or rig is None:
        return None
    clock = DepthClock(spec.rate_hz, spec.delay_ms / 1e3, spec.clock_drift_ppm) if spec.has_clock else None
    if not spec.has_camera and not spec.registered:
        return None if clock is None else DepthUnit(clock=clock)
    rows = None
    if rig.depth is not None:
        between = invert_pose(rig.rgb.robot_from_sensor) @ rig.depth.robot_from_sensor
        if np.abs(between - np.eye(4)).max() > _SAME_POSE:
            rows = tuple(tuple(row) for row in rounded_poses(between).tolist())
    camera = DepthCamera(spec.intrinsics(colour), rows)
    if rows is None and camera.intrinsics == colour:
        return None if clock is None else DepthUnit(clock=clock)
    return DepthUnit(camera, spec.registered, clock)


@dataclass(frozen=True)
class MountedSource:
    """A source as it is seen by a rig whose depth sensor is a device of its own: its stamps and its optics."""

    source: Source
    unit: DepthUnit

    @property
    def location(self) -> str:
        """The source's."""
        return self.source.location

    @property
    def capabilities(self) -> SourceCapabilities:
        """The source's."""
        return self.source.capabilities

    @property
    def stamps_s(self) -> Float64:
        """Time stamps (N,) of the path's frames, seconds."""
        return self.source.stamps_s

    @property
    def frame_stamps(self) -> FrameStamps:
        """Those of the source, with depth's by its own clock."""
        return self._frame_stamps

    @cached_property
    def _frame_stamps(self) -> FrameStamps:
        stamps = self.source.frame_stamps
        if self.unit.clock is None:
            return stamps
        return replace(stamps, depth=Stamps(self.unit.clock.exposures_s(self.stamps_s)))

    @property
    def repeats(self) -> NDArray[np.int64] | None:
        """(N,): the first frame that shows the exposure of depth which each shows; None where each shows its own."""
        if self.unit.clock is None:
            return None
        _, first, inverse = np.unique(self.frame_stamps.depth.seconds, return_index=True, return_inverse=True)
        shown = first[inverse].astype(np.int64)
        return None if len(first) == len(shown) else shown

    @property
    def robot_axes(self) -> Axes | None:
        """The source's."""
        return self.source.robot_axes

    def camera(self, asked: Intrinsics | None) -> Intrinsics | None:
        """Return the intrinsics of colour."""
        return self.source.camera(asked)

    def optics(self, camera: Intrinsics) -> Optics:
        """Return what its cameras have beyond one pinhole: depth's own, where it is written raw."""
        own = self.source.optics(camera)
        return own if self.unit.raw is None else replace(own, depth=self.unit.raw)

    def trajectory(self) -> Trajectory:
        """Return the source's path."""
        return self.source.trajectory()

    @property
    def mesh(self) -> Callable[[], Mesh] | None:
        """The source's."""
        return self.source.mesh

    def remarks(self, camera: Intrinsics) -> Iterable[str]:
        """Return the source's."""
        return self.source.remarks(camera)

    def hashes(self) -> dict[str, Any]:
        """Return what decides the source's bytes."""
        return self.source.hashes()

    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> AbstractContextManager[PreparedSource]:
        """Prepare the source."""
        return self.source.prepare(camera, note)


@dataclass(frozen=True)
class ClockedSource:
    """A source whose depth is of another moment than colour. after_s: (N,) how much later, for each frame."""

    opened: OpenSource
    after_s: Float64
    channels: frozenset[str]

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Return the frame of a request: all but depth at its time, and depth when that is exposed."""
        if request.index is None or (after_s := float(self.after_s[request.index])) == 0.0:
            return self.opened.frame(request)
        wanted = self.channels if request.channels is None else self.channels & request.channels
        depth_m = None
        if "depth" in wanted:
            late = replace(request.after(after_s), rays=request.rays, channels=frozenset({"depth"}))
            depth_m = self.opened.frame(late).depth_m
        if wanted <= {"depth"}:
            return RenderedFrame(None, depth_m)
        seen = self.opened.frame(replace(request, channels=wanted - {"depth"}))
        if isinstance(seen, RenderedFrame):
            return replace(seen, depth_m=depth_m)
        others = {name: image for name in wanted - {"rgb", "depth"} if (image := seen.image(name)) is not None}
        rgb: Any = seen.rgb
        return RenderedFrame(rgb, depth_m, others, light=seen.light)

    def motion(self, here: FrameRequest, there: FrameRequest) -> Motion | None:
        """Return what the source says."""
        return motion_between(self.opened, here, there)


# Putting a rig's depth sensor on the scenes of a preset, and refusing what it cannot do there.


def mounted(scene: Scene, rig: Rig, preset: Preset) -> Scene:
    """Return a scene as the rig sees it: as it is, unless its depth sensor is a device of its own.

    Raises InputError where the scene's source or the layout does not go with it.
    """
    spec = preset.spec.rig
    assert spec is not None, "there is a rig"
    colour = scene.camera(preset)
    unit = depth_unit(spec.depth, rig, colour)
    if unit is None:
        return scene
    place = preset.place("rig").at("depth")
    if unit.camera is not None and unit.camera.intrinsics != colour and not scene.source.capabilities.depth_cameras:
        problem = f"{scene.name}: its source renders colour and depth through one camera"
        raise place.error(problem, "leave out the size and the focal length, or use a mesh without light: scene")
    if unit.clock is not None and (why := scene.source.capabilities.instants_only):
        raise place.error(f"{scene.name}: depth is exposed between the frames, but {why}", "leave out its clock")
    found = MountedSource(scene.source, unit)
    layout = preset.spec.output.format.layout
    if problem := layout.stamps_problem(found.frame_stamps):
        where = Message("choose another ", PresetKey("output.layout"), ", such as replica, or other times")
        raise place.error(problem, where)
    if found.repeats is not None and layout.lists_depth:
        row = int(np.flatnonzero(found.repeats != np.arange(len(found.repeats)))[0])
        problem = f"is so slow that frames {found.repeats[row]} and {row} show one exposure of depth"
        why = f"{problem}, which the {layout.label} layout lists by time stamps of their own"
        other = Message("use a higher one, or ", PresetKey("output.layout"), " replica")
        raise place.at("rate_hz").error(why, other)
    return replace(scene, source=found)


def unit_of(scene: Scene) -> DepthUnit | None:
    """Return the depth sensor that a scene is seen by, where that is a device of its own."""
    return scene.source.unit if isinstance(scene.source, MountedSource) else None


def repeats_of(scene: Scene) -> NDArray[np.int64] | None:
    """Return (N,) the first frame that shows the exposure of depth which each shows; None where each has its own."""
    return scene.source.repeats if isinstance(scene.source, MountedSource) else None


def check_clock(setting: Setting, moving: Many[Step[MotionPerturbation]], preset: Preset) -> None:
    """Refuse a depth sensor's own clock beside motion that has nothing between its poses. Raises InputError."""
    apart = [step.perturbation for step in moving if step.perturbation.apply is not None]
    if lone := next((item.name for item in apart if not item.continuous), ""):
        problem = f"{setting.name}: rig.depth looks between the poses, but {lone} moves each pose by itself"
        raise preset.place("settings").error(problem, "take one of them out")


# Checks that the scenes of a preset can give the channels that it asks for.


SURFACE_ENGINES = ("cycles", "embree")  # that tell which surface a pixel sees


def check_surface(scene: Scene, preset: Preset) -> None:
    """Refuse channels of a mesh's surface where frames are not of one, or are rendered by an engine without them.

    Raises InputError.
    """
    asked = [item.name for item in surface_channels(preset.spec.output.modalities)]
    if not asked:
        return
    place, what, engine = preset.place("output.modalities"), " and ".join(asked), preset.spec.render.engine
    capabilities = scene.source.capabilities
    stored = capabilities.own is None and scene.source.mesh is not None  # shown as it is
    for item in surface_channels(asked):
        if not item.needs <= capabilities.surface:
            problem = f"{item.name}: {scene.name} has none: its source does not tell it"
            raise place.error(f"{problem} as it is rendered here", "take it out, or leave that scene out")
        if stored and (problem := item.problem(scene.source.location)):
            raise scene.error(f"has no {item.name}: {problem}", "name such a mesh", "take it out")
        if capabilities.objects is not None and (problem := item.problem_of(capabilities.objects)):
            raise scene.error(f"has no {item.name}: {problem}", "give objects one", "take it out")
    if capabilities.own is None and engine not in SURFACE_ENGINES:
        problem = Message(f"{what}: ", PresetKey("render.engine"), f" {engine} cannot tell it")
        raise place.error(problem, f"use {' or '.join(SURFACE_ENGINES)}")


def check_passes(scene: Scene, preset: Preset) -> None:
    """Refuse passes where a scene has none, or its frames are bent by a lens. Raises InputError."""
    if PASSES not in preset.spec.output.modalities:
        return
    without = Message(f"take {PASSES} out of ", PresetKey("output.modalities"))
    if not scene.source.capabilities.passes:
        raise scene.error(f"has no {PASSES}: these are of scenes of one's own, a .blend", without)
    if preset.spec.camera is not None and preset.spec.camera.distortion is not None:
        raise scene.error(f"has no {PASSES} through a lens that distorts: they are a pinhole's", without)


def check_light(scene: Scene, settings: Sequence[Setting], preset: Preset) -> None:
    """Refuse light as output where a scene has none, and what acts on the image that a view transform makes of it.

    Raises InputError.
    """
    if not preset.spec.output.format.of_light:
        return
    instead = Message("set ", PresetKey("output.image", "png"))
    if not scene.source.capabilities.lit:
        raise scene.error("has no light of its own, and output.image exr is scene-linear light", instead)
    for setting in settings:
        if late := [step.perturbation for step in setting.rgb if not step.perturbation.acts_on_light]:
            problem = f"{setting.name}: {late[0].name} ({late[0].stage}) acts on what the view transform shows"
            message = f"{problem}, and output.image exr is the light before it"
            raise preset.place("settings").error(message, either("take it out", instead))


def check_pairs(scene: Scene, optics: Optics, preset: Preset, unit: DepthUnit | None = None) -> None:
    """Refuse channels that lead from a frame to the next where depth and poses do not tell them. optics: the scene's.

    unit: the rig's depth sensor, where it is a device of its own.

    Raises InputError.
    """
    asked = pair_channels(preset.spec.output.modalities)
    if not asked:
        return
    capabilities, name = scene.source.capabilities, asked[0].name
    problem, lacks = "", None
    if not capabilities.depth:
        problem, lacks = "without depth nothing tells where its pixels go", "depth"
    elif optics.distortion is not None:
        problem, lacks = "its lens distorts", "pinhole"
    elif unit is not None:
        problem = "rig.depth has a camera or a clock of its own, which does not see what colour sees"
    elif not capabilities.any_pose and not scene.path.known.all():
        problem, lacks = "the poses of some frames are not known", "poses"
    if problem:
        without = Message(f"take {name} out of ", PresetKey("output.modalities"))
        raise scene.error(f"has no {name}: {problem}", without, "leave that scene out", lacks=lacks)


def check_exposed(exposing: str, preset: Preset) -> None:
    """Refuse channels of one moment beside a perturbation of exposure. exposing: what exposes, for the message.

    Raises InputError.
    """
    modalities = preset.spec.output.modalities
    asked = [item.name for item in (*surface_channels(modalities), *pair_channels(modalities))]
    if asked := [*asked, *({PASSES} & set(modalities))]:
        problem = f"{exposing} makes colour and depth of several moments, and no {asked[0]}"
        raise preset.place("output.modalities").error(problem, "take one of them out")


def check_distorts(scene: Scene, preset: Preset) -> None:
    """Refuse a lens of the preset's camera that a scene's frames do not pass, and channels that are not undistorted.

    Raises InputError.
    """
    camera = preset.spec.camera
    if camera is None or (spec := camera.distortion) is None:
        return
    place = preset.place("camera").at("distortion")
    if not scene.source.capabilities.distorts:
        problem = f"{scene.name} is not seen through it: its source makes frames of a pinhole"
        raise place.error(problem, "leave it out, or take that scene out")
    if spec.undistort and (asked := surface_channels(preset.spec.output.modalities)):
        problem = f"{asked[0].name} is not interpolated"
        raise place.at("undistort").error(problem, Message("take it out of ", PresetKey("output.modalities")))


OTHER_LAYOUT = Message("choose another ", PresetKey("output.layout"), ", such as tum")


@dataclass(frozen=True)
class Render:
    """What is rendered (or read) once for all the sequences that show it.

    frames: the source frames that these need. camera: of its images. moving: the steps that move the scene's path, with
    the identifiers of their random streams; without steps the path is as planned. exposure: the steps that take frames
    at other moments than the instants of their stamps. optics: what the cameras have beyond one pinhole, as images are
    written. unit: the rig's depth sensor, where it is a device of its own.
    """

    name: str
    scene: Scene
    frames: Numbers
    sequences: tuple[PlannedSequence, ...]
    camera: Intrinsics
    moving: tuple[Step[MotionPerturbation], ...] = ()
    identifiers: Identifiers = ()
    exposure: tuple[Step[ExposurePerturbation], ...] = ()
    optics: Optics = PINHOLE
    unit: DepthUnit | None = None

    @property
    def acts_on_light(self) -> bool:
        """Whether a step of a setting acts on the light of a lit scene, before its view transform."""
        steps = [step for sequence in self.sequences for step in sequence.setting.rgb]
        return self.scene.source.capabilities.lit and any(step.perturbation.acts_on_light for step in steps)

    @property
    def depth_camera(self) -> Intrinsics:
        """The camera of its depth images: the colour's, unless they have one of their own."""
        return self.camera if self.optics.depth is None else self.optics.depth.intrinsics

    @property
    def measured_camera(self) -> Intrinsics:
        """The camera by which depth is measured: that of its images, unless these are registered into colour."""
        return self.depth_camera if self.registration is None else self.registration.depth.intrinsics

    @property
    def registers(self) -> bool:
        """Whether depth is registered into colour before it is written."""
        return self.unit is not None and self.unit.registered and self.unit.camera is not None

    @cached_property
    def registration(self) -> Registration | None:
        """What is between colour and depth as it is measured; None where they have one camera."""
        depth = self.optics.depth if self.unit is None or self.unit.camera is None else self.unit.camera
        return None if depth is None else Registration(self.camera, depth, self.optics.distortion)

    @property
    def needs_depth(self) -> bool:
        """Whether a step of colour depends on depth."""
        return any(sequence.setting.needs_depth for sequence in self.sequences)

    @property
    def needs_rgb(self) -> bool:
        """Whether a step of depth depends on colour."""
        return any(sequence.setting.needs_rgb for sequence in self.sequences)

    @property
    def needed_besides(self) -> frozenset[Modality]:
        """The channels that steps need, whether they are written or not."""
        depth = self.needs_depth or any(sequence.setting.measures_travel for sequence in self.sequences)
        return frozenset(name for name, wanted in (("rgb", self.needs_rgb), ("depth", depth)) if wanted)


@dataclass(frozen=True)
class Refused:
    """A sequence of a preset that cannot be made of what its scene has.

    why: a sentence's end, after the setting's name. error: what ends a run where nothing is left out.
    """

    setting: str
    scene: str
    why: str
    error: InputError

    @property
    def folder(self) -> str:
        """The folder that it would have in the dataset."""
        return f"{self.setting}/{self.scene}"


@dataclass(frozen=True)
class Plan:
    """All renders and sequences of a preset. chosen: the frames of each sequence to make, if not all.

    refused: sequences that are left out, as their scenes lack what their settings need. reach: how far its frames can
    see, where that decides the depth scale.
    """

    preset: Preset
    format: OutputFormat
    rig: Rig | None
    settings: tuple[Setting, ...]
    renders: tuple[Render, ...]
    chosen: slice | None = None
    refused: tuple[Refused, ...] = ()
    reach: DepthReach | None = None

    @cached_property
    def sequences(self) -> tuple[PlannedSequence, ...]:
        """Every sequence, in the order of the renders; --frames may leave it without a frame."""
        return tuple(sequence for render in self.renders for sequence in render.sequences)

    @property
    def scenes(self) -> tuple[Scene, ...]:
        """Every scene once, in order."""
        return tuple({render.scene.name: render.scene for render in self.renders}.values())

    @cached_property
    def cameras(self) -> dict[str, Intrinsics]:
        """The intrinsics of each scene's frames, by the scene's name."""
        return {render.scene.name: render.camera for render in self.renders}

    @cached_property
    def depth_cameras(self) -> dict[str, Intrinsics]:
        """The intrinsics of each scene's depth images, by the scene's name."""
        return {render.scene.name: render.depth_camera for render in self.renders}

    @property
    def camera(self) -> Intrinsics | None:
        """The intrinsics of all frames; None where scenes have different ones."""
        cameras = set(self.cameras.values())
        return cameras.pop() if len(cameras) == 1 else None

    @property
    def renders_anything(self) -> bool:
        """Whether anything is rendered, rather than read from a recording."""
        return any(scene.source.capabilities.rendered for scene in self.scenes)

    @property
    def uses_render_settings(self) -> bool:
        """Whether anything is rendered as the preset says, rather than by settings of its own."""
        return any(
            scene.source.capabilities.rendered and scene.source.capabilities.own is None for scene in self.scenes
        )

    @property
    def engines(self) -> tuple[EngineName, ...]:
        """The engines that render anything, each once, in alphabetical order."""
        capabilities = [scene.source.capabilities for scene in self.scenes if scene.source.capabilities.rendered]
        engine = self.preset.spec.render.engine
        return tuple(sorted({engine if item.own is None else item.own.engine for item in capabilities}))

    @property
    def renders_in_blender(self) -> bool:
        """Whether Blender renders anything."""
        return any(engine != "embree" for engine in self.engines)

    @cached_property
    def composites(self) -> bool:
        """Whether anything is perturbed in Blender's compositor."""
        return "rgb" in self.format.modalities and any(setting.composited for setting in self.settings)

    @property
    def needs_blender(self) -> bool:
        """Whether Blender renders anything, or its compositor perturbs it."""
        return self.renders_in_blender or self.composites

    @cached_property
    def parts_made(self) -> dict[tuple[str, Modality], dict[str, float]]:
        """What `estimate` has found of `parts_made`, by the render's name and the channel."""
        return {}

    def only(self, render: Render) -> "Plan":
        """Return the plan of one of the renders alone, with the settings of its sequences."""
        settings = tuple(sequence.setting for sequence in render.sequences)
        return replace(self, renders=(render,), settings=settings)

    @property
    def frame_count(self) -> int:
        """How many source frames are rendered or read."""
        return sum(len(render.frames) for render in self.renders)


def read_settings(preset: Preset, registry: Registry) -> tuple[Setting, ...]:
    """Read the settings of a preset that are wanted. registry: the perturbations that they may name.

    Raises InputError where they are wrong or cannot be carried out.
    """
    spec = preset.spec
    for file in preset.named_files:
        check_device_part(file.part, file.value, file.place, registry)
    settings = parse_settings(spec.settings, preset.setting_places, registry, spec.render.backend)
    names = [setting.name for setting in settings]
    wanted = set(selected(names, spec.only.settings, preset.place("only.settings")))
    sensor = depth_sensor(preset, registry)
    settings = tuple(replace(setting, sensor=sensor) for setting in settings if setting.name in wanted)
    check_sensors(settings, preset)
    _check_executions(settings, preset)
    return settings


def lay_out_plan(
    preset: Preset,
    settings: tuple[Setting, ...],
    scenes: Sequence[Scene],
    chosen: slice | None = None,
    *,
    leave_out: bool = False,
) -> Plan:
    """Lay out the work of a preset with its settings and scenes.

    chosen: the frames of each sequence to make, start and stop only; they keep their numbers. leave_out: whether a
    setting that needs what a scene has not is left out there, and the rest planned. Raises InputError where the preset
    asks for what cannot be made, and where nothing is left.
    """
    spec = preset.spec
    _check_scenes(scenes, preset)
    plan = Plan(
        preset=preset,
        format=spec.output.format,
        rig=read_rig(preset, {axes for scene in scenes if (axes := scene.source.robot_axes) is not None}),
        settings=settings,
        renders=(),
        chosen=chosen,
    )
    if plan.rig is not None:
        check_imu(plan.rig, settings, scenes, preset)
        scenes = [mounted(scene, plan.rig, preset) for scene in scenes]
    refused = tuple(found for scene in scenes for setting in settings if (found := _refused(setting, scene)))
    if refused and (not leave_out or len(refused) == len(scenes) * len(settings)):
        raise _none_left(refused, preset) if leave_out else refused[0].error
    without = {item.folder for item in refused}
    renders = tuple(render for scene in scenes for render in _renders(plan, scene, without))
    planned = {sequence.setting.name for render in renders for sequence in render.sequences}
    settings = tuple(setting for setting in settings if setting.name in planned)
    plan = replace(plan, settings=settings, renders=renders, refused=refused)
    given = spec.output.depth_range == "layout" or spec.output.depth_scale_per_m is not None
    if given or "depth" not in plan.format.modalities:
        return plan
    reach = max((_reach(render, preset) for render in renders), key=lambda found: found.farthest_m)
    return replace(plan, format=replace(plan.format, depth_scale_per_m=reach.scale_per_m), reach=reach)


def _reach(render: Render, preset: Preset) -> DepthReach:
    """Return how far the frames of a render can see. Raises InputError where nothing tells it."""
    path = move(render.moving, render.scene.path, render.identifiers)
    apart = None if render.registration is None else render.registration.depth.matrix[:3, 3]
    mount_m = 0.0 if apart is None else float(np.linalg.norm(apart))
    place = preset.place("output.depth_range")
    return depth_reach(render.scene, path, mount_m, preset.spec.camera, place)


def _refused(setting: Setting, scene: Scene) -> Refused | None:
    """Return why a setting cannot be carried out on what a scene has; None where it can."""
    capabilities, remedies = scene.source.capabilities, ["take that setting out"]
    moves = any(step.perturbation.apply is not None for step in setting.motion if step.severity != 0)
    lacks = None
    if setting.exposure and (between := capabilities.instants_only):
        why = f"looks between the frames with {setting.exposure[0].perturbation.name}, but {between}"
        remedies.append("render a mesh")
    elif not capabilities.depth and (
        setting.needs_depth or setting.measures_travel or setting.depth or setting.pairing
    ):
        why, lacks = f"needs depth, and {scene.name} has none", "depth"
    elif moves and not capabilities.any_pose:
        why = "deviates from the path, but an existing sequence cannot be seen from elsewhere"
        remedies.append("render the scene's mesh")
    else:
        return None
    return Refused(setting.name, scene.name, why, scene.error(f"{setting.name} {why}", *remedies, lacks=lacks))


def _none_left(refused: Sequence[Refused], preset: Preset) -> InputError:
    """Return the error that says that nothing of a preset can be made."""
    if len(refused) == 1:
        return refused[0].error
    reasons = list(dict.fromkeys(item.why for item in refused))
    others = f", and {len(reasons) - 1} reasons more" if len(reasons) > 1 else ""
    first = f"{refused[0].setting} {reasons[0]}"
    problem = f"none of {len(refused)} sequences can be made: {first}{others}"
    return preset.place("settings").error(problem, "add a setting that its scenes can show, such as {name: clean}")


def _renders(plan: Plan, scene: Scene, without: Collection[str]) -> list[Render]:
    """Group the settings of a scene by what has to be rendered: one render serves all that leave the path alone.

    Those that expose its frames alike, along equal poses, share one too. without: folders of sequences to leave out.
    """
    settings = [setting for setting in plan.settings if f"{setting.name}/{scene.name}" not in without]
    if not settings:
        return []
    _check_chosen(scene, plan)
    preset, modalities = plan.preset, plan.format.modalities
    camera = scene.camera(preset)
    optics, unit = _optics(scene, plan, camera), unit_of(scene)
    check_pairs(scene, optics, preset, unit)
    clocked = unit is not None and unit.clock is not None
    check_light(scene, settings, preset)
    shared: list[PlannedSequence] = []
    moved: dict[Hashable, Render] = {}
    for setting in settings:
        moving, _ = split_motion(setting.motion, exposed=clocked or bool(setting.exposure))
        _check_exposure(setting, moving, scene, preset)
        identifiers = (preset.spec.seed, scene.name, setting.name)
        pairing = {"clocked": clocked, "repeats": repeats_of(scene)}
        sequence = lay_out(setting, scene.name, scene.frame_count, identifiers, plan.chosen, **pairing)
        if plan.chosen is None and not sequence.frames:
            pairing = ", ".join(step.perturbation.name for step in setting.pairing)
            raise preset.place("settings").error(
                f"{setting.name}: {pairing} leaves none of the {scene.frame_count} frames of {scene.name}",
                "change its parameters; desync has edge: clamp",
            )
        if clocked:
            check_clock(setting, moving, preset)
        if not moving and not setting.exposure:
            shared.append(sequence)
            continue
        key = _shown_key(setting, moving, scene.frame_count, identifiers)
        empty = Render(f"{scene.name}@{setting.name}", scene, range(0), (), camera, moving, identifiers)
        first = moved.get(key, replace(empty, optics=optics, unit=unit))
        sequences = (*first.sequences, sequence)
        moved[key] = replace(
            first, frames=needed_sources(sequences, modalities), sequences=sequences, exposure=setting.exposure
        )
    if not shared:
        return list(moved.values())
    needed = needed_sources(shared, modalities)
    return [Render(scene.name, scene, needed, tuple(shared), camera, optics=optics, unit=unit), *moved.values()]


def _shown_key(
    setting: Setting, moving: tuple[Step[MotionPerturbation], ...], count: int, identifiers: Identifiers
) -> Hashable:
    """Return what is equal for settings whose frames are taken along equal poses, at equal moments.

    Poses that a setting moves are its own.
    """
    if any(step.perturbation.apply is not None for step in moving):
        return setting.name
    chosen = chosen_poses(moving, count, identifiers)
    return exposure_key(setting.exposure), None if chosen is None else chosen.tobytes()


def _check_exposure(
    setting: Setting, moving: tuple[Step[MotionPerturbation], ...], scene: Scene, preset: Preset
) -> None:
    """Refuse to look between frames where there is nothing."""
    if not setting.exposure:
        return
    exposing = setting.exposure[0].perturbation.name
    check_exposed(f"{setting.name}: {exposing}", preset)
    bent = [step.perturbation.name for step in setting.exposure if step.perturbation.rays]
    if bent and not scene.source.capabilities.casts_rays:
        why = scene.source.capabilities.at_once
        problem = f"{setting.name}: {bent[0]} {why or 'casts rays of its own, which this scene does not do'}"
        other = () if why else (Message("use ", PresetKey("render.engine", "embree")),)
        raise scene.error(problem, "take that setting out", *other)
    apart = [step.perturbation for step in moving if step.perturbation.apply is not None]
    if lone := next((item.name for item in apart if not item.continuous), ""):
        problem = f"{setting.name}: {exposing} looks between the poses, but {lone} moves each pose by itself"
        raise preset.place("settings").error(problem, "take one of them out")


def _optics(scene: Scene, plan: Plan, camera: Intrinsics) -> Optics:
    """Return what a scene's cameras have beyond one pinhole. Raises InputError where the layout cannot tell it."""
    check_distorts(scene, plan.preset)
    optics, layout = scene.source.optics(camera), plan.format.layout
    said = optics.depth is None and optics.distortion is not None and layout.says_lens(optics.distortion)
    if optics.plain or layout.optics or said:
        return optics
    if optics.depth is not None:
        problem = f"depth has a camera of its own, which the {layout.label} layout cannot say"
        raise scene.error(problem, OTHER_LAYOUT, lacks="registration")
    raise scene.error(f"its lens distorts, which the {layout.label} layout cannot say", OTHER_LAYOUT, lacks="pinhole")


def needed_sources(sequences: Sequence[PlannedSequence], modalities: Sequence[Modality]) -> Numbers:
    """Return the source frames that sequences of one render show, increasing."""
    return union([sequence.sources_shown(modality) for sequence in sequences for modality in modalities])


# --- checks ---


def _check_scenes(scenes: Sequence[Scene], preset: Preset) -> None:
    """Refuse names given twice, and scenes that do not fit the layout or the rig."""
    names: dict[str, str] = {}
    for scene in scenes:
        if (other := names.get(scene.name.casefold())) is not None:
            same = other == scene.name
            problem = f"{scene.name!r} names two scenes" if same else format_same_folder(scene.name, other)
            raise scene.place.at("name").error(problem, "give each a name of its own")
        names[scene.name.casefold()] = scene.name
        if preset.spec.rig is not None and not scene.source.capabilities.any_pose:
            raise scene.error("is a recording, which has no other poses for a rig", "leave rig out")
        if problem := preset.spec.output.format.layout.stamps_problem(scene.source.frame_stamps):
            raise scene.place.error(problem, Message("mend the stamps, or ", OTHER_LAYOUT))
        if not scene.source.capabilities.any_pose:
            _check_poses(scene, preset)
        if not scene.source.capabilities.depth and "depth" in preset.spec.output.modalities:
            problem = Message(f"{scene.name} has no depth, but ", PresetKey("output.modalities"), " asks for it")
            raise scene.error(problem, Message("set ", PresetKey("output.modalities", "[rgb]")), lacks="depth")
        check_surface(scene, preset)
        check_passes(scene, preset)


def _check_poses(scene: Scene, preset: Preset) -> None:
    """Refuse frames without a pose in a layout that has a line for each."""
    known, layout = scene.path.known, preset.spec.output.format.layout
    if known.any() and not known.all() and not layout.gaps:
        message = f"{np.count_nonzero(~known)} of {len(known)} frames have no pose, but {layout.label} has one for each"
        raise scene.error(message, OTHER_LAYOUT, lacks="poses")


def _check_executions(settings: tuple[Setting, ...], preset: Preset) -> None:
    """Refuse perturbations that the compositor cannot execute."""
    for setting in settings:
        lacking = [step.perturbation.name for step in setting.rgb if step.perturbation.nodes is None]
        if setting.composited and lacking:
            problem = f"{setting.name}: {lacking[0]} has no node group for the compositor"
            raise preset.place("settings").error(problem, Message("give it ", PresetKey("backend", "reference")))


def _check_chosen(scene: Scene, plan: Plan) -> None:
    chosen = plan.chosen
    if chosen is not None and not range(scene.frame_count)[chosen]:
        raise InputError(
            plan.preset.path,
            f"--frames {chosen.start or 0}:{'' if chosen.stop is None else chosen.stop} chooses none of the "
            f"{scene.frame_count} frames of {scene.name}",
            remedy=f"choose from 0:{scene.frame_count}",
        )


# What a user should know about a plan before it is made: one sentence each.


MS_PER_S = 1000.0


def plan_notes(plan: Plan) -> list[str]:
    """Return what is to be said of a plan beside its format: what is left out, exposures, what is seen too much."""
    refused = [f"{item.folder} is left out: {item.setting} {item.why}" for item in plan.refused]
    reach = [] if plan.reach is None else [plan.reach.note]
    seen = [*_long_exposures(plan), *_limits(plan)]
    return [*refused, *reach, *seen, *_broken_depth(plan), *_one_depth(plan), *_aliased(plan)]


def _one_depth(plan: Plan) -> list[str]:
    """Return a sentence where a sequence's pairing shows one frame's depth with every colour; one for all of them."""
    found: list[tuple[str, int]] = []
    for sequence in plan.sequences if "depth" in plan.format.modalities else ():
        if not sequence.setting.pairing or sequence.depth_frames is None:
            continue
        shown = array_of(sequence.depth_frames)
        if len(shown) > 1 and (shown == shown[0]).all() and shown[0] >= 0:
            found.append((sequence.folder, len(shown)))
    if not found:
        return []
    (folder, frames), more = found[0], len(found) - 1
    also = f", like {counted(more, 'more sequence')}" if more else ""
    return [f"{folder}: depth is paired from beyond its {counted(frames, 'frame')}, so all have the same{also}"]


def _aliased(plan: Plan) -> list[str]:
    """Return a sentence for each setting that shakes faster than an IMU can tell, which has no low-pass against it."""
    imu = None if plan.rig is None else plan.rig.imu
    if imu is None or 0 < imu.model.bandwidth_hz < imu.rate_hz / 2:
        return []
    found: list[str] = []
    for setting in plan.settings:
        for step in setting.motion:
            kind = step.perturbation
            if kind.highest_hz is None or step.severity == 0:
                continue
            highest_hz = kind.highest_hz(step.parameters(step.severity))
            if highest_hz > imu.rate_hz / 2:
                found.append(
                    f"{setting.name}: {kind.name} shakes at up to {highest_hz:g} Hz, more than half of the IMU's "
                    f"{imu.rate_hz:g} samples a second, so it aliases; rig.imu.bandwidth_hz gives it a low-pass"
                )
    return found


def _broken_depth(plan: Plan) -> list[str]:
    """Return a sentence for each setting of a dataset with depth that moves colour away from it."""
    if not {"rgb", "depth"} <= set(plan.format.modalities):
        return []
    return [
        f"{setting.name}: {step.perturbation.name} moves colour alone: depth no longer fits it"
        for setting in plan.settings
        for step in setting.rgb
        if step.perturbation.breaks_depth and step.severity != 0
    ]


def _limits(plan: Plan) -> list[str]:
    """Return a sentence for each setting that draws less of something than it asks for, as a camera sees so much."""
    found: dict[str, None] = {}
    for render in plan.renders:
        if render.scene.source.capabilities.lit:
            continue  # node groups draw there, whose time goes with the image
        for setting in (sequence.setting for sequence in render.sequences):
            for step in () if setting.composited else setting.rgb:
                if step.perturbation.limits is None or step.severity == 0:
                    continue
                severities = (step.severity,) if step.levels is None else sorted({*step.levels} - {0})
                said = (step.perturbation.limits(step.parameters(each), render.camera) for each in severities)
                if text := next(filter(None, said), ""):
                    found[f"{setting.name}: {step.perturbation.name} {text}"] = None
    return list(found)


def _long_exposures(plan: Plan) -> list[str]:
    """Return a sentence for each setting whose shutter, or whose readout, takes longer than frames are apart."""
    gaps = [
        (float(np.diff(stamps).min()), scene.name)
        for scene in plan.scenes
        if len(stamps := scene.source.frame_stamps.rgb.seconds) > 1
    ]
    if not gaps:
        return []
    apart_s, nearest = min(gaps)
    found: list[str] = []
    for setting in plan.settings:
        if (shutter := setting.shutter) is None:
            continue
        longest_s, what = max((shutter.exposure_s, "exposure"), (shutter.readout_s, "readout"))
        if longest_s > apart_s * (1 + 1e-6):
            longest_ms, apart_ms = longest_s * MS_PER_S, apart_s * MS_PER_S
            took = f"{what} of {longest_ms:.3g} ms is longer than the {apart_ms:.3g} ms between frames of {nearest}"
            found.append(f"{setting.name}: {took}, which no camera does; shorten it, or take fewer frames a second")
    return found


# Making a preset's plan, with its files found and all perturbations that are installed.


def make_plan(preset: Preset, chosen: slice | None = None, scenes: Collection[str] = ()) -> Plan:
    """Find every file of a preset and lay out the work.

    chosen: the frames of each sequence to make, start and stop only; they keep their numbers.
    scenes: names; with some, the plan has these alone, as a machine that makes one shard looks at no other scene.

    Raises InputError for files that are missing or wrong, and for what cannot be made from them.
    """
    settings = read_settings(preset, registry())  # first, so that a misspelt key is reported before files are read
    return lay_out_plan(preset, settings, find_scenes(preset, set(scenes)), chosen, leave_out=True)
