# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of an OBJ file before it is imported: its material files and their textures."""

import itertools
import re
from pathlib import Path

from ..errors import InputError
from ..regular_files import open_regular
from .beside import check_no_pipe, is_file, is_inside, leads_out, place_inside
from .text_numbers import check_lines

_ARGUMENTS = {"-mm": 2, "-o": 3, "-s": 3, "-t": 3}  # of options before a texture's name; all others have one
_NUMBER = re.compile(r"[-+]?(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][-+]?[0-9]++)?$")
_MATERIAL = re.compile(rb"^[ \t]*+newmtl[ \t]++([^\n]++)", re.MULTILINE)
_LONGEST_NAME = 255  # bytes that Blender keeps of a material's name
_LIBRARY = re.compile(rb"^[ \t]*+mtllib[ \t]++([^\n]++)", re.MULTILINE)
_FACE = re.compile(rb"^[ \t]*+f[ \t]++\S", re.MULTILINE)
_MAP = re.compile(r"^[ \t]*+(?:map_\w++|bump|norm|disp|decal|refl)[ \t]++([^\n]++)", re.MULTILINE | re.IGNORECASE)


def check_obj(path: Path) -> None:
    """Raise InputError where an OBJ file has no faces, or files of its materials are outside its folder."""
    data = _bytes(path)
    if not _FACE.search(data):
        raise InputError(path, "holds no faces", remedy="export it as a polygon mesh")
    for library in _libraries(path, data):
        for name in _textures(library) if is_file(library) else ():
            for place in _places(library.parent, name):
                check_no_pipe(path, "texture", place)


def check_obj_numbers(path: Path) -> None:
    """Raise InputError where a coordinate or a colour of an OBJ file and its materials is no finite number."""
    data = _bytes(path)
    check_lines(path, data, ((b"v", 3, "coordinate"), (b"vt", 1, "texture coordinate")))
    for library in filter(is_file, _libraries(path, data)):
        check_lines(library, _bytes(library), ((rb"K[de]", 3, "colour"),))


def faces_of_obj(path: Path) -> int:
    """Return how many faces an OBJ file lists."""
    return sum(1 for _ in _FACE.finditer(_bytes(path)))


def files_of_obj(path: Path) -> list[Path]:
    """Return the files of an OBJ file's materials and of their textures, those that are there."""
    found: dict[Path, None] = {}
    for library in filter(is_file, _libraries(path, _bytes(path))):
        found[library] = None
        for name in _textures(library):
            places = [*_places(library.parent, name), path.parent / Path(name.replace("\\", "/")).name]
            there = (place for place in places if is_file(place) and is_inside(path.parent, place))
            found.update(dict.fromkeys(itertools.islice(there, 1)))
    return list(found)


def materials_of_obj(path: Path) -> set[str]:
    """Return the names of the materials that an OBJ file's own files define, as Blender names them."""
    libraries = filter(is_file, _libraries(path, _bytes(path)))
    return {_as_blender(name.strip()) for library in libraries for name in _MATERIAL.findall(_bytes(library))}


def missing_libraries(path: Path) -> list[Path]:
    """Return the files of materials that an OBJ file names and that are not there."""
    return [library for library in _libraries(path, _bytes(path)) if not is_file(library)]


def _as_blender(name: bytes) -> str:
    return name.decode(errors="ignore").encode()[:_LONGEST_NAME].decode(errors="ignore")


def _bytes(path: Path) -> bytes:
    try:
        with open_regular(path) as file:
            return file.read()
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error


def _libraries(path: Path, data: bytes) -> list[Path]:
    """Return the files of materials, which Blender looks for beside the mesh too, under its name."""
    found: dict[Path, None] = {}
    for each in dict.fromkeys(_LIBRARY.findall(data)):
        name = each.strip().decode(errors="surrogateescape").strip('"')
        place = place_inside(path.parent, name)
        if place is None:
            raise leads_out(path, "materials", name)
        check_no_pipe(path, "materials", place)
        found[place] = None
    own = path.with_suffix(".mtl")
    check_no_pipe(path, "materials", own)
    if is_file(own):
        found[own] = None
    return list(found)


def _textures(library: Path) -> list[str]:
    """Return the names of the textures in a file of materials."""
    text = _bytes(library).decode(errors="surrogateescape")
    return [name for line in dict.fromkeys(_MAP.findall(text)) if (name := _texture_name(line.strip(" \t\r")))]


def _texture_name(text: str) -> str:
    """Return a texture's name without the options before it."""
    words, at = text.split(" "), 0
    while at < len(words) - 1 and words[at].startswith("-"):
        most, taken = _ARGUMENTS.get(words[at], 1), 0
        at += 1
        while at < len(words) - 1 and taken < most and (taken == 0 or _NUMBER.match(words[at])):
            at, taken = at + 1, taken + 1
    return " ".join(words[at:]).strip('"')


def _places(folder: Path, name: str) -> list[Path]:
    """Return where Blender looks for a texture: as the name says, or beside its materials."""
    slashes = name.replace("\\", "/")
    return [folder / name, folder / slashes, folder / Path(slashes).name]
