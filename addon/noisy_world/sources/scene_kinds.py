# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of a preset, the files that they name, and the kinds of source that they come from.

Scenes of a preset, and the kinds of source that they come from: each is an object, ours and those of packages.

A preset's scene has one key that is the name of a source, and otherwise the keys of that source alone.
"""

import glob
import hashlib
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from fnmatch import fnmatchcase
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, TypeAlias, TypeVar

import numpy as np

from ..core.atomic_files import sha256_of_file
from ..core.errors import CommandLineOnly, InputError, Message, Part, either
from ..core.file_access import check_utf8, located, path_in
from ..core.geometry import Intrinsics
from ..core.packages import LAST, Distribution
from ..core.schema import ConfigPath, deciding_values, quoted
from ..core.trajectory import MOST_POSES, Trajectory, resample, rounded_path, subsample
from ..preset.keys import Preset
from ..preset.scene_keys import SceneKeys, TrajectorySpec
from ..render.source import Source
from ..trajectories.formats import read_trajectory_file
from ..trajectories.matrix_poses import numbered_files

if TYPE_CHECKING:
    from ..preset.keys import Preset


K = TypeVar("K", bound=SceneKeys)

Lack: TypeAlias = Literal["depth", "poses", "registration", "pinhole"]
"""What a scene may lack that a layout or a setting asks for."""

ALWAYS_RECORDED = ("name", "mesh", "replica", "sequence", "trajectory", "rate_hz")
"""Keys that a dataset tells of each scene, be they its own or not, as datasets of version 0.1.0 do."""


@dataclass(frozen=True)
class SceneEntry(Generic[K]):
    """An entry of a preset's scenes, checked. distribution: the package that brings its source; None for our own."""

    preset: "Preset"
    place: ConfigPath
    kind: "SourceKind[K]"
    keys: K
    distribution: Distribution | None = None

    @property
    def source_place(self) -> ConfigPath:
        """The place of the key that names the source; messages about it name this key."""
        return self.place.at(self.kind.name)

    def recorded_keys(self) -> dict[str, Any]:
        """Return the keys as a dataset tells them for people: without what is not given."""
        given, defaults = self.kind.recorded(self.keys), {item.name: item.default for item in fields(self.keys)}
        recorded = {
            name: value for name, value in given.items() if name in self.kind.always_recorded or value != defaults[name]
        }
        return {**dict.fromkeys(ALWAYS_RECORDED), **recorded}

    def deciding(self) -> dict[str, Any]:
        """Return by key the values that decide bytes as they are."""
        return deciding_values(self.keys)


@dataclass(frozen=True)
class FoundScene:
    """A scene that an entry stands for. source: checks its files and returns its source; raises InputError.

    found: what was found of it already, for `check_found`.
    """

    entry: SceneEntry[Any]
    name: str
    source: Callable[[], Source]
    found: Any = None


class SourceKind(ABC, Generic[K]):
    """A kind of source: where clean frames may come from. A preset's scene that has a key of this name is of it.

    name: that key. order: in lists, ours first. label, meaning: for people. keys: a frozen dataclass from SceneKeys,
    with the keys that such a scene may have; the one of this name is among them. A package's source has no other: what
    belongs to it is inside that.

    always_recorded: keys that a dataset's identity states of a scene for people even where they are the default.
    remedies: what in a scene's keys mends that it lacks something. instead: of keys that belong to other sources, what
    to do here.
    """

    name: ClassVar[str]
    order: ClassVar[int] = LAST
    label: ClassVar[str]
    meaning: ClassVar[str]
    keys: ClassVar[type[SceneKeys]]
    always_recorded: ClassVar[tuple[str, ...]] = ()
    remedies: ClassVar[Mapping[Lack, Part]] = {}
    instead: ClassVar[Mapping[str, Part]] = {}

    def check(self, keys: K, place: ConfigPath) -> None:
        """Check what involves several keys of a scene. Raises InputError."""

    def recorded(self, keys: K) -> dict[str, Any]:
        """Return the keys of a scene as plain values, for people."""
        return asdict(keys)

    def path_key(self, keys: K) -> str:
        """Return the key of a scene that says its path."""
        return "trajectory" if getattr(keys, "trajectory", None) is not None else self.name

    @abstractmethod
    def scenes(self, entry: SceneEntry[K]) -> Iterable[FoundScene]:
        """Return the scenes that an entry stands for. Opens none of them. Raises InputError."""

    def check_found(self, chosen: Sequence[FoundScene]) -> None:
        """Check the scenes of this kind that are wanted, all at once, before any is opened. Raises InputError."""


