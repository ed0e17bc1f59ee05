# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a preset, and reading it: YAML in, checked frozen dataclasses out. A preset runs no code."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, make_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias

from ..channels import CHANNELS
from ..channels.channel import FILE_KINDS
from ..core.errors import CommandLineOnly, InputError, Message, PresetKey
from ..core.file_access import check_utf8_values, open_regular, path_in
from ..core.geometry import Intrinsics
from ..core.schema import (
    DEEPEST,
    LARGEST_BYTES,
    Choice,
    ChoicesOf,
    ConfigPath,
    describe,
    held_by,
    key,
    parse,
    quoted,
    read_yaml,
)
from ..layouts import LAYOUTS, Beyond, Colour, Image, Layout, OutputFormat
from ..layouts.described import SequenceSpec
from .camera_devices import CAMERA_DEVICES, with_device
from .device_files import NamedFile, with_device_files
from .names import OnlySpec, chosen_part, safe_name, stream_name, template
from .scene_keys import BodySpec, TrajectorySpec
from .sensor_keys import DepthCameraKeys, DistortionSpec, ImuKeys, check_depth_camera, check_distortion

# The keys of a preset's settings: one, several by a sweep, or those of another preset.


DepthRangeOf = Literal["layout", "scene"]
"""What decides a depth scale that is not given."""

BACKENDS = {
    "compositor": Choice("Compositor", "Blender's compositor: the node groups that the preview shows"),
    "reference": Choice("Reference", "The same perturbations in numpy and OpenCV"),
}


@dataclass(frozen=True)
class SweepSpec:
    """Settings of one perturbation each: every name with every severity, mode and value of its parameters."""

    perturb: tuple[str, ...] = key("names of perturbations", identity="meaning")
    severities: tuple[float, ...] | None = key(
        "severities; without parameters 1, 2, 3, 4 and 5", default=None, minimum=1, maximum=5, identity="meaning"
    )
    modes: tuple[Literal["static", "dynamic"], ...] | None = key(
        "modes; static if none is given", default=None, identity="meaning"
    )
    parameters: Any = key(
        "lists of values of parameters, by name: {factor: [2, 4, 8]}", default=None, identity="meaning"
    )
    without: Any = key(
        "what is left out, a list such as [{rotation_deg: 0, translation_m: 0}]", default=None, identity="meaning"
    )
    name: str | None = key(
        "what each setting is called, with {perturb}, {severity}, {mode} and {any parameter}; needed with parameters, "
        "else fog_s3 and fog_s3_dynamic",
        default=None,
        pattern=template,
        identity="meaning",
    )
    stream: str | None = key(
        "as a setting's, with what name may have in braces: '{perturb}' lets all severities of one draw equal patterns",
        default=None,
        pattern=stream_name,
        identity="meaning",
    )


@dataclass(frozen=True)
class SettingSpec:
    """A setting of the benchmark: what is done to every scene; or a sweep or another preset, which make several."""

    name: str | None = key(
        "the setting's folder in the dataset", default=None, pattern=safe_name, identity="meaning", label="Setting"
    )
    perturb: tuple[Any, ...] = key(
        "perturbations, each {name: {severity, mode, levels, temporal, or parameters}}; see --list perturbations",
        default=(),
        identity="meaning",
    )
    stream: str | None = key(
        "the name under which its colour and depth draw random patterns; settings of one stream draw the same in the "
        "same frame, and share images; its own name if none is given",
        default=None,
        pattern=stream_name,
        identity="meaning",
    )
    sweep: SweepSpec | None = key("instead of name and perturb: settings by the dozen", default=None)
    include: str | None = key(
        "instead of all others: another preset, whose settings are taken", default=None, identity="meaning"
    )
    backend: Literal["compositor", "reference"] | None = key(
        "what executes this setting's perturbations of colour, where it is not the preset's",
        default=None,
        choices=BACKENDS,
        identity="meaning",
    )


