# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of the numbers in text mesh files; Blender's importers silently read bad ones as 0.

Every pattern here takes time in proportion to the text: what one part of it has matched, no other tries again.
"""

import math
import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from .ply_file import DAMAGED

_NUMBER = rb"[-+]?(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][-+]?[0-9]++)?"
_WORD = re.compile(rb"[^ \t\r\n\f\v]++")
_IS_NUMBER = re.compile(_NUMBER).fullmatch
_IS_NO_FINITE = re.compile(rb"[-+]?(?:nan|inf(?:inity)?)", re.IGNORECASE).fullmatch
_HAS_COMMA = re.compile(rb"[-+]?[0-9]*+,[0-9]++").fullmatch
_BLANKS = rb"[ \t\f\v]"
_OF_NUMBERS = b"0123456789+-.eE, \t\r\n"
_LARGE = re.compile(rb"[0-9]{29}|[eE]\+?0*+[1-9][0-9]")  # all smaller numbers are below 1e38, and float32 holds them


def check_lines(path: Path, data: bytes, kinds: tuple[tuple[bytes, int, str], ...]) -> None:
    """Raise InputError where a line that begins with a keyword has something else than numbers, or too few of them.

    kinds: for each a pattern of keywords, how many numbers there have to be, and what these are. What follows # is a
    comment; a line goes on behind a \\ at its end.
    """
    text = data.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ") if b"\\" in data else data
    large = _LARGE.search(text) is not None
    for keywords, least, what in kinds:
        lines = rb"^" + _BLANKS + rb"*+(?:" + keywords + rb")" + _BLANKS + rb"++"
        more = rb"(?:" + _BLANKS + rb"++" + _NUMBER + rb"){%d,}+" % (least - 1)
        odd = re.compile(lines + rb"(?!" + _NUMBER + more + _BLANKS + rb"*+\r?(?:#|$))", re.MULTILINE)
        if found := odd.search(text):
            raise _error(path, data, text, found.end(), least=least, what=what)
        for line in re.finditer(lines + rb"([^#\r\n]*+)", text, re.MULTILINE) if large else ():
            if _too_large(line[1].split()):
                raise _error(path, data, text, line.start(1), least=least, what=what)


def check_stl_corners(path: Path, data: bytes) -> None:
    """Raise InputError where the corners of an STL file that is text are not three numbers each."""
    three = rb"\s++" + _NUMBER + rb"\s++" + _NUMBER + rb"\s++" + _NUMBER + rb"(?!\S)"
    if found := re.search(rb"\bvertex\b(?!" + three + rb")", data):
        raise _error(path, data, data, found.end(), least=3, what="coordinate")
    if _LARGE.search(data):
        for corner in re.finditer(rb"\bvertex\b\s++(\S++)\s++(\S++)\s++(\S++)", data):
            if _too_large(list(corner.groups())):
                raise _error(path, data, data, corner.start(1), least=3, what="coordinate")


def check_fbx_arrays(path: Path, data: bytes) -> None:
    """Raise InputError where a mesh's arrays in an FBX file that is text hold something else than numbers.

    NaN and what is too large are left to the importer, which keeps them.
    """
    for array in re.finditer(rb"\b(?:Vertices|PolygonVertexIndex|UV|UVIndex):[^{}\n:]*+\{\s*+a:([^}]*+)", data):
        if array[1].translate(None, _OF_NUMBERS):
            for word in re.finditer(rb"[^,\s]++", array[1]):
                if not re.fullmatch(_NUMBER + rb"|[-+]?(?:nan|inf)", word[0], re.IGNORECASE):
                    line = 1 + data.count(b"\n", 0, array.start(1) + word.start())
                    problem = f"{word[0][:40].decode('utf-8', 'replace')!r} is not a number"
                    raise InputError(path, problem, where=f"line {line}", remedy=DAMAGED)


def line_with_odd_number(data: bytes) -> int | None:
    """Return the first line of a text, from 1, with a number that float32 does not hold; None if there is none."""
    for found in re.finditer(rb"(?<![\w.\"/])(?:[-+]?(?:nan|inf)\b|" + _NUMBER + rb")", data, re.IGNORECASE):
        if not math.isfinite(_float32(found[0])):
            return 1 + data.count(b"\n", 0, found.start())
    return None


def _too_large(words: list[bytes]) -> bool:
    return any(not math.isfinite(_float32(word)) for word in words)


def _float32(word: bytes) -> float:
    with np.errstate(over="ignore"):
        return float(np.float32(float(word)))


def _error(path: Path, data: bytes, text: bytes, start: int, *, least: int, what: str) -> InputError:
    """Return the error of a line whose numbers begin at a place."""
    line = 1 + data.count(b"\n", 0, start)
    where = f"line {line}"
    end = text.find(b"\n", start)
    words = _WORD.findall(text[start : len(text) if end < 0 else end].split(b"#", 1)[0])
    words = words[:3] if data[start - 6 : start].strip() == b"vertex" else words
    for word in words:
        if _IS_NUMBER(word) and not _LARGE.search(word):
            continue
        shown = repr(word[:40].decode("utf-8", "replace"))
        if _IS_NO_FINITE(word):
            return InputError(path, f"a {what} is NaN or infinite", where=where, remedy=DAMAGED)
        if _HAS_COMMA(word):
            return InputError(path, f"{shown} is not a number", where=where, remedy="write a decimal point")
        if not _IS_NUMBER(word):
            return InputError(path, f"{shown} is not a number", where=where, remedy=DAMAGED)
        if _too_large([word]):
            return InputError(path, f"{shown} is too large for float32", where=where, remedy=DAMAGED)
    problem = f"has {len(words)} numbers, where a {what} takes {least}"
    return InputError(path, problem, where=where, remedy=DAMAGED)
