# SPDX-License-Identifier: GPL-3.0-or-later
"""SLAM systems as data: what a definition says, which there are, and where their environments lie."""

import hashlib
import json
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Literal, cast, get_args

from ..core.errors import InputError, NoisyWorldError
from ..core.file_access import read_bytes
from ..core.packages import PACKAGE, Brought, Distribution, add, checkout, loaded_entries
from ..core.schema import Choice, ConfigPath, key, parse, quoted, read_yaml, unknown_name
from ..layouts import LAYOUTS
from ..trajectories.formats import TRAJECTORY_FORMATS
from ..trajectories.pose_files import LARGEST_READ_BYTES
from .estimates import StampsOf

Modality = Literal["colour", "depth"]
AxesOf = Literal["auto", "opencv", "opengl", "robot"]
DirectionOf = Literal["auto", "c2w", "w2c"]
IsolateBy = Literal["none", "bubblewrap"]
UnitOf = Literal["auto", "s", "ms", "us", "ns"]

PLACEHOLDERS = {
    "python": "the Python of the system's environment; without one, the one that this runs in",
    "frames": "a JSON file that names camera, depth scale and the images of each frame",
    "sequence": "the folder of the sequence, in a layout that the system reads, without true poses",
    "out": "the folder that the system writes into, which is its working directory too",
    "programs": "the folder of the programs that come with Noisy World",
    "environment": "the folder of the system's environment",
    "here": "the folder that the definition is in",
    "scene": "in a study, the scene's name",
    "setting": "in a study, the setting's name",
    "seed": "in a study, the seed",
    "repeat": "in a study, which run on the sequence it is, from 1",
}
"""What a command may name in braces, and its meaning."""

STUDY_NAMES = ("scene", "setting", "seed", "repeat")
"""The placeholders that only a study fills in."""

UNDECISIVE = ("about", "remedy", "file", "versions", "limits", "isolate", "reaches", "expects_clean")
"""What of a definition does not decide what a system estimates."""

FORMAT_CHOICES: dict[str, Choice] = {
    "auto": Choice("Auto", "told by content"),
    **{name: Choice(name, known.meaning) for name, known in TRAJECTORY_FORMATS.items()},
}
"""What `writes.format` may be, by name."""

MOVED = {
    "noisy_world.evaluation.odometry": "noisy_world.evaluate.odometry",
    "noisy_world.evaluation.systems.configurations": "noisy_world.evaluate.configurations",
}
"""Programs of ours by the names that older definitions have for them."""

_PLACEHOLDER = re.compile(r"\{(\w*)\}")
_VARIABLE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*=.*", re.DOTALL)
_NAME = re.compile(r"[a-z0-9][a-z0-9_\-]{0,63}")


def _no_name(text: str) -> str:
    return "" if _NAME.fullmatch(text) else f"{quoted(text)} is no name: small letters, digits, _ and -, at most 64"


def _no_variable(text: str) -> str:
    return "" if _VARIABLE.fullmatch(text) else f"{quoted(text)} is no NAME=VALUE"


def _no_word(text: str) -> str:
    for name in _PLACEHOLDER.findall(text):
        if name not in PLACEHOLDERS:
            return f"{{{name}}} is no placeholder; known: {', '.join(f'{{{known}}}' for known in PLACEHOLDERS)}"
    return "" if text else "is empty"


def _no_file(text: str) -> str:
    path = Path(text)
    inside = text and not path.is_absolute() and ".." not in path.parts
    return "" if inside else f"{quoted(text)} is no file inside the folder that the system writes into"


@dataclass(frozen=True)
class Reads:
    """What a system is given."""

    modalities: tuple[Modality, ...] = key("colour, depth or both", default=("colour", "depth"))
    layouts: tuple[str, ...] = key(
        f"layouts of {{sequence}} that it reads, the preferred one first: {', '.join(LAYOUTS)}", default=()
    )

    @property
    def monocular(self) -> bool:
        """Whether it has no depth, so that the scale of what it estimates is its own."""
        return "depth" not in self.modalities


