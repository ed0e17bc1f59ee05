# SPDX-License-Identifier: GPL-3.0-or-later
"""Embree through embreex: which triangle each ray meets first, where in it, and how far away."""

import importlib
import sys
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import MissingDependencyError
from ..core.extras import install_command, unavailable
from ..core.messages import Message, PresetKey, either


@dataclass(frozen=True)
class Hits:
    """What N rays meet first.

    triangles: (N,) int32; -1 where a ray meets nothing. second, third: (N,) float32, the weights of a triangle's second
    and third corner. lengths: (N,) float32, in lengths of the ray's direction.
    """

    triangles: NDArray[np.int32]
    second: NDArray[np.float32]
    third: NDArray[np.float32]
    lengths: NDArray[np.float32]


class TracedTriangles:
    """Triangles in Embree, seen from both sides. Rays can be cast in several threads at once. scene: embreex's."""

    def __init__(self, vertices_m: NDArray[np.float32], triangles: NDArray[np.int32]) -> None:
        """Copy the vertices (V, 3) and the vertices of triangles (T, 3), and build the tree.

        Raises MissingDependencyError where embreex cannot be imported.
        """
        scenes, meshes = _embreex()
        # Robust: no ray slips through between two triangles. It is no slower.
        self.scene = scenes.EmbreeScene(robust=True)
        self._mesh = meshes.TriangleMesh(self.scene, np.ascontiguousarray(vertices_m), np.ascontiguousarray(triangles))
        nothing = np.zeros((1, 3), np.float32)
        self.scene.run(nothing, nothing + 1, output=True)  # the first call builds the tree, before threads begin

    def first(self, origins_m: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """Cast rays from origins (N, 3) along directions (N, 3), which may have any length. Lets other threads run."""
        found = self.scene.run(origins_m, directions, output=True)
        return Hits(found["primID"], found["u"], found["v"], found["tfar"])


def embree_version() -> dict[str, str]:
    """Return the version of what decides rendered bytes. Raises MissingDependencyError where embreex is missing."""
    check_embree()
    return {"embreex": version("embreex")}


def check_embree() -> None:
    """Raise MissingDependencyError where embreex cannot be imported."""
    _embreex()


def _embreex() -> tuple[Any, Any]:
    """Return embreex's modules of scenes and of meshes."""
    try:
        return importlib.import_module("embreex.rtcore_scene"), importlib.import_module("embreex.mesh_construction")
    except ImportError as error:
        python = f"Python {sys.version_info.major}.{sys.version_info.minor}"
        missing = isinstance(error, ModuleNotFoundError)
        problem = f"is missing in this {python}" if missing else f"cannot be imported: {error}"
        instead = Message("use ", PresetKey("render.engine", "cycles"))
        if missing and (where := unavailable("embreex")):
            message = Message(PresetKey("render.engine"), f" is embree, but embreex has no package for {where}")
            raise MissingDependencyError(message, remedy=instead) from error
        message = Message(PresetKey("render.engine"), f" is embree, but embreex {problem}")
        remedy = either(f"run: {install_command('embree')}", instead)
        raise MissingDependencyError(message, remedy=remedy) from error