# Settings that a preset takes from another one: `- {include: other.yaml}` stands for all settings of that file.


Load: TypeAlias = Callable[[Path], dict[str, Any]]
"""A function that reads a preset's file as a document; it raises InputError."""


def included(document: dict[str, Any], path: Path, load: Load) -> tuple[dict[str, Any], tuple[ConfigPath, ...]]:
    """Return a document with the settings that it includes written out, and the place of each.

    The document then stands for itself, wherever it is recorded. Without includes it is returned as it is, without
    places. Raises InputError.
    """
    items = document.get("settings")
    if not isinstance(items, list) or not any(_includes(item) for item in items):
        return document, ()
    found = _settings(items, ConfigPath(path, "settings"), (path.resolve(),), load)
    return {**document, "settings": [item for item, _ in found]}, tuple(place for _, place in found)


def _includes(item: object) -> bool:
    return isinstance(item, Mapping) and item.get("include") is not None


def _settings(items: list[Any], place: ConfigPath, files: tuple[Path, ...], load: Load) -> list[tuple[Any, ConfigPath]]:
    """Return settings with their places. files: those that are being read, the last one with these settings."""
    found: list[tuple[Any, ConfigPath]] = []
    for index, item in enumerate(items):
        where = place.at(index)
        parsed = parse(SettingSpec, item, where)
        if parsed.include is None:
            found.append((item, where))
            continue
        if len(item) > 1:
            others = ", ".join(name for name in item if name != "include")
            raise where.error(f"has {others} beside include", "write that into a setting of its own")
        file = path_in(files[-1].parent, parsed.include, where.at("include"))
        if file.resolve() in files:
            raise where.at("include").error(f"{file.name} includes itself", "name another preset")
        others = load(file).get("settings")
        if not isinstance(others, list):
            raise where.at("include").error(f"{file} has no settings to take: they are {describe(others)}")
        found += _settings(others, ConfigPath(file, "settings"), (*files, file.resolve()), load)
    return found


# The keys of a preset's `output`, derived from the registry of layouts.


def _defaults(of: Callable[[Layout], str]) -> str:
    """Return the layouts' defaults in words: "default jpg for replica, png for tum and euroc"."""
    names: dict[str, list[str]] = {}
    for name, layout in LAYOUTS.items():
        names.setdefault(of(layout), []).append(name)
    return "default " + ", ".join(f"{value} for {' and '.join(those)}" for value, those in names.items())


def _format_key(name: str) -> tuple[str, Any, Any]:
    kinds = CHANNELS[name].kinds
    choices = {kind: Choice(kind.upper(), FILE_KINDS[kind]) for kind in kinds}
    meaning = f"what files of {CHANNELS[name].spoken} are"
    return name, str, key(meaning, default=kinds[0], choices=choices, identity="meaning")


if TYPE_CHECKING:

    @dataclass(frozen=True)
    class FormatsSpec:
        """A field for each channel that may be stored in several ways, but colour, which has `image`."""

else:
    chosen = [name for name, item in CHANNELS.items() if item.steps is None and len(item.kinds) > 1]
    # Before Python 3.12 make_dataclass does not say where the class stands, and what stands nowhere cannot be pickled.
    named = {"__module__": __name__}
    FormatsSpec = make_dataclass("FormatsSpec", map(_format_key, chosen), frozen=True, namespace=named)


