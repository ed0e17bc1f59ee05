# SPDX-License-Identifier: GPL-3.0-or-later
"""What an OBJ file says of itself before it is imported: its materials' files, and the textures that these name."""

import re
from pathlib import Path

from ..errors import InputError
from ..regular_files import read_bytes
from .ply_file import DAMAGED

_ARGUMENTS = {"-mm": 2, "-o": 3, "-s": 3, "-t": 3}  # of options before a texture's name; all others have one
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")
_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_FACE = re.compile(rb"^[ \t]*f[ \t]+\S", re.MULTILINE)
_NOT_FINITE = re.compile(rb"^[ \t]*v[ \t][^\n]*(nan|inf)", re.MULTILINE | re.IGNORECASE)
_MAP = re.compile(r"^[ \t]*map_K[ade][ \t]+(.+?)[ \t\r]*$", re.MULTILINE)


def check_obj(path: Path) -> None:
    """Raise InputError where an OBJ file has no faces, or the file of its materials is missing."""
    data = _bytes(path)
    if not _FACE.search(data):
        raise InputError(path, "holds no faces", remedy="export it as a polygon mesh")
    if _NOT_FINITE.search(data):
        raise InputError(path, "a coordinate is NaN or infinite", remedy=DAMAGED)
    for library in _libraries(path, data):
        if not library.is_file():
            problem = f"its materials {library.name[:200]!r} are missing in {library.parent}"
            raise InputError(path, problem, remedy="put the file there, or take the line mtllib out")


def files_of_obj(path: Path) -> list[Path]:
    """Return the files of an OBJ file's materials and of their textures, those that are there."""
    found: dict[Path, None] = {}
    for library in _libraries(path, _bytes(path)):
        if not library.is_file():
            continue
        found[library] = None
        for text in _MAP.findall(_bytes(library).decode(errors="surrogateescape")):
            found.update(dict.fromkeys(_places(library.parent, _texture_name(text))))
    return list(found)


def _bytes(path: Path) -> bytes:
    try:
        return read_bytes(path, largest_bytes=None)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error


def _libraries(path: Path, data: bytes) -> list[Path]:
    names = [name.decode(errors="surrogateescape").strip('"') for name in _LIBRARY.findall(data)]
    return [path.parent / name for name in dict.fromkeys(names)]


def _texture_name(text: str) -> str:
    """Return a texture's name without the options before it."""
    words = text.split(" ")
    while len(words) > 1 and words[0].startswith("-"):
        option, words = words[0], words[1:]
        taken = 0
        most = _ARGUMENTS.get(option, 1)
        while len(words) > 1 and taken < most and (taken == 0 or _NUMBER.match(words[0])):
            words, taken = words[1:], taken + 1
    return " ".join(words).strip('"')


def _places(folder: Path, name: str) -> list[Path]:
    """Return where Blender finds a texture: as the name says, or beside its materials."""
    tried = [folder / name, folder / name.replace("\\", "/"), folder / Path(name.replace("\\", "/")).name]
    return [next(place for place in tried if place.is_file())] if any(place.is_file() for place in tried) else []
