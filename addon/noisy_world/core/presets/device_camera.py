# SPDX-License-Identifier: GPL-3.0-or-later
"""`camera: {device: NAME}`: a real camera's intrinsics and lens, written out as the keys that they stand for."""

from collections.abc import Mapping
from typing import Any

from ..camera_devices import CAMERA_DEVICES, CameraDevice
from ..schema import ConfigPath, describe, unknown_name

_SIZE = ("width", "height")
_FOCUS = ("fx", "fy", "cx", "cy")


def with_device(document: dict[str, Any], place: ConfigPath) -> dict[str, Any]:
    """Return a preset's document with what its camera's device stands for in its stead; what is given stays.

    With another size than the device's own, focal lengths and principal point are scaled. Raises InputError.
    """
    camera = document.get("camera")
    if not isinstance(camera, Mapping) or camera.get("device") is None:
        return document
    device = device_named(camera["device"], place.at("camera").at("device"))
    given = {
        name: value
        for name, value in camera.items()
        if name != "device" and (value is not None or name == "distortion")
    }
    return {**document, "camera": {**_sized(device, given, place.at("camera")), **given}}


def device_named(name: object, place: ConfigPath) -> CameraDevice:
    """Return the camera of a name. Raises InputError for another."""
    if not isinstance(name, str):
        raise place.error(f"is {describe(name)}, but has to be one of {', '.join(CAMERA_DEVICES)}")
    if name not in CAMERA_DEVICES:
        raise unknown_name(place, "camera", name, list(CAMERA_DEVICES))
    return CAMERA_DEVICES[name]


def _sized(device: CameraDevice, given: Mapping[str, Any], place: ConfigPath) -> dict[str, Any]:
    """Return the keys of a device at the size that is given."""
    own = device.camera
    sizes = {name: given[name] for name in _SIZE if name in given}
    if not sizes or all(name in given for name in _FOCUS):
        return own
    if not all(type(value) is int and value >= 1 for value in sizes.values()):
        return own  # which is refused where keys are checked
    scale = sizes["width"] / own["width"] if "width" in sizes else sizes["height"] / own["height"]
    size = {name: sizes.get(name, max(1, round(own[name] * scale))) for name in _SIZE}
    if abs(size["height"] - own["height"] * scale) >= 1:
        problem = (
            f"is {size['width']} x {size['height']}, another shape than the device's {own['width']} x {own['height']}"
        )
        raise place.error(problem, "give width alone, or fx, fy, cx and cy too")
    across, down = (size[name] / own[name] for name in _SIZE)
    focus = {"fx": own["fx"] * across, "fy": own["fy"] * down}
    return own | size | focus | {"cx": (own["cx"] + 0.5) * across - 0.5, "cy": (own["cy"] + 0.5) * down - 0.5}
