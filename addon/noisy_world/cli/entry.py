# SPDX-License-Identifier: GPL-3.0-or-later
"""How the command line was started: as a script, inside a Blender program or as the installed command."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """What differs between the ways to start a subcommand.

    name: the beginning of its messages, such as "generate.py".
    words: the command that starts it again, without the subcommand's arguments.
    whose_python: whose Python this is, such as "this Blender's "; empty for a plain Python.
    remedy: what to do where packages are missing. blender_remedy: what to do where Blender is, if it is another thing
    than to install the extra `blender`.
    """

    name: str
    words: tuple[str, ...]
    whose_python: str = ""
    remedy: str = "install them with pip"
    blender_remedy: str = ""

    def command(self, arguments: Sequence[str]) -> list[str]:
        """Return the command that starts the subcommand again."""
        return [*self.words, *arguments]

    def pasteable(self, arguments: Sequence[str]) -> str:
        """Return the command as text to paste into a shell."""
        return shlex.join(self.command(arguments))

    def complain(self, text: str) -> None:
        """Print a line on what is wrong."""
        say(f"{self.name}: {text}")


def say(text: str) -> None:
    """Print a line for the user on standard error; standard output is for the command's result."""
    print(text, file=sys.stderr, flush=True)
