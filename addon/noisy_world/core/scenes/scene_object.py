# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects of a scene in Blender, as plain data."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SceneObject:
    """An object of a scene in Blender: its number, its name, and the pass index that the artist gave it."""

    number: int
    name: str
    pass_index: int
