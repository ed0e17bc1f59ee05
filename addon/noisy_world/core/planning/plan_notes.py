# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user should know about a plan before it is made: one sentence each."""

import numpy as np

from .plan import Plan

MS_PER_S = 1000.0


def plan_notes(plan: Plan) -> list[str]:
    """Return what is to be said of a plan beside its format: of exposures, and of what a camera sees too much of."""
    return [*_long_exposures(plan), *_limits(plan)]


def _limits(plan: Plan) -> list[str]:
    """Return a sentence for each setting that draws less of something than it asks for, as a camera sees so much."""
    found: dict[str, None] = {}
    for render in plan.renders:
        if render.scene.source.capabilities.lit:
            continue  # node groups draw there, whose time goes with the image
        for setting in (sequence.setting for sequence in render.sequences):
            for step in () if setting.composited else setting.rgb:
                if step.perturbation.limits is None or step.severity == 0:
                    continue
                severities = (step.severity,) if step.levels is None else sorted({*step.levels} - {0})
                said = (step.perturbation.limits(step.parameters(each), render.camera) for each in severities)
                if text := next(filter(None, said), ""):
                    found[f"{setting.name}: {step.perturbation.name} {text}"] = None
    return list(found)


def _long_exposures(plan: Plan) -> list[str]:
    """Return a sentence for each setting whose shutter, or whose readout, takes longer than frames are apart."""
    gaps = [
        (float(np.diff(stamps).min()), scene.name)
        for scene in plan.scenes
        if len(stamps := scene.source.frame_stamps.rgb.seconds) > 1
    ]
    if not gaps:
        return []
    apart_s, nearest = min(gaps)
    found: list[str] = []
    for setting in plan.settings:
        if (shutter := setting.shutter) is None:
            continue
        longest_s, what = max((shutter.exposure_s, "exposure"), (shutter.readout_s, "readout"))
        if longest_s > apart_s * (1 + 1e-6):
            longest_ms, apart_ms = longest_s * MS_PER_S, apart_s * MS_PER_S
            took = f"{what} of {longest_ms:.3g} ms is longer than the {apart_ms:.3g} ms between frames of {nearest}"
            found.append(f"{setting.name}: {took}, which no camera does; shorten it, or take fewer frames a second")
    return found
