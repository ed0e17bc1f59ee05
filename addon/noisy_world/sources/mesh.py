# SPDX-License-Identifier: GPL-3.0-or-later
"""Source `mesh`: a mesh, or an embedded room, with a path through it, whose frames are rendered."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar, Literal

from ..core.errors import Message, Part, PresetKey
from ..core.schema import Choice, ConfigPath, key
from ..preset.scene_keys import PathKeys, check_trajectory
from ..render.source import Source
from ..scenes.polygon_mesh import EMBEDDED_ROOM, MEANT, ROOMS, is_embedded, room_name, room_seeds
from .rendered_mesh import MeshSource, mesh_scene
from .scene_kinds import FileSource, FoundScene, SceneEntry, check_one_name, named


@dataclass(frozen=True, kw_only=True)
class MeshKeys(PathKeys):
    """What a preset says of a mesh and the way through it."""

    TOOLTIPS: ClassVar[dict[str, str]] = {
        "mesh": "Mesh with colors or textures: PLY, glTF, OBJ, USD, FBX or STL",
    }

    mesh: str = key(
        "PLY, glTF, OBJ, USD, FBX or STL file, relative to the preset; * allowed; or "
        f"{EMBEDDED_ROOM}?seed=0 to {ROOMS - 1}",
        identity="meaning",
        label="Mesh File",
    )
    up: Literal["y", "z"] | None = key(
        "the axis of the mesh's file that points up, where that is not what the file declares; y is turned to Z up",
        default=None,
        choices={
            "y": Choice("Y", "The file's y points up: it is turned to Z up"),
            "z": Choice("Z", "The file's z points up, as Blender's does"),
        },
        identity="meaning",
    )
    light: Literal["none", "scene"] = key(
        "how a mesh is lit: not at all, showing its base colours; or by the lights and materials of its file",
        default="none",
        choices={
            "none": Choice("None", "Not at all: its base colours are shown"),
            "scene": Choice("Scene", "By the lights and materials of its file"),
        },
        identity="meaning",
    )


class MeshKind(FileSource[MeshKeys]):
    """A mesh is rendered along a path: unlit, or with the lights of its file."""

    name = "mesh"
    order = 10
    label = "Mesh"
    meaning = "a mesh's file or an embedded room, rendered along a path"
    keys = MeshKeys
    several = "meshes"
    instead: ClassVar[Mapping[str, Part]] = {
        "rate_hz": Message("the rate of a mesh's path is ", PresetKey("trajectory.rate_hz"))
    }

    def check(self, keys: MeshKeys, place: ConfigPath) -> None:
        """Refuse keys of a file where there is none, and a mesh without a path."""
        if is_embedded(keys.mesh):
            for name, value in (("up", keys.up is not None), ("light", keys.light != "none")):
                if value:
                    raise place.at(name).error("goes with the file of a mesh", "leave it out")
        if keys.trajectory is None:
            raise place.at("trajectory").error("is missing", "add it: the way of the camera")
        check_trajectory(keys.trajectory, place.at("trajectory"))

    def scenes(self, entry: SceneEntry[MeshKeys]) -> Iterable[FoundScene]:
        """Return a scene for each file, or for each embedded room."""
        mesh = entry.keys.mesh
        if not is_embedded(mesh):
            return super().scenes(entry)
        try:
            seeds = room_seeds(mesh)
        except ValueError as error:
            raise entry.source_place.error(str(error), MEANT) from error
        check_one_name(entry, len(seeds), "rooms")
        return [self._room(entry, seed) for seed in seeds]

    def _room(self, entry: SceneEntry[MeshKeys], seed: int) -> FoundScene:
        parts = () if entry.keys.mesh == EMBEDDED_ROOM else (str(seed),)
        name = named(entry, parts) or room_name(entry.keys.mesh, seed)
        return FoundScene(entry, name, partial(_plain, entry, name, None, parts, room=seed))

    def open_file(self, entry: SceneEntry[MeshKeys], name: str, path: Path, parts: tuple[str, ...]) -> Source:
        """Return the source of a mesh's file."""
        plain = _plain(entry, name, path, parts)
        if entry.keys.light == "none":
            return plain
        from .lit_scene import lit_mesh

        return lit_mesh(entry.preset, plain)


SOURCE = MeshKind()


def _plain(
    entry: SceneEntry[MeshKeys], name: str, mesh_path: Path | None, parts: tuple[str, ...], room: int = 0
) -> MeshSource:
    assert entry.keys.trajectory is not None, "that it is there has been checked"
    return mesh_scene(
        entry.preset, entry.place, name, mesh_path, entry.keys.trajectory, parts=parts, room=room, up=entry.keys.up
    )
