# SPDX-License-Identifier: GPL-3.0-or-later
"""`recipe`: write what a dataset was made from and the digests of its files, some hundred kilobytes for terabytes."""

import argparse
import sys

from .command import Command
from .entry import Entry, say
from .parser import Parser
from .places import out_path, place


def _recipe_options(parser: Parser) -> None:
    parser.add_argument("dataset", metavar="DATASET", type=place, help="the dataset's folder or address")
    parser.add_argument("--out", metavar="FILE", type=out_path, help="the file to write (default: standard output)")


def _write_recipe(options: argparse.Namespace, _: Entry) -> int:
    """Write the recipe."""
    from ..core.datasets.storage import ELSEWHERE, storage_errors
    from ..recipes.making import unnamed_sequences
    from ..recipes.of_dataset import recipe_of
    from .running import listener

    progress, _stop = listener("text")
    recipe = recipe_of(options.dataset, progress)
    text = recipe.text()
    if options.out is None:
        sys.stdout.write(text)
    else:
        with storage_errors(options.out, ELSEWHERE):
            options.out.write_text(text, encoding="utf-8")
    if others := unnamed_sequences(recipe):
        say(
            f"the preset that this dataset was last made with does not name {others}: the recipe verifies that, "
            "but cannot make it again"
        )
    return 0


RECIPE = Command(
    name="recipe",
    group="share a dataset, and make it again",
    help="write what makes a dataset, and the digests of its files",
    description="Write the recipe of a finished dataset: its preset, versions, the hashes of its inputs, and "
    "digests of its files. Images are not read; 'noisy-world verify' hashes them.",
    options=_recipe_options,
    run=_write_recipe,
)
