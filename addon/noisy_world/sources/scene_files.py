# SPDX-License-Identifier: GPL-3.0-or-later
"""Sources whose scenes are files or folders, which wildcards may stand for, as a preset's entries name them."""

import glob
from abc import abstractmethod
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import ClassVar

from ..core.home import check_utf8, located, path_in
from ..core.messages import CommandLineOnly
from ..core.planning.scene import FoundScene, K, SceneEntry, SourceKind
from ..core.planning.source import Source
from ..core.presets.preset import Preset
from ..core.schema import ConfigPath, shown
from .wildcards import matched_parts


class FileSource(SourceKind[K]):
    """A source whose key names a file or a folder, or several by wildcards.

    folder: whether it is a folder. several: the word for more than one.
    """

    folder: ClassVar[bool] = False
    several: ClassVar[str]

    @abstractmethod
    def open_file(self, entry: SceneEntry[K], name: str, path: Path, parts: tuple[str, ...]) -> Source:
        """Return the source of a scene. parts: what wildcards matched. Raises InputError."""

    def scenes(self, entry: SceneEntry[K]) -> Iterable[FoundScene]:
        """Return a scene for each file that there is."""
        preset, place, own_name = entry.preset, entry.source_place, entry.keys.name
        pattern: str = getattr(entry.keys, self.name)
        if not glob.has_magic(pattern) or path_in(preset.folder, pattern, place).exists():
            name = own_name or path_in(preset.folder, pattern, place).stem
            return [FoundScene(entry, name, partial(self._open_named, entry, name, pattern))]
        folder, pattern = located(preset.folder, pattern, place)
        found = sorted(glob.glob(pattern, root_dir=folder))  # noqa: PTH207 - takes absolute patterns too
        if self.folder:  # files lie beside sequences: cam_params.json, manifest.json, overview.png
            found = [text for text in found if not (folder / text).is_file()]
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
        path = found_path(entry.preset, entry.source_place, text, folder=self.folder)
        return self.open_file(entry, name, path, ())


def check_one_name(entry: SceneEntry[K], count: int, what: str) -> None:
    """Refuse one name for several scenes. what: the word for several."""
    name = entry.keys.name
    if name and "*" not in name and count > 1:
        raise entry.place.at("name").error(f"is {name!r}, but {count} {what} match", "put a * where they differ")


def named(entry: SceneEntry[K], parts: tuple[str, ...]) -> str:
    """Return the name that an entry gives a scene, "" where it gives none. parts: what wildcards matched."""
    return filled(entry.keys.name, parts, entry.place.at("name")) if entry.keys.name else ""


def found_path(preset: Preset, place: ConfigPath, text: str, *, folder: bool | None = False) -> Path:
    """Return the path of a file or a folder that exists; folder: None where it may be either. Raises InputError."""
    path = path_in(preset.folder, text, place)
    kind = "folder" if folder else "file"
    try:
        there = path.is_dir() if folder else path.is_file() or (folder is None and path.is_dir())
    except OSError as error:  # a name that is too long, for instance
        raise place.error(f"{shown(text)} cannot be a {kind}: {error.strerror}") from error
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
