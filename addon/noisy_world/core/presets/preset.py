# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a preset, and reading it: YAML in, checked frozen dataclasses out. A preset runs no code."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

from ..camera_devices import CAMERA_DEVICES
from ..errors import InputError
from ..geometry import Intrinsics
from ..home import path_in
from ..messages import CommandLineOnly, Message, PresetKey
from ..regular_files import open_regular
from ..schema import Choice, ConfigPath, key, parse
from ..utf8_names import check_utf8_values
from ..yaml_reading import LARGEST_BYTES, read_yaml
from .depth_camera import DepthCameraKeys, check_depth_camera
from .device_camera import with_device
from .distortion import DistortionSpec, check_distortion
from .imu import ImuKeys
from .including import included
from .output import OutputSpec, check_output
from .overrides import override
from .selection import OnlySpec, chosen_part
from .settings import SettingSpec

EngineName = Literal["cycles", "eevee", "workbench", "embree"]

WORKBENCH_SAMPLES = (1, 5, 8, 11, 16, 32)  # the numbers that Blender's Workbench offers
EMBREE_SAMPLES = (1, 4, 9, 16, 25, 36, 49, 64)  # of square grids; the last is chosen


@dataclass(frozen=True)
class CameraSpec:
    """Pinhole intrinsics; integer pixel coordinates name pixel centres."""

    width: int = key("image width", unit="px", minimum=1, maximum=65500, identity="meaning", slider=(16, 4096))
    height: int = key("image height", unit="px", minimum=1, maximum=65500, identity="meaning", slider=(16, 4096))
    fx: float = key("focal length", unit="px", above=0, maximum=1e6, identity="meaning", slider=(50, 4000))
    fy: float = key("focal length", unit="px", above=0, maximum=1e6, identity="meaning", slider=(50, 4000))
    cx: float = key("principal point", unit="px", minimum=-1e6, maximum=1e6, identity="meaning", slider=(0, 4096))
    cy: float = key("principal point", unit="px", minimum=-1e6, maximum=1e6, identity="meaning", slider=(0, 4096))
    near_m: float = key(
        "what is nearer is not seen",
        unit="m",
        default=0.01,
        minimum=1e-6,
        maximum=1e6,
        identity="meaning",
        slider=(0.001, 1),
    )
    far_m: float = key(
        "what is farther is not seen",
        unit="m",
        default=1000.0,
        above=0,
        maximum=1e6,
        identity="meaning",
        slider=(1, 1000),
    )
    device: str | None = key(
        "a real camera, whose intrinsics and distortion stand for keys that are not given",
        default=None,
        choices={name: Choice(item.label, item.meaning) for name, item in CAMERA_DEVICES.items()},
        identity="meaning",
    )
    distortion: DistortionSpec | None = key("the lens of what is rendered, where it distorts", default=None)

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera without what it does not see."""
        return Intrinsics(self.width, self.height, self.fx, self.fy, self.cx, self.cy)


@dataclass(frozen=True)
class SensorSpec:
    """Where a sensor sits on the robot: the sensor's OpenCV axes in the robot's frame. One rotation at most."""

    translation_m: tuple[float, float, float] = key(
        "position", unit="m", default=(0.0, 0.0, 0.0), minimum=-1e6, maximum=1e6, identity="meaning"
    )
    quat_wxyz: tuple[float, float, float, float] | None = key(
        "rotation, as a quaternion", default=None, minimum=-1e6, maximum=1e6, identity="meaning"
    )
    rotation_euler_deg: tuple[float, float, float] | None = key(
        "rotation about x, y and z, as Rz Ry Rx",
        unit="deg",
        default=None,
        minimum=-3600,
        maximum=3600,
        identity="meaning",
    )
    matrix: tuple[tuple[float, float, float, float], ...] | None = key(
        "the whole pose as 4 rows of 4, instead of the others",
        default=None,
        minimum=-1e6,
        maximum=1e6,
        identity="meaning",
    )


@dataclass(frozen=True)
class DepthSensorSpec(SensorSpec, DepthCameraKeys):
    """A depth sensor: where it sits, its camera and clock, and what it measures."""

    sensor: Any = key(
        "what measures every setting's depth, before its own perturbations: a device such as realsense_d435, or one "
        "perturbation of depth, {stereo: {noise: 0.5}}; empty: depth is exact",
        default=None,
        identity="meaning",
    )

    def shares_place(self, rgb: SensorSpec) -> bool:
        """Tell whether it is a sensor of some kind at the very pose of the colour sensor, whose view it then has."""
        return self.sensor is not None and all(
            getattr(self, item.name) == getattr(rgb, item.name) for item in fields(SensorSpec)
        )


@dataclass(frozen=True)
class ImuSpec(SensorSpec, ImuKeys):
    """An inertial measurement unit: where it sits, its axes in the robot's frame, and what it measures by."""


