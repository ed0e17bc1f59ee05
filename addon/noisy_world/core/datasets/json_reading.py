# SPDX-License-Identifier: GPL-3.0-or-later
"""JSON that a user gave, read strictly: an error in one line for all that is no JSON, NaN and infinities included."""

import json
import math
from pathlib import Path
from typing import Any

from ..errors import InputError


def parse_json(text: str, path: Path, *, where: str = "", remedy: str = "") -> Any:
    """Return the value of a JSON text. Raises InputError, which names the file and `where`."""
    try:
        return json.loads(text, parse_constant=_refuse)
    except ValueError as error:  # a number of thousands of digits is one too
        raise InputError(path, "is not valid JSON", where=where, remedy=remedy) from error
    except RecursionError as error:
        raise InputError(path, "is nested too deeply", where=where, remedy=remedy) from error


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


def finite_number(value: object) -> float | None:
    """Return a JSON value as a float, or None where it is no finite number; true and false are none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
