# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels: what a camera gives for a frame. Each is an object in a file of its own, found by its name."""

from collections.abc import Iterable

from . import depth, rgb
from .channel import Channel

__all__ = ["CHANNELS", "COLOUR_AND_DEPTH", "Channel", "channel", "in_order"]

CHANNELS: dict[str, Channel] = {item.name: item for item in (rgb.CHANNEL, depth.CHANNEL)}
"""Every channel by its name in presets, in the order in which their images are made and listed."""

COLOUR_AND_DEPTH = frozenset({rgb.CHANNEL.name, depth.CHANNEL.name})
"""What every source has, but a video without depth; perturbations act on these."""


def channel(name: str) -> Channel:
    """Return the channel of a name that a preset may have. Raises KeyError."""
    return CHANNELS[name]


def in_order(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of channels in the registry's order, each once."""
    wanted = set(names)
    return tuple(name for name in CHANNELS if name in wanted)
