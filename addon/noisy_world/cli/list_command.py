# SPDX-License-Identifier: GPL-3.0-or-later
"""`list`: the keys of presets and what is shipped, or what a preset holds; the same as `generate --list`."""

from . import generate
from .entry import Entry
from .listing import HELD, KNOWN
from .parser import Parser
from .part import add_part_options, part_words


def main(arguments: list[str], entry: Entry) -> int:
    """Run the command line and return the exit status."""
    parser = Parser(prog=entry.name, description="List the keys of presets, or what a preset holds.")
    parser.add_argument(
        "what",
        metavar="WHAT",
        choices=[*KNOWN, *HELD],
        help=f"{', '.join(KNOWN)}: what there is; {', '.join(HELD)}: what a preset holds",
    )
    parser.add_argument("preset", metavar="PRESET", nargs="?", help=f"the preset, for {', '.join(HELD)}")
    add_part_options(parser)
    options = parser.parse_args(arguments)
    if options.what in HELD and options.preset is None:
        parser.error(f"{options.what}: name a preset, presets/demo.yaml for instance")
    named = [] if options.preset is None else [options.preset]
    return generate.main([*named, "--list", options.what, *part_words(options)], entry)
