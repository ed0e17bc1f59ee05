# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels: what a camera gives for a frame. Each is an object in a file of its own, found by its name."""

import re
from collections.abc import Iterable

from ..errors import NoisyWorldError
from ..installed import Door, Registry
from . import depth, instance, normal, rgb
from .channel import Channel
from .surface import SurfaceChannel

__all__ = ["CHANNELS", "COLOUR_AND_DEPTH", "Channel", "in_order", "surface_channels"]

_GIVEN = ("name", "label", "meaning", "spoken", "dtype", "components", "unit", "convention", "needs", "bytes_per_pixel")


def _problem(item: Channel) -> str:
    """Return what a channel does not say of itself, in a sentence, or ""."""
    if lacking := [name for name in _GIVEN if not getattr(item, name, None)]:
        return f"its channel {type(item).__name__} lacks {', '.join(lacking)}"
    if not re.fullmatch(r"[a-z][a-z0-9_]*", item.name):
        return f"{item.name!r} is no name of a channel: small letters, digits and underscores, a letter first"
    return ""


# Of installed packages, those of a mesh's surface alone: what else there is, a renderer would have to give.
DOOR = Door[Channel]("noisy_world.channels", "channel", "CHANNEL", (SurfaceChannel,), _problem)

CHANNELS = Registry[Channel](DOOR, lambda: (rgb.CHANNEL, depth.CHANNEL, normal.CHANNEL, instance.CHANNEL))
"""Every channel by its name in presets, ours and those of installed packages, in the order in which they are made."""

COLOUR_AND_DEPTH = frozenset({rgb.CHANNEL.name, depth.CHANNEL.name})
"""What every source has, but a video without depth; perturbations act on these."""


def in_order(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of channels in the registry's order, each once.

    Raises NoisyWorldError for a channel of a package that is not installed here.
    """
    wanted = set(names)
    if unknown := sorted(wanted.difference(CHANNELS)):
        told = f"there is no channel {', '.join(unknown)} here"
        raise NoisyWorldError(f"{told}: install the package that brings it; known are {', '.join(CHANNELS)}")
    return tuple(name for name in CHANNELS if name in wanted)


def surface_channels(names: Iterable[str]) -> tuple[SurfaceChannel, ...]:
    """Return those channels of some names that tell of the surface of a mesh, in the registry's order."""
    found = (CHANNELS[name] for name in in_order(names))
    return tuple(item for item in found if isinstance(item, SurfaceChannel))