@dataclass(frozen=True)
class OutputSpec:
    """How the dataset is written."""

    TOOLTIPS: ClassVar[dict[str, str]] = {
        "layout": "The layout of the files",
        "image": "Format of color: JPEG at quality 98 without chroma subsampling, PNG, or EXR of light",
        "colour": "What color images hold: red, green and blue, or one channel of gray",
        "depth_scale_per_m": "Steps of the 16-bit depth images a metre",
        "modalities": "The channels that are rendered and written",
    }

    layout: str = key(
        "the layout of the files; see --list layouts",
        default="replica",
        choices=ChoicesOf(LAYOUTS, lambda layout: Choice(layout.label, layout.summary)),
        identity="meaning",
    )
    image: Image | None = key(
        lambda: (
            "colour images; jpg is quality 98 without chroma subsampling; exr is scene-linear light as half floats, of "
            f"scenes with light of their own; {_defaults(lambda item: item.images[0])}"
        ),
        default=None,
        choices={
            "jpg": Choice("JPEG", "Quality 98 without chroma subsampling, as readers of Replica expect it"),
            "png": Choice("PNG", "Without loss"),
            "exr": Choice("EXR", "Scene-linear light before the view transform, as half floats"),
        },
        identity="meaning",
        label="Images",
    )
    colour: Colour | None = key(
        lambda: (
            "what colour images hold: red, green and blue, or one channel of grey (BT.601 weights on encoded values); "
            + _defaults(lambda item: item.colours[0])
        ),
        default=None,
        choices={
            "rgb": Choice("Colour", "Red, green and blue"),
            "grey": Choice("Grey", "One channel, as systems for visual odometry read it"),
        },
        identity="meaning",
        label="Channels",
    )
    depth_scale_per_m: float | None = key(
        lambda: "steps of the 16-bit depth images a metre; " + _defaults(lambda item: f"{item.depth_scale_per_m:g}"),
        default=None,
        unit="steps/m",
        above=0,
        maximum=1e6,
        identity="meaning",
        slider=(100, 10_000),
        label="Depth Scale",
    )
    depth_range: DepthRangeOf = key(
        "what decides the depth scale where depth_scale_per_m is not given",
        default="layout",
        choices={
            "layout": Choice("Layout", "What readers of the layout expect"),
            "scene": Choice("Scene", "The finest of 1, 2, 5, 10, ... steps a metre that holds the farthest surface"),
        },
        identity="meaning",
        label="Range",
    )
    depth_beyond: Beyond = key(
        "what becomes of depth that 16 bits do not hold: void, or the farthest that they do",
        default="void",
        choices={
            "void": Choice("Void", "No depth"),
            "farthest": Choice("Farthest", "The farthest depth that 16 bits hold"),
        },
        identity="meaning",
        label="Beyond Range",
    )
    modalities: tuple[str, ...] = key(
        "the channels that are rendered and written; see --list channels",
        default=("rgb", "depth"),
        choices=ChoicesOf(CHANNELS, lambda item: Choice(item.label, item.meaning)),
        identity="meaning",
        label="Write",
    )
    formats: FormatsSpec = key(
        "what files of channels are that keep values exactly, or in steps; of colour, image says it",
        default=FormatsSpec(),
        identity="meaning",
    )
    overview: bool = key(
        "whether to draw overview.png, a contact sheet of the dataset", default=False, identity="nothing"
    )
    licence: str | None = key(
        "the licence that a packed dataset states, such as cc-by-4.0; by default that of the scenes holds",
        default=None,
        identity="nothing",
    )

    @property
    def format(self) -> OutputFormat:
        """The format of the dataset; keys that are not given have the layout's defaults."""
        layout = LAYOUTS[self.layout]
        return OutputFormat(
            layout,
            self.image or layout.images[0],
            self.colour or layout.colours[0],
            self.modalities,
            self.depth_scale_per_m or layout.depth_scale_per_m,
            self.depth_beyond,
            tuple(
                (item.name, value)
                for item in fields(self.formats)
                if (value := getattr(self.formats, item.name)) != item.default
            ),
        )


