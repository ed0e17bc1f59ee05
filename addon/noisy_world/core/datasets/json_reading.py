# SPDX-License-Identifier: GPL-3.0-or-later
"""JSON that a user gave, read strictly: an error in one line for all that is no JSON, NaN and infinities included."""

import math
from pathlib import Path
from typing import Any

from ..errors import InputError
from .json_text import parse_json


def given_json(text: str, path: Path, *, where: str = "", remedy: str = "") -> Any:
    """Return the value of a JSON text that a user gave. Raises InputError, which names the file and `where`."""
    try:
        return parse_json(text)
    except ValueError as error:
        problem = str(error) if "nested" in str(error) else "is not valid JSON"
        raise InputError(path, problem, where=where, remedy=remedy) from error


def finite_number(value: object) -> float | None:
    """Return a JSON value as a float, or None where it is no finite number; true and false are none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
