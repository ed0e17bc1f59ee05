# SPDX-License-Identifier: GPL-3.0-or-later
"""Source `replica`: the scenes of Replica that SLAM systems are compared on, found under a preset's `data`."""

import fnmatch
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..core.schema import ConfigPath, key, unknown_name
from ..preset.scene_keys import PathKeys, TrajectorySpec, check_trajectory
from .rendered_mesh import MeshSource, mesh_scene
from .scene_kinds import FoundScene, SceneEntry, SourceKind, check_one_name, named

# The scenes of Replica that SLAM systems are compared on, and where people have their files.
#
# The dataset's own download has a folder for each scene, `room_0/mesh.ply`. The sequences of iMAP and NICE-SLAM come as
# `room0/traj.txt`, beside copies of the meshes, `room0_mesh.ply`.


REPLICA_SCENES = ("room0", "room1", "room2", "office0", "office1", "office2", "office3", "office4")


@dataclass(frozen=True)
class ReplicaFile:
    """What is found of a file of a scene: none, one, or more than one that may be meant. sought: relative paths."""

    found: tuple[Path, ...]
    sought: tuple[str, ...]


def replica_names(pattern: str) -> tuple[str, ...]:
    """Return the scenes that a name or a glob stands for; the download's names, room_0, are understood too."""
    return tuple(name for name in REPLICA_SCENES if any(fnmatch.fnmatchcase(k, pattern) for k in (name, _own(name))))


def replica_mesh(folder: Path, name: str) -> ReplicaFile:
    """Look for a scene's mesh: the download's, or else the copy that comes with the sequences."""
    return _search(folder, (f"{_own(name)}/mesh.ply", f"{name}/mesh.ply", f"{name}_mesh.ply"))


def replica_path(folder: Path, name: str) -> ReplicaFile:
    """Look for the path of a scene's sequence."""
    return _search(folder, (f"{name}/traj.txt", f"{_own(name)}/traj.txt"))


def _own(name: str) -> str:
    """The name of a scene in the dataset's own download: room_0 for room0."""
    return f"{name[:-1]}_{name[-1]}"


def _search(folder: Path, sought: tuple[str, ...]) -> ReplicaFile:
    """Look for each of several paths in turn in a folder, then in the folders that are in it."""
    if folder.is_dir():
        inside = sorted(path for path in folder.iterdir() if path.is_dir())
        for text in sought:
            for folders in ([folder], inside):
                if found := tuple(path for base in folders if (path := base / text).is_file()):
                    return ReplicaFile(found, sought)
    return ReplicaFile((), sought)


DOWNLOADS = (
    "the meshes are Replica's own download, the paths come with NICE-SLAM's Replica; say where they are with "
    "--data DIR, or choose scenes with --scenes"
)


@dataclass(frozen=True, kw_only=True)
class ReplicaKeys(PathKeys):
    """What a preset says of scenes of Replica."""

    replica: str = key(
        f"instead of mesh: a scene of Replica, looked for under data; * allowed; {', '.join(REPLICA_SCENES)}",
        identity="meaning",
    )

    @property
    def own_path(self) -> bool:
        """Whether the entry gives a path, rather than keys of Replica's own at most."""
        path = self.trajectory
        return path is not None and (path.file is not None or path.handheld is not None)


@dataclass(frozen=True)
class ReplicaFiles:
    """The files found for a scene of an entry; path: None where the entry gives its own trajectory."""

    mesh: ReplicaFile
    path: ReplicaFile | None


class ReplicaKind(SourceKind[ReplicaKeys]):
    """Replica's meshes, and the paths that SLAM systems are evaluated on."""

    name = "replica"
    order = 20
    label = "Replica"
    meaning = "scenes of Replica by name, with the paths that the SLAM systems use"
    keys = ReplicaKeys

    def check(self, keys: ReplicaKeys, place: ConfigPath) -> None:
        """Refuse what is no scene of Replica, and a path that is none."""
        if not replica_names(keys.replica):
            raise unknown_name(place.at("replica"), "scene of Replica", keys.replica, REPLICA_SCENES)
        if keys.trajectory is not None and keys.own_path:
            check_trajectory(keys.trajectory, place.at("trajectory"))

    def scenes(self, entry: SceneEntry[ReplicaKeys]) -> Iterable[FoundScene]:
        """Return the scenes that the name stands for, and their files as far as there are any."""
        names = replica_names(entry.keys.replica)
        check_one_name(entry, len(names), "scenes of Replica")
        return [self._scene(entry, scene) for scene in names]

    def _scene(self, entry: SceneEntry[ReplicaKeys], scene: str) -> FoundScene:
        folder = entry.preset.folder
        try:
            files = ReplicaFiles(
                replica_mesh(folder, scene), None if entry.keys.own_path else replica_path(folder, scene)
            )
        except OSError as error:
            raise entry.preset.place("data").error(f"{folder} cannot be read: {error.strerror}") from error
        name = named(entry, (scene,)) or scene
        return FoundScene(entry, name, partial(_opened, entry, name, scene, files), (scene, files))

    def check_found(self, chosen: Sequence[FoundScene]) -> None:
        """Refuse scenes whose files are missing, or of which there are several copies, all in one line."""
        preset = chosen[0].entry.preset
        scenes: list[tuple[str, ReplicaFiles]] = [item.found for item in chosen]
        place = preset.place("data")
        if not preset.folder.is_dir():
            raise place.error(f"no such folder: {preset.folder}", DOWNLOADS)
        missing = [
            f"no {what} of {', '.join(name for name, _ in lacking)} ({' or '.join(lacking[0][1].sought)}, for instance)"
            for what, lacking in (
                ("mesh", [(name, item.mesh) for name, item in scenes if not item.mesh.found]),
                ("path", [(name, item.path) for name, item in scenes if item.path is not None and not item.path.found]),
            )
            if lacking
        ]
        if missing:
            raise place.error(f"in {preset.folder} and the folders in it there is {', and '.join(missing)}", DOWNLOADS)
        for name, item in scenes:
            for file in (item.mesh, item.path):
                if file is not None and len(file.found) > 1:
                    others = " and ".join(str(path) for path in file.found[:2])
                    raise place.error(f"{name} is there more than once: {others}", "give one's folder with --data")


SOURCE = ReplicaKind()


def _opened(entry: SceneEntry[ReplicaKeys], name: str, scene: str, files: ReplicaFiles) -> MeshSource:
    path = None if files.path is None else files.path.found[0]
    spec = entry.keys.trajectory or TrajectorySpec()
    return mesh_scene(entry.preset, entry.place, name, files.mesh.found[0], spec, parts=(scene,), path_file=path)
