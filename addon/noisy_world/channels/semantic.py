# SPDX-License-Identifier: GPL-3.0-or-later
"""Which class of things each pixel sees: those of Replica's info_semantic.json, or those that an artist gave."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import read_json
from ..images.pixels import UINT16_MAX
from ..scenes.polygon_mesh import OBJECT_NAMES, Mesh, SceneObject, is_embedded
from .channel import Surface, SurfaceChannel
from .instance import CHANNEL as INSTANCE
from .instance import known_objects

_REMEDY = "mend it, or take semantic out"


class Semantic(SurfaceChannel):
    """The class of the object of a face, by info_semantic.json beside the mesh, or of an object of a .blend."""

    name = "semantic"
    order = 45
    label = "Classes"
    meaning = "the number of the class of the object that a pixel sees"
    spoken = "classes"
    dtype = "uint16"
    components = 1
    unit = "class id"
    convention = (
        "number of the class of the object that the pixel's centre sees, as semantic.json names it; uint16; 0 is void, "
        "or no known class"
    )
    needs = frozenset({"objects"})
    bytes_per_pixel = 0.05
    kinds = ("png", "npy")  # an EXR has whole numbers of 32 bits alone
    has_content = True

    def problem(self, mesh: str) -> str:
        """Return why a mesh's file has no classes, or ""."""
        if lacking := INSTANCE.problem(mesh):
            return lacking
        return (
            ""
            if is_embedded(mesh) or self.files(mesh)
            else f"there is no {OBJECT_NAMES} beside it, which says its objects' classes"
        )

    def problem_of(self, objects: Callable[[], Sequence[SceneObject]]) -> str:
        """Return why a scene in Blender has no classes, or ""."""
        if any(item.category for item in objects()):
            return ""
        return "no object has a custom property `class`, or lies in a collection that has a name of its own"

    def files(self, mesh: str) -> tuple[Path, ...]:
        """Return the file of the objects' classes, where there is one."""
        return INSTANCE.files(mesh)

    def of_mesh(self, mesh: Mesh | None) -> Callable[[Surface], NDArray[Any]]:
        """Return what gives the classes (H, W) uint16; all 0 of a mesh without a file of names."""
        if mesh is None or mesh.names_path is None:
            known = () if mesh is None else mesh.object_classes
            return _looked_up({number: class_id for number, (class_id, _) in enumerate(known, 1)})
        return _looked_up({number: found[0] for number, found in _classes(mesh.names_path).items()})

    def of_objects(self, objects: Sequence[SceneObject]) -> Callable[[Surface], NDArray[Any]]:
        """Return the same for a scene in Blender."""
        numbers = _numbers(objects)
        return _looked_up({item.number: numbers[item.category] for item in objects if item.category})

    def content(self, mesh: Mesh, path: str) -> dict[str, Any]:
        """Return the classes of the mesh's objects, in increasing order, with their names.

        Raises InputError where the file that says them is damaged.
        """
        found = dict(mesh.object_classes)
        there = set(np.unique(known_objects(mesh)).tolist())
        for beside in self.files(path):
            found |= {class_id: name for number, (class_id, name) in _classes(beside).items() if number in there}
        return _content(found)

    def content_of(self, objects: Sequence[SceneObject]) -> dict[str, Any]:
        """Return the classes of a scene's objects, numbered from 1 on by their names."""
        return _content({number: name for name, number in _numbers(objects).items()})


def _content(names: dict[int, str]) -> dict[str, Any]:
    return {"void": 0, "classes": [{"id": number, "name": names[number]} for number in sorted(names)]}


def _numbers(objects: Sequence[SceneObject]) -> dict[str, int]:
    """Return the number of each class of a scene by its name."""
    names = sorted({item.category for item in objects if item.category})
    return {name: number for number, name in enumerate(names, 1)}


def _looked_up(classes: dict[int, int]) -> Callable[[Surface], NDArray[Any]]:
    """Return what gives each pixel the class of its object, by its number."""
    table = np.zeros(UINT16_MAX + 1, dtype=np.uint16)
    for number, class_id in classes.items():
        table[number] = class_id

    def made(surface: Surface) -> NDArray[Any]:
        assert surface.objects is not None, "they are needed"
        return np.take(table, surface.objects)

    return made


def _classes(path: Path) -> dict[int, tuple[int, str]]:
    """Return class and its name by object, of those that have one. Raises InputError."""
    try:
        objects = read_json(path)["objects"]
        found = {int(item["id"]): (int(item["class_id"]), str(item["class_name"])) for item in objects}
    except (ValueError, KeyError, TypeError) as error:
        reason = str(error) if type(error) is ValueError else "has no list of objects with id, class_id and class_name"
        raise InputError(path, reason, remedy=_REMEDY) from error
    if too_large := [pair for pair in found.values() if pair[0] > UINT16_MAX]:
        problem = f"class_id {too_large[0][0]} does not fit into the 16 bits of an image of classes"
        raise InputError(path, problem, remedy=_REMEDY)
    return {number: pair for number, pair in found.items() if 0 < number <= UINT16_MAX and pair[0] > 0}


CHANNEL = Semantic()
