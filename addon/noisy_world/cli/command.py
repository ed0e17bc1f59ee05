# SPDX-License-Identifier: GPL-3.0-or-later
"""The installed command `noisy-world`, also `python -m noisy_world`, and the registry of its subcommands.

A subcommand is a `Command`: all that is said of it stands there, and help, docs, completion and manual pages are made
from it. Ours are held by modules of this package as their COMMAND; those of installed packages come by entry points.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from ..core.errors import did_you_mean
from ..core.packages import LAST, NEEDED, Door, Registry
from .arguments import Parser
from .entry import CONTINUES, Entry, ended, exit_status, say

PROGRAM = "noisy-world"

# What people look for under another word, and under the names that there were before 0.1.0.
OTHER_WORDS = {
    "clean": "render-clean",
    "materialise": "remake",
    "materialize": "remake",
    "track": "run-odometry",
    "odometry": "run-odometry",
    "help": "--help",
    "version": "--version",
}


def _as_they_are(_: Parser, options: argparse.Namespace) -> argparse.Namespace:
    return options


@dataclass(frozen=True)
class Command:
    """A subcommand of `noisy-world`.

    name: the word for it. group: the heading that it stands under in `noisy-world --help`. help: its line there.
    order: in lists, ours first.
    description, epilog: what its own --help says before and after its options.
    options: adds its options to a parser. settle: returns the parsed options as `run` takes them; for what is wrong in
    several together it calls the parser's `error`.
    run: does the work and returns the exit status: 0 where it was done. What a user can mend it raises as
    NoisyWorldError.
    needs: the modules without which nothing is begun.
    stopped: what follows "stopped; " where a signal ended it. again: returns the arguments that go on from there, of
    the options and the arguments that were given; None for none.
    busy: the exit status where another process does the same.
    """

    name: str
    group: str
    help: str
    description: str
    options: Callable[[Parser], None]
    run: Callable[[argparse.Namespace, Entry], int]
    epilog: str | None = None
    settle: Callable[[Parser, argparse.Namespace], argparse.Namespace] = _as_they_are
    needs: Sequence[str] = tuple(NEEDED)
    stopped: str = CONTINUES
    again: Callable[[argparse.Namespace, list[str]], Sequence[str] | None] = lambda _options, _arguments: None
    busy: int = 1
    order: int = LAST

    def parser(self, program: str) -> Parser:
        """Return the parser of its options. program: what --help calls it."""
        parser = Parser(prog=program, description=self.description, epilog=self.epilog)
        self.options(parser)
        return parser

    def parse(self, arguments: Sequence[str], entry: Entry) -> argparse.Namespace:
        """Parse the command line; exit with a usage line if it is wrong."""
        parser = self.parser(entry.name)
        return self.settle(parser, parser.parse_args(arguments))

    def main(self, arguments: list[str], entry: Entry) -> int:
        """Run the command line and return the exit status."""
        options = self.parse(arguments, entry)
        again = self.again(options, arguments)
        stopped = self.stopped if again is None else f"{self.stopped}:\n  {entry.pasteable(again)}"
        work = lambda: self.run(options, entry)  # noqa: E731
        return ended(work, entry, needs=self.needs, stopped=stopped, busy=self.busy, options=options)


def as_given(_: argparse.Namespace, arguments: list[str]) -> list[str]:
    """Return the arguments that were given: for `Command.again` where the same command goes on."""
    return arguments


def _problem(command: Command) -> str:
    """Return what is wrong with a package's subcommand; "" where nothing is."""
    words = command.name.split("-")
    if not all(word.isascii() and word.isalnum() and word.islower() for word in words):
        return f"its subcommand has the name {command.name!r}; use small letters, digits and hyphens"
    return "" if command.group and command.help else f"its subcommand {command.name} needs a group and a line of help"


DOOR = Door("noisy_world.commands", "subcommand", "COMMAND", (Command,), _problem)

