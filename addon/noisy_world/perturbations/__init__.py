# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations by name. To add one, add a file with a `PERTURBATION` to `shipped`, or to a package of your own.

docs/your_perturbation.md says how a package brings its own.
"""

import importlib
import pkgutil
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache, cached_property

from ..core.dependencies import check_opencv
from ..core.entry_points import Door, collected
from ..core.errors import NoisyWorldError
from . import shipped
from .kinds import KINDS, Perturbation, propagation_key

DOOR = Door[Perturbation]("noisy_world.perturbations", "perturbation", "PERTURBATION", KINDS)


@cache
def registry() -> Mapping[str, Perturbation]:
    """Return all perturbations by name, our own and those of installed packages, in the order of propagation.

    One of ours is imported when it is asked for by its name, which is its file's; all are when they are gone through.
    Raises NoisyWorldError naming an installed package whose perturbations cannot be loaded or have a name in use, or
    an OpenCV that is too old.
    """
    check_opencv()
    brought = collected(DOOR, ())
    if taken := next((name for name in brought if name in _own_modules()), None):
        raise NoisyWorldError(
            f"its perturbation {taken} has the name of one of our own",
            file=brought[taken].distribution,
            remedy="rename it, or uninstall the package",
        )
    return _Perturbations({name: replace(each.item, distribution=each.distribution) for name, each in brought.items()})


class _Perturbations(Mapping[str, Perturbation]):
    def __init__(self, brought: Mapping[str, Perturbation]) -> None:
        self._brought = brought

    @cached_property
    def _every(self) -> dict[str, Perturbation]:
        every = [*map(_own, _own_modules()), *self._brought.values()]
        return {item.name: item for item in sorted(every, key=propagation_key)}

    def __getitem__(self, name: str) -> Perturbation:
        return self._brought[name] if name not in _own_modules() else _own(name)

    def __contains__(self, name: object) -> bool:
        return name in _own_modules() or name in self._brought

    def __iter__(self) -> Iterator[str]:
        return iter(self._every)

    def __len__(self) -> int:
        return len(_own_modules()) + len(self._brought)


@cache
def _own_modules() -> dict[str, str]:
    """Return the modules of our own perturbations by their names, without importing them."""
    found = (item.name for item in pkgutil.iter_modules(shipped.__path__))
    return {name: f"{shipped.__name__}.{name}" for name in found if not name.startswith("_")}


def _own(name: str) -> Perturbation:
    return importlib.import_module(_own_modules()[name]).PERTURBATION