class SingleSceneKind(SourceKind[K]):
    """A kind of source whose entries stand for one scene each: they have no wildcards."""

    def scenes(self, entry: SceneEntry[K]) -> Iterable[FoundScene]:
        """Return the scene; it is not opened yet."""
        return [FoundScene(entry, entry.keys.name or self.name, partial(self.open, entry))]

    @abstractmethod
    def open(self, entry: SceneEntry[K]) -> Source:
        """Return the source of an entry. Raises InputError for files missing or wrong."""


@dataclass(frozen=True)
class Scene:
    """A scene of a preset: its name in the dataset, its place in the preset, and its source.

    entry: what the preset says of it; None for one that comes from a store.
    """

    name: str
    place: ConfigPath
    source: Source
    entry: SceneEntry[Any] | None = None

    @cached_property
    def path(self) -> Trajectory:
        """The source's path, rounded to what is meaningful, so that it is the same everywhere. Raises InputError."""
        return rounded_path(self.source.trajectory())

    def camera(self, preset: "Preset") -> Intrinsics:
        """Return the intrinsics of its colour images. Raises InputError."""
        spec = preset.spec
        own = self.source.camera(None if spec.camera is None else spec.camera.intrinsics)
        return own or spec.mesh_camera.intrinsics

    @property
    def frame_count(self) -> int:
        """How many frames its path has."""
        return len(self.source.stamps_s)

    @property
    def source_place(self) -> ConfigPath:
        """The place of the key that names the source."""
        return self.place if self.entry is None else self.entry.source_place

    @property
    def path_place(self) -> ConfigPath:
        """The place of the key that says the path."""
        return self.place if self.entry is None else self.place.at(self.entry.kind.path_key(self.entry.keys))

    def error(self, problem: str, *remedies: Part, lacks: Lack | None = None) -> InputError:
        """Return an error that names the source's key. lacks: what the source may know a remedy for."""
        own = "" if lacks is None or self.entry is None else self.entry.kind.remedies.get(lacks, "")
        return self.source_place.error(problem, either(own, *remedies))


# Scenes that are files or folders, as a preset names them, and the files of their paths.


# What the wildcards of a glob pattern matched.


_PIECE = re.compile(r"\*+|\[!?+\]?+[^\]]*\]|.", re.DOTALL)  # stars, a set of letters in brackets, or one letter

_PLAIN = re.compile(r"\*+|.", re.DOTALL)


def matched_parts(pattern: str, path: str) -> tuple[str, ...]:
    """Return what each wildcard of a glob pattern matched in a path that it matches; the stem where ** is in it."""
    found: list[str] = []
    of_pattern, of_path = Path(pattern).parts, Path(path).parts
    for names in zip(of_pattern, of_path, strict=False):
        parts = _parts_of_name(*names)
        if parts is None or len(of_pattern) != len(of_path):
            return (Path(path).stem,)
        found += parts
    return tuple(found)


def _parts_of_name(pattern: str, name: str) -> list[str] | None:
    """Return what each wildcard matched in a name, the first ones as little as they can; None if it does not match.

    Only the latest star is ever tried again, one letter longer, so the time is at most pattern times name.
    """
    sets_end = pattern.rfind("]") + 1  # behind it, every [ is a letter, and need not look for its end
    pieces = _PIECE.findall(pattern[:sets_end]) + _PLAIN.findall(pattern[sets_end:])
    taken: list[int] = []  # how many letters each piece has matched so far
    star = -1
    while True:
        at, piece = sum(taken), len(taken)
        if piece == len(pieces) and at == len(name):
            return [
                name[sum(taken[:number]) :][: taken[number]]
                for number, each in enumerate(pieces)
                if each[0] in "*?" or len(each) > 1
            ]
        if piece < len(pieces) and pieces[piece].startswith("*"):
            star = piece
            taken.append(0)
        elif piece < len(pieces) and at < len(name) and fnmatchcase(name[at], pieces[piece]):
            taken.append(1)
        elif star < 0 or sum(taken[: star + 1]) >= len(name):
            return None
        else:
            taken[star:] = [taken[star] + 1]


