# SPDX-License-Identifier: GPL-3.0-or-later
"""Strict reading of JSON, from users and of our own files, which may have been changed since."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .errors import InputError
from .file_access import read_bytes

DEEPEST = 60  # levels of nesting; what is written here has about ten


def read_json(path: Path) -> Any:
    """Return the content of a file of JSON; links are followed.

    Raises FileNotFoundError, with no such file and no link of that name, and ValueError with the reason, in a few
    words, where the file cannot be read.
    """
    if path.is_dir():
        raise ValueError("is a folder")
    if not path.is_file() and os.path.lexists(path):
        raise ValueError("is a link that leads nowhere" if path.is_symlink() else "is not a file")
    try:
        value = parse_json(read_bytes(path).decode())
        json.dumps(value, ensure_ascii=False).encode()  # half a surrogate pair could not be written again
    except FileNotFoundError:
        raise
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror or error}") from error
    except UnicodeError as error:
        raise ValueError("is not UTF-8") from error
    return value


def parse_json(text: str) -> Any:
    """Return the value of a JSON text. Raises ValueError for what could not be written again: not a number, infinity.

    Neither is a value accepted that is nested more deeply than anything written here.
    """
    try:
        value = _DECODER.decode(text)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    except json.JSONDecodeError as error:
        raise ValueError(f"cannot be read at line {error.lineno}, column {error.colno}") from error
    if text.count("{") + text.count("[") > DEEPEST:  # most have too few to be nested that deeply
        _check_depth(value)
    return value


def parse_json_file(text: str, path: Path, *, where: str = "", remedy: str = "") -> Any:
    """Return the value of a JSON text that a user gave. Raises InputError, which names the file and `where`."""
    try:
        return parse_json(text)
    except ValueError as error:
        raise InputError(path, f"is not valid JSON: it {error}", where=where, remedy=remedy) from error


def finite_number(value: object) -> float | None:
    """Return a JSON value as a float, or None where it is no finite number; true and false are none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def plain_values(value: Any) -> Any:
    """Return a value as JSON holds it: lists for tuples, texts as keys."""
    if isinstance(value, dict):
        return {str(name): plain_values(item) for name, item in value.items()}
    return [plain_values(item) for item in value] if isinstance(value, (list, tuple)) else value


def _refuse(name: str) -> float:
    raise ValueError(f"holds {name}")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"holds {text}")
    return number


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:  # Python converts no more than some thousand digits
        raise ValueError(f"holds a number of {len(text)} digits") from None


_DECODER = json.JSONDecoder(parse_constant=_refuse, parse_float=_finite, parse_int=_whole)
"""Made once: a dataset of thousands of sequences has millions of lines."""


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(DEEPEST):
        inside = [item.values() if isinstance(item, dict) else item for item in level if isinstance(item, (dict, list))]
        level = [item for items in inside for item in items]
        if not level:
            return
    raise ValueError("is nested too deeply")


def canonical(value: Mapping[str, Any]) -> str:
    """Return JSON text that people can read; equal content gives equal text."""
    return json.dumps(value, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n"
