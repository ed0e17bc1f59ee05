# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps of colour on lit frames: some on scene-linear light, the rest on what a view transform shows of it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..linear_light import decoded, encoded
from ..node_graphs.as_nodes import as_nodes
from .execution import ColourWork, on_encoded, perturb_colour
from .kinds import ColourPerturbation, FrameContext
from .steps import Step


def acts_on_light(work: ColourWork) -> bool:
    """Tell whether a step acts on light, so before the view transform."""
    return any(step.perturbation.acts_on_light for step, _, _ in work.active)


def on_light(work: ColourWork, rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    """Do what acts on light to scene-linear light (H, W, 3), of any brightness; return light."""
    for step, context, severity in work.active:
        if step.perturbation.acts_on_light:
            rgb = perturb_light(step, rgb, severity, context)
    return rgb


def after_light(work: ColourWork, shown: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Do the rest to what the view transform has made of `on_light`: (H, W, 3), display-encoded in [0, 1]."""
    return on_encoded(tuple(item for item in work.active if not item[0].perturbation.acts_on_light), shown)


def perturb_light(
    step: Step[ColourPerturbation], light: NDArray[np.float32], severity: float | None, context: FrameContext
) -> NDArray[np.float32]:
    """Carry out one step on scene-linear light (H, W, 3) float32, of any brightness; the result is at least 0.

    Some carry out their node group. What only averages works on light itself; the others as ever, on encoded values, by
    sRGB's curve, which goes on above 1.
    """
    context = replace(context, lit=True)
    if step.perturbation.lit_by_nodes:
        made = as_nodes(step.perturbation, light, step.parameters(severity), context)
    elif step.perturbation.averages:
        made = perturb_colour(step, light, severity, context)
    else:
        made = decoded(perturb_colour(step, encoded(light), severity, context))
    return np.maximum(made, np.float32(0))