def check_output(spec: OutputSpec, place: ConfigPath) -> None:
    """Check that the layout can have these keys' values. Raises InputError naming the key."""
    layout = LAYOUTS[spec.layout]
    for name, allowed in (("image", layout.images), ("colour", layout.colours)):
        given, known = getattr(spec, name), " or ".join(allowed)
        if given is not None and given not in allowed:
            raise place.at(name).error(
                f"is {given}, but the {layout.label} layout's readers expect {known}", f"use {known}"
            )
    if spec.image == "exr" and spec.colour == "grey":
        raise place.at("colour").error("is grey, but an EXR holds red, green and blue", "use rgb, or another image")
    if spec.licence is not None and not (spec.licence.strip() and spec.licence.isprintable()):
        raise place.at("licence").error("has to be one line of text", "name the licence, or leave the key out")
    if not spec.modalities or len(set(spec.modalities)) < len(spec.modalities):
        raise place.at("modalities").error(f"has to name channels, each once: {', '.join(CHANNELS)}")


# What --set changes in a preset's document.


BARE = {
    "trajectory": TrajectorySpec.SHORTHAND,
    "body": BodySpec.SHORTHAND,
    "sequence": SequenceSpec.SHORTHAND,
    **{item.name: hint.SHORTHAND for item in fields(SequenceSpec) if (hint := held_by(SequenceSpec, item.name))},
}
"""What a bare text stands for: so trajectory.every can be set where the preset names only a file."""


def override(document: dict[str, Any], text: str, path: Path) -> None:
    """Change a document by a text `key.path=value`, the value in YAML, entries of lists by their number.

    path: of the preset, for messages. Raises InputError.
    """
    name, equals, value_text = text.partition("=")
    keys = name.strip().split(".")
    message = f"--set {text if text.isprintable() and len(text) <= 100 else quoted(text)}"
    if not equals or not all(keys):
        raise InputError(path, f"{message}: has to be key.path=value")
    if len(keys) > DEEPEST:
        raise InputError(path, f"{message}: leads more than {DEEPEST} deep")
    value = read_yaml(value_text, path, message)
    node: Any = document
    where = ConfigPath(path)
    for index, step in enumerate(keys):
        where = where.at(step)
        last = index == len(keys) - 1
        if isinstance(node, list):
            entry = _entry(node, step, where)
            if last:
                node[entry] = value
            else:
                node = node[entry]
        elif not isinstance(node, dict):
            raise where.error("--set: leads into a value that has no keys")
        elif last:
            node[step] = value
        else:
            if not isinstance(node.get(step), (dict, list)):
                bare = node.get(step)
                node[step] = {BARE[step]: bare} if step in BARE and isinstance(bare, str) else {}
            node = node[step]


def _entry(entries: list[Any], step: str, where: ConfigPath) -> int:
    if not (step.isascii() and step.isdecimal()) or len(step) > 9 or int(step) >= len(entries):
        raise where.error(f"--set: {quoted(step)} is no entry of this list", f"it has {len(entries)}, counted from 0")
    return int(step)


EngineName = Literal["cycles", "eevee", "workbench", "embree"]

WORKBENCH_SAMPLES = (1, 5, 8, 11, 16, 32)  # the numbers that Blender's Workbench offers
EMBREE_SAMPLES = (1, 4, 9, 16, 25, 36, 49, 64)  # of square grids; the last is chosen


