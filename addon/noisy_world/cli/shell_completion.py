# SPDX-License-Identifier: GPL-3.0-or-later
"""What is made from the parsers of the subcommands: completion for three shells, and manual pages."""

import argparse
import shlex
from collections.abc import Callable, Iterable
from datetime import UTC, datetime

from .arguments import Parser
from .command import PROGRAM, Command

Parsers = Iterable[tuple[Command, Parser]]


def options_of(parser: Parser) -> list[argparse.Action]:
    """Return the options of a parser that --help shows, those that begin with dashes."""
    return [item for item in parser._actions if item.option_strings and item.help != argparse.SUPPRESS]


def arguments_of(parser: Parser) -> list[argparse.Action]:
    """Return what a parser takes without dashes."""
    return [item for item in parser._actions if not item.option_strings]


def words_of(action: argparse.Action) -> list[str]:
    """Return the words that may stand for an option's value; none where it is free."""
    return [str(word) for word in action.choices or ()]


# --- bash, zsh, fish ---


def bash(parsers: Parsers) -> str:
    """Return a script for bash: words by what stands before, files where any may."""
    cases = []
    for command, parser in parsers:
        words = [text for item in options_of(parser) for text in item.option_strings]
        words += [word for item in arguments_of(parser) for word in words_of(item)]
        after = [
            f"      {'|'.join(item.option_strings)}) words={shlex.quote(' '.join(words_of(item)))} ;;"
            for item in options_of(parser)
            if words_of(item)
        ]
        inner = "\n".join(
            ['    case "$before" in', *after, f"      *) words={shlex.quote(' '.join(words))} ;;", "    esac"]
        )
        cases.append(f"  {command.name})\n{inner}\n    ;;")
    names = " ".join(command.name for command, _ in parsers)
    body = "\n".join(cases)
    return f"""# Completion of {PROGRAM} for bash: source this.
_noisy_world() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" words=""
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "{names} --help --version" -- "$word"))
    return
  fi
  case "${{COMP_WORDS[1]}}" in
{body}
  esac
  COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _noisy_world {PROGRAM}
"""


def zsh(parsers: Parsers) -> str:
    """Return a script for zsh, with what each subcommand and option means."""
    cases = []
    for command, parser in parsers:
        specs = []
        for item in options_of(parser):
            takes = "" if item.nargs == 0 else f":{_zsh_value(item)}"
            specs += [f"'{text}[{_zsh_text(item.help or '')}]{takes}'" for text in item.option_strings]
        specs += [f"'*:{_zsh_text(_name(item))}:{_zsh_words(item)}'" for item in arguments_of(parser)[:1]]
        cases.append(f"    {command.name}) _arguments {' '.join(specs)} ;;")
    described = "\n".join(f"    '{command.name}:{_zsh_text(command.help)}'" for command, _ in parsers)
    body = "\n".join(cases)
    return f"""#compdef {PROGRAM}
# Completion of {PROGRAM} for zsh: source this after compinit.
_noisy_world() {{
  local -a subcommands=(
{described}
  )
  if (( CURRENT == 2 )); then
    _describe subcommand subcommands
    return
  fi
  local chosen=$words[2]
  shift words
  (( CURRENT-- ))
  case "$chosen" in
{body}
  esac
}}
compdef _noisy_world {PROGRAM}
"""


def _zsh_text(text: str) -> str:
    """Return a text that may stand in brackets, between single quotes."""
    plain = text.replace("\\", "\\\\").replace("[", "(").replace("]", ")").replace(":", "\\:").replace("%%", "%")
    return plain.replace("'", "'\\''")


def _zsh_value(item: argparse.Action) -> str:
    return f"{_zsh_text(_name(item))}:{_zsh_words(item)}"


def _zsh_words(item: argparse.Action) -> str:
    return f"({' '.join(words_of(item))})" if words_of(item) else "_files"


def fish(parsers: Parsers) -> str:
    """Return a script for fish, with what each subcommand and option means."""
    lines = [f"# Completion of {PROGRAM} for fish: save this as ~/.config/fish/completions/{PROGRAM}.fish."]
    for command, parser in parsers:
        first = f"complete -c {PROGRAM} -n __fish_use_subcommand"
        lines.append(f"{first} -a {command.name} -d {_fish_text(command.help)}")
        within = f"complete -c {PROGRAM} -n '__fish_seen_subcommand_from {command.name}'"
        for item in options_of(parser):
            names = " ".join(
                f"-{'l' if text.startswith('--') else 's'} {text.lstrip('-')}" for text in item.option_strings
            )
            takes = "" if item.nargs == 0 else f" -x -a '{' '.join(words_of(item))}'" if words_of(item) else " -r"
            lines.append(f"{within} {names}{takes} -d {_fish_text(item.help or '')}")
        lines += [f"{within} -a '{' '.join(words_of(item))}'" for item in arguments_of(parser) if words_of(item)]
    return "\n".join(lines) + "\n"


def _fish_text(text: str) -> str:
    escaped = text.replace("%%", "%").replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"


SHELLS: dict[str, Callable[[Parsers], str]] = {"bash": bash, "zsh": zsh, "fish": fish}


def script(shell: str, parsers: Parsers) -> str:
    """Return what makes a shell, one of SHELLS, complete the words of all subcommands."""
    return SHELLS[shell](list(parsers))


# --- manual pages ---


def manual_page(command: Command, parser: Parser, version: str) -> str:
    """Return a subcommand's manual page in troff's man macros. Its date is today's."""
    date = datetime.now(UTC).strftime("%Y-%m-%d")
    name = f"{PROGRAM}-{command.name}"
    usage = parser.format_usage().removeprefix("usage: ").split()
    lines = [
        f'.TH "{name.upper()}" "1" "{date}" "{PROGRAM} {version}" "Noisy World"',
        ".SH NAME",
        f"{_troff(name)} \\- {_troff(command.help)}",
        ".SH SYNOPSIS",
        f".B {_troff(' '.join(usage[:2]))}",
        _troff(" ".join(usage[2:])),
        ".SH DESCRIPTION",
        _troff(command.description),
    ]
    lines += [".SH ARGUMENTS", *_listed(arguments_of(parser))] if arguments_of(parser) else []
    lines += [".SH OPTIONS", *_listed(options_of(parser))]
    if command.epilog:
        lines += [".SH NOTES", _troff(command.epilog)]
    lines += [".SH SEE ALSO", _troff(f"'{PROGRAM} --help' names all subcommands, '{PROGRAM} docs' the pages.")]
    return "\n".join(lines) + "\n"


def _listed(actions: Iterable[argparse.Action]) -> list[str]:
    lines = []
    for item in actions:
        value = "" if item.nargs == 0 or not item.option_strings else f" {_name(item)}"
        names = ", ".join(item.option_strings) or _name(item)
        lines += [".TP", f".B {_troff(names + value)}", _troff((item.help or "").replace("%%", "%"))]
    return lines


def _name(item: argparse.Action) -> str:
    if isinstance(item.metavar, str):
        return item.metavar
    return "{" + ",".join(words_of(item)) + "}" if words_of(item) else item.dest.upper()


def _troff(text: str) -> str:
    """Return a line as it stands: neither a macro nor an escape."""
    plain = " ".join(text.split()).replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{plain}" if plain.startswith((".", "'")) else plain
