# SPDX-License-Identifier: GPL-3.0-or-later
"""The areas of mutated inputs, by their names."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fuzz import dataset_folders, meshes, presets, recordings, trajectories, videos


@dataclass(frozen=True)
class Area:
    """Inputs of one kind.

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
}
