# SPDX-License-Identifier: GPL-3.0-or-later
"""`render-clean`: make the clean frames that a recipe's frames are made from on the spot, in `noisy_world.open`."""

import argparse

from .arguments import frame_slice
from .command import Command, as_given
from .entry import Entry
from .generate import need_blender
from .parser import Parser
from .part import add_part_options, recipe_part
from .places import folder, path


def _clean_options(parser: Parser) -> None:
    parser.add_argument("recipe", metavar="RECIPE", type=path, help="the recipe, from 'noisy-world recipe'")
    parser.add_argument("--out", metavar="DIR", type=folder, required=True, help="the folder of clean frames")
    add_part_options(parser)
    parser.add_argument(
        "--frames", metavar="A:B", type=frame_slice, help="only what frames A to B-1 of each sequence show"
    )


def _render(options: argparse.Namespace, entry: Entry) -> int:
    """Render the frames, and print how many."""
    from ..core.errors import InputError
    from ..recipes.clean_making import make_store, rendered
    from ..recipes.recipe import read_recipe
    from .running import listener

    recipe = read_recipe(options.recipe)
    plan = recipe_part(recipe, options)
    if not plan.renders_anything:
        raise InputError(options.recipe, "its scenes are recordings, which noisy_world.open reads as they are")
    need_blender(plan, entry)
    progress, stop = listener("text")
    made = make_store(plan, options.out, progress, stop)
    print(f"{options.out}: {made} frames rendered, {rendered(plan).frame_count - made} kept")
    return 0


RENDER_CLEAN = Command(
    name="render-clean",
    group="share a dataset, and make it again",
    help="render the clean frames that noisy_world.open makes a recipe's frames of",
    description="Render the clean frames of a recipe into a folder, lossless, for noisy_world.open(RECIPE, "
    "clean=DIR). A frame of 1200 x 680 takes 13 MB, so a part is chosen as a rule: settings that move the camera "
    "have frames of their own. The same command again resumes, and other parts can be added.",
    options=_clean_options,
    run=_render,
    again=as_given,
)
