# SPDX-License-Identifier: GPL-3.0-or-later
"""What the wildcards of a glob pattern matched."""

import re
from fnmatch import fnmatchcase
from pathlib import Path

_PIECE = re.compile(r"\*+|\[!?+\]?+[^\]]*\]|.", re.DOTALL)  # stars, a set of letters in brackets, or one letter

_PLAIN = re.compile(r"\*+|.", re.DOTALL)


def matched_parts(pattern: str, path: str) -> tuple[str, ...]:
    """Return what each wildcard of a glob pattern matched in a path that it matches; the stem where ** is in it."""
    found: list[str] = []
    of_pattern, of_path = Path(pattern).parts, Path(path).parts
    for names in zip(of_pattern, of_path, strict=False):
        parts = _parts_of_name(*names)
        if parts is None or len(of_pattern) != len(of_path):
            return (Path(path).stem,)
        found += parts
    return tuple(found)


def _parts_of_name(pattern: str, name: str) -> list[str] | None:
    """Return what each wildcard matched in a name, the first ones as little as they can; None if it does not match.

    Only the latest star is ever tried again, one letter longer, so the time is at most pattern times name.
    """
    sets_end = pattern.rfind("]") + 1  # behind it, every [ is a letter, and need not look for its end
    pieces = _PIECE.findall(pattern[:sets_end]) + _PLAIN.findall(pattern[sets_end:])
    taken: list[int] = []  # how many letters each piece has matched so far
    star = -1
    while True:
        at, piece = sum(taken), len(taken)
        if piece == len(pieces) and at == len(name):
            return [
                name[sum(taken[:number]) :][: taken[number]]
                for number, each in enumerate(pieces)
                if each[0] in "*?" or len(each) > 1
            ]
        if piece < len(pieces) and pieces[piece].startswith("*"):
            star = piece
            taken.append(0)
        elif piece < len(pieces) and at < len(name) and fnmatchcase(name[at], pieces[piece]):
            taken.append(1)
        elif star < 0 or sum(taken[: star + 1]) >= len(name):
            return None
        else:
            taken[star:] = [taken[star] + 1]
