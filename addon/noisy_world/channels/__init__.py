# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels: what a camera gives for a frame. Each is an object in a file of its own, found by its name."""

import re
from collections.abc import Iterable
from typing import TypeVar

from ..core.entry_points import Door, Registry
from ..core.errors import NoisyWorldError
from .channel import Channel, PairChannel, SurfaceChannel

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
