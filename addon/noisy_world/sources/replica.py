# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of Replica's scenes, found under a preset's `data`; what is missing is said of all scenes at once."""

from collections.abc import Iterable
from dataclasses import dataclass

from ..core.presets.preset import Preset
from ..core.presets.scene_keys import SceneSpec
from ..core.scenes.replica import ReplicaFile, replica_mesh, replica_path

DOWNLOADS = (
    "the meshes are Replica's own download, the paths come with NICE-SLAM's Replica; say where they are with "
    "--data DIR, or choose scenes with --scenes"
)


@dataclass(frozen=True)
class ReplicaScene:
    """The files found for a scene of an entry; path: None where the entry gives its own trajectory."""

    scene: str
    mesh: ReplicaFile
    path: ReplicaFile | None


def replica_scene(preset: Preset, spec: SceneSpec, scene: str) -> ReplicaScene:
    """Look for the files of a scene. Raises InputError where the folder cannot be read."""
    folder, place = preset.folder, preset.place("data")
    own = spec.trajectory is not None and (spec.trajectory.file is not None or spec.trajectory.handheld is not None)
    try:
        return ReplicaScene(scene, replica_mesh(folder, scene), None if own else replica_path(folder, scene))
    except OSError as error:
        raise place.error(f"{folder} cannot be read: {error.strerror}") from error


def check_replica(scenes: Iterable[ReplicaScene], preset: Preset) -> None:
    """Refuse scenes whose files are missing, or of which there are several copies, all in one line."""
    scenes = list(scenes)
    place = preset.place("data")
    if scenes and not preset.folder.is_dir():
        raise place.error(f"no such folder: {preset.folder}", DOWNLOADS)
    missing = [
        f"no {what} of {', '.join(name for name, _ in lacking)} ({' or '.join(lacking[0][1].sought)}, for instance)"
        for what, lacking in (
            ("mesh", [(item.scene, item.mesh) for item in scenes if not item.mesh.found]),
            ("path", [(item.scene, item.path) for item in scenes if item.path is not None and not item.path.found]),
        )
        if lacking
    ]
    if missing:
        raise place.error(f"in {preset.folder} and the folders in it there is {', and '.join(missing)}", DOWNLOADS)
    for item in scenes:
        for file in (item.mesh, item.path):
            if file is not None and len(file.found) > 1:
                others = " and ".join(str(path) for path in file.found[:2])
                raise place.error(f"{item.scene} is there more than once: {others}", "give one's folder with --data")
