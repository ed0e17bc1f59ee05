# SPDX-License-Identifier: GPL-3.0-or-later
"""`clean`: make the clean frames that a recipe's frames are made from on the spot, in `noisy_world.open`."""

import argparse

from ..core.requirements import NEEDED
from .arguments import frame_slice
from .entry import INTERRUPTED, Entry, say
from .missing import blender_problem, missing_package
from .part import add_part_options, recipe_part
from .places import folder, path


def main(arguments: list[str], entry: Entry) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(
        prog=entry.name,
        description="Render the clean frames of a recipe into a folder, lossless, for noisy_world.open(RECIPE, "
        "clean=DIR). A frame of 1200 x 680 takes 13 MB, so a part is chosen as a rule: settings that move the camera "
        "have frames of their own. The same command again resumes, and other parts can be added.",
    )
    parser.add_argument("recipe", metavar="RECIPE", type=path, help="the recipe, from 'noisy-world recipe'")
    parser.add_argument("--out", metavar="DIR", type=folder, required=True, help="the folder of clean frames")
    add_part_options(parser)
    parser.add_argument(
        "--frames", metavar="A:B", type=frame_slice, help="only what frames A to B-1 of each sequence show"
    )
    options = parser.parse_args(arguments)
    if problem := missing_package(NEEDED, entry):
        entry.complain(problem)
        return 1
    from ..core.errors import InterruptedRunError, NoisyWorldError
    from ..recipes.clean_making import make_store
    from ..recipes.recipe import read_recipe
    from .running import listener

    try:
        recipe = read_recipe(options.recipe)
        plan = recipe_part(recipe, options)
        if not plan.renders_anything:
            entry.complain(f"{options.recipe}: its scenes are recordings, which noisy_world.open reads as they are")
            return 1
        if plan.needs_blender and (problem := missing_package(["bpy"], entry) or blender_problem()):
            entry.complain(problem)
            return 1
        progress, stop = listener("text")
        made = make_store(plan, options.out, progress, stop)
    except InterruptedRunError:
        say(
            f"stopped; finished frames stay, and the same command continues from there:\n  {entry.pasteable(arguments)}"
        )
        return INTERRUPTED
    except NoisyWorldError as error:
        entry.complain(str(error))
        return 1
    print(f"{options.out}: {made} frames rendered, {plan.frame_count - made} kept")
    return 0