@dataclass(frozen=True)
class RigSpec:
    """A robot with sensors; the trajectory is then the robot's centre."""

    rgb: SensorSpec = key("the colour sensor", default=SensorSpec())
    depth: DepthSensorSpec | None = key("the depth sensor, where it is not the colour sensor's place", default=None)
    imu: ImuSpec | None = key(
        "the inertial measurement unit, with the robot's axes if it has no rotation", default=None
    )


@dataclass(frozen=True)
class RenderSpec:
    """How frames are rendered."""

    engine: EngineName = key(
        "the render engine; eevee and workbench need GL, in software where there is no graphics card; embree casts "
        "rays without Blender, and needs the extra embree",
        default="cycles",
        choices={
            "cycles": Choice("Cycles", "Rays on the processor: no graphics card needed, and depth is exact"),
            "eevee": Choice("EEVEE", "GL: on the graphics card or, where there is none, in software"),
            "workbench": Choice("Workbench", "GL without materials: vertex colours as they are"),
            "embree": Choice("Embree", "One ray a pixel, without Blender; needs the Python package embreex"),
        },
        identity="meaning",
    )
    backend: Literal["compositor", "reference"] = key(
        "what executes the perturbations of colour: Blender's compositor, as an artist sees it, or numpy and OpenCV",
        default="compositor",
        choices={
            "compositor": Choice("Compositor", "Blender's compositor: the node groups that the preview shows"),
            "reference": Choice("Reference", "The same perturbations in numpy and OpenCV"),
        },
        identity="meaning",
    )
    device: Literal["cpu", "gpu"] = key(
        "what Cycles renders on; a graphics card is used only where this asks for it", default="cpu", identity="meaning"
    )
    samples: int = key(
        "rays a pixel, with embree at most: it casts more than one where colours differ; depth is the pixel centre's "
        "at any number",
        default=1,
        minimum=1,
        maximum=65536,
        identity="meaning",
        slider=(1, 256),
    )
    allow_empty: bool = key(
        "whether a path may begin with frames that see nothing, which is an error", default=False, identity="nothing"
    )
    processors: Literal["same", "any"] = key(
        "whether all frames have to come from one kind of processor; any: results differ by 1/255 between kinds",
        default="same",
        identity="nothing",
    )

    @property
    def in_blender(self) -> bool:
        """Whether Blender renders."""
        return self.engine != "embree"


# Of the Replica sequences that iMAP and NICE-SLAM use.
REPLICA_CAMERA = CameraSpec(width=1200, height=680, fx=600.0, fy=600.0, cx=599.5, cy=339.5)


@dataclass(frozen=True)
class PresetSpec:
    """A whole preset."""

    scenes: tuple[Any, ...] = key(
        "the scenes, each {name, the key of a source, and the source's other keys}; see --list sources",
        identity="meaning",
    )
    seed: int = key(
        "the seed of everything that is random", default=0, minimum=0, maximum=2**63 - 1, identity="meaning"
    )
    camera: CameraSpec | None = key(
        "the camera; default for meshes Replica's 1200 x 680, for a sequence or a .blend its own", default=None
    )
    rig: RigSpec | None = key("the robot that carries the sensors", default=None)
    render: RenderSpec = key("the rendering", default=RenderSpec())
    settings: tuple[SettingSpec, ...] = key("the settings", default=(SettingSpec("clean"),))
    output: OutputSpec = key("the dataset", default=OutputSpec())
    data: str | None = key(
        "folder that the scenes' paths are relative to, and where Replica is looked for; default the preset's",
        default=None,
        identity="nothing",
    )
    only: OnlySpec = key("a part of the scenes and settings", default=OnlySpec())

    @property
    def mesh_camera(self) -> CameraSpec:
        """The camera that meshes are seen through: the one given, or Replica's."""
        return REPLICA_CAMERA if self.camera is None else self.camera


