# SPDX-License-Identifier: GPL-3.0-or-later
"""Installed packages: those that are needed, the commands that install them, what others bring by entry points."""

import importlib
import importlib.util
import json
import pkgutil
import platform
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from ..other_name import give_other_name
from .errors import MissingDependencyError, NoisyWorldError
from .file_access import read_text

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


NEEDED = {
    "numpy": "numpy",
    "yaml": "pyyaml",
    "cv2": "opencv-contrib-python-headless",
    "OpenEXR": "OpenEXR",
    "deflate": "deflate",
    "simplejpeg": "simplejpeg",
    "tqdm": "tqdm",
}


def missing_packages(modules: Iterable[str] = NEEDED) -> list[str]:
    """Return the packages of the modules that cannot be imported, by the names under which they are installed."""
    return [NEEDED.get(name, name) for name in modules if not _importable(name)]


def _importable(module: str) -> bool:
    if module in sys.modules:
        return sys.modules[module] is not None  # None forbids its import
    return importlib.util.find_spec(module) is not None


def missing_sentence(packages: Iterable[str], where: str, remedy: str) -> str:
    """Return one line: what is missing, for which Python, and what to do about it.

    where: whose Python it is, such as "this Blender's "; may be empty.
    """
    python = f"Python {sys.version_info.major}.{sys.version_info.minor}"
    return f"{', '.join(packages)}: missing in {where or 'this '}{python} on {sys.platform}; {remedy}"


def install_remedy(extension: Path) -> str:
    """Return a sentence on which zip to install instead of the extension in this folder."""
    wheels = sorted(path.name for path in (extension / "wheels").glob("*.whl"))
    if not wheels:
        return "install the zip that 'make extension' builds for this platform: it holds them"
    pythons = sorted({name.split("-")[-3].removeprefix("cp3") for name in wheels if "-cp31" in name})
    known = " and ".join(f"3.{minor}" for minor in pythons)
    return f"install the zip for this platform; the one installed holds {wheels[0].split('-')[-1][:-4]} for {known}"


# Files that come with Noisy World and lie beside its code: in the package, or at the top of a checkout.


PACKAGE = Path(__file__).resolve().parents[1]
"""The folder of the package noisy_world."""


def found_shipped(name: str) -> Path | None:
    """Return a file or folder that may come along, such as docs; None where it does not."""
    places = (folder / name for folder in (PACKAGE, PACKAGE.parents[1]))  # installed, or in a checkout
    return next((place for place in places if place.exists()), None)


def shipped(name: str) -> Path:
    """Return a file or folder that is shipped, such as presets."""
    if (place := found_shipped(name)) is None:
        raise RuntimeError(f"no {name} at {PACKAGE} or above")
    return place


def checkout() -> Path | None:
    """Return the checkout that this package is run from; None where it was installed."""
    top = PACKAGE.parents[1]
    return top if (top / "pyproject.toml").is_file() and (top / "blender_manifest.toml").is_file() else None


def package_version() -> str:
    """Return this package's version from blender_manifest.toml, its only source: in the package or a folder above."""
    if version := _in_manifest("version"):
        return version
    raise RuntimeError(f"no blender_manifest.toml with a version at {PACKAGE} or above")


def project_address() -> str:
    """Return the project's address, `website` in blender_manifest.toml; "" until somebody has published it."""
    return _in_manifest("website")


def _in_manifest(name: str) -> str:
    for folder in (PACKAGE, *PACKAGE.parents[:2]):
        manifest = folder / "blender_manifest.toml"
        if manifest.is_file() and (found := re.search(rf'^{name}\s*=\s*"([^"]+)"', read_text(manifest), re.MULTILINE)):
            return found[1]
    return ""


# The extras of the Python package, and the command that installs one, however the package came here.


DISTRIBUTION = "noisy-world"

