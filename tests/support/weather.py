# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog, frost, snow and spatter, and blurs, called as their tests call them, and the paper's table of the four."""

import numpy as np

from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.shipped import fog, frost, snow, spatter
from noisy_world.perturbations import registry

MODULES = {module.PERTURBATION.name: module for module in (fog, frost, snow, spatter)}
NAMES = sorted(MODULES)
SIZES = [(1, 1), (1, 7), (7, 1), (2, 3), (13, 17), (31, 8)]

# The paper's table "Specific configurations of the RGB imaging perturbations", severities 1 to 5.
TABLE = {
    "fog": [(1.5, 2.0), (2.0, 2.0), (2.5, 1.7), (2.5, 1.5), (3.0, 1.4)],
    "frost": [(1.0, 0.4), (0.8, 0.6), (0.7, 0.7), (0.65, 0.7), (0.6, 0.75)],
    "snow": [
        (0.1, 0.3, 3, 0.5, 10, 4, 0.8),
        (0.2, 0.3, 2, 0.5, 12, 4, 0.7),
        (0.55, 0.3, 4, 0.9, 12, 8, 0.7),
        (0.55, 0.3, 4.5, 0.85, 12, 8, 0.65),
        (0.55, 0.3, 2.5, 0.85, 12, 12, 0.55),
    ],
    "spatter": [
        (0.65, 0.3, 4, 0.69, 0.6, 0),
        (0.65, 0.3, 3, 0.68, 0.6, 0),
        (0.65, 0.3, 2, 0.68, 0.5, 0),
        (0.65, 0.3, 1, 0.65, 1.5, 1),
        (0.67, 0.4, 1, 0.65, 1.5, 1),
    ],
}
KEYS = {
    "fog": ("thickness", "smoothness"),
    "frost": ("intensity", "influence"),
    "snow": ("mean", "std", "scale", "threshold", "blur_radius_px", "blur_sigma_px", "blending_ratio"),
    "spatter": ("mean", "std", "sigma_px", "threshold", "scaling", "complexity"),
}


def picture(size, seed=0):
    return np.random.default_rng(seed).random((*size, 3), dtype=np.float32)


def flat(size, level=0.0):
    return np.full((*size, 3), level, dtype=np.float32)


def frame(index=0, temporal="fresh", seed=1):
    return FrameContext(index, (seed, "scene", "setting", "weather", 0), temporal)


def run(name, rgb, severity=3, where=None, **given):
    perturbation = registry()[name]
    return perturbation.apply(rgb, perturbation.at_severity(severity, **given), where or frame())
