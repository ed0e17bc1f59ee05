# SPDX-License-Identifier: GPL-3.0-or-later
"""Which object of a scene each pixel sees, as the mesh's file numbers them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import read_json
from ..images.pixels import UINT16_MAX
from ..scenes.polygon_mesh import OBJECT_ID as PROPERTY
from ..scenes.polygon_mesh import OBJECT_NAMES, Mesh, SceneObject, is_embedded
from .channel import Surface, SurfaceChannel


class Instance(SurfaceChannel):
    """The face property `object_id` of Replica's mesh_semantic.ply, with its names, or the objects of a .blend."""

    name = "instance"
    order = 40
    label = "Instances"
    meaning = "the number of the object that a pixel sees"
    spoken = "instances"
    dtype = "uint16"
    components = 1
    unit = "object id"
    convention = (
        "number of the object that the pixel's centre sees: object_id of the mesh's face, or that of instance.json; "
        "uint16; 0 is void, or no known object"
    )
    needs = frozenset({"objects"})
    bytes_per_pixel = 0.05
    kinds = ("png", "npy")  # an EXR has whole numbers of 32 bits alone
    has_content = True

    def problem(self, mesh: str) -> str:
        """Return why a mesh's file has no objects, or ""."""
        from ..scenes.ply import face_properties  # few datasets have objects

        if is_embedded(mesh):
            return ""
        path = Path(mesh)
        if path.suffix.lower() == ".ply" and path.is_file() and PROPERTY in face_properties(path):
            return ""
        return f"its faces have no property {PROPERTY}, as those of Replica's mesh_semantic.ply"

    def files(self, mesh: str) -> tuple[Path, ...]:
        """Return the file of the objects' names, where there is one."""
        beside = Path(mesh).parent / OBJECT_NAMES
        return (beside,) if beside.is_file() else ()

    def of_mesh(self, mesh: Mesh | None) -> Callable[[Surface], NDArray[Any]]:
        """Return what gives the ids (H, W) uint16."""
        del mesh
        return _objects

    def content(self, mesh: Mesh, path: str) -> dict[str, Any]:
        """Return the ids of the mesh's objects in increasing order, each with its name, None where no file tells it.

        Raises InputError where the file of names is damaged.
        """
        names = {number: name for number, (_, name) in enumerate(mesh.object_classes, 1)}
        for beside in self.files(path):
            names |= _names(beside)
        ids = np.unique(known_objects(mesh))
        return {"void": 0, "objects": [{"id": number, "name": names.get(number)} for number in ids[ids > 0].tolist()]}

    def content_of(self, objects: Sequence[SceneObject]) -> dict[str, Any]:
        """Return the numbers of a scene's objects, each with its name and its own pass index."""
        lines = [{"id": item.number, "name": item.name, "pass_index": item.pass_index} for item in objects]
        return {"void": 0, "objects": lines}


def _objects(surface: Surface) -> NDArray[Any]:
    assert surface.objects is not None, "they are needed"
    return surface.objects


def known_objects(mesh: Mesh) -> NDArray[np.uint16]:
    """Return the object (F,) of each face; 0 where it is negative, which is none. Raises ValueError."""
    if mesh.object_ids is None:
        raise ValueError(f"its faces have no property {PROPERTY}")
    if len(mesh.object_ids) and (largest := int(mesh.object_ids.max())) > UINT16_MAX:
        raise ValueError(f"{PROPERTY} {largest} does not fit into the 16 bits of an instance image")
    return np.maximum(mesh.object_ids, 0).astype(np.uint16)


def _names(path: Path) -> dict[int, str]:
    """Return the objects' names by id: each object's class and, as Replica gives nothing more, that alone."""
    try:
        content = read_json(path)
        objects = content["objects"]
        return {int(item["id"]): str(item["class_name"]) for item in objects}
    except (ValueError, KeyError, TypeError) as error:
        reason = str(error) if type(error) is ValueError else "has no list of objects with id and class_name"
        raise InputError(path, reason, remedy="mend it, or take it away: ids need no names") from error


CHANNEL = Instance()
