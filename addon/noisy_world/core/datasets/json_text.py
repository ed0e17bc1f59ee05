# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading JSON that only this program should have written, and that a disk, a tool or a person may have changed."""

import json
import math
import os
from pathlib import Path
from typing import Any

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
        value = parse_json(path.read_bytes().decode())
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
        value = json.loads(text, parse_constant=_refuse, parse_float=_finite)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    except ValueError as error:
        raise ValueError("is not the JSON that was written") from error
    _check_depth(value)
    return value


def _refuse(name: str) -> float:
    raise ValueError(f"holds {name}")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"holds {text}")
    return number


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(DEEPEST):
        inside = [item.values() if isinstance(item, dict) else item for item in level if isinstance(item, (dict, list))]
        level = [item for items in inside for item in items]
        if not level:
            return
    raise ValueError("is nested too deeply")
