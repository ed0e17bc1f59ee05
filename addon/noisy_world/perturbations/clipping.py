# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a chain of steps makes so much of a frame white or black that little is left of it, and which step does."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.errors import Message, PresetKey
from .execution import Active, ColourPerturbation, perturb_colour

MOST_CLIPPED = 0.4  # of a frame's pixels; chosen: what is left is no longer the scene
WHITE, BLACK = 255, 0


@dataclass(frozen=True)
class Clipping:
    """A share of a frame's pixels that became white or black. step: the name of the step that made most of them so.

    own: the share that this step alone added. white: whether most of them are white, not black.
    """

    share: float
    step: str
    own: float
    white: bool

    def note(self, where: str) -> Message:
        """Return a line for people. where: the setting, or what else was perturbed."""
        what = "white" if self.white else "black"
        by = f"{self.step} makes most of them so ({self.own:.0%} of the frame); lower its "
        text = f"{where}: {self.share:.0%} of a frame's pixels are {what} after all steps; {by}"
        return Message(text, PresetKey("severity"))


def clipped(rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return where (H, W, 3) is white or black: (H, W, 2), white first. One channel alone still shows the scene."""
    return np.stack([(rgb == end).all(axis=2) for end in (WHITE, BLACK)], axis=2)


def clipping(active: Active[ColourPerturbation], clean: NDArray[np.uint8], made: NDArray[np.uint8]) -> Clipping | None:
    """Return what a chain clips, where that is more than MOST_CLIPPED of the pixels; None where it is not.

    active: the steps with their contexts, in their order. clean, made: (H, W, 3), before and after them all. What is
    white or black in the clean frame does not count. Which step it was is found on arrays, one step after another, and
    only where it is asked for.
    """
    new = clipped(made) & ~clipped(clean)
    share = float(new.any(axis=2).mean())
    if share <= MOST_CLIPPED:
        return None
    image = clean.astype(np.float32) / np.float32(WHITE)
    before, shares = 0.0, []
    for step, context, severity in active:
        image = np.clip(perturb_colour(step, image, severity, context), 0.0, 1.0)
        now = clipped(np.rint(image * WHITE).astype(np.uint8)) & ~clipped(clean)
        after = float(now.any(axis=2).mean())
        shares.append(after - before)
        before = after
    most = int(np.argmax(shares))
    white = bool(new[..., 0].sum() >= new[..., 1].sum())
    return Clipping(share, active[most][0].perturbation.name, shares[most], white)
