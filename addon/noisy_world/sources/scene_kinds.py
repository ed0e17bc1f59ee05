# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of a preset, and the kinds of source that they come from: each is an object, ours and those of packages.

A preset's scene has one key that is the name of a source, and otherwise the keys of that source alone.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, TypeAlias, TypeVar

from ..core.entry_points import LAST, Distribution
from ..core.errors import InputError, Part, either
from ..core.geometry import Intrinsics
from ..core.schema import ConfigPath, deciding_values
from ..core.trajectory import Trajectory, rounded_path
from ..preset.scene_keys import SceneKeys
from ..render.source import Source

if TYPE_CHECKING:  # presets name what packages bring, which import this
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
