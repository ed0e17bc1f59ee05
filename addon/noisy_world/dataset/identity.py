# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset's provenance: its identity, which is everything that decides its bytes, and its manifest.

An identity says what is common to all frames, and by name what belongs to each scene and to each setting: a dataset
grows by scenes, settings and frames, and each keeps what it was made from.
"""

from __future__ import annotations

import hashlib
import json
import platform
import re
import sys
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS as REGISTERED
from ..channels import COLOUR_AND_DEPTH, surface_channels
from ..core.atomic_files import sha256_of_file
from ..core.depth_range import RangeLoss
from ..core.file_access import NOT_UTF8, RENAME, canonical, finite_number, is_utf8, plain_values
from ..core.frame_table import FRAMES, OUT_OF_RANGE, SEQUENCE
from ..core.geometry import Intrinsics
from ..core.lens import OPTICS_KEYS
from ..core.machine import processor_features
from ..core.packages import package_version
from ..core.schema import deciding_values, quoted
from ..core.trajectory import Trajectory
from ..layouts import EVERY, LAYOUTS, OutputFormat

if TYPE_CHECKING:  # a plan's identity is made of a plan; to read one needs none
    from ..perturbations.steps import Setting, Step
    from ..sources.scene_kinds import Scene, SceneEntry
    from ..trajectories.rig import Rig, Sensor
    from .plan import Plan

# Settings and their steps as an identity holds them, in manifest.json, recipes and study.json: what writes them reads
# them.


KEYS = "keys"  # those of a preset that decide bytes by their own values

_WANTED = "is neither a mapping nor, with levels, a list of one for each"

Parameters: TypeAlias = Mapping[str, Any] | None
"""The parameters of one severity; None for 0, which is the identity."""


@dataclass(frozen=True)
class RecordedStep:
    """A step: what decides what it does to a frame.

    severity: None where only parameters or levels were given. levels: None of a static step. parameters: of its
    severity alone or, where it has levels, of each of them. share: `mix` and `mask`, where the step has them.
    """

    name: str
    severity: float | None
    levels: tuple[float, ...] | None
    parameters: tuple[Parameters, ...]
    temporal: str = "fresh"
    keyed: bool = False
    version: int = 1
    share: Mapping[str, Any] = field(default_factory=dict)

    @property
    def mode(self) -> Literal["static", "dynamic", "keyed"]:
        """The mode, in a preset's words."""
        return "static" if self.levels is None else "keyed" if self.keyed else "dynamic"

    @classmethod
    def of(cls, step: Step[Any]) -> RecordedStep:
        """Return the record of a step. Raises OSError where a file that is a parameter is gone."""
        from ..perturbations.steps import deciding

        severities = (step.severity,) if step.levels is None else step.levels
        return cls(
            step.perturbation.name,
            step.severity,
            step.levels,
            tuple(None if each == 0 else plain_values(deciding(step.parameters(each))) for each in severities),
            step.temporal,
            step.keyed,
            step.perturbation.version,
            {} if step.share is None else plain_values(step.share.deciding()),
        )

    def content(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        return {
            "name": self.name,
            "severity": self.severity,
            "levels": None if self.levels is None else list(self.levels),
            **({"keyed": True} if self.keyed else {}),
            **({} if self.version == 1 else {"version": self.version}),
            "temporal": self.temporal,
            "parameters": self.parameters[0] if self.levels is None else list(self.parameters),
            **({"share": dict(self.share)} if self.share else {}),
        }

    @classmethod
    def read(cls, content: Any) -> RecordedStep:
        """Return the step that JSON holds. Raises ValueError with the key, and what is wrong with it."""
        _check(isinstance(content, dict), ": is no mapping")
        severity, levels, parameters = (content.get(key) for key in ("severity", "levels", "parameters"))
        name, temporal = content.get("name"), content.get("temporal", "fresh")
        keyed, version = content.get("keyed", False), content.get("version", 1)
        _check(isinstance(name, str), ".name: is no text")
        _check(severity is None or finite_number(severity) is not None, ".severity: is no number")
        listed = isinstance(levels, list) and bool(levels) and _are_numbers(levels)
        _check(levels is None or listed, ".levels: is no list of numbers")
        each = [parameters] if levels is None else parameters
        whole = isinstance(each, list) and len(each) == (1 if levels is None else len(levels))
        _check(whole and all(one is None or isinstance(one, dict) for one in each), f".parameters: {_WANTED}")
        _check(isinstance(temporal, str), ".temporal: is no text")
        _check(isinstance(keyed, bool), ".keyed: is neither true nor false")
        _check(type(version) is int, ".version: is no whole number")
        share = content.get("share", {})
        _check(isinstance(share, dict), ".share: is no mapping")
        of_levels = None if levels is None else tuple(levels)
        return cls(name, severity, of_levels, tuple(each), temporal, keyed, version, share)


@dataclass(frozen=True)
class RecordedSetting:
    """A setting. stream: None is its own name. backend: None where no step acts on colour. sensor: steps of the rig's
    depth sensor, which its depth has before its own. keys: of its entry in the preset.
    """

    steps: tuple[RecordedStep, ...]
    sensor: tuple[RecordedStep, ...] = ()
    backend: str | None = None
    stream: str | None = None
    keys: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, setting: Setting) -> RecordedSetting:
        """Return the record of a setting. Raises OSError where a file that is a parameter is gone."""
        return cls(
            tuple(map(RecordedStep.of, setting.steps)),
            tuple(map(RecordedStep.of, setting.sensor)),
            setting.backend if setting.rgb else None,
            None if setting.stream == setting.name else setting.stream,
            plain_values(dict(setting.keys)),
        )

    def content(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        return {
            **({} if self.stream is None else {"stream": self.stream}),
            "backend": self.backend,
            "steps": [step.content() for step in self.steps],
            **({"sensor": [step.content() for step in self.sensor]} if self.sensor else {}),
            **({KEYS: dict(self.keys)} if self.keys else {}),
        }

    @classmethod
    def read(cls, content: Any) -> RecordedSetting:
        """Return the setting that JSON holds. Raises ValueError with the key, and what is wrong with it."""
        _check(isinstance(content, dict), "is no mapping")
        backend, stream, keys = content.get("backend"), content.get("stream"), content.get(KEYS, {})
        for key, value in (("backend", backend), ("stream", stream)):
            _check(value is None or isinstance(value, str), f"{key}: is no text")
        _check(isinstance(keys, dict), f"{KEYS}: is no mapping")
        return cls(_steps(content, "steps"), _steps({"sensor": [], **content}, "sensor"), backend, stream, keys)


def _steps(content: Mapping[str, Any], key: str) -> tuple[RecordedStep, ...]:
    listed: Any = content.get(key)
    _check(isinstance(listed, list), f"{key}: is no list")
    found: list[RecordedStep] = []
    for number, each in enumerate(listed):
        try:
            found.append(RecordedStep.read(each))
        except ValueError as error:
            raise ValueError(f"{key}.{number}{error}") from error
    return tuple(found)


def _check(right: bool, problem: str) -> None:
    if not right:
        raise ValueError(problem)


def _are_numbers(values: Iterable[object]) -> bool:
    return all(finite_number(value) is not None for value in values)


def setting_problem(name: str, content: Any) -> str:
    """Return the key and what is wrong with what JSON holds of the setting of a name, or ""."""
    try:
        RecordedSetting.read(content)
    except ValueError as error:
        return f"settings.{name}: {error}"
    return ""


@dataclass(frozen=True)
class Described:
    """A sequence that an identity describes.

    frames: their numbers, of those that were asked for; None where a perturbation that decides them is not known here.
    seconds_each: what a frame costs by the estimate, on two cores; a render's cost is shared by those that show it.
    """

    setting: str
    scene: str
    frames: Collection[int] | None
    seconds_each: float

    @property
    def folder(self) -> str:
        """The sequence's folder inside the dataset, with forward slashes."""
        return f"{self.setting}/{self.scene}"


FORMAT = 2  # version of the identity and the manifest; raised when their keys change

CONVENTIONS = {
    "pose": "camera-to-world; camera axes x right, y down, z forward (OpenCV); metres; world z up",
    **{name: REGISTERED[name].convention for name in COLOUR_AND_DEPTH},
    "pixel": "integer coordinates name pixel centres; the principal point is given in them",
    "time": "seconds",
}
CHANNELS = "channels"  # of a scene: the files that say what the values of its channels mean
BETWEEN = "between_sha256"  # of a path, where a setting looks between its poses
HUFFMAN = "huffman"  # of the output: which JPEG images have Huffman tables of their own; none in datasets of before
GREY = {"rgb": "grey, 8 bits: 0.299 R + 0.587 G + 0.114 B of sRGB-encoded values (ITU-R BT.601); void is black"}


# --- the identity ---


def identity(plan: Plan, renderer: Mapping[str, str]) -> dict[str, Any]:
    """Return what decides every byte of a dataset, as plain JSON values.

    renderer: the versions of what renders, by name.

    What is compared is what the preset means: settings have their steps with all parameters, whether they were swept,
    written out or left to their defaults. The preset's document stands beside that for people. Which frames a run makes
    (--frames) is no part of it, nor what decides no bytes, such as the overview.
    """
    spec = plan.preset.spec
    rendered = plan.uses_render_settings
    cameras = {render.scene.name: render.camera for render in plan.renders}
    counts = {scene.name: scene.frame_count for scene in plan.scenes}
    return {
        "format": FORMAT,
        "preset": plan.preset.described,
        "preset_sha256": plan.preset.sha256,
        "seed": spec.seed,
        "near_m": spec.mesh_camera.near_m if rendered else None,
        "far_m": spec.mesh_camera.far_m if rendered else None,
        "rig": None if plan.rig is None else _rig(plan.rig),
        "render": {name: getattr(spec.render, name) for name in ("engine", "device", "samples")} if rendered else None,
        "output": _output(plan.format),
        "scenes": {scene.name: _scene(plan, scene, cameras[scene.name]) for scene in plan.scenes},
        "settings": {setting.name: RecordedSetting.of(setting).content() for setting in plan.settings},
        "sequences": {sequence.folder: counts[sequence.scene] for sequence in plan.sequences},
        "versions": {**_packages(plan), **renderer, **base_versions()},
        "processor": processor(),
        **_keys({name: value for name, value in deciding_values(spec).items() if not _of_part(name)}),
    }


def _keys(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an identity says of keys that decide bytes by their own values; nothing where all are the default."""
    return {KEYS: plain_values(dict(values))} if values else {}


def _of_part(name: str) -> bool:
    """Tell whether a key belongs to one scene or setting, where it is told."""
    return name.split(".", maxsplit=1)[0] in ("scenes", "settings")


def plain_identity(plan: Plan, renderer: Mapping[str, str]) -> dict[str, Any]:
    """Return the identity as it is read back from a file: JSON turns tuples into lists, for instance."""
    return json.loads(canonical(identity(plan, renderer)))


def _sensor(sensor: Sensor | None) -> list[list[float]] | None:
    return None if sensor is None else (sensor.robot_from_sensor + 0.0).tolist()


def _rig(rig: Rig) -> dict[str, Any]:
    """Return the sensors' poses, and all that an IMU measures by; without one as datasets of before say it."""
    found: dict[str, Any] = {"rgb": _sensor(rig.rgb), "depth": _sensor(rig.depth)}
    if rig.imu is not None:
        content = {item.name: getattr(rig.imu, item.name) for item in fields(rig.imu)}
        content["robot_from_sensor"] = (rig.imu.robot_from_sensor + 0.0).tolist()
        model = asdict(rig.imu.model)
        if not rig.imu.model.bandwidth_hz:  # datasets of before have none
            del model["bandwidth_hz"]
        found["imu"] = content | {"model": model}
    return found


def _output(format_: OutputFormat) -> dict[str, Any]:
    coloured = "rgb" in format_.modalities
    formats = {name: kind for name, kind in format_.formats if name in format_.modalities}
    return {
        "layout": format_.layout.name,
        "image": format_.image if coloured else None,
        "colour": format_.colour if coloured else None,
        "depth_scale_per_m": format_.depth_scale_per_m,
        "depth_beyond": format_.depth_beyond,
        "modalities": sorted(format_.modalities),
        **({"formats": formats} if formats else {}),
        **({HUFFMAN: "perturbed noise"} if coloured and format_.image == "jpg" else {}),
    }


def _scene(plan: Plan, scene: Scene, camera: Intrinsics) -> dict[str, Any]:
    """Return what belongs to a scene. Its entry in the preset is for people; the path is compared by its poses."""
    path: dict[str, Any] = {
        "frames": scene.frame_count,
        "sha256": path_sha256(scene.path, scene.source.stamps_s, scene.frame_count),
    }
    own = [render for render in plan.renders if render.scene.name == scene.name]
    looked = any(render.exposure or (render.unit is not None and render.unit.clock) for render in own)
    if looked or (plan.rig is not None and plan.rig.imu is not None):
        path[BETWEEN] = between_sha256(scene.path)
    return {
        "entry": relevant_entry(scene.entry),
        "inputs": _inputs(scene),
        **_channels(plan, scene),
        "camera": _camera(camera),
        **scene.source.optics(camera).content(),
        "path": path,
        **_keys({} if scene.entry is None else scene.entry.deciding()),
    }


def _inputs(scene: Scene) -> dict[str, Any]:
    """Return the names and hashes of a scene's files. Raises InputError for a name that JSON cannot hold."""
    found = plain_values(scene.source.hashes())
    for text in found.values():
        if isinstance(text, str) and not is_utf8(text):
            raise scene.place.error(f"{text} {NOT_UTF8}", RENAME)
    return found


def _channels(plan: Plan, scene: Scene) -> dict[str, dict[str, str]]:
    """Return the hashes of files that say what the values of channels mean; nothing where there is none."""
    found = {
        f"{item.name}_sha256": hashlib.sha256("".join(map(str, map(sha256_of_file, files))).encode()).hexdigest()
        for item in surface_channels(plan.format.modalities)
        if (files := item.files(scene.source.location))
    }
    return {CHANNELS: found} if found else {}


def relevant_entry(entry: SceneEntry[Any] | None) -> dict[str, Any]:
    """Return a scene's entry of a preset as plain values, without keys that say nothing of it."""
    return {} if entry is None else plain_values(entry.recorded_keys())


def _camera(camera: Intrinsics) -> dict[str, float]:
    return {
        "width": camera.width_px,
        "height": camera.height_px,
        "fx": float(camera.fx_px),
        "fy": float(camera.fy_px),
        "cx": float(camera.cx_px),
        "cy": float(camera.cy_px),
    }


def path_sha256(path: Trajectory, stamps_s: NDArray[np.float64], count: int) -> str:
    """Return the SHA-256 of the first poses of a path and of their stamps, as float64; `count` of them."""
    digest = hashlib.sha256()
    for values in (path.c2w, path.stamps_s, stamps_s):
        digest.update(np.ascontiguousarray(values[:count] + 0.0, dtype="<f8").tobytes())  # -0.0 is 0.0
    if path.posed is not None:
        digest.update(path.posed[:count].tobytes())
    return digest.hexdigest()


def between_sha256(path: Trajectory) -> str:
    """Return the SHA-256 of where a path is halfway between its poses, as float64."""
    halfway_s = (path.stamps_s[:-1] + path.stamps_s[1:]) / 2
    c2w = path.continuous.pose_at(halfway_s)
    return hashlib.sha256(np.ascontiguousarray(c2w + 0.0, dtype="<f8").tobytes()).hexdigest()


SAME_BYTES = frozenset({"0.1.0", "0.2.0"})
"""Versions that make the same bytes where nothing else of two identities differs; 0.2.0 was called 0.1.0 at first."""


def same_version(name: str, before: str | None, now: str | None) -> bool:
    """Tell whether two versions of what a dataset is made with, by its name, make the same bytes."""
    return before == now or (name == "noisy_world" and {before, now} <= SAME_BYTES)


def base_versions() -> dict[str, str]:
    """Return the versions of what every dataset is made with, by name."""
    import cv2
    import deflate
    import OpenEXR

    return {
        "noisy_world": package_version(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        "openexr": OpenEXR.__version__,
        "deflate": deflate.__version__,
    }


def processor() -> dict[str, Any]:
    """Return the kind of processor that this is, as far as it decides bytes."""
    return {"machine": platform.machine(), "byte_order": sys.byteorder, "features": processor_features()}


def _packages(plan: Plan) -> dict[str, str]:
    """Return the versions of the installed packages whose perturbations, layout, channels or sources a plan uses."""
    used = [step.perturbation.distribution for setting in plan.settings for step in (*setting.sensor, *setting.steps)]
    used.append(EVERY.distribution(plan.format.layout.name))
    used += [REGISTERED.distribution(name) for name in plan.format.modalities]
    used += [scene.entry.distribution for scene in plan.scenes if scene.entry is not None]
    return {item.name: item.version for item in used if item is not None}


# --- the manifest ---


def manifest(
    plan: Plan,
    identity_: dict[str, Any],
    files: dict[str, Any],
    frames: dict[str, int],
    losses: Mapping[str, RangeLoss],
) -> dict[str, Any]:
    """Return the manifest's content.

    files: SHA-256 by name of the dataset's own files and, a level deeper, of each sequence's and setting's.
    frames: how many frames each sequence has. losses: the depth that the images of sequences cannot hold.
    """
    spec = plan.preset.spec
    clipping = {"near_m": spec.mesh_camera.near_m, "far_m": spec.mesh_camera.far_m}
    inputs = {name: scene["inputs"] for name, scene in identity_["scenes"].items()}
    seen = {name: {key: own.get(key, value) for key, value in clipping.items()} for name, own in inputs.items()}
    beyond = optics_of(identity_)
    cameras = {name: asdict(camera) | seen[name] | beyond[name] for name, camera in cameras_of(identity_).items()}
    shared = None
    if cameras_agree(identity_):
        first, *others = cameras.values()
        shared = {key: value for key, value in first.items() if all(camera[key] == value for camera in others)}
    return {
        "identity": identity_,
        "seeds": {"preset": spec.seed, "render": render_seed(spec.seed)},
        **({"cameras": cameras} if shared is None else {"camera": shared}),
        "depth_scale_per_m": plan.format.depth_scale_per_m,
        "depth_limit_m": plan.format.depth_limit_m,
        "depth_beyond": plan.format.depth_beyond,
        OUT_OF_RANGE: {folder: loss.content() for folder, loss in losses.items()},
        "colour": plan.format.colour,
        "conventions": conventions(plan.format),
        "frames": frames,
        "files": files,
    }


def conventions(format_: OutputFormat) -> dict[str, str]:
    """Return what the values in a dataset's files mean; colour and depth are told where they are left out, too."""
    channels = {name: REGISTERED[name].convention_in(REGISTERED[name].suffix(format_)) for name in format_.modalities}
    return CONVENTIONS | channels | (GREY if format_.colour == "grey" else {}) | format_.layout.conventions


def cameras_of(identity_: dict[str, Any]) -> dict[str, Intrinsics]:
    """Return the camera of each scene of a dataset, by its identity; scenes that an earlier run made are in it."""
    found = {name: scene["camera"] for name, scene in identity_["scenes"].items()}
    return {
        name: Intrinsics(camera["width"], camera["height"], *(camera[key] for key in ("fx", "fy", "cx", "cy")))
        for name, camera in found.items()
    }


def cameras_agree(identity_: dict[str, Any]) -> bool:
    """Tell whether all scenes of a dataset have one camera, so that a setting can say it for all of them."""
    beyond = list(optics_of(identity_).values())
    return len(set(cameras_of(identity_).values())) == 1 and all(item == beyond[0] for item in beyond)


def optics_of(identity_: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return what the cameras of each scene have beyond one pinhole, as plain values; {} for nothing."""
    scenes = identity_["scenes"].items()
    return {scene: {key: content[key] for key in OPTICS_KEYS if key in content} for scene, content in scenes}


def render_seed(seed: int) -> int:
    """Return the seed of the renderer's sampling pattern, which takes 31 bits."""
    return seed % 2**31


# Versions of the renderers and of the compositor that a plan uses.


def versions_of(plan: Plan) -> dict[str, str]:
    """Return the versions of Blender and of what else renders the plan.

    Raises MissingDependencyError where that cannot run here.
    """
    device, versions = plan.preset.spec.render.device, dict[str, str]()
    for engine in plan.engines:
        if engine == "embree":
            from ..render.embree import embree_version

            versions |= embree_version()
        else:
            from ..render.mesh_session import renderer_versions

            versions |= renderer_versions(engine, device if engine == "cycles" else "cpu")
    if plan.composites or any(scene.source.capabilities.imported for scene in plan.scenes):
        from ..render.mesh_session import blender_version

        versions |= blender_version()
    if plan.composites and plan.preset.spec.render.compositor_device == "gpu":
        from ..render.engines import compositor_card

        versions["compositor_gpu"] = compositor_card()
    return versions


# --- reading them ---


MOST_FRAMES = 10**7  # chosen: of a path; four days at 30 Hz, and gigabytes of poses as text

NUMBER = (int, float, type(None))
TEXT = (str, type(None))


@dataclass(frozen=True)
class _Each:
    """A mapping of any names to values of one shape, or a list of these."""

    kind: type
    shape: Any


_SCENE = {"entry": dict, "inputs": dict, "camera": dict, "path": {"frames": int, "sha256": str}}
_OUTPUT = {"layout": str, "image": TEXT, "modalities": _Each(list, str)}
_RENDER = {"engine": str, "samples": int}
_COMMON = {"preset": dict, "preset_sha256": str, "seed": int, "near_m": NUMBER, "far_m": NUMBER, "output": _OUTPUT}
_PROCESSOR = {"machine": str, "byte_order": str, "features": _Each(list, str)}
_MIXED = {"rig": (dict, type(None)), "render": (dict, type(None)), "processor": _PROCESSOR}
_LAYERS = {"sequences": _Each(dict, int), "scenes": _Each(dict, _SCENE), "settings": _Each(dict, dict)}
_IDENTITY = {**_COMMON, **_MIXED, **_LAYERS, "versions": _Each(dict, str)}
_MANIFEST = {OUT_OF_RANGE: _Each(dict, dict), "frames": _Each(dict, int), "files": _Each(dict, (str, dict))}
_DIGEST = re.compile("[0-9a-f]{64}")
_INSIDE = re.compile(r"(?!\.\.?(/|$))[^/\0\\]+(/(?!\.\.?(/|$))[^/\0\\]+)*")  # a name that leads nowhere else


def _fits(value: Any, shape: Any) -> bool:
    """Tell whether a JSON value has a shape: a mapping with at least these keys, or one of some types."""
    if isinstance(shape, dict):
        return isinstance(value, dict) and all(name in value and _fits(value[name], shape[name]) for name in shape)
    if isinstance(shape, _Each):
        inside = value.values() if isinstance(value, dict) else value
        return isinstance(value, shape.kind) and all(_fits(item, shape.shape) for item in inside)
    return isinstance(value, shape) and (not isinstance(value, bool) or shape is object)


def identity_problem(value: Any) -> str:
    """Return why a JSON value cannot be used as the identity of a dataset, or ""."""
    if not _fits(value, {"format": int, "sequences": (list, dict)}) or not all(map(is_sequence, value["sequences"])):
        return "is not the identity of a dataset"
    if value["format"] != FORMAT:
        return ""
    whole = _fits(value, _IDENTITY) and _has_cameras(value)
    if whole and value["output"]["layout"] not in LAYOUTS:
        layout = quoted(value["output"]["layout"])
        return f"is in the layout {layout}, which is not known here: install the package that brings it"
    whole = whole and all(0 < scene["path"]["frames"] <= MOST_FRAMES for scene in value["scenes"].values())
    if not whole or not (value["render"] is None or _fits(value["render"], _RENDER)):
        return "lacks what an identity holds, or holds something else"
    if wrong := next(filter(None, map(setting_problem, value["settings"], value["settings"].values())), ""):
        return f"lacks what an identity holds, or holds something else: {wrong}"
    parts = [name.split("/") for name in value["sequences"]]
    known = all(setting in value["settings"] and scene in value["scenes"] for setting, scene in parts)
    return "" if known else "does not say what all its sequences are made from"


def _is_file(name: str, digest: object) -> bool:
    """Tell whether these are the name of a file in a folder and a SHA-256."""
    return is_inside(name) and isinstance(digest, str) and bool(_DIGEST.fullmatch(digest))


def is_inside(name: str) -> bool:
    """Tell whether a name, with forward slashes, is one of a file in a folder, which leads nowhere else."""
    return bool(_INSIDE.fullmatch(name))


def _has_cameras(identity: dict[str, Any]) -> bool:
    """Tell whether each scene has the intrinsics of a camera."""
    try:
        cameras_of(identity)
    except (KeyError, TypeError, ValueError, OverflowError):
        return False
    return True


def manifest_problem(value: Any) -> str:
    """Return why a JSON value cannot be used as the manifest of a dataset, or ""."""
    identity: Any = value.get("identity") if isinstance(value, dict) else None
    if (problem := identity_problem(identity)) or identity["format"] != FORMAT:
        return problem
    if not _fits(value, _MANIFEST):
        return "lacks what a manifest holds, or holds something else"
    finished = {name for name, found in value["files"].items() if isinstance(found, dict)}
    digests = {name: found for name, found in value["files"].items() if name not in finished}
    if any(FRAMES not in value["files"][name] for name in finished):
        return f"does not name the {FRAMES} of each sequence"
    for files in (digests, *(value["files"][name] for name in finished)):
        if wrong := next((name for name, digest in files.items() if not _is_file(name, digest)), None):
            return f"does not tell a name inside the dataset and its SHA-256 of {wrong[:80]!r}"
    agree = finished == set(value["frames"]) and finished <= set(identity["sequences"])
    return "" if agree else "contradicts itself"


def version_problem(identity: dict[str, Any]) -> str:
    """Return why a dataset of this identity cannot be understood by this version, or ""."""
    if identity["format"] == FORMAT:
        return ""
    by = "a later" if identity["format"] > FORMAT else "an earlier"
    return f"made by {by} version of Noisy World, and cannot be continued by this one"


def is_sequence(name: Any) -> bool:
    """Tell whether this is the folder of a sequence: two plain names, which lead nowhere else."""
    return isinstance(name, str) and SEQUENCE.fullmatch(name) is not None
