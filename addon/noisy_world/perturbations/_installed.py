# SPDX-License-Identifier: GPL-3.0-or-later
"""The perturbations of installed packages, found by their entry points."""

import importlib
import pkgutil
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any

from ..core.errors import NoisyWorldError
from ..core.perturbing.kinds import KINDS, Distribution, Perturbation
from ..other_name import give_other_name

GROUP = "noisy_world.perturbations"
PACKAGE = "noisy_world"  # how installed packages know us, whatever our name is here


def installed_perturbations() -> Iterator[Perturbation]:
    """Yield what installed packages bring, package after package.

    An entry point of the group leads to a perturbation, or to a package whose modules each hold a `PERTURBATION`; those
    whose names begin with an underscore are left out. Raises NoisyWorldError naming the package where one does not.
    """
    root = __name__.removesuffix(".perturbations._installed")
    if root != PACKAGE:
        give_other_name(PACKAGE, root)
    found = [(_distribution(entry), entry) for entry in entry_points(group=GROUP)]
    for distribution, entry in sorted(found, key=lambda item: (item[0].name, item[1].name)):
        for item in _brought_by(entry, distribution):
            yield replace(item, distribution=distribution)


def _distribution(entry: EntryPoint) -> Distribution:
    assert entry.dist is not None  # entry_points() reads them from distributions
    return Distribution(entry.dist.name, entry.dist.version)


def _brought_by(entry: EntryPoint, distribution: Distribution) -> Iterator[Perturbation]:
    where = f"{distribution}: the entry point {entry.name} = {entry.value}"
    loaded = _loaded(entry.load, where)
    if not (isinstance(loaded, ModuleType) and hasattr(loaded, "__path__")):
        yield _checked(loaded, where)
        return
    for module in pkgutil.iter_modules(loaded.__path__):
        if module.name.startswith("_"):
            continue
        name = f"{loaded.__name__}.{module.name}"
        part = f"{where}: the module {name}"
        yield _checked(
            getattr(_loaded(lambda name=name: importlib.import_module(name), part), "PERTURBATION", None), part
        )


def _loaded(load: Any, where: str) -> Any:
    try:
        return load()
    except Exception as error:  # whatever another's code raises is told in a line
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise NoisyWorldError(f"{where} cannot be loaded: {told}; mend or uninstall the package") from error


def _checked(found: Any, where: str) -> Perturbation:
    if isinstance(found, KINDS):
        return found
    names = ", ".join(kind.__name__ for kind in KINDS)
    if type(found).__name__ in names.split(", "):
        raise NoisyWorldError(
            f"{where} was made with another copy of noisy_world; restart, and keep one copy on Python's path"
        )
    if found is None:
        raise NoisyWorldError(f"{where} holds no PERTURBATION; begin the names of other modules with an underscore")
    raise NoisyWorldError(f"{where} is a {type(found).__name__}, but has to be one of {names}, or a package of modules")
