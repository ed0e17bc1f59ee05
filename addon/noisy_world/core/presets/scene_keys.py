# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a preset's scenes: where clean frames come from, and the way through them."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from ..datasets.known_poses import PosePolicy
from ..datasets.layouts import known_recordings
from ..datasets.stored import SCALES_PER_M
from ..scenes.embedded import EMBEDDED_ROOM, ROOMS, is_embedded
from ..scenes.replica import REPLICA_SCENES, replica_names
from ..schema import Place, key, unknown_name
from .frame_range import FrameRange, frame_range_problem
from .names import scene_name


@dataclass(frozen=True)
class HandheldSpec:
    """A seeded path of a camera held in the hand, walking through the scene."""

    frames: int = key("length of the path", unit="frames", minimum=1, maximum=1_000_000, identity="meaning")
    rate_hz: float = key("frames a second", unit="Hz", default=20.0, above=0, maximum=10_000, identity="meaning")
    seed: int | None = key(
        "seed of the path, where it should not follow the preset's", default=None, minimum=0, identity="meaning"
    )
    speed_m_s: float = key("walking speed", unit="m/s", default=0.5, above=0, maximum=10, identity="meaning")
    clearance_m: float = key(
        "distance kept from everything", unit="m", default=0.45, above=0, maximum=10, identity="meaning"
    )
    revisit: bool = key(
        "whether earlier stretches are walked again, looking the same way: loops to close",
        default=False,
        identity="meaning",
    )


@dataclass(frozen=True)
class TrajectorySpec:
    """Where the camera goes: a file, or a path made here; a bare text is a file."""

    SHORTHAND: ClassVar[str] = "file"

    file: str | None = key(
        "file of poses, or folder of one pose a file, relative to the preset; * allowed; its format is told by content",
        default=None,
        identity="meaning",
    )
    handheld: HandheldSpec | None = key("a path made here instead of a file", default=None)
    format: Literal["auto", "replica", "kitti", "tum", "euroc", "matrices", "log", "transforms"] = key(
        "the file's format, where its content should not decide", default="auto", identity="meaning"
    )
    pose: Literal["auto", "c2w", "w2c"] = key(
        "whether the file holds camera-to-world or world-to-camera; auto is camera-to-world",
        default="auto",
        identity="meaning",
    )
    axes: Literal["auto", "opencv", "opengl", "robot"] = key(
        "the file's camera axes: x right, y down, z forward; y up, z backward; or x forward, y left, z up; auto is "
        "opencv, and opengl for transforms.json",
        default="auto",
        identity="meaning",
    )
    rate_hz: float = key(
        "frames a second, where the file has no time stamps",
        unit="Hz",
        default=20.0,
        above=0,
        maximum=10_000,
        identity="meaning",
    )
    stamp_unit: Literal["auto", "s", "ms", "us", "ns"] = key(
        "the unit of the file's time stamps; auto tells seconds from nanoseconds", default="auto", identity="meaning"
    )
    start: int = key("first pose used", default=0, minimum=0, identity="meaning")
    stop: int | None = key("the pose after the last one used", default=None, minimum=1, identity="meaning")
    every: int = key("use every n-th pose", default=1, minimum=1, identity="meaning")
    resample_hz: float | None = key(
        "take poses at this rate, from the smooth path through all poses",
        unit="Hz",
        default=None,
        above=0,
        maximum=10_000,
        identity="meaning",
    )


@dataclass(frozen=True)
class SceneSpec:
    """A scene and the way through it, or a sequence that exists."""

    mesh: str | None = key(
        "PLY, glTF, OBJ, USD, FBX or STL file, relative to the preset; * allowed; or "
        f"{EMBEDDED_ROOM}?seed=0 to {ROOMS - 1}",
        default=None,
        identity="meaning",
    )
    up: Literal["y", "z"] | None = key(
        "the axis of the mesh's file that points up, where that is not what the file declares; y is turned to Z up",
        default=None,
        identity="meaning",
    )
    light: Literal["none", "scene"] = key(
        "how a mesh is lit: not at all, showing its base colours; or by the lights and materials of its file",
        default="none",
        identity="meaning",
    )
    replica: str | None = key(
        f"instead of mesh: a scene of Replica, looked for under data; * allowed; {', '.join(REPLICA_SCENES)}",
        default=None,
        identity="meaning",
    )
    sequence: str | None = key(
        f"instead of mesh and trajectory: a folder laid out as {known_recordings()}, relative to the preset; * allowed",
        default=None,
        identity="meaning",
    )
    video: str | None = key(
        "instead of sequence: a video file, relative to the preset; * allowed", default=None, identity="meaning"
    )
    depth: str | None = key(
        "the folder of a video's depth, a 16-bit PNG for each frame in the order of their numbers, relative to the "
        "preset; * stands for what the * of video matched",
        default=None,
        identity="meaning",
    )
    depth_scale_per_m: float | None = key(
        "steps a metre of the depth beside a video; default 1000: millimetres",
        unit="steps/m",
        default=None,
        minimum=SCALES_PER_M[0],
        maximum=SCALES_PER_M[1],
        identity="meaning",
    )
    blend: str | None = key(
        "instead of mesh: a .blend, rendered as its artist set it up, relative to the preset; * allowed",
        default=None,
        identity="meaning",
    )
    scene: str | None = key("the scene of the .blend; default the file's active one", default=None, identity="meaning")
    camera: str | None = key(
        "the camera object of that scene; default the scene's own, and those that its markers name",
        default=None,
        identity="meaning",
    )
    frames: str | None = key(
        "the scene's frames, FIRST:LAST or FIRST:LAST:STEP, both with them; default the scene's range and step",
        default=None,
        pattern=frame_range_problem,
        identity="meaning",
    )
    compositor: Literal["off", "keep"] = key(
        "what becomes of the .blend's own compositor", default="off", identity="meaning"
    )
    depth_alpha: float = key(
        "depth of a .blend goes through what is less opaque than this",
        default=0.5,
        minimum=0,
        maximum=1,
        identity="meaning",
    )
    trajectory: TrajectorySpec | None = key(
        "the way of the camera, or of the robot that carries it; for replica the path that the SLAM systems use, for a "
        ".blend its own camera's",
        default=None,
    )
    rate_hz: float | None = key(
        "frames a second of a sequence that has no time stamps of its own; default 20",
        unit="Hz",
        default=None,
        above=0,
        maximum=10_000,
        identity="meaning",
    )
    poses: PosePolicy = key(
        "frames of a sequence that have no valid pose: drop leaves them out, keep keeps them without one, require ends "
        "the run; none looks for no poses at all: a recording without ground truth",
        default="drop",
        identity="meaning",
    )
    undistort: bool = key(
        "whether a sequence whose lens distorts is made a pinhole's", default=False, identity="meaning"
    )
    register: bool = key(
        "whether depth of a sequence that has a camera of its own is laid into colour, by the calibration",
        default=False,
        identity="meaning",
    )
    name: str | None = key(
        "the scene's folder in the dataset; * stands for what the * of mesh, sequence, video or blend matched",
        default=None,
        pattern=scene_name,
        identity="meaning",
    )

    @property
    def frame_range(self) -> FrameRange | None:
        """The scene's frames that are asked for; None for its own."""
        return None if self.frames is None else FrameRange.parse(self.frames)


