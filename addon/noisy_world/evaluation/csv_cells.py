# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts in tables of comma-separated values, which people open in spreadsheets: none may be taken for a formula.

A text that begins with = + - @, a tab or a carriage return gets an apostrophe before it, as spreadsheets do for a text
that is typed in. It is taken off where this program reads its tables. Numbers stay as they are.
"""

import re

_FORMULA = re.compile(r"'*[=+\-@\t\r]")


def cell_of(text: str) -> str:
    """Return a text as it stands in a cell."""
    return f"'{text}" if _FORMULA.match(text) else text


def text_of(cell: str) -> str:
    """Return the text that stands in a cell: what `cell_of` was given."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell
