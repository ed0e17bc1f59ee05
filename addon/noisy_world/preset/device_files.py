# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of measured devices, as `noisy-world measure --device` writes them, where a preset names a device.

What such a file says is written out into the preset's document, as of an included preset. So a dataset's identity and
its recipe hold all of it, and need the file no more.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.file_access import path_in
from ..core.geometry import Intrinsics
from ..core.schema import ConfigPath, describe, key, parse, unknown_name
from .camera_devices import CameraDevice, in_place_of_device
from .sensor_keys import DistortionSpec, ImuKeys, check_distortion

ENDINGS = (".yaml", ".yml")
DEVICE = "device"
NAME = "name"


@dataclass(frozen=True)
class DeviceCamera:
    """The camera of a measured device."""

    width: int = key("width of the image", unit="px", minimum=1, maximum=65500)
    height: int = key("height of the image", unit="px", minimum=1, maximum=65500)
    fx: float = key("focal length", unit="px", above=0, maximum=1e6)
    fy: float = key("focal length", unit="px", above=0, maximum=1e6)
    cx: float = key("principal point", unit="px", minimum=-1e6, maximum=1e6)
    cy: float = key("principal point", unit="px", minimum=-1e6, maximum=1e6)
    distortion: DistortionSpec | None = key("the lens, where it distorts", default=None)


@dataclass(frozen=True)
class DeviceFile:
    """What a file says of a device; a part that it does not say cannot be taken from it."""

    camera: DeviceCamera | None = key("the camera, for `camera: {device: FILE}`", default=None)
    depth: Any = key("how depth is measured, {axial_noise: {...}}: for `sensor: FILE` of a rig", default=None)
    delay_ms: float | None = key(
        "how much later than colour depth is exposed; `sensor: FILE` takes it too, where the rig has no delay_ms",
        unit="ms",
        default=None,
        minimum=-10_000,
        maximum=10_000,
    )
    imu: ImuKeys | None = key("what the IMU measures by, for `imu: {device: FILE}` of a rig", default=None)
    perturb: tuple[Any, ...] = key("noise of colour: perturbations, for `{device: FILE}` in a setting", default=())


@dataclass(frozen=True)
class NamedFile:
    """A part of a device's file that a preset names. place: of the part in the file. part: depth or perturb."""

    place: ConfigPath
    part: str
    value: Any


def with_device_files(
    document: dict[str, Any], place: ConfigPath, settings: tuple[ConfigPath, ...], load: Callable[[Path], Any]
) -> tuple[dict[str, Any], tuple[NamedFile, ...]]:
    """Return a preset's document with what files of devices say in the stead of their names, and what was taken.

    settings: the place of each setting, where some are included. load: reads a file as a document. What is taken of
    depth and colour is not checked beyond its shape here. Raises InputError that names the file and the key.
    """
    taken: list[NamedFile] = []

    def part(value: str, where: ConfigPath, name: str) -> Any:
        return whole(value, where, name)[name]

    def whole(value: str, where: ConfigPath, name: str) -> Mapping[str, Any]:
        """Return all that a file says, which has to have a part of a name."""
        file = path_in(where.folder, value, where)
        if not file.is_file():
            raise where.error(f"{file} is not there", "name the file that noisy-world measure --device wrote")
        content = load(file)
        parsed = parse(DeviceFile, content, ConfigPath(file))
        inside = ConfigPath(file, name)
        if not getattr(parsed, name):
            raise inside.error("is missing", f"{where.path} takes it: measure again with --device, or name another")
        if name == "camera":
            assert parsed.camera is not None, "this has been checked"
            if parsed.camera.distortion is not None:
                check_distortion(parsed.camera.distortion, inside.at("distortion"))
        elif name in ("depth", "perturb"):
            taken.append(NamedFile(inside, name, content[name]))
        return content

    found = dict(document)
    camera = document.get("camera")
    if isinstance(camera, Mapping) and is_device_file(camera.get(DEVICE)):
        where = place.at("camera")
        device = _camera_device(part(camera[DEVICE], where.at(DEVICE), "camera"))
        found["camera"] = in_place_of_device(camera, device, where)
    rig = document.get("rig")
    if isinstance(rig, Mapping):
        found["rig"] = _rig(rig, place.at("rig"), whole)
    items = document.get("settings")
    if isinstance(items, list) and any(_names_file(step) for item in items for step in _steps(item)):
        places = settings or tuple(place.at("settings").at(number) for number in range(len(items)))
        found["settings"] = [_setting(item, where, part) for item, where in zip(items, places, strict=True)]
    return found, tuple(taken)


def _rig(
    rig: Mapping[str, Any], place: ConfigPath, read: Callable[[str, ConfigPath, str], Mapping[str, Any]]
) -> dict[str, Any]:
    """Return a rig with what files say of its depth sensor and of its IMU, where it names files."""
    made = dict(rig)
    depth, imu = rig.get("depth"), rig.get("imu")
    if isinstance(depth, Mapping) and is_device_file(depth.get("sensor")):
        file = read(depth["sensor"], place.at("depth").at("sensor"), "depth")
        delay = {} if file.get("delay_ms") is None else {"delay_ms": file["delay_ms"]}
        made["depth"] = {**delay, **depth, "sensor": file["depth"]}
    if isinstance(imu, Mapping) and is_device_file(imu.get(DEVICE)):
        keys = read(imu[DEVICE], place.at("imu").at(DEVICE), "imu")["imu"]
        made["imu"] = {**keys, **{name: value for name, value in imu.items() if name != DEVICE}}
    return made


def is_device_file(value: object) -> bool:
    """Tell whether the name of a device is that of a file."""
    return isinstance(value, str) and value.lower().endswith(ENDINGS)


def _steps(setting: object) -> list[Any]:
    steps = setting.get("perturb") if isinstance(setting, Mapping) else None
    return steps if isinstance(steps, list) else []


def _setting(item: Any, place: ConfigPath, part: Callable[[str, ConfigPath, str], Any]) -> dict[str, Any]:
    """Return a setting with what files say in place of the steps that name them."""
    steps: list[Any] = []
    for at, step in enumerate(_steps(item)):
        if not _names_file(step):
            steps.append(step)
            continue
        inside = place.at("perturb").at(at).at(DEVICE)
        given = step[DEVICE] if isinstance(step[DEVICE], Mapping) else {NAME: step[DEVICE]}
        steps.append(_changed(part(given[NAME], inside, "perturb"), given, inside))
    return {**item, "perturb": steps} if steps else item


def _names_file(step: object) -> bool:
    if not isinstance(step, Mapping) or list(step) != [DEVICE]:
        return False
    device = step[DEVICE]
    return is_device_file(device.get(NAME) if isinstance(device, Mapping) else device)


def _changed(steps: list[Any], given: Mapping[str, Any], place: ConfigPath) -> list[Any]:
    """Return a file's steps with parameters in place of theirs, and without those that are false."""
    known = [str(name) for step in steps if isinstance(step, Mapping) for name in step]
    for name, value in given.items():
        if name != NAME and name not in known:
            raise unknown_name(place.at(name), "part of that device", name, known)
        if name != NAME and value is not False and not isinstance(value, Mapping):
            problem = f"is {describe(value)}, but has to be a mapping of parameters, or false"
            raise place.at(name).error(problem, "false leaves it out")
    made: list[Any] = []
    for step in steps:
        name = next(iter(step)) if isinstance(step, Mapping) and len(step) == 1 else NAME
        if name == NAME or name not in given:
            made.append(step)
        elif given[name] is not False:
            made.append({name: {**(step[name] or {}), **given[name]}})
    return made


def _camera_device(camera: Mapping[str, Any]) -> CameraDevice:
    size = camera["width"], camera["height"]
    pinhole = Intrinsics(*size, *(float(camera[name]) for name in ("fx", "fy", "cx", "cy")))
    return CameraDevice("measured", "Measured", "a measured camera", pinhole, camera.get("distortion") or {}, {}, {})
