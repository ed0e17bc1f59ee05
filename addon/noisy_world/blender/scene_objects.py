# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects of a scene of one's own, numbered alike by the inspection and the renderer."""

from collections.abc import Iterable

import bpy

from ..core.scenes.scene_object import SceneObject
from .own_settings import free_of_animation

WITH_SURFACE = ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD")


def numbered_objects(blocks: Iterable[bpy.types.ID]) -> tuple[SceneObject, ...]:
    """Return the objects with a surface among the data-blocks of a scene, those of libraries too, in order."""
    return tuple(SceneObject(number, item.name_full, item.pass_index) for number, item in _numbered(blocks))


def show_numbers(blocks: Iterable[bpy.types.ID]) -> None:
    """Give each object its number as its pass index. What is an instance of an object has its number."""
    for number, item in _numbered(blocks):
        free_of_animation(item, ("pass_index",))
        item.pass_index = number


def _numbered(blocks: Iterable[bpy.types.ID]) -> Iterable[tuple[int, bpy.types.Object]]:
    found = [block for block in blocks if isinstance(block, bpy.types.Object) and block.type in WITH_SURFACE]
    return enumerate(sorted(found, key=lambda item: item.name_full), 1)
