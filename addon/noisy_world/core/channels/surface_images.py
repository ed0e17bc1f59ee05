# SPDX-License-Identifier: GPL-3.0-or-later
"""The images of all surface channels that a renderer of a mesh is asked for."""

from collections.abc import Iterable
from typing import Any

from numpy.typing import NDArray

from ..errors import NoisyWorldError
from ..scenes.mesh import Mesh
from . import surface_channels
from .surface import Fact, Surface


class SurfaceImages:
    """Makes the images of the surface channels among some names. needs: what they are made from; empty without any."""

    def __init__(self, names: Iterable[str], mesh: Mesh) -> None:
        """Take from the mesh what they need. Raises NoisyWorldError where it cannot give one of them."""
        channels = surface_channels(names)
        self.needs: frozenset[Fact] = frozenset().union(*(item.needs for item in channels))
        try:
            self._makers = {item.name: item.of_mesh(mesh) for item in channels}
        except ValueError as error:
            raise NoisyWorldError(str(error)) from error

    def of(self, surface: Surface) -> dict[str, NDArray[Any]]:
        """Return the images of a frame by the channels' names."""
        return {name: make(surface) for name, make in self._makers.items()}
