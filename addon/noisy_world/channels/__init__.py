# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels: what a camera gives for a frame. Each is an object in a file of its own, found by its name."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError
from ..core.packages import Door, Registry
from ..scenes.polygon_mesh import Mesh, SceneObject
from .channel import Channel, Fact, PairChannel, Surface, SurfaceChannel
from .instance import known_objects

__all__ = ["CHANNELS", "COLOUR_AND_DEPTH", "Channel", "in_order", "pair_channels", "surface_channels"]

T = TypeVar("T", bound=Channel)

_GIVEN = ("name", "label", "meaning", "spoken", "dtype", "components", "unit", "convention", "bytes_per_pixel")


def contract_problem(item: Channel) -> str:
    """Return what a channel does not say of itself, in a sentence, or ""."""
    needed = (*_GIVEN, "needs") if isinstance(item, SurfaceChannel) else _GIVEN
    if lacking := [name for name in needed if not getattr(item, name, None)]:
        return f"its channel {type(item).__name__} lacks {', '.join(lacking)}"
    if not re.fullmatch(r"[a-z][a-z0-9_]*", item.name):
        return f"{item.name!r} is no name of a channel: small letters, digits and underscores, a letter first"
    return ""


# Of installed packages, those of a surface or of two frames alone: what else there is, a renderer would have to give.
KINDS = (SurfaceChannel, PairChannel)
DOOR = Door[Channel]("noisy_world.channels", "channel", "CHANNEL", KINDS, contract_problem)

CHANNELS = Registry[Channel](DOOR, __name__, own=Channel)
"""Every channel by its name in presets, ours and those of installed packages, in the order in which they are made."""

COLOUR_AND_DEPTH = frozenset({"rgb", "depth"})
"""What every source has, but a video without depth; perturbations act on these."""


def in_order(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of channels in the registry's order, each once.

    Raises NoisyWorldError for a channel of a package that is not installed here.
    """
    wanted = set(names)
    if unknown := sorted(name for name in wanted if name not in CHANNELS):
        message = f"there is no channel {', '.join(unknown)} here"
        raise NoisyWorldError(f"{message}: install the package that brings it; known are {', '.join(CHANNELS)}")
    return tuple(name for name in CHANNELS if name in wanted)


def surface_channels(names: Iterable[str]) -> tuple[SurfaceChannel, ...]:
    """Return those channels of some names that tell of the surface of a mesh, in the registry's order."""
    return _of_kind(names, SurfaceChannel)


def pair_channels(names: Iterable[str]) -> tuple[PairChannel, ...]:
    """Return those channels of some names that lead to a sequence's next frame, in the registry's order."""
    return _of_kind(names, PairChannel)


def _of_kind(names: Iterable[str], kind: type[T]) -> tuple[T, ...]:
    found = (CHANNELS[name] for name in in_order(names))
    return tuple(item for item in found if isinstance(item, kind))


# The images of all surface channels that a renderer of a mesh is asked for.


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
