# SPDX-License-Identifier: GPL-3.0-or-later
"""The sensors of a robot in a plan: where they sit, what measures depth and when, and what cannot be combined."""

from collections.abc import Callable, Iterable, Sequence
from collections.abc import Sequence as Many
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..channels import pair_channels, surface_channels
from ..core.errors import Message, PresetKey, either
from ..core.frame_request import FrameRequest
from ..core.geometry import Intrinsics, invert_pose
from ..core.lens import DepthCamera, Optics
from ..core.schema import ConfigPath
from ..core.trajectory import NS_PER_S, Axes, FrameStamps, Stamps, Trajectory, rounded_poses
from ..perturbations.kinds import DepthPerturbation, MotionPerturbation
from ..perturbations.parsing import Registry, is_sensor, parse_sensor
from ..perturbations.steps import Setting, Step, steps_of_kind
from ..preset.keys import DepthSensorSpec, ImuSpec, Preset, SensorSpec
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
from ..sources.scene_kinds import Scene
from ..trajectories.rig import MOST_SAMPLES, Imu, Rig, Sensor, sensor_from_extrinsics


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
    if asked := (*surface_channels(modalities), *pair_channels(modalities)):
        problem = f"{exposing} makes colour and depth of several moments, and no {asked[0].name}"
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
