# SPDX-License-Identifier: GPL-3.0-or-later
"""The perturbations, one file each. To add one, add a file with a `PERTURBATION`, here or in an installed package.

docs/your_perturbation.md says how a package brings its own.
"""

import importlib
import pkgutil
from functools import cache

from ..core.errors import NoisyWorldError
from ..core.perturbing.kinds import Perturbation, propagation_key
from ._installed import installed_perturbations


@cache
def registry() -> dict[str, Perturbation]:
    """Return all perturbations by name, our own and those of installed packages, in the order of propagation.

    Raises NoisyWorldError naming an installed package whose perturbations cannot be loaded or have a name in use.
    """
    found = {item.name: item for item in _own()}
    for item in installed_perturbations():
        if item.name in found:
            other = found[item.name].distribution
            raise NoisyWorldError(
                f"{item.distribution}: its perturbation {item.name} has the name of one "
                f"{f'of {other}' if other else 'of our own'}; rename it, or uninstall the package"
            )
        found[item.name] = item
    return {item.name: item for item in sorted(found.values(), key=propagation_key)}


def _own() -> list[Perturbation]:
    return [
        importlib.import_module(f"{__name__}.{module.name}").PERTURBATION
        for module in pkgutil.iter_modules(__path__)
        if not module.name.startswith("_")
    ]
