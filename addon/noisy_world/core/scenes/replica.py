# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes of Replica that SLAM systems are compared on, and where people have their files.

The dataset's own download has a folder for each scene, `room_0/mesh.ply`. The sequences of iMAP and NICE-SLAM come as
`room0/traj.txt`, beside copies of the meshes, `room0_mesh.ply`.
"""

import fnmatch
from dataclasses import dataclass
from pathlib import Path

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
