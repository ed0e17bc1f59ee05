# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers of the panel as a preset has them: Blender's are float32, and angles in radians."""

import json
import math
from typing import Any

import numpy as np


def property_name(name: str) -> str:
    """Return the property that holds a value: that of an angle, in radians, is without the unit."""
    return name.removesuffix("_deg")


def value_of(group: Any, name: str) -> Any:
    """Return a property's value as typed: the stored number, or the shortest decimal that gives this float32.

    name: of the value; where it ends in _deg, the value is in degrees.
    """
    value = getattr(group, property_name(name))
    if not isinstance(value, float):
        return value
    remembered = json.loads(group.exact).get(name) if getattr(group, "exact", "") else None
    if remembered is not None and np.float32(_stored(name, remembered)) == np.float32(value):
        return remembered
    return _shortest_deg(value) if name.endswith("_deg") else float(str(np.float32(value)))


def set_value(group: Any, name: str, value: Any) -> None:
    """Set a property as `value_of` gives it; a number that float32 does not hold exactly is stored beside it."""
    setattr(group, property_name(name), _stored(name, value))
    if isinstance(value, float) and value_of(group, name) != value:
        group.exact = json.dumps((json.loads(group.exact) if group.exact else {}) | {name: value})


def _stored(name: str, value: Any) -> Any:
    return math.radians(value) if name.endswith("_deg") else value


def _shortest_deg(angle_rad: float) -> float:
    """Return the shortest decimal in degrees that gives this float32 in radians."""
    angle_deg = math.degrees(angle_rad)
    shorter = (float(f"{angle_deg:.{digits}g}") for digits in range(1, 10))
    return next((value for value in shorter if np.float32(math.radians(value)) == np.float32(angle_rad)), angle_deg)