@dataclass(frozen=True)
class CameraSpec:
    """Pinhole intrinsics; integer pixel coordinates name pixel centres."""

    width: int = key("image width", unit="px", minimum=1, maximum=65500, identity="meaning", slider=(16, 4096))
    height: int = key("image height", unit="px", minimum=1, maximum=65500, identity="meaning", slider=(16, 4096))
    fx: float = key("focal length", unit="px", above=0, maximum=1e6, identity="meaning", slider=(50, 4000), label="fx")
    fy: float = key("focal length", unit="px", above=0, maximum=1e6, identity="meaning", slider=(50, 4000), label="fy")
    cx: float = key(
        "principal point", unit="px", minimum=-1e6, maximum=1e6, identity="meaning", slider=(0, 4096), label="cx"
    )
    cy: float = key(
        "principal point", unit="px", minimum=-1e6, maximum=1e6, identity="meaning", slider=(0, 4096), label="cy"
    )
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
        "a real camera, or a measured one's file, whose intrinsics and distortion stand for keys that are not given",
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

    TOOLTIPS: ClassVar[dict[str, str]] = {
        "translation_m": "Where the sensor sits beside the camera, in the axes of the path's poses",
    }

    translation_m: tuple[float, float, float] = key(
        "position",
        unit="m",
        default=(0.0, 0.0, 0.0),
        minimum=-1e6,
        maximum=1e6,
        identity="meaning",
        label="Place",
        slider=(-0.5, 0.5),
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
        "what measures every setting's depth, before its own perturbations: a device such as realsense_d435, the "
        "file of a measured one, or one perturbation of depth, {stereo: {noise: 0.5}}; empty: depth is exact",
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
        "the inertial measurement unit, with the robot's axes if it has no rotation", default=None, label="IMU"
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
        choices=BACKENDS,
        identity="meaning",
    )
    device: Literal["cpu", "gpu"] = key(
        "what Cycles renders on; a graphics card is used only where this asks for it",
        default="cpu",
        choices={
            "cpu": Choice("Processor", "Frames are the same on every computer"),
            "gpu": Choice("Graphics Card", "Faster; frames depend on the card"),
        },
        identity="meaning",
    )
    compositor_device: Literal["cpu", "gpu"] = key(
        "what Blender's compositor perturbs colour on; a graphics card is used only where this asks for it",
        default="cpu",
        choices={
            "cpu": Choice("Processor", "Frames are the same on every computer"),
            "gpu": Choice("Graphics Card", "Faster; frames depend on the card, by float32's last digits"),
        },
        identity="value",
        label="Compositor Device",
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
        choices={
            "same": Choice("Same", "All frames come from one kind of processor"),
            "any": Choice("Any", "Frames may differ by 1/255 between kinds of processors"),
        },
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

    places: of its settings, where some are included. named_files: what was taken of files of measured devices.
    """

    path: Path
    document: dict[str, Any]
    spec: PresetSpec
    places: tuple[ConfigPath, ...] = ()
    named_files: tuple[NamedFile, ...] = ()

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
    document, named = with_device_files(document, ConfigPath(path), places, _load)
    document = with_device(document, ConfigPath(path))
    spec = parse(PresetSpec, document, ConfigPath(path))
    _check(spec, ConfigPath(path))
    return Preset(path, document, spec, places, named)


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
        remedy = "name a YAML file; 'noisy-world list presets' names those that are shipped"
        raise InputError(path, f"cannot be read: {error.strerror or error}", remedy=remedy) from error
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
    if spec.camera is not None:
        _check_view(spec.camera, place.at("camera"))
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


# No camera is so, but numbers in another unit are; chosen: a focal length in pixels, and how far the axis lies outside.
LEAST_FOCAL_OF_LENGTH = 0.001
MOST_LENGTHS_OUTSIDE = 50


def _check_view(camera: CameraSpec, place: ConfigPath) -> None:
    """Raise InputError where a focal length or a principal point cannot be in pixels."""
    remedy = "give focal length and principal point in pixels of the image"
    for focal, middle, length in (("fx", "cx", "width"), ("fy", "cy", "height")):
        focal_px, middle_px, length_px = (getattr(camera, name) for name in (focal, middle, length))
        if focal_px < LEAST_FOCAL_OF_LENGTH * length_px:
            raise place.at(focal).error(f"is {focal_px:g} px, with a {length} of {length_px} px", remedy)
        if max(-0.5 - middle_px, middle_px - length_px + 0.5) > MOST_LENGTHS_OUTSIDE * length_px:
            raise place.at(middle).error(f"is {middle_px:g} px, with a {length} of {length_px} px", remedy)


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
