# SPDX-License-Identifier: GPL-3.0-or-later
"""`verify`: hash every file of a dataset, and compare it with a recipe."""

import argparse

from .command import Command
from .entry import Entry
from .parser import Parser
from .places import path, place


def _verify_options(parser: Parser) -> None:
    parser.add_argument("recipe", metavar="RECIPE", type=path, help="the recipe, from 'noisy-world recipe'")
    parser.add_argument("dataset", metavar="DATASET", type=place, help="the dataset's folder or address")


def _verify(options: argparse.Namespace, _: Entry) -> int:
    """Compare, and print what differs; return 0 where all that is there is as the recipe says."""
    from ..recipes.recipe import read_recipe
    from ..recipes.verifying import verify
    from .running import listener

    progress, stop = listener("text")
    findings = verify(read_recipe(options.recipe), options.dataset, progress, stop)
    for line in [*findings.lines(), *findings.summary_lines()]:
        print(line)
    return 0 if findings.as_the_recipe else 1


VERIFY = Command(
    name="verify",
    group="share a dataset, and make it again",
    help="hash a dataset's files and compare them with a recipe",
    description="Hash every file of a dataset and say what is missing, damaged, extra, or not as a recipe says. A "
    "dataset with a part of the recipe's settings, scenes or frames is compared in that part.",
    options=_verify_options,
    run=_verify,
    stopped="nothing was written, and verify begins at the beginning",
)
