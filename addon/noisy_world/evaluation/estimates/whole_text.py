# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a text of poses is whole: one that was cut inside its last number still reads as numbers, but false ones."""

import math
from pathlib import Path

from ...core.errors import InputError
from ...core.schema import shown

REMEDY = "write it again or, if it is whole, end its last line with a line break"
FEWEST = 3  # chosen: lines from which on equally many digits are no chance
_HOMOGENEOUS = (4, 16)  # numbers of a line that ends a 4 x 4 matrix, so that the last is a 1


def check_whole(path: Path, text: str) -> None:
    """Raise InputError, with file and line, for a text without an end of its last line that may be cut.

    A writer ends each line, and a file that is cut does not end so. Without that end the last number is known to be
    whole where it has as many characters after the point as in every line before it, three at least, where a blank or
    comma follows it, and where it is the 1 of a 4 x 4 matrix. All else is refused: nothing in it tells 0.7 from the
    beginning of 0.70710678. JSON is left to its own reader.
    """
    if not text or text[-1] in "\n\r, \t" or text.lstrip()[:1] in ("{", "["):
        return
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    last = _words(lines[-1])
    if not last or "#" in lines[-1]:
        return
    before = [(number, words) for number, line in enumerate(lines[:-1], 1) if _is_number((words := _words(line))[-1:])]
    where = f"line {len(lines)}"
    if before and len(before[-1][1]) != len(last):
        number, words = before[-1]
        problem = f"the file ends in the middle of a line: {len(last)} numbers, but line {number} has {len(words)}"
        raise InputError(path, problem, where=where, remedy=REMEDY)
    if not _is_number(last[-1:]) or not math.isfinite(float(last[-1])):
        return  # which the reader refuses in words of its own
    if len(last) in _HOMOGENEOUS and float(last[-1]) == 1.0:
        return
    others = [words[-1] for _, words in before]
    if len(others) >= FEWEST and _decimals(last[-1]) and {_decimals(last[-1])} == set(map(_decimals, others)):
        return
    problem = f"the file does not end with a line break, so its last number, {shown(last[-1])}, may be cut"
    raise InputError(path, problem, where=where, remedy=REMEDY)


def _words(line: str) -> list[str]:
    return line.partition("#")[0].replace(",", " ").split()


def _is_number(words: list[str]) -> bool:
    try:
        return [float(word) for word in words] != []
    except ValueError:
        return False


def _decimals(number: str) -> int:
    """Return how many characters follow the point, those of an exponent too; 0 where there is none."""
    return len(number.partition(".")[2])
