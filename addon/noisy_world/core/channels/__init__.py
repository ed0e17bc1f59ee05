# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels: what a camera gives for a frame. Each is an object in a file of its own, found by its name."""

from collections.abc import Iterable

from . import depth, instance, normal, rgb
from .channel import Channel
from .surface import SurfaceChannel

__all__ = ["CHANNELS", "COLOUR_AND_DEPTH", "Channel", "in_order", "surface_channels"]

CHANNELS: dict[str, Channel] = {
    item.name: item for item in (rgb.CHANNEL, depth.CHANNEL, normal.CHANNEL, instance.CHANNEL)
}
"""Every channel by its name in presets, in the order in which their images are made and listed."""

COLOUR_AND_DEPTH = frozenset({rgb.CHANNEL.name, depth.CHANNEL.name})
"""What every source has, but a video without depth; perturbations act on these."""


def in_order(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of channels in the registry's order, each once."""
    wanted = set(names)
    return tuple(name for name in CHANNELS if name in wanted)


def surface_channels(names: Iterable[str]) -> tuple[SurfaceChannel, ...]:
    """Return those channels of some names that tell of the surface of a mesh, in the registry's order."""
    found = (CHANNELS[name] for name in in_order(names))
    return tuple(item for item in found if isinstance(item, SurfaceChannel))
