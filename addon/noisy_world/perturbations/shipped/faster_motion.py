# SPDX-License-Identifier: GPL-3.0-or-later
"""Faster motion: the same path at several times the speed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.schema import key
from ..kinds import About, Example, MotionPerturbation, SequenceContext


@dataclass(frozen=True)
class FasterMotion:
    """The factor of the speed; the poses between are left out."""

    factor: int = key("how many times as fast the camera goes", default=2, minimum=1, maximum=1000)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "factor": "Higher: the camera moves further from frame to frame, and there are fewer frames",
    }


def choose(count: int, parameters: FasterMotion, _context: SequenceContext) -> NDArray[np.int64]:
    """Return the numbers of every factor-th of `count` poses, from 0 on.

    The camera's rate does not change: the poses that are kept get the first stamps of the path.
    """
    return np.arange(0, count, parameters.factor)


PERTURBATION = MotionPerturbation(
    name="faster_motion",
    label="Faster motion",
    order=20,
    parameters=FasterMotion,
    severities={},
    source='paper, section "Benchmark Statistics": factors 2, 4 and 8',
    about=About(
        law="every n-th pose, at an unchanged frame rate",
        caption="every 2nd, 4th and 8th pose. Each frame is laid over the next one.",
        picture="Frames laid over the next one, at 2, 4 and 8 times the speed",
        of_paper=True,
        example=Example(
            text="Faster motion in the embedded room, as the paper has it.",
            settings=(
                "{name: x2, perturb: [{faster_motion: {factor: 2}}]}",
                "{name: x4, perturb: [{faster_motion: {factor: 4}}]}",
                "{name: x8, perturb: [{faster_motion: {factor: 8}}]}",
            ),
            frames=24,
            rate_hz=4,
        ),
    ),
    choose=choose,
)
