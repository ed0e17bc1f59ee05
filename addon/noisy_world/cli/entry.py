# SPDX-License-Identifier: GPL-3.0-or-later
"""How the command line was started: as a script, inside a Blender program or as the installed command."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass

INTERRUPTED = 130  # the exit status that shells give a program that Ctrl-C ended


@dataclass(frozen=True)
class Entry:
    """What differs between the ways to start a subcommand.

    name: what its messages begin with, "generate.py" for instance.
    words: the command that starts it again, without the subcommand's arguments.
    whose_python: what has this Python, "this Blender's " for instance; empty where it is a plain one.
    remedy: what to do where packages are missing.
    """

    name: str
    words: tuple[str, ...]
    whose_python: str = ""
    remedy: str = "install them with pip"

    def command(self, arguments: Sequence[str]) -> list[str]:
        """Return the command that starts the subcommand again."""
        return [*self.words, *arguments]

    def pasteable(self, arguments: Sequence[str]) -> str:
        """Return the command as a person pastes it into a shell."""
        return shlex.join(self.command(arguments))

    def complain(self, text: str) -> None:
        """Say in a line what is wrong."""
        say(f"{self.name}: {text}")


def say(text: str) -> None:
    """Print a line for a person, apart from what the command prints as its result."""
    print(text, file=sys.stderr, flush=True)
