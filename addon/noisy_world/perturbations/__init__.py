# SPDX-License-Identifier: GPL-3.0-or-later
"""The perturbations, one file each. Adding one is adding a file with a `PERTURBATION`."""

import importlib
import pkgutil
from functools import cache

from ..core.perturbing.kinds import Perturbation, propagation_key


@cache
def registry() -> dict[str, Perturbation]:
    """Return all perturbations by name, in the order of propagation."""
    found = [
        importlib.import_module(f"{__name__}.{module.name}").PERTURBATION
        for module in pkgutil.iter_modules(__path__)
        if not module.name.startswith("_")
    ]
    return {item.name: item for item in sorted(found, key=propagation_key)}
