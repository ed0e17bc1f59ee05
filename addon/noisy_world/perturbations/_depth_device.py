# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth sensors as tables: what is below 0 among the parameters of a model is taken from its device's table."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from ..core.geometry import Intrinsics
from ..core.perturbing.kinds import FrameContext
from ..core.schema import key

P = TypeVar("P")

Devices = Mapping[str, Mapping[str, float]]
"""By a device's name the values of the parameters that are its own."""

DEVICE_TOOLTIPS = {
    "device": "Whose values are taken where a field is below 0",
    "noise": "Higher: everything random is stronger; 0 leaves rounding and holes",
    "focal_px": "Higher: the sensor's own image has more pixels to a degree, so depth gets better",
    "baseline_m": "Higher: depth gets better, and the shadows beside things wider",
    "step_px": "Higher: far depth is in larger steps",
    "shift_px": "Higher: edges get more ragged",
    "min_m": "Higher: more of what is near has no depth",
    "max_m": "Lower: more of what is far has no depth",
}
NOISE_SEVERITIES = (0.25, 0.5, 1.0, 2.0, 4.0)  # times the device's: halved and doubled around it


def of_device(meaning: str, maximum: float, unit: str = "", **words: Any) -> Any:
    """Return the field of a number that is the device's where it is below 0, by default. words: as for `key`."""
    return key(f"{meaning}; below 0: the device's", default=-1.0, unit=unit, minimum=-1, maximum=maximum, **words)


def noise_of_device() -> Any:
    """Return the field of the number that all noise of a device is multiplied by, which severity sets."""
    return key("random errors, times the device's", default=NOISE_SEVERITIES[2], minimum=0, maximum=100)


def filled(parameters: P, devices: Devices) -> P:
    """Return parameters with the values of their `device` where theirs are below 0."""
    given: Any = parameters
    own = devices[given.device]
    return replace(given, **{name: value for name, value in own.items() if getattr(given, name) < 0})


def range_contradiction(devices: Devices) -> Callable[[Any], str]:
    """Return what tells of parameters that nothing is between min_m and max_m; a max_m of 0 is left alone."""

    def contradiction(parameters: Any) -> str:
        own = filled(parameters, devices)
        return f"min_m is {own.min_m:g}, more than max_m, {own.max_m:g}" if own.min_m > own.max_m > 0 else ""

    return contradiction


def camera_of(context: FrameContext, name: str) -> Intrinsics:
    """Return the camera of a depth image. Raises TypeError, naming the model, where it is not known."""
    if context.intrinsics is None:
        raise TypeError(f"{name} needs the camera's intrinsics: rays and disparities follow from them")
    return context.intrinsics
