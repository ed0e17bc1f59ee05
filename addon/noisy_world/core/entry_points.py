# SPDX-License-Identifier: GPL-3.0-or-later
"""What installed packages bring, found by their entry points, beside our own of the same kind.

An entry point names an object, or a package whose modules each hold one under the door's attribute; modules whose names
begin with an underscore are left out. Everything that is wrong with a package is one line that names it and its entry
point.
"""

import importlib
import importlib.util
import pkgutil
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from ..other_name import give_other_name
from .errors import NoisyWorldError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
S = TypeVar("S")

LAST = 1000  # the `order` of what says none
PACKAGE = "noisy_world"  # the name by which installed packages import us; inside Blender our own name is another


@dataclass(frozen=True)
class Distribution:
    """An installed package, by the name and version that its metadata declare."""

    name: str
    version: str

    def __str__(self) -> str:
        return f"{self.name} {self.version}"


@dataclass(frozen=True)
class Door(Generic[T]):
    """How installed packages bring things of one kind.

    group: of the entry points. word: what such a thing is called. attribute: under which a module holds it.
    kinds: the classes of which it is an instance; each has a name. problem: returns what is wrong with one in a
    sentence, or "". owned: returns one as it is kept, with the package that brought it.
    """

    group: str
    word: str
    attribute: str
    kinds: tuple[type[T], ...]
    problem: Callable[[T], str] = lambda _: ""
    owned: Callable[[T, Distribution], T] = lambda item, _: item


@dataclass(frozen=True)
class Loaded:
    """What an entry point leads to. where: package and entry point, for messages."""

    found: object
    distribution: Distribution
    where: str


@dataclass(frozen=True)
class Brought(Generic[T]):
    """A thing and the package that brought it; None for our own."""

    item: T
    distribution: Distribution | None


def loaded_entries(group: str) -> Iterator[Loaded]:
    """Load the entry points of a group, sorted by package and entry point.

    Raises NoisyWorldError naming the package whose entry point cannot be loaded.
    """
    root = __name__.removesuffix(".core.entry_points")
    if root != PACKAGE:
        give_other_name(PACKAGE, root)
    found = [(_distribution(entry), entry) for entry in _entry_points(tuple(sys.path)).select(group=group)]
    for distribution, entry in sorted(found, key=lambda pair: (pair[0].name, pair[1].name)):
        where = f"{distribution}: the entry point {entry.name} = {entry.value}"
        yield Loaded(_loaded(entry.load, where), distribution, where)


@lru_cache(maxsize=1)
def _entry_points(_path: tuple[str, ...]) -> Any:  # EntryPoints; under Python 3.11 another class with its `select`
    """Read the entry points of all that is installed on Python's path, once for all groups."""
    from importlib.metadata import entry_points

    return entry_points()


def add(found: dict[str, Brought[T]], name: str, new: Brought[T], word: str) -> None:
    """Add what a package brings by its name. Raises NoisyWorldError naming the package where the name is in use."""
    if name in found:
        other = found[name].distribution
        raise NoisyWorldError(
            f"its {word} {name} has the name of one {f'of {other}' if other else 'of our own'}",
            file=new.distribution,
            remedy="rename it, or uninstall the package",
        )
    found[name] = new


# A name as our files say it: name="tum", in a class or where an object is made, or the first that makes a constant.
_NAMED = re.compile(r'\bname(?:: .+)? ?= ?"([\w-]+)"|^[A-Z]\w+(?:: .+)? = \w+\(\s*"([\w-]+)"', re.MULTILINE)


