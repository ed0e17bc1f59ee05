# SPDX-License-Identifier: GPL-3.0-or-later
"""The areas of mutated inputs, by their names."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fuzz import (
    dataset_folders, dataset_records, definitions, estimates, imported_meshes, jpegs, mesh_headers, meshes,
    presets,
    recording_files, recordings, results, shaped_presets, trajectories, videos,
)  # fmt: skip


@dataclass(frozen=True)
class Area:
    """Inputs of one kind: of the first six, bytes and words are changed, of the others the structure.

    write: writes a mutated input into an empty folder. read: reads it as the project does, and raises NoisyWorldError
    where it is refused. differs: how what was read differs from what an independent reader finds, "" where it does not.
    """

    write: Callable[[Path, np.random.Generator], None]
    read: Callable[[Path], Any]
    differs: Callable[[Path, Any, Any], str]


def _area(module):
    return Area(module.write, module.read, module.differs)


AREAS = {
    "presets": _area(presets),
    "trajectories": _area(trajectories),
    "recordings": _area(recordings),
    "videos": _area(videos),
    "meshes": _area(meshes),
    "datasets": _area(dataset_folders),
    "shaped_presets": _area(shaped_presets),
    "mesh_headers": _area(mesh_headers),
    "recording_files": _area(recording_files),
    "dataset_records": _area(dataset_records),
    "recipes": Area(dataset_records.write_recipe, dataset_records.read, dataset_records.differs),
    "estimates": _area(estimates),
    "definitions": _area(definitions),
    "results": _area(results),
    "jpegs": _area(jpegs),
}

OF_BLENDER = {"imported_meshes": _area(imported_meshes)}
"""Areas that take Blender."""
