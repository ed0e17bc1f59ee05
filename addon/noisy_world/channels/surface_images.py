# SPDX-License-Identifier: GPL-3.0-or-later
"""The images of all surface channels that a renderer of a mesh is asked for."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError
from ..scenes.polygon_mesh import Mesh, SceneObject
from . import surface_channels
from .channel import Fact, Surface
from .instance import known_objects

FACES: frozenset[Fact] = frozenset({"faces"})


class SurfaceImages:
    """Makes the images of the surface channels among some names. needs: what they are made from; empty without any."""

    def __init__(self, names: Iterable[str], mesh: Mesh | None, objects: Sequence[SceneObject] = ()) -> None:
        """Take from the mesh what they need; None for a scene in Blender, which has objects.

        Raises NoisyWorldError where it cannot give one of them.
        """
        channels = surface_channels(names)
        self.needs: frozenset[Fact] = frozenset().union(*(item.needs for item in channels))
        self._ids: NDArray[np.uint16] | None = None
        try:
            if mesh is not None and "objects" in self.needs:
                self._ids = known_objects(mesh)
                self.needs = self.needs.difference(["objects"]).union(FACES)
            self._makers = {
                item.name: item.of_objects(objects) if mesh is None else item.of_mesh(mesh) for item in channels
            }
        except ValueError as error:
            raise NoisyWorldError(str(error)) from error

    def of(self, surface: Surface) -> dict[str, NDArray[Any]]:
        """Return the images of a frame by the channels' names."""
        if self._ids is not None:
            assert surface.faces is not None, "they are needed"
            seen = np.take(self._ids, surface.faces, mode="clip")
            surface = replace(surface, objects=np.where(surface.faces >= 0, seen, np.uint16(0)))
        return {name: make(surface) for name, make in self._makers.items()}
