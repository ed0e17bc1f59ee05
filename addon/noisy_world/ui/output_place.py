# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of the panel's files and of its dataset."""

from pathlib import Path
from typing import Any

import bpy

from ..core.errors import InputError
from ..core.home import with_home
from ..core.utf8_names import NOT_UTF8, RENAME, is_utf8


def output_folder(panel: Any) -> Path:
    """Return the dataset's folder. Raises InputError where the panel names none."""
    return folder_of(panel.output_folder, "Output")


def folder_of(named: str, field: str) -> Path:
    """Return a folder that a field names. Raises InputError where it names none, or one whose name is not UTF-8."""
    text = named.strip()
    if not text:
        raise InputError(field, "no folder is named", remedy="choose one")
    if text.startswith("//") and not bpy.data.filepath:
        raise InputError(field, f"{text} is beside this file, which has no place yet", remedy="save it")
    try:
        folder = Path(bpy.path.abspath(str(with_home(text)) if text.startswith("~") else text)).resolve()
    except LookupError as error:
        raise InputError(field, str(error)) from error
    if not is_utf8(folder):
        raise InputError(field, f"{folder} {NOT_UTF8}", remedy=RENAME)
    return folder


def absolute(path: str) -> str:
    """Return a path of the panel as an absolute one, with forward slashes; "" stays "".

    ~ and ~user are home folders; the name of a user who is not there stays, and is refused when the file is read.
    """
    if path.startswith("~"):
        try:
            path = str(with_home(path))
        except LookupError:
            return path
    return Path(bpy.path.abspath(path)).resolve().as_posix() if path else ""
