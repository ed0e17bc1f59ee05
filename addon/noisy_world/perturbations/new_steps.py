# SPDX-License-Identifier: GPL-3.0-or-later
"""What a step that is newly added to a setting says: its values, by the scene and by what stands there already.

Presets of before keep what they had, as defaults stay. What is written anew has what came later: newer laws, and what
the scene's depth tells.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .kinds import ColourPerturbation, Perturbation
from .steps import DEFAULT_SEVERITY

GENTLE_SEVERITY = 1.0  # of an overlay that comes on top of another


@dataclass(frozen=True)
class NewStep:
    """A step as a preset has it: its severity, None where there is none, and parameters beside it.

    says: sentences for whoever adds it, about what was chosen for him; empty where nothing was.
    """

    severity: float | None
    given: Mapping[str, Any]
    says: tuple[str, ...]

    @property
    def values(self) -> dict[str, Any]:
        """What stands in the preset, under the step's name."""
        return ({} if self.severity is None else {"severity": self.severity}) | dict(self.given)


def new_step(
    perturbation: Perturbation, before: Iterable[Perturbation] = (), depth_m: NDArray[np.float32] | None = None
) -> NewStep:
    """Return how a perturbation begins in a setting.

    before: those that the setting has. depth_m: clean planar depth (H, W) of a frame of the scene, metres, 0 = void;
    None where it is unknown, and then nothing is chosen by it.
    """
    says: list[str] = []
    severity = DEFAULT_SEVERITY if perturbation.severities else None
    if severity is not None and is_overlay(perturbation):
        others = [item.label.lower() for item in before if is_overlay(item)]
        if others:
            severity = GENTLE_SEVERITY
            says.append(f"An overlay on {' and '.join(dict.fromkeys(others))}: begins at 1, as they add up to white")
    given = dict(perturbation.newly)
    if perturbation.by_depth is not None and depth_m is not None:
        chosen, why = perturbation.by_depth(depth_m)
        given |= chosen
        says.append(why)
    return NewStep(severity, given, tuple(says))


def is_overlay(perturbation: Perturbation) -> bool:
    """Tell whether a perturbation lies over the whole frame; lists say "overlay" beside its name."""
    return isinstance(perturbation, ColourPerturbation) and perturbation.overlay
