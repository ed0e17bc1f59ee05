# SPDX-License-Identifier: GPL-3.0-or-later
"""`list`: the keys of presets and what is shipped, or what a preset holds; the same as `generate --list`."""

import argparse

from .command import Command, run
from .entry import Entry
from .listing import HELD, KNOWN
from .parser import Parser
from .part import add_part_options, part_words


def _list_options(parser: Parser) -> None:
    parser.add_argument(
        "what",
        metavar="WHAT",
        choices=[*KNOWN, *HELD],
        help=f"{', '.join(KNOWN)}: what there is; {', '.join(HELD)}: what a preset holds",
    )
    parser.add_argument("preset", metavar="PRESET", nargs="?", help=f"the preset, for {', '.join(HELD)}")
    add_part_options(parser)


def _settle_list(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    if options.what in HELD and options.preset is None:
        parser.error(f"{options.what}: name a preset, presets/demo.yaml for instance")
    return options


def _list(options: argparse.Namespace, entry: Entry) -> int:
    named = [] if options.preset is None else [options.preset]
    return run("generate", [*named, "--list", options.what, *part_words(options)], entry)


LIST = Command(
    name="list",
    group="look at what there is",
    help="list what a preset may say and what is shipped, or what a preset holds",
    description="List the keys of presets, or what a preset holds.",
    options=_list_options,
    settle=_settle_list,
    run=_list,
    needs=(),
)
