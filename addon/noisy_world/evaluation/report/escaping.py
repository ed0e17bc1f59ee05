# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts that users chose, such as names of scenes, as LaTeX and Markdown show them; HTML is the template engine's."""

import re

from ...core.errors import one_line

_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
    "\u2013": "--",
    "\u00a0": "~",
    "…": r"\ldots{}",
    "±": r"$\pm$",
    "\u2020": r"$\dagger$",
    "\u00d7": r"$\times$",
    "↑": r"$\uparrow$",
    "↓": r"$\downarrow$",
}
_LATEX_LETTERS = re.compile("[" + re.escape("".join(_LATEX)) + "]")
_MARKDOWN_LETTERS = re.compile(r"[\\`*_{}\[\]<>#|~!&$]")


def latex(text: str) -> str:
    """Return a text as LaTeX shows it, in a document of UTF-8."""
    shown = _LATEX_LETTERS.sub(lambda found: _LATEX[found[0]], _line(text))
    return f"{{}}{shown}" if shown.startswith(("[", "*")) else shown  # which would belong to the \\ of the row before


def markdown(text: str) -> str:
    """Return a text as Markdown shows it, in a cell of a table too."""
    return _MARKDOWN_LETTERS.sub(lambda found: f"\\{found[0]}", _line(text))


def _line(text: str) -> str:
    """Return a text of one line that keeps its no-break spaces, which Python does not count as printable."""
    return "\u00a0".join(map(one_line, text.split("\u00a0")))