@dataclass(frozen=True)
class Writes:
    """The file with the estimated path, in the folder {out}."""

    file: str = key("the file, or a pattern such as run*/poses.txt that one file matches", pattern=_no_file)
    format: str = key("the file's format", default="auto", choices=FORMAT_CHOICES)
    axes: AxesOf = key("of the camera", default="auto")
    direction: DirectionOf = key("of the poses: c2w, or w2c", default="auto")
    stamps: StampsOf = key(
        "how a pose says its frame: by its time, by the frame's index in place of the time, or by its order",
        default="time",
    )
    stamp_unit: UnitOf = key("of the times", default="auto")
    keyframes: str = key("a file of the same format with the poses of keyframes", default="", pattern=lambda _: "")


@dataclass(frozen=True)
class TimeLimit:
    """Seconds on the wall after which a run is stopped: a part for the start and a part for each frame."""

    start_s: float = key("for the start", unit="s", default=120.0, above=0.0, maximum=1e6)
    frame_s: float = key("for each frame", unit="s", default=10.0, minimum=0.0, maximum=1e6)

    def of(self, frames: int) -> float:
        """Return the limit of a run on so many frames, in seconds."""
        return self.start_s + self.frame_s * frames


@dataclass(frozen=True)
class Limits:
    """What a run may take, and what of it is read: so that no system ends a study."""

    estimate_mb: float = key(
        "of the estimate, and of the keyframes and frames.csv each; of an array, what is read of it",
        unit="MB",
        default=LARGEST_READ_BYTES / 1e6,
        above=0.0,
        maximum=1e5,
    )
    map_mb: float = key("of map.ply", unit="MB", default=512.0, above=0.0, maximum=1e6)
    written_gb: float = key("of all that it writes in {out}", unit="GB", default=50.0, above=0.0, maximum=1e6)
    files: int = key("that it writes in {out}", default=100_000, minimum=1)
    processes: int = key("at once", default=512, minimum=1)
    memory_gb: float | None = key("of all its processes together", unit="GB", default=None, above=0.0, maximum=1e6)

    @property
    def estimate_bytes(self) -> int:
        """`estimate_mb` in bytes."""
        return round(self.estimate_mb * 1e6)

    @property
    def map_bytes(self) -> int:
        """`map_mb` in bytes."""
        return round(self.map_mb * 1e6)

    @property
    def of_guard(self) -> dict[str, int | None]:
        """The limits that `guard.py` watches over, in whole numbers."""
        memory_bytes = None if self.memory_gb is None else round(self.memory_gb * 1e9)
        written_bytes = round(self.written_gb * 1e9)
        return {
            "written_bytes": written_bytes,
            "files": self.files,
            "processes": self.processes,
            "memory_bytes": memory_bytes,
        }


def _length(value_m: float) -> str:
    return f"{value_m:.3g} m" if value_m >= 1.0 else f"{1e3 * value_m:.3g} mm"


@dataclass(frozen=True)
class ExpectedClean:
    """What a system reaches on clean frames where it works as it should; a ratio to a worse error says little."""

    ate_m: float = key("largest ATE RMSE, by protocol strict", unit="m", above=0.0, maximum=1e6)
    scale_off: float | None = key(
        "how far the scale of the path may be from 1; left out where it is the system's own", default=None, above=0.0
    )

    @property
    def text(self) -> str:
        """It, in words."""
        scale = "" if self.scale_off is None else f", scale within {100.0 * self.scale_off:.3g} %"
        return f"ATE at most {_length(self.ate_m)}{scale}"

    def unmet(self, ate_m: float | None, scale: float | None) -> list[str]:
        """Return what of a clean run is not as expected, in words. ate_m, scale: None where it has none."""
        differences = [f"ATE {_length(ate_m)}"] if ate_m is not None and ate_m > self.ate_m else []
        if self.scale_off is not None and scale is not None and abs(scale - 1.0) > self.scale_off:
            differences.append(f"scale {scale:.3f}")
        return differences


