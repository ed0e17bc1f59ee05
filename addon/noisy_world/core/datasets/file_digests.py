# SPDX-License-Identifier: GPL-3.0-or-later
"""The SHA-256 of each file of a recording that this program wrote, as its frames.jsonl tells them."""

import os
import re
from pathlib import Path

from ..errors import InputError
from ..regular_files import read_text
from .json_text import parse_given_json
from .records import FRAMES

_DIGEST = re.compile("[0-9a-f]{64}")
_REMEDY = "mend or remove it"


def read_digests(folder: Path) -> dict[str, str]:
    """Return by name in a sequence the SHA-256 of its files; none where no frames.jsonl tells them.

    Raises InputError where it cannot be read, or tells what is no SHA-256.
    """
    path = folder / FRAMES
    if not os.path.lexists(path):
        return {}
    try:
        lines = read_text(path, encoding="utf-8-sig").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read: {error}") from error
    found: dict[str, str] = {}
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        where = f"line {number}"
        record = parse_given_json(line, path, where=where, remedy=_REMEDY)
        digests = record.get("sha256", {}) if isinstance(record, dict) else None
        if not isinstance(digests, dict) or not all(map(_is_digest, digests.values())):
            raise InputError(path, "tells no SHA-256 by the files' names", where=where, remedy=_REMEDY)
        found |= digests
    return found


def _is_digest(value: object) -> bool:
    return isinstance(value, str) and _DIGEST.fullmatch(value) is not None
