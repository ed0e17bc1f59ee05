# SPDX-License-Identifier: GPL-3.0-or-later
"""The border that names of files pass: to libraries in C, which end the process over other bytes, and into JSON.

Linux lets a file's name be any bytes. Python holds those that are not UTF-8 as halves of surrogate pairs, over which
OpenCV ends the process by a signal, and which neither JSON nor YAML can hold.
"""

import os
from typing import Any, TypeAlias

from .errors import InputError

Name: TypeAlias = str | os.PathLike[str]

NOT_UTF8 = "has a name that is not UTF-8, or lies in a folder that has"
RENAME = "rename it"


def is_utf8(name: Name) -> bool:
    """Tell whether a name, or a path, is text that UTF-8 can hold."""
    try:
        os.fspath(name).encode()
    except UnicodeEncodeError:
        return False
    return True


def utf8_name(path: Name) -> str:
    """Return a path as a library in C, JSON and YAML take it. Raises InputError where its name is not UTF-8."""
    if not is_utf8(path):
        raise InputError(os.fspath(path), NOT_UTF8, remedy=RENAME)
    return os.fspath(path)


def check_utf8_values(value: Any, file: Name, where: str = "") -> None:
    """Look at the texts of a document before it is written as JSON or YAML, or read as if it had been.

    file, where: of the document, and of a value in it. Raises InputError, which names the key.
    """
    match value:
        case str() if not is_utf8(value):
            raise InputError(os.fspath(file), f"{value} {NOT_UTF8}", where=where, remedy=RENAME)
        case dict():
            for name, item in value.items():
                check_utf8_values(item, file, f"{where}.{name}" if where else str(name))
        case list() | tuple():
            for number, item in enumerate(value):
                check_utf8_values(item, file, f"{where}.{number}" if where else str(number))
