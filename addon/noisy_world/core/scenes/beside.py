# SPDX-License-Identifier: GPL-3.0-or-later
"""Resolves file names inside a mesh file, which may lead only into the mesh's folder or below it."""

import os
import posixpath
import re
from pathlib import Path

from ..errors import InputError
from ..regular_files import check_regular

_SOMEWHERE_ELSE = re.compile(r"/|[A-Za-z]:|file:|[^/:]++://", re.IGNORECASE)  # absolute, of a drive, or an address


def place_inside(folder: Path, name: str, within: str = "") -> Path | None:
    """Return where a name in a mesh leads; None where that is not inside the mesh's folder.

    name: as it is written, a \\ for a / too, but without percent signs for letters. within: the folder of the file
    that gives the name, relative to the mesh's.
    """
    text = name.replace("\\", "/")
    inside = posixpath.normpath(posixpath.join(within, text))
    if _SOMEWHERE_ELSE.match(text) or inside == ".." or inside.startswith("../"):
        return None
    return folder / inside


def is_inside(folder: Path, file: Path) -> bool:
    """Tell whether a file's path leads into a folder, whatever the links on its way."""
    return _plain(file).is_relative_to(_plain(folder))


def is_file(path: Path) -> bool:
    """Tell whether there is such a file, and not a pipe or a device; names that no file can have are none."""
    return os.path.isfile(path)  # noqa: PTH113 - for a name that no file can have, Path.is_file raises


def check_no_pipe(mesh_path: Path, what: str, place: Path) -> None:
    """Raise InputError where a name of a mesh leads to a pipe or a device, which its importer would wait for."""
    try:
        there = os.path.exists(place) and not os.path.isdir(place)  # noqa: PTH110, PTH112 - as for is_file
        if there:
            check_regular(place)
    except OSError as error:
        raise InputError(mesh_path, f"its {what} {place.name[:200]!r}: {error.strerror or error}") from error


def leads_out(mesh_path: Path, what: str, name: str) -> InputError:
    """Return the error of a name that leads out of the mesh's folder. what: a buffer, for instance."""
    problem = f"its {what} {name[:200]!r} leads out of the mesh's folder"
    return InputError(mesh_path, problem, remedy="put it beside the mesh, and name it so")


def link_notes(mesh_path: Path, files: list[Path]) -> list[str]:
    """Return a note for the files in a mesh's folder that are links to files outside it, or lie behind such a link."""
    home = Path(os.path.realpath(mesh_path.parent))
    found = [(file, Path(os.path.realpath(file))) for file in files if is_inside(mesh_path.parent, file)]
    away = [(file, target) for file, target in found if not target.is_relative_to(home)]
    if not away:
        return []
    file, target = away[0]
    more = f", and {len(away) - 1} more of its files are such links" if len(away) > 1 else ""
    return [f"its file {file.name[:200]!r} is a link out of the mesh's folder, to {str(target)[:300]!r}{more}"]


def _plain(path: Path) -> Path:
    return Path(os.path.normpath(os.path.abspath(path)))  # noqa: PTH100 - Path keeps '..'