_EMBREEX = 'embreex>=4.4; sys_platform != "linux" or platform_machine == "x86_64"'
_NUMBA = 'numba>=0.60; sys_platform != "darwin" or platform_machine != "x86_64" or python_version < "3.14"'
EXTRAS = {
    "blender": ('bpy==5.2.3; python_version == "3.13"',),
    "embree": (_EMBREEX, _NUMBA),
    "cloud": ("fsspec>=2026.2", "pyarrow>=23", "s3fs>=2026.2"),
    "cluster": ("ray>=2.50",),
    "simulate": ("mujoco>=3.3,<4",),
    "ros": ("rosbags>=0.11",),
    "view": ("rerun-sdk>=0.30",),
    "evaluate": (
        _EMBREEX,
        'gtsam>=4.3; sys_platform != "win32"',
        "jinja2>=3.1",
        "matplotlib>=3.9",
        _NUMBA,
        "pandas>=2.2.2",
        "scipy>=1.13",
        "tabulate>=0.9",
    ),
}
"""What each extra brings, as pyproject.toml has it."""

BLENDER_PYTHON = (3, 13)  # which Blender's package has wheels for


def need(modules: Iterable[str], extra: str, *, for_what: str = "", otherwise: str = "") -> None:
    """Raise MissingDependencyError, with the command that installs the extra, where a module cannot be imported.

    Of a module that no package brings to this machine, it says that.

    for_what: what needs them, in front of the line. otherwise: what else can be done, at its end.
    """
    if missing := missing_packages(modules):
        for name in missing:
            if where := unavailable(name):
                sentence = f"{name} has no package for {where}" + (f"; {otherwise}" if otherwise else "")
                raise MissingDependencyError(f"{for_what}: {sentence}" if for_what else sentence)
        remedy = f"run: {install_command(extra)}" + (f", or {otherwise}" if otherwise else "")
        sentence = missing_sentence(missing, "", remedy)
        raise MissingDependencyError(f"{for_what}: {sentence}" if for_what else sentence)


def unavailable(module: str) -> str:
    """Return for which kind of machine, as this one is, no package brings a module; "" where one does, or may."""
    machine = platform.machine()
    if module == "gtsam" and sys.platform == "win32":
        return "Windows"
    if module == "embreex" and sys.platform == "linux" and machine != "x86_64":
        return f"Linux on {machine}"
    if module == "numba" and sys.platform == "darwin" and machine == "x86_64" and sys.version_info >= (3, 14):
        return "macOS on Intel under Python 3.14"
    return ""


def blender_missing(for_what: str = "", *, otherwise: str = "", remedy: str = "") -> str:
    """Return one line on Blender's package where it is missing, what to do about it included; "" where it is there.

    for_what: what needs it, in front of the line. otherwise: what else can be done, at its end. remedy: what to do
    instead of installing the extra.
    """
    missing = missing_packages(["bpy"])
    if not missing:
        return ""
    sentence = missing_sentence(missing, "", (remedy or _blender_remedy()) + (f", or {otherwise}" if otherwise else ""))
    return f"{for_what}: {sentence}" if for_what else sentence


def _blender_remedy() -> str:
    if sys.version_info[:2] == BLENDER_PYTHON:
        return f"run: {install_command('blender')}"
    version = ".".join(map(str, BLENDER_PYTHON))
    command = shlex.join([f"python{version}", "-m", "pip", "install", *(_source("blender") or EXTRAS["blender"])])
    return (
        f"the extra blender, which brings it, is for Python {version} alone: in an environment of that run: {command}"
    )


def install_command(extra: str) -> str:
    """Return the command that installs an extra into this Python.

    It names the checkout, wheel or repository that the package came from. Where that is gone, or the package is an
    extension of Blender, it names the extra's own packages.
    """
    found = _source(extra)
    return pip_command(EXTRAS[extra] if found is None else found)


def pip_command(words: Iterable[str]) -> str:
    """Return the command that installs what pip's words name into this Python."""
    if importlib.util.find_spec("pip") is None:  # an environment that uv has made
        return shlex.join(["uv", "pip", "install", "--python", sys.executable, *words])
    return shlex.join([sys.executable, "-m", "pip", "install", *words])


def _source(extra: str) -> list[str] | None:
    """Return the words that name the extra of where the package came from; None where that is unknown or gone."""
    import importlib.metadata

    if (top := checkout()) is not None:
        return [f"{top}[{extra}]"]
    try:
        record = importlib.metadata.distribution(DISTRIBUTION).read_text("direct_url.json")
    except importlib.metadata.PackageNotFoundError:
        return None
    if record is None:  # it came from an index
        return [f"{DISTRIBUTION}[{extra}]"]
    return _named(json.loads(record), extra)


