# SPDX-License-Identifier: GPL-3.0-or-later
"""For the docs' site: what a docstring says in running text of parameters and attributes becomes a list, examples code.

The docstrings say `image: (H, W, 3) uint8. seed, frame: name the stream.` where a name is a parameter or an attribute.
Examples are the paragraphs that are indented, and doctests.
"""

import re
import textwrap
from typing import Any

import griffe

NAMES = r"\*{0,2}[A-Za-z_]\w*(?:, \*{0,2}[A-Za-z_]\w*)*"
EXAMPLE = re.compile(r"(?<=\n\n)    \S.*(?:\n(?:    .*|(?=\n    )))*")  # indented lines, and blank ones between them
DOCTEST = re.compile(r"^>>> .*(?:\n.+)*", re.MULTILINE)  # to the next blank line
DESCRIPTION = re.compile(rf"(?:^|(?<=[.;] ))({NAMES}): ")


class ListedParameters(griffe.Extension):
    """Rewrites the docstrings of modules, functions and classes before they are rendered."""

    def on_module_members(self, *, mod: griffe.Module, **_: Any) -> None:
        """Mark a module's examples."""
        rewrite(mod, set())

    def on_function_instance(self, *, func: griffe.Function, **_: Any) -> None:
        """List a function's parameters."""
        rewrite(func, {parameter.name.lstrip("*") for parameter in func.parameters})

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        """List a class's attributes."""
        rewrite(cls, set(cls.members))


def rewrite(item: griffe.Object, known: set[str]) -> None:
    """Rewrite an object's docstring, where it has one."""
    if item.docstring is not None:
        text = EXAMPLE.sub(lambda found: f"```python\n{textwrap.dedent(found[0])}\n```", item.docstring.value)
        text = DOCTEST.sub(lambda found: f"```python\n{found[0]}\n```", text)
        parts = re.split(r"(^```python\n.*?^```$)", text, flags=re.DOTALL | re.MULTILINE)
        item.docstring.value = "".join(part if number % 2 else prose(part, known) for number, part in enumerate(parts))


def prose(text: str, known: set[str]) -> str:
    """Return what stands between examples, with lists of the known names that it describes."""
    paragraphs = re.sub(r"(?<=[.;])\s+Raises (?=[A-Z])", "\n\nRaises ", text).split("\n\n")
    return "\n\n".join(listed(paragraph, known) for paragraph in paragraphs)


def listed(paragraph: str, known: set[str]) -> str:
    """Return a paragraph as a list where it describes known names; else as it is."""
    if paragraph.startswith((" ", "-", "|")):
        return paragraph
    text = " ".join(paragraph.split("\n"))
    starts = [
        found for found in DESCRIPTION.finditer(text) if all(name.lstrip("*") in known for name in found[1].split(", "))
    ]
    if not starts:
        return paragraph
    ends = [found.start() for found in starts[1:]] + [len(text)]
    before = text[: starts[0].start()].strip()
    items = []
    for found, end in zip(starts, ends, strict=True):
        names = ", ".join(f"`{name}`" for name in found[1].split(", "))
        items.append(f"- {names}: {text[found.end() : end].strip()}")
    return "\n".join([*([before, ""] if before else []), *items])
