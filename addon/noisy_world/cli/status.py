# SPDX-License-Identifier: GPL-3.0-or-later
"""`status`: how far a dataset has come, what is missing or damaged, and how long the rest will take."""

import argparse
import json
import sys

from .arguments import frame_slice
from .command import Command
from .entry import Entry
from .parser import Parser
from .places import place
from .status_table import LONGEST_TABLE, content, format_status


def _status_options(parser: Parser) -> None:
    parser.add_argument("out", metavar="OUT", type=place, help="the dataset's folder or address")
    parser.add_argument("--check", action="store_true", help="read every file and compare its SHA-256")
    parser.add_argument("--frames", metavar="A:B", type=frame_slice, help="ask for frames A to B-1 of each path alone")
    parser.add_argument(
        "--all",
        action="store_true",
        help=f"a row for each setting, also where there are more than {LONGEST_TABLE}; else severities share a row",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")


def _tell_status(options: argparse.Namespace, _: Entry) -> int:
    """Print it; return 0, or 1 where files are lost or damaged."""
    from ..core.progress import SilentProgress
    from ..perturbations import registry
    from ..pipeline.status import read_status
    from .running import text_listener

    listener = text_listener(sys.stderr) if options.check else SilentProgress()  # without it, looking takes seconds
    status = read_status(options.out, registry(), listener, chosen=options.frames, check=options.check)
    print(json.dumps(content(status), indent=1) if options.json else format_status(status, every_setting=options.all))
    return 1 if status.lost or status.damaged else 0


STATUS = Command(
    name="status",
    group="look at what there is",
    help="say how far a dataset has come, and what of it is missing or damaged",
    description="Say how far a dataset has come, while a run makes it or after that: a table of settings and "
    "scenes, what is lost or damaged, and how long the rest takes at the present pace. Nothing is changed.",
    options=_status_options,
    run=_tell_status,
)
