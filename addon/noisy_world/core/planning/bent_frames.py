# SPDX-License-Identifier: GPL-3.0-or-later
"""The images of a frame beside its colour, as a lens that distorts shows them."""

from dataclasses import replace

from ..bending import Bending
from .source import RenderedFrame


def surfaces_bent(frame: RenderedFrame, bending: Bending, *, own_depth: bool = False) -> RenderedFrame:
    """Return a frame whose colour is bent already with all else bent too, but depth of a camera of its own."""
    behind_m = frame.behind_glass_m
    return replace(
        frame,
        depth_m=frame.depth_m if own_depth or frame.depth_m is None else bending.depth_m(frame.depth_m),
        others={name: bending.nearest(image) for name, image in frame.others.items()},
        behind_glass_m=None if behind_m is None else bending.depth_m(behind_m),
    )