class FileSource(SourceKind[K]):
    """A source whose key names a file or a folder, or several by wildcards.

    folder: whether it is a folder. several: the word for more than one.
    """

    folder: ClassVar[bool] = False
    several: ClassVar[str]

    @abstractmethod
    def open_file(self, entry: SceneEntry[K], name: str, path: Path, parts: tuple[str, ...]) -> Source:
        """Return the source of a scene. parts: what wildcards matched. Raises InputError."""

    def named_file(self, keys: K) -> str:
        """Return the file or folder that a scene names, or a pattern of several."""
        return getattr(keys, self.name)

    def takes_file(self, keys: K, name: str) -> bool:
        """Tell whether a name may be that of a file, where the key names folders."""
        del keys, name
        return False

    def scenes(self, entry: SceneEntry[K]) -> Iterable[FoundScene]:
        """Return a scene for each file that there is."""
        preset, place, own_name = entry.preset, entry.source_place, entry.keys.name
        pattern = self.named_file(entry.keys)
        if not glob.has_magic(pattern) or path_in(preset.folder, pattern, place).exists():
            name = own_name or path_in(preset.folder, pattern, place).stem
            return [FoundScene(entry, name, partial(self._open_named, entry, name, pattern))]
        folder, pattern = located(preset.folder, pattern, place)
        found = sorted(glob.glob(pattern, root_dir=folder))  # noqa: PTH207 - takes absolute patterns too
        if self.folder:  # files lie beside sequences: cam_params.json, manifest.json, overview.png
            found = [text for text in found if not (folder / text).is_file() or self.takes_file(entry.keys, text)]
        if not found:
            beside = "beside the preset" if preset.spec.data is None else f"in {preset.folder}"
            raise place.error(f"no {'folder' if self.folder else 'file'} matches {pattern!r} {beside}")
        check_one_name(entry, len(found), self.several)
        scenes = []
        for text in found:
            check_utf8(folder / text, place)
            parts = matched_parts(pattern, text)
            name = named(entry, parts) or "_".join(parts)
            scenes.append(FoundScene(entry, name, partial(self.open_file, entry, name, folder / text, parts)))
        return scenes

    def _open_named(self, entry: SceneEntry[K], name: str, text: str) -> Source:
        folder = None if self.folder and self.takes_file(entry.keys, text) else self.folder
        path = located_path(entry.preset, entry.source_place, text, folder=folder)
        return self.open_file(entry, name, path, ())


def check_one_name(entry: SceneEntry[K], count: int, what: str) -> None:
    """Refuse one name for several scenes. what: the word for several."""
    name = entry.keys.name
    if name and "*" not in name and count > 1:
        raise entry.place.at("name").error(f"is {name!r}, but {count} {what} match", "put a * where they differ")


def named(entry: SceneEntry[K], parts: tuple[str, ...]) -> str:
    """Return the name that an entry gives a scene, "" where it gives none. parts: what wildcards matched."""
    return filled(entry.keys.name, parts, entry.place.at("name")) if entry.keys.name else ""


def located_path(preset: Preset, place: ConfigPath, text: str, *, folder: bool | None = False) -> Path:
    """Return the path of a file or a folder that exists; folder: None where it may be either. Raises InputError."""
    path = path_in(preset.folder, text, place)
    kind = "folder" if folder else "file"
    try:
        there = path.is_dir() if folder else path.is_file() or (folder is None and path.is_dir())
    except OSError as error:  # a name that is too long, for instance
        raise place.error(f"{quoted(text)} cannot be a {kind}: {error.strerror}") from error
    if not there:
        relative_to = "the preset" if preset.spec.data is None else f"data, {preset.folder}"
        raise place.error(f"no such {kind}: {path}", CommandLineOnly(f"paths are relative to {relative_to}"))
    return path