@dataclass(frozen=True)
class System:
    """A SLAM system. file: its definition, for messages."""

    name: str = key("its name in results", pattern=_no_name)
    command: tuple[str, ...] = key(
        f"the program and its arguments; {', '.join(f'{{{name}}}' for name in PLACEHOLDERS)} are filled in",
        pattern=_no_word,
    )
    writes: Writes = key("what it writes")
    map_arguments: tuple[str, ...] = key(
        "arguments that follow where a map is asked for, which it then writes as map.ply", default=(), pattern=_no_word
    )
    about: str = key("a sentence on what it is", default="")
    reads: Reads = key("what it is given", default=Reads())
    environment: str = key(
        "a Python environment beside the project: slam is .venv-slam",
        default="",
        pattern=_no_name,
    )
    variables: tuple[str, ...] = key("environment variables, NAME=VALUE", default=(), pattern=_no_variable)
    threads: int | None = key("of numerical libraries, by OMP_NUM_THREADS and its like", default=None, minimum=1)
    time_limit: TimeLimit = key("when a run is stopped", default=TimeLimit())
    limits: Limits = key("what a run may take at most, and what of it is read", default=Limits())
    isolate: IsolateBy = key("whether it is kept apart, so that it reaches its own folder alone", default="none")
    reaches: tuple[str, ...] = key(
        "folders and files that it may read where it is isolated, beside what it is given and {here}", default=()
    )
    gpu: bool = key("whether it needs an NVIDIA GPU", default=False)
    repeatable: bool = key("whether two runs give the same estimate to the byte", default=True)
    versions: tuple[str, ...] = key(
        "a command that prints its versions as a JSON object of texts; it is also how we see that it can run",
        default=(),
        pattern=_no_word,
    )
    remedy: str = key("what to do where it cannot be run", default="")
    expects_clean: ExpectedClean | None = key("what is expected of it on clean frames", default=None)
    file: Path = field(default=Path(), metadata={"key": None})

    @cached_property
    def digest(self) -> str:
        """SHA-256 of what decides results in the definition, as 64 hexadecimal digits.

        Keys that have their defaults are not in it, so that it stays when a release adds one; programs of ours have
        their older names in it, so that studies of before grow.
        """
        usual = asdict(System("", (), Writes("")))
        older = {name: before for before, name in MOVED.items()}
        deciding = {
            name: value for name, value in asdict(self).items() if name not in UNDECISIVE and value != usual[name]
        }
        deciding |= {"command": [older.get(word, word) for word in self.command]} if self.command else {}
        return hashlib.sha256(json.dumps(deciding, sort_keys=True).encode()).hexdigest()


