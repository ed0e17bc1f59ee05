# SPDX-License-Identifier: GPL-3.0-or-later
"""The parser of every command line: what is wrong is one line, and a misspelt word is answered with what is near it."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from ..core.errors import one_line
from ..core.near import nearest
from ..core.utf8_names import RENAME, is_utf8


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose complaints are one line each."""

    def error(self, message: str) -> NoReturn:
        """Print one line and end with exit status 2."""
        more = "" if message.endswith("?") else f"; '{self.prog} --help' tells more"
        self.exit(2, f"{self.prog}: error: {message}{more}\n")

    def parse_args(  # pyright: ignore[reportIncompatibleMethodOverride]  its overloads tell types of namespaces
        self, args: Iterable[str] | None = None, namespace: Any = None
    ) -> Any:
        """Parse the words; end with a line where one is not UTF-8, or has no place, with the option that is near it."""
        words = sys.argv[1:] if args is None else list(args)
        if odd := next((word for word in words if not is_utf8(word)), ""):
            self.error(f"{one_line(odd)} is not UTF-8; where it names a file, {RENAME}")
        options, others = self.parse_known_args(words, namespace)
        if others:
            self.error(self._no_place(others[0]))
        return options

    def _no_place(self, word: str) -> str:
        if not word.startswith("-"):
            return f"{word!r} is one word too many"
        name = word.partition("=")[0]
        known = {text.lstrip("-"): text for action in self._actions for text in _shown_options(action)}
        near = nearest(name.lstrip("-"), known)
        return f"unknown option {name}" + (f"; did you mean {known[near]}?" if near else "")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Raise ArgumentError for a value that is none of an option's choices, with the one that is near it."""
        if action.choices is None or value in action.choices:
            return
        known = [str(choice) for choice in action.choices]
        near = nearest(str(value), known)
        asked = f"did you mean {near!r}?" if near else f"choose from {', '.join(known)}"
        raise argparse.ArgumentError(action, f"{str(value)!r} is none of its values; {asked}")


def _shown_options(action: argparse.Action) -> Sequence[str]:
    """Return an option's names; none of one that --help does not show."""
    return () if action.help == argparse.SUPPRESS else action.option_strings