class Registry(Mapping[str, T]):
    """Things of one kind by name: our own in their order, and then those of installed packages.

    One of ours is held by a module of a package under the door's attribute, or by a tuple there, so a file is enough to
    bring one. It is imported when its name is asked for, and all are when they are gone through.

    Raises NoisyWorldError when it is first asked, naming the package that brings something else, or a name in use.
    """

    def __init__(
        self,
        door: Door[T],
        package: str | None,
        *,
        own: type[T] | None = None,
        listed: Iterable[T] = (),
        key: Callable[[T], Any] | None = None,
    ) -> None:
        """Look in a package of ours for such objects.

        own: their class, where that is another than those of packages. listed: others of ours, which are the first.
        key: by which all are sorted, those of packages among them.
        """
        assert package is not None, "a module of ours is in one"
        self.door = door
        self._package = package
        self._own = door.kinds if own is None else own
        self._listed = {_name(item): item for item in listed}
        self._key = key
        self._asked: dict[str, T] = {}

    @cached_property
    def _folders(self) -> list[Path]:
        spec = importlib.util.find_spec(self._package)
        assert spec is not None
        return [Path(folder) for folder in spec.submodule_search_locations or ()]

    @cached_property
    def _modules(self) -> dict[str, set[str]]:
        """The modules that hold things of ours, with the names that their texts say; not all are of such things."""
        holds = re.compile(rf"^{self.door.attribute}\b.* = ", re.MULTILINE)
        files = [file for folder in self._folders for file in sorted(folder.glob("[!_]*.py"))]
        texts = {file.stem: file.read_text(encoding="utf-8") for file in files}
        return {
            module: {keyword or first for keyword, first in _NAMED.findall(text)}
            for module, text in texts.items()
            if holds.search(text)
        }

    def _held(self, module: str) -> list[T]:
        found = getattr(importlib.import_module(f"{self._package}.{module}"), self.door.attribute, None)
        return [item for item in (found if isinstance(found, tuple) else (found,)) if isinstance(item, self._own)]

    def _places(self, name: str) -> Iterator[str]:
        """Yield the modules that may hold what has a name: the one that is called so, and then those that say it."""
        if not isinstance(name, str):
            return  # such as a key of a document that is a number
        if name.isidentifier() and any((folder / f"{name}.py").is_file() for folder in self._folders):
            yield name
        yield from (module for module, names in self._modules.items() if name in names)

    def ours(self, name: str) -> T | None:
        """Return one of ours, whatever packages bring; None where there is none of the name."""
        if name in self._listed:
            return self._listed[name]
        return next((item for module in self._places(name) for item in self._held(module) if _name(item) == name), None)

    def load(self) -> None:
        """Load what installed packages bring, if that was not done."""
        _ = self._brought

    @cached_property
    def _brought(self) -> dict[str, Brought[T]]:
        found: dict[str, Brought[T]] = {}
        for entry in loaded_entries(self.door.group):
            for item in _brought_by(entry, self.door):
                new = Brought(self.door.owned(item, entry.distribution), entry.distribution)
                ours = self.ours(_name(item))
                add(found if ours is None else {_name(item): Brought(ours, None)}, _name(item), new, self.door.word)
        return found

    @cached_property
    def _every(self) -> dict[str, T]:
        brought = [each.item for each in self._brought.values()]
        held = [item for module in self._modules for item in self._held(module)]
        if unsaid := [_name(item) for item in held if self.ours(_name(item)) is not item]:
            raise AssertionError(f"{unsaid[0]} is not found by its name: its file has to say it as it is, in quotes")
        held.sort(key=lambda item: (getattr(item, "order", LAST), _name(item)))
        every = [*self._listed.values(), *held, *brought]
        return {_name(item): item for item in (every if self._key is None else sorted(every, key=self._key))}

    def __getitem__(self, name: str) -> T:
        if name not in self._asked:
            self.load()
            ours = self.ours(name)
            self._asked[name] = self._brought[name].item if ours is None else ours
        return self._asked[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._every)

    def __len__(self) -> int:
        return len(self._every)

    def distribution(self, name: str) -> Distribution | None:
        """Return the package that brought something; None for our own."""
        return self._brought[name].distribution if name in self._brought else None

    def origin(self, name: str) -> str:
        """Return where something is from, for a list: "; from my-layouts 1.0", or "" for our own."""
        found = self.distribution(name)
        return f"; from {found}" if found else ""

    def only(self, kind: type[S]) -> "Mapping[str, S]":
        """Return those of one class, which are found when they are first asked for."""
        return _Only(self, kind)

    def forget(self) -> None:
        """Look again for what is installed, when it is asked the next time."""
        self._asked.clear()
        for found in ("_brought", "_every"):
            self.__dict__.pop(found, None)


class _Only(Mapping[str, S]):
    """The things of a registry that are of one class."""

    def __init__(self, every: Mapping[str, Any], kind: type[S]) -> None:
        self._every = every
        self._kind = kind

    def __getitem__(self, name: str) -> S:
        item = self._every[name]
        if not isinstance(item, self._kind):
            raise KeyError(name)
        return item

    def __iter__(self) -> Iterator[str]:
        return (name for name, item in self._every.items() if isinstance(item, self._kind))

    def __len__(self) -> int:
        return sum(1 for _ in self)


def _name(item: Any) -> str:
    return item.name


def _distribution(entry: "EntryPoint") -> Distribution:
    assert entry.dist is not None  # entry_points() reads them from distributions
    return Distribution(entry.dist.name, entry.dist.version)


def _brought_by(entry: Loaded, door: Door[T]) -> Iterator[T]:
    package = entry.found
    if not (isinstance(package, ModuleType) and hasattr(package, "__path__")):
        yield _checked(package, entry.where, door)
        return
    for module in pkgutil.iter_modules(package.__path__):
        if module.name.startswith("_"):
            continue
        name = f"{package.__name__}.{module.name}"
        part = f"{entry.where}: the module {name}"
        held = getattr(_loaded(lambda name=name: importlib.import_module(name), part), door.attribute, None)
        if held is None:
            raise NoisyWorldError(
                f"{part} holds no {door.attribute}; begin the names of other modules with an underscore"
            )
        yield _checked(held, part, door)


def _loaded(load: Callable[[], object], where: str) -> object:
    try:
        return load()
    except Exception as error:  # the package's code may raise anything; the user gets one line
        message = " ".join(f"{type(error).__name__}: {error}".split())
        raise NoisyWorldError(f"{where} cannot be loaded: {message}; mend or uninstall the package") from error


def _checked(found: object, where: str, door: Door[T]) -> T:
    if isinstance(found, door.kinds):
        if problem := door.problem(found):
            raise NoisyWorldError(problem, file=where, remedy="mend or uninstall the package")
        return found
    names = [kind.__name__ for kind in door.kinds]
    if any(base.__name__ in names for base in type(found).__mro__):
        raise NoisyWorldError(
            f"{where} was made with another copy of noisy_world; restart, and keep one copy on Python's path"
        )
    if isinstance(found, type) and issubclass(found, door.kinds):
        raise NoisyWorldError(f"{where} is a class; give an object of it: {door.attribute} = {found.__name__}()")
    one = f"one of {', '.join(names)}" if len(names) > 1 else f"a {names[0]}"
    raise NoisyWorldError(f"{where} is a {type(found).__name__}, but has to be {one}, or a package of modules")
