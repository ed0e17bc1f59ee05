# SPDX-License-Identifier: GPL-3.0-or-later
"""`{device: NAME}` among a setting's steps stands for a real camera's shutter, lens and electronics."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..presets.device_camera import device_named
from ..schema import ConfigPath, describe, unknown_name

DEVICE = "device"
NAME = "name"


def written_out(items: Sequence[Any], place: ConfigPath) -> Iterator[tuple[Any, ConfigPath]]:
    """Yield the entries of `perturb` with their places, a device's steps in its stead. Raises InputError."""
    for index, item in enumerate(items):
        where = place.at(index)
        if isinstance(item, Mapping) and list(item) == [DEVICE]:
            for step in _steps(item[DEVICE], where.at(DEVICE)):
                yield step, where
        else:
            yield item, where


def _steps(value: object, place: ConfigPath) -> Iterator[dict[str, Any]]:
    """Yield the steps of {name: a device, a step's name: parameters in place of the device's, or false}."""
    given = value if isinstance(value, Mapping) else {NAME: value}
    if NAME not in given:
        raise place.error("names no device", "write {device: {name: phone}}")
    device = device_named(given[NAME], place.at(NAME) if value is given else place)
    for name, other in given.items():
        if name == NAME:
            continue
        if name not in device.steps:
            raise unknown_name(place.at(str(name)), f"part of a {device.label}", str(name), list(device.steps))
        if other is not False and not isinstance(other, Mapping):
            problem = f"is {describe(other)}, but has to be a mapping of parameters, or false"
            raise place.at(str(name)).error(problem, "false leaves it out")
    for name, values in device.steps.items():
        own = given.get(name, {})
        if isinstance(own, Mapping):
            yield {name: {**values, **own}}
