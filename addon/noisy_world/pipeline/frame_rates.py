# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether what drifts from frame to frame moves as fast as the frames that it is seen in follow one another."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..core.messages import Message, PresetKey
from ..core.perturbing.steps import Setting

RATE = "frame_rate_hz"
SAME = 1e-2  # of a rate: a difference that nobody sees


def other_rates(settings: Iterator[Setting], stamps_s: NDArray[np.float64]) -> list[Message]:
    """Return a note for each step that drifts by another rate of frames than that of their time stamps (N,), seconds.

    The rate is that of the median step between two stamps; of fewer than two nothing is said.
    """
    if len(stamps_s) < 2 or (step_s := float(np.median(np.diff(stamps_s)))) <= 0:
        return []
    rate_hz, found = 1 / step_s, []
    for setting in settings:
        for step in setting.rgb:
            given_hz = step.given.get(RATE, getattr(step.perturbation.parameters, RATE, None))
            if step.temporal != "drift" or given_hz is None or abs(given_hz - rate_hz) <= SAME * rate_hz:
                continue
            times = f"{rate_hz / given_hz:.3g} times as fast as in the scene, whose frames are {rate_hz:.4g} a second"
            text = f"{setting.name}: {step.perturbation.name} moves {times}; set "
            found.append(Message(text, PresetKey(RATE, f"{rate_hz:.4g}")))
    return found