def _named(record: dict[str, Any], extra: str) -> list[str] | None:
    """Return the words that name the extra of what `direct_url.json` records (PEP 610)."""
    import urllib.parse  # with the next
    import urllib.request

    address = urllib.parse.urlsplit(record["url"])
    if address.scheme == "file":
        path = Path(urllib.request.url2pathname(address.path))
        return [f"{path}[{extra}]"] if path.exists() else None
    kind = f"{record['vcs_info']['vcs']}+" if "vcs_info" in record else ""
    at = f"@{record['vcs_info']['commit_id']}" if kind else ""
    below = f"#subdirectory={record['subdirectory']}" if "subdirectory" in record else ""
    return [f"{DISTRIBUTION}[{extra}] @ {kind}{record['url']}{at}{below}"]


# Which OpenCV is here: packages of several names put theirs into one folder, and pip sees no conflict in that.


OLDEST = 5
"""OpenCV 4 refuses tables of 16 bits, and its warps, blurs and exponentials give other pixels (snow: by 44 of 255)."""


def check_opencv() -> None:
    """Raise MissingDependencyError, with the remedy, where OpenCV is too old; nothing where it is missing."""
    if problem := old_opencv():
        raise MissingDependencyError(problem)


def old_opencv() -> str:
    """Return one line on an OpenCV that is too old, which package brought it and what to do; "" where it is none."""
    version = _version()
    if not version or int(version.partition(".")[0]) >= OLDEST:
        return ""
    needed = NEEDED["cv2"]
    others = _other_packages(needed)
    whose = f", of the package {', '.join(others)}," if others else ""
    python = f"Python {sys.version_info.major}.{sys.version_info.minor}"
    problem = f"OpenCV is {version}{whose} in this {python}, and {OLDEST} is needed, as older ones give other pixels"
    # What is uninstalled takes the folder along, so ours has to be put there again.
    again = pip_command(["--force-reinstall", "--no-deps", f"{needed}>={OLDEST}.0"])
    first = f"uninstall {shlex.join(others)}, then " if others else ""
    return f"{problem}; {first}run: {again}"


def _version() -> str:
    """Return the version of the OpenCV here, "" without one; it is imported only where no file says its version."""
    module = sys.modules.get("cv2")
    if module is None and ("cv2" in sys.modules or importlib.util.find_spec("cv2") is None):
        return ""
    if module is None:
        spec = importlib.util.find_spec("cv2")
        file = Path(spec.origin).with_name("version.py") if spec is not None and spec.origin else None
        text = read_text(file) if file is not None and file.is_file() else ""
        if found := re.search(r'opencv_version = "([\d.]+)"', text):
            return found[1]
        module = importlib.import_module("cv2")  # a system's package has no such file
    found = re.match(r"[\d.]+", str(getattr(module, "__version__", "")))
    return found[0] if found else ""


def _other_packages(needed: str) -> list[str]:
    """Return the installed packages that bring OpenCV, but for the one that is needed."""
    import importlib.metadata

    names = {item.name for item in importlib.metadata.distributions() if item.name.startswith("opencv")}
    return sorted(names - {needed})


# What installed packages bring, found by their entry points, beside our own of the same kind.
#
# An entry point names an object, or a package whose modules each hold one under the door's attribute; modules whose
# names begin with an underscore are left out. Everything that is wrong with a package is one line that names it and its
# entry point.


T = TypeVar("T")
S = TypeVar("S")

LAST = 1000  # the `order` of what says none
OWN_PACKAGE = "noisy_world"  # the name by which installed packages import us; inside Blender our own name is another


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
    root = __name__.removesuffix(".core.packages")
    if root != OWN_PACKAGE:
        give_other_name(OWN_PACKAGE, root)
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


LONGEST_NAME = 100  # of a module here; what a user writes may be longer than any file's name


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
        if (
            len(name) <= LONGEST_NAME
            and name.isidentifier()
            and any((folder / f"{name}.py").is_file() for folder in self._folders)
        ):
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
