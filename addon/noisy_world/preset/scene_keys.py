# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys that scenes of several sources have: a name, and the way through them. Each source adds its own."""

from dataclasses import dataclass
from typing import ClassVar

from ..core.schema import Choice, ConfigPath, key, key_of
from ..trajectories.bodies import BodyKind
from ..trajectories.formats import PoseAxes, PoseDirection, PoseKeys, StampUnits
from .names import scene_name


@dataclass(frozen=True)
class HandheldSpec:
    """A seeded path of a camera held in the hand, walking through the scene."""

    frames: int = key(
        "length of the path",
        unit="frames",
        minimum=1,
        maximum=1_000_000,
        identity="meaning",
        slider=(2, 2000),
        label="Length",
    )
    rate_hz: float = key(
        "frames a second",
        unit="Hz",
        default=20.0,
        above=0,
        maximum=10_000,
        identity="meaning",
        slider=(1, 120),
        label="Frame Rate",
    )
    seed: int | None = key(
        "seed of the path, where it should not follow the preset's", default=None, minimum=0, identity="meaning"
    )
    speed_m_s: float = key(
        "walking speed", unit="m/s", default=0.5, above=0, maximum=10, identity="meaning", slider=(0.05, 3)
    )
    clearance_m: float = key(
        "distance kept from everything", unit="m", default=0.45, above=0, maximum=10, identity="meaning", slider=(0, 1)
    )
    revisit: bool = key(
        "whether earlier stretches are walked again, looking the same way: loops to close",
        default=False,
        identity="meaning",
    )
    wander_m: float = key(
        "how far the hand strays from the walk along each axis, where there is room, so that the path has extent in "
        "three of them; 0 is a walk at nearly one height, often nearly straight",
        unit="m",
        default=0.0,
        minimum=0,
        maximum=2,
        identity="meaning",
    )


@dataclass(frozen=True)
class BodySpec:
    """What carries the camera along the path; a bare text is its kind."""

    SHORTHAND: ClassVar[str] = "kind"

    kind: BodyKind = key(
        "whose camera it is: that of a head that walks or runs, a small quadruped, a rover on a rough floor, a drone",
        choices={
            "walker": Choice("Walker", "A head that walks"),
            "runner": Choice("Runner", "A head that runs"),
            "quadruped": Choice("Quadruped", "A small robot on four legs that trots"),
            "rover": Choice("Rover", "A robot on four wheels, on a rough floor"),
            "drone": Choice("Drone", "A multicopter, which leans into its acceleration"),
        },
        identity="meaning",
        label="Body",
    )
    motion: float = key(
        "what the body's own motion is multiplied by; 0 leaves the mean way",
        default=1.0,
        minimum=0,
        maximum=10,
        identity="meaning",
        label="Body Motion",
    )


@dataclass(frozen=True)
class TrajectorySpec:
    """Where the camera goes: a file, or a path made here; a bare text is a file."""

    TOOLTIPS: ClassVar[dict[str, str]] = {
        "file": "Poses of Replica, KITTI, TUM, EuRoC, ScanNet, Open3D (.log) or nerfstudio (transforms.json)",
        "every": "Use every pose, every second one, every third, and so on",
    }

    SHORTHAND: ClassVar[str] = "file"

    file: str | None = key(
        "file of poses, or folder of one pose a file, relative to the preset; * allowed; its format is told by content",
        default=None,
        identity="meaning",
        label="File",
    )
    handheld: HandheldSpec | None = key("a path made here instead of a file", default=None)
    body: BodySpec | None = key("what carries the camera along the path, with its own motion", default=None)
    format: str = key_of(PoseKeys, "format")
    pose: PoseDirection = key_of(PoseKeys, "pose")
    axes: PoseAxes = key_of(PoseKeys, "axes")
    rate_hz: float = key(
        "frames a second, where the file has no time stamps",
        unit="Hz",
        default=20.0,
        above=0,
        maximum=10_000,
        identity="meaning",
        slider=(1, 120),
        label="Frame Rate",
    )
    stamp_unit: StampUnits = key_of(PoseKeys, "stamp_unit")
    start: int = key("first pose used", default=0, minimum=0, identity="meaning")
    stop: int | None = key("the pose after the last one used", default=None, minimum=1, identity="meaning")
    every: int = key(
        "use every n-th pose", default=1, minimum=1, identity="meaning", slider=(1, 20), label="Every Nth Pose"
    )
    resample_hz: float | None = key(
        "take poses at this rate, from the smooth path through all poses",
        unit="Hz",
        default=None,
        above=0,
        maximum=10_000,
        identity="meaning",
    )


@dataclass(frozen=True, kw_only=True)
class SceneKeys:
    """What an entry of a preset's `scenes` says, whatever its source."""

    TOOLTIPS: ClassVar[dict[str, str]] = {
        "name": "The scene's folder in the dataset",
    }

    name: str | None = key(
        "the scene's folder in the dataset; * stands for what the * of mesh, sequence, video or blend matched",
        default=None,
        pattern=scene_name,
        identity="meaning",
        label="Name",
    )


@dataclass(frozen=True, kw_only=True)
class PathKeys(SceneKeys):
    """What a scene says that is seen along a path."""

    trajectory: TrajectorySpec | None = key(
        "the way of the camera, or of the robot that carries it; for replica the path that the SLAM systems use, for a "
        ".blend its own camera's",
        default=None,
    )


def check_trajectory(spec: TrajectorySpec, place: ConfigPath) -> None:
    """Check what involves several keys of a path. Raises InputError."""
    if (spec.file is None) == (spec.handheld is None):
        raise place.error("needs either file or handheld", "name one of them")
    if spec.body is not None and spec.handheld is not None and spec.handheld.wander_m > 0.0:
        problem = "strays by a hand, and a body carries the camera"
        raise place.at("handheld").at("wander_m").error(problem, "leave body or wander_m out")
    if spec.stop is not None and spec.stop <= spec.start:
        raise place.at("stop").error(f"is {spec.stop}, not beyond start ({spec.start})")
