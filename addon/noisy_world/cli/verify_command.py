# SPDX-License-Identifier: GPL-3.0-or-later
"""`verify`: hash every file of a dataset, and compare it with a recipe."""

import argparse

from .ending import ended
from .entry import Entry
from .parser import Parser
from .places import path, place


def main(arguments: list[str], entry: Entry) -> int:
    """Run the command line and return the exit status: 0 where all that is there is as the recipe says."""
    parser = Parser(
        prog=entry.name,
        description="Hash every file of a dataset and say what is missing, damaged, extra, or not as a recipe says. A "
        "dataset with a part of the recipe's settings, scenes or frames is compared in that part.",
    )
    parser.add_argument("recipe", metavar="RECIPE", type=path, help="the recipe, from 'noisy-world recipe'")
    parser.add_argument("dataset", metavar="DATASET", type=place, help="the dataset's folder or address")
    options = parser.parse_args(arguments)
    return ended(lambda: compare(options), entry, stopped="nothing was written, and verify begins at the beginning")


def compare(options: argparse.Namespace) -> int:
    """Compare, and print what was found."""
    from ..recipes.recipe import read_recipe
    from ..recipes.verifying import verify
    from .running import listener

    progress, stop = listener("text")
    findings = verify(read_recipe(options.recipe), options.dataset, progress, stop)
    for line in [*findings.lines(), *findings.summary_lines()]:
        print(line)
    return 0 if findings.as_the_recipe else 1
