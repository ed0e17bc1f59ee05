# SPDX-License-Identifier: GPL-3.0-or-later
"""Exposures that take longer than from one frame to the next, which no camera does."""

import numpy as np

from .plan import Plan

MS_PER_S = 1000.0


def long_exposures(plan: Plan) -> list[str]:
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