def filled(template: str, parts: tuple[str, ...], place: ConfigPath) -> str:
    """Replace each wildcard of a text by what those of the scene's file matched, in order. Raises InputError."""
    if template.count("*") > len(parts):
        raise place.error(f"{template!r} has more * than mesh has wildcards")
    for part in parts:
        template = template.replace("*", part, 1)
    return template


# The path of a scene from a file of poses, as a preset's `trajectory` names it.


def path_file_of(preset: Preset, place: ConfigPath, spec: TrajectorySpec, parts: tuple[str, ...]) -> Path:
    """Return the file of poses that a trajectory names. parts: what the entry's wildcards matched."""
    text = spec.file or ""
    return located_path(preset, place, filled(text, parts, place) if "*" in text else text, folder=None)


def read_path(
    path: Path, spec: TrajectorySpec, place: ConfigPath, camera: Intrinsics
) -> tuple[Trajectory, TrajectorySpec]:
    """Read and select the poses of a file; return also the keys with the conventions that it was read with.

    camera: the preset's; a file that states another gets a note. Raises InputError.
    """
    found = read_trajectory_file(
        path, format=spec.format, direction=spec.pose, axes=spec.axes, rate_hz=spec.rate_hz, stamp_unit=spec.stamp_unit
    )
    chosen = selected_poses(found.trajectory, spec, place)
    difference = "" if found.camera is None else found.camera.difference(camera)
    notes = [Message(f"{path.name}: ", note) for note in (*chosen.notes, difference) if note]
    return replace(chosen, notes=tuple(notes)), replace(spec, pose=found.direction, axes=found.axes)


def selected_poses(trajectory: Trajectory, spec: TrajectorySpec, place: ConfigPath) -> Trajectory:
    """Resample and subsample a trajectory as the preset says. Raises InputError where no pose is left, or too many."""
    if spec.resample_hz is not None:
        try:
            trajectory = resample(trajectory, spec.resample_hz)
        except ValueError as error:
            span_s = float(np.ptp(trajectory.stamps_s))
            remedy = f"at most {0.99 * MOST_POSES / span_s:.2g} Hz, or mend the stamps"
            raise place.at("resample_hz").error(str(error), remedy) from error
    try:
        return subsample(trajectory, spec.start, spec.stop, spec.every)
    except ValueError as error:
        raise place.error(str(error)) from error


def sha256_of_path(path: Path) -> str | None:
    """Return the hash of a file of poses; of a folder's files, that of their names and hashes."""
    if path.is_file():
        return sha256_of_file(path)
    texts = any(path.glob("*.txt"))  # else others, such as a JSON for each image
    files = numbered_files(path) if texts else sorted(file for file in path.iterdir() if file.is_file())
    listed = "".join(f"{sha256_of_file(file)} {file.name}\n" for file in files)
    return hashlib.sha256(listed.encode(errors="surrogateescape")).hexdigest()


# --- the camera of footage that nothing says one of ---

# Of the larger side: what COLMAP begins with (ImageReaderOptions::default_focal_length_factor).
FOCAL_LENGTH_FACTOR = 1.2
GUESSED = (
    "nothing says its camera: a guess is written, with a focal length of 1.2 times the larger side; camera says another"
)


def camera_or_guess(asked: Intrinsics | None, size_px: tuple[int, int], place: ConfigPath, what: str) -> Intrinsics:
    """Return the intrinsics asked for or, where none are, a guess.

    place: the key of the source. what: the word for its images. Raises InputError where another size is asked for.
    """
    wide, high = size_px
    if asked is None:
        focal_px = FOCAL_LENGTH_FACTOR * max(wide, high)
        return Intrinsics(wide, high, focal_px, focal_px, (wide - 1) / 2, (high - 1) / 2)
    if (asked.width_px, asked.height_px) != size_px:
        problem = f"its {what} are {wide} x {high}, but the preset's camera has {asked.width_px} x {asked.height_px}"
        raise place.error(problem, "set camera to that, or leave it out")
    return asked