@dataclass(frozen=True)
class Preset:
    """A checked preset: its file, its document as read (with overrides and includes), and the checked content.

    places: of its settings, where some are included.
    """

    path: Path
    document: dict[str, Any]
    spec: PresetSpec
    places: tuple[ConfigPath, ...] = ()

    @property
    def described(self) -> dict[str, Any]:
        """The document without what decides no byte: where the files lie, and which part of it is made."""
        return {name: value for name, value in self.document.items() if name not in ("data", "only")}

    @property
    def sha256(self) -> str:
        """The hash of what is described, as canonical JSON: comments and the order of keys do not count."""
        text = json.dumps(self.described, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def folder(self) -> Path:
        """The folder that the paths of scenes are relative to. Raises InputError for the home of an unknown user."""
        beside = self.path.parent
        return beside if self.spec.data is None else path_in(beside, self.spec.data, ConfigPath(self.path, "data"))

    def place(self, path: str) -> ConfigPath:
        """Return the place of a key, for errors."""
        return ConfigPath(self.path, path, self._data)

    @property
    def _data(self) -> Path | None:
        return None if self.spec.data is None else self.folder

    @property
    def setting_places(self) -> tuple[ConfigPath, ...]:
        """The place of each setting; those of an included preset are in that."""
        included = tuple(replace(place, data=self._data) for place in self.places)
        return included or tuple(self.place("settings").at(k) for k in range(len(self.spec.settings)))


def read_preset(
    path: Path,
    overrides: Sequence[str] = (),
    *,
    data: Path | None = None,
    scenes: Sequence[str] = (),
    settings: Sequence[str] = (),
) -> Preset:
    """Read and check a preset.

    overrides: `key.path=value` texts, the value in YAML, list entries by their number; relative paths in them are
    relative to the preset, as they are inside it. data: the folder of the scenes, relative to the working folder.
    scenes, settings: names or globs of those that are wanted, if not all.

    Raises InputError naming the file and the key.
    """
    document = _load(path)
    for text in overrides:
        override(document, text, path)
    if data is not None:
        document["data"] = str(data.absolute())
    if only := chosen_part(scenes, settings):
        document["only"] = only
    return check_document(document, path)


def check_document(document: dict[str, Any], path: Path) -> Preset:
    """Check a preset's document, as if it stood in the file `path`, with the settings that it includes.

    Raises InputError naming the key.
    """
    check_utf8_values(document, path)
    document, places = included(document, path, _load)
    document = with_device(document, ConfigPath(path))
    spec = parse(PresetSpec, document, ConfigPath(path))
    _check(spec, ConfigPath(path))
    return Preset(path, document, spec, places)


def _load(path: Path) -> dict[str, Any]:
    try:
        with open_regular(path) as file:
            content = file.read(LARGEST_BYTES + 1)
    except FileNotFoundError as error:
        near = ", ".join(sorted(item.name for item in path.parent.glob("*.yaml"))) if path.parent.is_dir() else ""
        raise InputError(
            path, "no such preset", remedy=f"presets there: {near}" if near else "check the path"
        ) from error
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    document = read_yaml(content, path)
    if not isinstance(document, dict):
        problem = "is empty" if document is None else "is not a mapping of keys"
        raise InputError(path, problem, remedy=CommandLineOnly("see --list keys"))
    return document


def _check(spec: PresetSpec, place: ConfigPath) -> None:
    """Check what involves several keys."""
    if not spec.scenes:
        raise place.at("scenes").error("is empty", "name a scene")
    if not spec.settings:
        raise place.at("settings").error("is empty", "name a setting, {name: clean} for instance")
    if spec.camera is not None and spec.camera.far_m <= spec.camera.near_m:
        problem = Message(f"is {spec.camera.far_m:g} m, not beyond ", PresetKey("near_m"))
        raise place.at("camera").at("far_m").error(problem)
    if spec.camera is not None and spec.camera.distortion is not None:
        check_distortion(spec.camera.distortion, place.at("camera").at("distortion"))
    check_output(spec.output, place.at("output"))
    _check_render(spec.render, place.at("render"))
    if spec.rig:
        for name, sensor in (("rgb", spec.rig.rgb), ("depth", spec.rig.depth), ("imu", spec.rig.imu)):
            if sensor:
                _check_sensor(sensor, place.at("rig").at(name))
        if spec.rig.depth:
            check_depth_camera(spec.rig.depth, place.at("rig").at("depth"))


def _check_render(spec: RenderSpec, place: ConfigPath) -> None:
    if spec.device == "gpu" and spec.engine != "cycles":
        how = "casts its rays on the processor" if spec.engine == "embree" else "renders with GL, on whatever GL finds"
        raise place.at("device").error(f"is gpu, but {spec.engine} {how}", "leave it out, or use cycles")
    offered = {"workbench": WORKBENCH_SAMPLES, "embree": EMBREE_SAMPLES}.get(spec.engine)
    if offered is not None and spec.samples not in offered:
        name = "embree" if spec.engine == "embree" else "Workbench"
        raise place.at("samples").error(f"is {spec.samples}; {name} knows {', '.join(map(str, offered))}")


def _check_sensor(spec: SensorSpec, place: ConfigPath) -> None:
    rotations = [spec.quat_wxyz, spec.rotation_euler_deg, spec.matrix]
    if sum(item is not None for item in rotations) > 1:
        raise place.error("gives more than one rotation", "keep one of quat_wxyz, rotation_euler_deg and matrix")
    if spec.matrix is not None and spec.translation_m != (0.0, 0.0, 0.0):
        raise place.error("gives matrix and translation_m", "put the translation into the matrix")
    if spec.matrix is not None and len(spec.matrix) != 4:
        raise place.at("matrix").error(f"has {len(spec.matrix)} rows, but has to have 4")


def canonical(value: Mapping[str, Any]) -> str:
    """Return JSON text that people can read; equal content gives equal text."""
    return json.dumps(value, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n"