BLEND_KEYS = ("blend", "scene", "camera", "frames", "compositor", "depth_alpha")
"""The keys of a scene that say something about a .blend alone."""

RECORDING_KEYS = ("video", "depth", "depth_scale_per_m", "poses", "undistort", "register")
"""The keys of a scene that say something about a recording alone, and are told in a dataset where they are given."""

MESH_KEYS = ("up", "light")
"""The keys that say something about the file of a mesh alone."""


def check_scene(spec: SceneSpec, place: Place) -> None:
    """Check what involves several keys of a scene. Raises InputError."""
    if sum(item is not None for item in (spec.mesh, spec.replica, spec.sequence, spec.video, spec.blend)) != 1:
        raise place.error("needs either mesh or sequence, or replica, video or blend", "name one of them")
    if spec.up is not None and (spec.mesh is None or is_embedded(spec.mesh)):
        raise place.at("up").error("goes with the file of a mesh", "leave it out")
    if spec.light != "none" and (spec.mesh is None or is_embedded(spec.mesh)):
        raise place.at("light").error("goes with the file of a mesh", "leave it out")
    _check_recording(spec, place)
    _check_blend(spec, place)
    if spec.sequence is not None or spec.video is not None:
        if spec.trajectory is not None:
            raise place.at("trajectory").error("goes with mesh; a sequence has its own", "leave it out")
        return
    if spec.replica is not None:
        if not replica_names(spec.replica):
            raise unknown_name(place.at("replica"), "scene of Replica", spec.replica, REPLICA_SCENES)
        if spec.trajectory is None or (spec.trajectory.file is None and spec.trajectory.handheld is None):
            return
    if spec.trajectory is None:
        if spec.blend is not None:
            return
        raise place.at("trajectory").error("is missing", "add it: the way of the camera")
    _check_trajectory(spec.trajectory, place.at("trajectory"))


def _check_recording(spec: SceneSpec, place: Place) -> None:
    if spec.depth is not None and spec.video is None:
        raise place.at("depth").error("goes with video", "leave it out")
    if spec.depth_scale_per_m is not None and spec.depth is None:
        raise place.at("depth_scale_per_m").error("goes with depth of a video", "leave it out")
    if spec.sequence is not None:
        return
    if spec.rate_hz is not None:
        raise place.at("rate_hz").error("goes with sequence", "the rate of a mesh's path is trajectory.rate_hz")
    for name in ("poses", "undistort", "register"):
        if getattr(spec, name) not in ("drop", False):
            raise place.at(name).error("goes with sequence", "leave it out")


def _check_blend(spec: SceneSpec, place: Place) -> None:
    if spec.blend is None:
        untold = SceneSpec()
        for name in BLEND_KEYS:
            if getattr(spec, name) != getattr(untold, name):
                raise place.at(name).error("goes with blend", "leave it out")
    elif spec.trajectory is not None and spec.trajectory.handheld is not None:
        problem = "is made through a mesh, which a .blend is not"
        raise place.at("trajectory").at("handheld").error(problem, "give a file, or let the scene's camera move")


def _check_trajectory(spec: TrajectorySpec, place: Place) -> None:
    if (spec.file is None) == (spec.handheld is None):
        raise place.error("needs either file or handheld", "name one of them")
    if spec.stop is not None and spec.stop <= spec.start:
        raise place.at("stop").error(f"is {spec.stop}, not beyond start ({spec.start})")
