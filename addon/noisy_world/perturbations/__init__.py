# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations by name. To add one, add a file with a `PERTURBATION` to `shipped`, or to a package of your own.

docs/your_perturbation.md says how a package brings its own.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

from ..core.packages import Door, Registry, check_opencv
from . import shipped
from .kinds import KINDS, Perturbation, propagation_key

DOOR = Door[Perturbation](
    "noisy_world.perturbations",
    "perturbation",
    "PERTURBATION",
    KINDS,
    owned=lambda item, distribution: replace(item, distribution=distribution),
)


@cache
def registry() -> Mapping[str, Perturbation]:
    """Return all perturbations by name, our own and those of installed packages, in the order of propagation.

    Raises NoisyWorldError naming an installed package whose perturbations cannot be loaded or have a name in use, or
    an OpenCV that is too old.
    """
    check_opencv()
    found = Registry(DOOR, shipped.__name__, key=propagation_key)
    found.load()
    return found
