# SPDX-License-Identifier: GPL-3.0-or-later
"""Which systems there are: those that come along or are brought by installed packages, by name; others by file."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import cast, get_args

from ...core.errors import InputError, NoisyWorldError
from ...core.installed import Brought, Distribution, add, loaded_entries
from ...core.schema import ConfigPath, unknown_name
from ...core.shipped import PACKAGE
from .definition import IsolateBy, System, read_system

SHIPPED = PACKAGE / "evaluate" / "definitions"
SUFFIXES = (".yaml", ".yml")
GROUP = "noisy_world.systems"


@dataclass(frozen=True)
class _Definition:
    """The file of a system, which is named like it. where: the package and entry point that brought it, or ""."""

    name: str
    file: Path
    where: str = ""


def shipped_names() -> list[str]:
    """Return the names of the systems that come with Noisy World, sorted."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def system_names() -> list[str]:
    """Return the names of all systems that are known here: those that come along, then those of installed packages.

    Raises NoisyWorldError naming a package that brings no definitions, or a name that is in use.
    """
    return list(_definitions())


def distribution_of(name: str) -> Distribution | None:
    """Return the installed package that brought a system; None for one that comes along, or of a file."""
    found = _definitions().get(name)
    return None if found is None else found.distribution


def find_system(name: str, option: str = "--systems") -> System:
    """Return a system by its name or, where that ends in .yaml, by the file of its definition.

    option: by which it is named. Raises InputError where there is none, or its definition is wrong; NoisyWorldError
    naming the installed package whose it is.
    """
    if name.endswith(SUFFIXES):
        return read_system(Path(name).expanduser())
    if name in shipped_names():
        return read_system(SHIPPED / f"{name}.yaml")
    definitions = _definitions()
    if name not in definitions:
        raise unknown_name(ConfigPath(option), "system", name, list(definitions))
    return _read(definitions[name].item)


def _definitions() -> dict[str, Brought[_Definition]]:
    found = {name: Brought(_Definition(name, SHIPPED / f"{name}.yaml"), None) for name in shipped_names()}
    for entry in loaded_entries(GROUP):
        for definition in _brought_by(entry.found, entry.where):
            add(found, definition.name, Brought(definition, entry.distribution), "system")
    return found


def _brought_by(package: object, where: str) -> Iterator[_Definition]:
    folders = getattr(package, "__path__", None)
    if not isinstance(package, ModuleType) or folders is None:
        raise NoisyWorldError(f"{where} is no package; name the package that holds the definitions, NAME.yaml each")
    files = sorted(file for folder in folders for file in Path(folder).glob("*.yaml"))
    if not files:
        raise NoisyWorldError(f"{where} holds no system; put the definitions, NAME.yaml each, beside its __init__.py")
    for file in files:
        yield _Definition(file.stem, file, where)


def _read(definition: _Definition) -> System:
    try:
        system = read_system(definition.file)
    except InputError as error:
        raise NoisyWorldError(str(error), file=definition.where, remedy="mend or uninstall the package") from error
    if system.name != definition.name:
        raise NoisyWorldError(
            f"{definition.file.name} defines {system.name}",
            file=definition.where,
            remedy="name the file like the system",
        )
    return system


def find_systems(names: Iterable[str], option: str = "--systems") -> list[System]:
    """Return systems by their names or files. Raises InputError, also where two that differ have one name.

    option: by which they are named.
    """
    found: dict[str, System] = {}
    for system in (find_system(name, option) for name in names):
        if found.setdefault(system.name, system) != system:
            raise InputError(system.file, f"is a second system called {system.name}", where="name", remedy="rename one")
    return list(found.values())


def isolating(systems: Iterable[System], isolate: str) -> list[System]:
    """Return the systems, kept apart by a program where they are not yet; "none" changes nothing."""
    if isolate == "none":
        return list(systems)
    assert isolate in get_args(IsolateBy), isolate
    return [replace(system, isolate=cast("IsolateBy", isolate)) for system in systems]
