# SPDX-License-Identifier: GPL-3.0-or-later
"""The perturbations, one file each. To add one, add a file with a `PERTURBATION`, here or in an installed package.

docs/your_perturbation.md says how a package brings its own.
"""

import importlib
import pkgutil
import sys
from dataclasses import replace
from functools import cache

from ..core.installed import Door, collected
from ..core.opencv import check_opencv
from ..core.perturbing.kinds import KINDS, Perturbation, propagation_key
from . import shipped

DOOR = Door[Perturbation]("noisy_world.perturbations", "perturbation", "PERTURBATION", KINDS)


@cache
def registry() -> dict[str, Perturbation]:
    """Return all perturbations by name, our own and those of installed packages, in the order of propagation.

    Raises NoisyWorldError naming an installed package whose perturbations cannot be loaded or have a name in use, or
    an OpenCV that is too old.
    """
    check_opencv()
    found = collected(DOOR, _own()).values()
    items = [replace(each.item, distribution=each.distribution) for each in found]
    return {item.name: item for item in sorted(items, key=propagation_key)}


def _own() -> list[Perturbation]:
    modules = [
        importlib.import_module(f"{package.__name__}.{module.name}")
        for package in (sys.modules[__name__], shipped)
        for module in pkgutil.iter_modules(package.__path__)
        if not module.name.startswith("_")
    ]
    return [module.PERTURBATION for module in modules if hasattr(module, "PERTURBATION")]