COMMANDS = Registry(DOOR, __package__)
"""All subcommands by name, ours first; those that packages bring come by entry points."""


def find_command(name: str) -> Command | None:
    """Return a subcommand, whatever packages bring if it is ours; None where there is no such one.

    Raises NoisyWorldError where a package's subcommand cannot be loaded.
    """
    return COMMANDS.ours(name) or COMMANDS.get(name)


def run(name: str, arguments: list[str], entry: Entry | None = None) -> int:
    """Run one of our subcommands and return its exit status. entry: how it was started, if not by `noisy-world`."""
    command = COMMANDS.ours(name)
    assert command is not None, "a subcommand of ours"
    return command.main(arguments, entry or own_entry(name))


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit status. arguments: by default the process's own."""
    words = sys.argv[1:] if arguments is None else arguments
    return exit_status(lambda: _carry_out(words))


def _carry_out(words: Sequence[str]) -> int:
    from ..core.errors import NoisyWorldError

    try:
        if not words:
            print(help_text())
            return 2
        if words[0].startswith("-"):
            _parser().parse_args(words[:1])  # ends with --help and its like, and for what is none of them
        name, *rest = words
        command = find_command(name)
    except NoisyWorldError as error:  # of a package's subcommand
        say(f"{PROGRAM}: {error.message}")
        return 1
    if command is not None:
        return command.main(rest, own_entry(name))
    meant = OTHER_WORDS.get(name.casefold())
    asked = did_you_mean(name, COMMANDS) if meant is None else f"did you mean {meant!r}?"
    say(f"{PROGRAM}: {name!r} is no subcommand; {asked or 'there are ' + ', '.join(COMMANDS)}")
    return 2


def own_entry(subcommand: str) -> Entry:
    """Return how to start a subcommand again: by this Python, as its folder of commands may not be on the path."""
    return Entry(
        f"{PROGRAM} {subcommand}",
        (sys.executable, "-m", "noisy_world", subcommand),
        remedy=f"install them with {sys.executable} -m pip install",
    )


def help_text() -> str:
    """Return what `noisy-world --help` prints: the subcommands in their groups, each with its line."""
    parser = _parser()
    parser.epilog = f"{groups_text()}\n\n'{PROGRAM} SUBCOMMAND --help' tells more."
    return parser.format_help().rstrip("\n")


def groups_text() -> str:
    """Return the subcommands in their groups, each with its line of help."""
    width = max(map(len, COMMANDS))
    groups: dict[str, list[str]] = {}
    for name, command in COMMANDS.items():
        groups.setdefault(command.group, []).append(f"  {name:<{width}}  {command.help}{COMMANDS.origin(name)}")
    return "\n\n".join("\n".join([f"{group}:", *lines]) for group, lines in groups.items())


def _version() -> str:
    from ..core.packages import package_version

    return f"{PROGRAM} {package_version()}"


def _parser() -> Parser:
    """Return the parser of what stands before a subcommand."""
    parser = Parser(
        prog=PROGRAM,
        usage=f"{PROGRAM} SUBCOMMAND ...",
        description="Clean 3D scenes in, noisy RGB-D worlds out.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        add_help=False,
    )
    _add_answer(parser, ("-h", "--help"), "show this help message and exit", help_text)
    _add_answer(parser, ("--version",), "print the version and end", _version)
    names = "print the names of the subcommands and end, for a shell that completes words"
    _add_answer(parser, ("--commands",), names, lambda: "\n".join(COMMANDS))
    return parser


def _add_answer(parser: Parser, options: tuple[str, ...], meaning: str, answer: Callable[[], str]) -> None:
    """Add an option that prints a text, worked out only then, and ends."""

    class Answer(argparse.Action):
        def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> NoReturn:
            print(answer())
            parser.exit()

    parser.add_argument(*options, action=Answer, nargs=0, help=meaning)
