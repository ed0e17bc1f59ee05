# SPDX-License-Identifier: GPL-3.0-or-later
"""Which systems there are: those that come with Noisy World, by name, and the user's own, by file."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import cast, get_args

from ...core.errors import InputError
from ...core.schema import Place, unknown_name
from .definition import IsolateBy, System, read_system

SHIPPED = Path(__file__).parent / "shipped"
SUFFIXES = (".yaml", ".yml")


def shipped_names() -> list[str]:
    """Return the names of the systems that come with Noisy World, sorted."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def find_system(name: str) -> System:
    """Return a system by its name or, where that ends in .yaml, by the file of its definition.

    Raises InputError where there is none, or its definition is wrong.
    """
    if name.endswith(SUFFIXES):
        return read_system(Path(name).expanduser())
    if name not in shipped_names():
        raise unknown_name(Place("--systems"), "system", name, shipped_names())
    return read_system(SHIPPED / f"{name}.yaml")


def find_systems(names: str) -> list[System]:
    """Return the systems of a list with commas. Raises InputError, also where two have one name."""
    systems = [find_system(name.strip()) for name in names.split(",") if name.strip()]
    if not systems:
        raise InputError("--systems", "names no system", remedy=f"known here: {', '.join(shipped_names())}, or a .yaml")
    seen: dict[str, System] = {}
    for system in systems:
        if system.name in seen:
            raise InputError(system.file, f"is a second system called {system.name}", where="name", remedy="rename one")
        seen[system.name] = system
    return systems


def isolating(systems: Iterable[System], isolate: str) -> list[System]:
    """Return the systems, kept apart by a program where they are not yet; "none" changes nothing."""
    if isolate == "none":
        return list(systems)
    assert isolate in get_args(IsolateBy), isolate
    return [replace(system, isolate=cast("IsolateBy", isolate)) for system in systems]
