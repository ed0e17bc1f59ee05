# SPDX-License-Identifier: GPL-3.0-or-later
"""Desynchronisation: depth that was taken at another time than the colour it is paired with."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.schema import Choice, key
from ..kinds import About, Example, PairingPerturbation, SequenceContext


@dataclass(frozen=True)
class Desync:
    """Which depth is paired with which colour, and what happens at the ends."""

    offset: int = key(
        "depth of frame i + offset goes with colour of frame i: above 0, depth was taken after its colour; below 0 it "
        "comes late",
        unit="frames",
        default=5,
        minimum=-10_000,
        maximum=10_000,
        slider=(-30, 30),
    )
    mode: Literal["static", "dynamic"] = key(
        "dynamic: offset - 1, offset or offset + 1, drawn for each frame",
        default="static",
        choices={
            "static": Choice("Static", "All frames are off by Offset"),
            "dynamic": Choice("Dynamic", "Each frame is off by Offset, or by one frame less or more, drawn for it"),
        },
    )
    edge: Literal["clamp", "drop"] = key(
        "where there is no such depth: clamp takes the nearest there is, drop leaves the frame out",
        default="clamp",
        choices={
            "clamp": Choice("Clamp", "The nearest depth that there is"),
            "drop": Choice("Drop", "The frame is left out"),
        },
    )
    lost_percent: float = key(
        "share of the frames that are lost, colour and depth, drawn for each",
        unit="%",
        default=0.0,
        minimum=0,
        maximum=99,
        later=True,
    )
    repeated_percent: float = key(
        "share of the frames whose depth is that of the frame before again, drawn for each",
        unit="%",
        default=0.0,
        minimum=0,
        maximum=100,
        later=True,
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "offset": "Above 0: depth was taken after its color. Below 0: before it, as depth that comes late",
        "mode": "Whether all frames are off by the same, or each by a draw of its own",
        "edge": "What happens where depth would come from before the first frame or after the last",
        "lost_percent": "Higher: more frames are missing, as a busy recorder loses them",
        "repeated_percent": "Higher: more frames show the depth of the one before once more",
    }


def apply(count: int, parameters: Desync, context: SequenceContext) -> NDArray[np.int64]:
    """Return (count,) int64: for each frame the one whose depth is paired with it, -1 where the frame is left out.

    A frame that is lost is left out, and what is repeated is what the frame before shows, lost or not.

    D'[i] = D[i + offset] (paper, section "RGB-D desynchronization", which calls an offset above 0 a delay): depth that
    was taken after its colour. Depth that arrives late, by a latency of n frames, has the offset -n.
    """
    source = np.arange(count) + parameters.offset
    if parameters.mode == "dynamic":
        source += context.integers(count, -1, 2)
    if parameters.edge == "clamp":
        source = np.clip(source, 0, count - 1)
    else:
        source = np.where((source >= 0) & (source < count), source, -1)
    if parameters.repeated_percent > 0:
        again = np.flatnonzero(100 * context.stream("repeated").random(count) < parameters.repeated_percent)
        for frame in again[again > 0]:  # in their order, as one may be repeated twice
            source[frame] = source[frame - 1]
    if parameters.lost_percent > 0:
        source[100 * context.stream("lost").random(count) < parameters.lost_percent] = -1
    return source


PERTURBATION = PairingPerturbation(
    name="desync",
    label="RGB-D desynchronisation",
    order=10,
    parameters=Desync,
    severities={},
    source='paper, section "Benchmark Statistics": offsets 5, 10 and 20',
    about=About(
        "Pairs colour with depth of another moment",
        "colour of frame i with depth of frame i + offset: above 0 depth that was taken after its colour, as "
        "in the paper; depth that comes late is below 0",
        caption="colour with depth that was taken 5, 10 and 20 frames after it, at 20 frames a second. Edges of that "
        "depth are drawn over the colour.",
        picture="Edges of later depth over colour",
        of_paper=True,
        example=Example(
            text="RGB-D desynchronisation in the embedded room, as the paper has it.",
            settings=(
                "{name: offset5, perturb: [{desync: {offset: 5}}]}",
                "{name: offset5_dynamic, perturb: [{desync: {offset: 5, mode: dynamic}}]}",
                "{name: offset10, perturb: [{desync: {offset: 10}}]}",
                "{name: offset10_dynamic, perturb: [{desync: {offset: 10, mode: dynamic}}]}",
                "{name: offset20, perturb: [{desync: {offset: 20}}]}",
                "{name: offset20_dynamic, perturb: [{desync: {offset: 20, mode: dynamic}}]}",
            ),
            frames=24,
            rate_hz=4,
        ),
    ),
    apply=apply,
)