def read_system(path: Path) -> System:
    """Read a definition. Raises InputError, with file and key, for what is wrong in it."""
    try:
        content = read_bytes(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from error
    place = ConfigPath(path)
    document = read_yaml(content, path)
    if isinstance(document, Mapping) and "file" in document:
        raise place.at("file").error("is no key of a system", "the file of the estimate is writes.file")
    system = replace(parse(System, document, place), file=path.resolve())
    _check(system, place)
    return system


def _check(system: System, place: ConfigPath) -> None:
    for index, name in enumerate(system.reads.layouts):
        if name not in LAYOUTS:
            raise (
                place.at("reads")
                .at("layouts")
                .at(index)
                .error(f"{quoted(name)} is no layout", f"known here: {', '.join(LAYOUTS)}")
            )
    if not system.reads.modalities:
        raise place.at("reads").at("modalities").error("is empty", "name colour, depth or both")
    for name in ("command", "map_arguments", "versions"):
        for index, word in enumerate(getattr(system, name)):
            _check_word(system, word, place.at(name).at(index))
    if not system.command:
        raise place.at("command").error("is empty", "name the program and its arguments")
    _check_convention(system.writes, place.at("writes"))
    if system.writes.keyframes and (problem := _no_file(system.writes.keyframes)):
        raise place.at("writes").at("keyframes").error(problem)


def _check_convention(writes: Writes, place: ConfigPath) -> None:
    """Refuse to be told what a format says itself."""
    if writes.format not in TRAJECTORY_FORMATS or not TRAJECTORY_FORMATS[writes.format].one_convention:
        return
    for name, usual in (("axes", "auto"), ("direction", "auto"), ("stamps", "time"), ("stamp_unit", "auto")):
        if getattr(writes, name) != usual:
            raise place.at(name).error(f"is given, but {writes.format} says it itself", "leave it out")


def _check_word(system: System, word: str, place: ConfigPath) -> None:
    named = _PLACEHOLDER.findall(word)
    if "sequence" in named and not system.reads.layouts:
        raise place.error("names {sequence}, but reads.layouts is empty", f"say which of {', '.join(LAYOUTS)} it reads")
    if "environment" in named and not system.environment:
        raise place.error("names {environment}, but there is none", "name one: environment: slam")


def filled(words: tuple[str, ...], values: Mapping[str, str | Path]) -> list[str]:
    """Return a command with its placeholders filled in. Raises KeyError for one that has no value."""
    return [_PLACEHOLDER.sub(lambda named: str(values[named[1]]), MOVED.get(word, word)) for word in words]


# Which systems there are: those that come along or are brought by installed packages, by name; others by file.


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
    definition = _definitions().get(name)
    return None if definition is None else definition.distribution


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
    definitions = {name: Brought(_Definition(name, SHIPPED / f"{name}.yaml"), None) for name in shipped_names()}
    for entry in loaded_entries(GROUP):
        for definition in _brought_by(entry.found, entry.where):
            add(definitions, definition.name, Brought(definition, entry.distribution), "system")
    return definitions


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
    systems: dict[str, System] = {}
    for system in (find_system(name, option) for name in names):
        if systems.setdefault(system.name, system) != system:
            raise InputError(system.file, f"is a second system called {system.name}", where="name", remedy="rename one")
    return list(systems.values())


def isolating(systems: Iterable[System], isolate: str) -> list[System]:
    """Return the systems, kept apart by a program where they are not yet; "none" changes nothing."""
    if isolate == "none":
        return list(systems)
    assert isolate in get_args(IsolateBy), isolate
    return [replace(system, isolate=cast("IsolateBy", isolate)) for system in systems]


# Python environments that systems which need other packages are run in: where they lie.


FOLDER_VARIABLE = "NOISY_WORLD_ENVIRONMENTS"


def environments_folder() -> Path:
    """Return the folder that environments are made in: $NOISY_WORLD_ENVIRONMENTS, the checkout, or the user's data."""
    if beside := os.environ.get(FOLDER_VARIABLE):
        return Path(beside).expanduser().resolve()
    return checkout() or _data_folder()


def environment_folder(name: str) -> Path:
    """Return where an environment lies: slam is .venv-slam in the folder of environments.

    Without $NOISY_WORLD_ENVIRONMENTS, one in the working folder is taken too: an installed package may be used in a
    checkout.
    """
    named = f".venv-{name}"
    folder = environments_folder() / named
    if not os.environ.get(FOLDER_VARIABLE) and not folder.exists() and Path(named).exists():
        return Path(named).resolve()
    return folder


def environment_python(name: str) -> Path:
    """Return the Python of an environment, whether it is there or not."""
    inside = ("Scripts", "python.exe") if sys.platform == "win32" else ("bin", "python")
    return environment_folder(name).joinpath(*inside)


def _data_folder() -> Path:
    """Return the folder of this user's data, as the system has it."""
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "noisy-world"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "noisy-world"
    given = os.environ.get("XDG_DATA_HOME", "")
    # The XDG specification has relative paths ignored.
    root = Path(given) if Path(given).is_absolute() else Path.home() / ".local" / "share"
    return root / "noisy-world"
