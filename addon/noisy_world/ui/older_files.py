# SPDX-License-Identifier: GPL-3.0-or-later
"""Angles of files that were saved when the panel held them in degrees."""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..perturbations import registry
from .properties import panel_of
from .typed_numbers import set_value

OWN = "deviation_rotation_deg"


@persistent
def _on_load(*_: object) -> None:
    for scene in bpy.data.scenes:
        stored = scene.bl_system_properties_get()
        if scene.library is None and stored is not None and "noisy_world" in stored:
            take_degrees(panel_of(scene), stored["noisy_world"])


def take_degrees(panel: Any, stored: Any) -> None:
    """Take the angles that are stored in degrees into the panel. stored: the values as the file holds them."""
    for group, values, name in _angles(panel, stored):
        if name in values:
            set_value(group, name, float(str(np.float32(values[name]))))
            del values[name]


def _angles(panel: Any, stored: Any) -> Iterator[tuple[Any, Any, str]]:
    """Yield each group of the panel with angles, what the file stores of it, and an angle's name."""
    yield panel, stored, OWN
    for step, values in zip(panel.steps, stored.get("steps", ()), strict=False):
        for name, perturbation in registry().items():
            for item in fields(perturbation.parameters):
                if item.name.endswith("_deg") and name in values:
                    yield getattr(step, name), values[name], item.name


def register_older_files() -> None:
    """Register the handler of files that are opened."""
    bpy.app.handlers.load_post.append(_on_load)


def unregister_older_files() -> None:
    """Unregister it."""
    bpy.app.handlers.load_post.remove(_on_load)
