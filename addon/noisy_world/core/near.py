# SPDX-License-Identifier: GPL-3.0-or-later
"""Suggestions for misspelt names: keys, commands, options, presets, perturbations, folders."""

import difflib
from collections.abc import Iterable

LONGEST = 60  # characters of a name that are compared: the time grows with their square
LEAST = 0.5  # likeness, from 0 to 1; difflib's own limit of 0.6 misses short names with one wrong letter


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is most like a name; None where none is like it."""
    near = difflib.get_close_matches(name[:LONGEST], list(known), n=1, cutoff=LEAST)
    return near[0] if near else None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a question that gives the nearest known name; "" where none is like it."""
    near = nearest(name, known)
    return "" if near is None else f"did you mean {near!r}?"
