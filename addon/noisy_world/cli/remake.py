# SPDX-License-Identifier: GPL-3.0-or-later
"""`remake`: make a part of a recipe's dataset again, from its inputs, and verify it."""

import argparse
from dataclasses import replace

from .arguments import frame_slice, positive
from .command import Command, as_given, own_entry
from .entry import Entry
from .parser import Parser
from .part import add_part_options, recipe_part
from .places import folder, path


def _remake_options(parser: Parser) -> None:
    parser.add_argument("recipe", metavar="RECIPE", type=path, help="the recipe, from 'noisy-world recipe'")
    parser.add_argument("--out", metavar="DIR", type=folder, required=True, help="the dataset's folder")
    add_part_options(parser)
    parser.add_argument(
        "--frames", metavar="A:B", type=frame_slice, help="only frames A to B-1; they keep their numbers"
    )
    parser.add_argument("--jobs", metavar="N", type=positive, default=1, help="processes that render (default: 1)")


def _remake(options: argparse.Namespace, entry: Entry) -> int:
    """Make the dataset, verify it, and return the exit status: 0 where all is as it can be here."""
    from ..recipes.recipe import read_recipe
    from ..recipes.verifying import verify
    from .generate import generate
    from .running import listener

    recipe = read_recipe(options.recipe)
    plan = recipe_part(recipe, options)
    status = generate(plan, _generate_options(options, entry), replace(entry, words=own_entry("generate").words))
    if status != 0:
        return status
    progress, stop = listener("text")
    findings = verify(recipe, options.out, progress, stop)
    for line in [*findings.lines(), *findings.summary_lines()]:
        print(line)
    return 0 if findings.sound else 1


def _generate_options(options: argparse.Namespace, entry: Entry) -> argparse.Namespace:
    """Return the options that `generate` has for this."""
    from .generate import GENERATE

    words = [str(options.recipe.absolute()), "--out", str(options.out.absolute()), "--jobs", str(options.jobs)]
    return argparse.Namespace(**{**vars(GENERATE.parse(words, entry)), **vars(options)})


REMAKE = Command(
    name="remake",
    group="share a dataset, and make it again",
    help="make a recipe's dataset again, or a part of it, and verify it",
    description="Make a recipe's dataset again, or a part of it, from the inputs that the recipe names, and verify "
    "every file. The same command again resumes, and other parts can be added to the same folder.",
    options=_remake_options,
    run=_remake,
    again=as_given,
)
