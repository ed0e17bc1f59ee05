# SPDX-License-Identifier: GPL-3.0-or-later
"""The options that say where a preset's data lie and which part of it is meant: the same for every subcommand."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.home import with_home

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..core.planning.plan import Plan
    from ..core.planning.shards import Shard
    from ..recipes.recipe import Recipe


EXAMPLES = {"scenes": "'room*,office0'", "settings": "'clean,fog*'"}


def add_part_options(parser: argparse.ArgumentParser, parts: "Sequence[str]" = tuple(EXAMPLES)) -> None:
    """Add --data, --scenes and --settings. parts: which of the latter two a subcommand knows."""
    parser.add_argument(
        "--data",
        metavar="DIR",
        help="folder that the scenes' paths are relative to, and where Replica is looked for (default: the preset's)",
    )
    others = "; a dataset can grow by others" if "settings" in parts else ""
    for what in parts:
        parser.add_argument(
            f"--{what}",
            metavar="NAMES",
            action="append",
            default=[],
            help=f"only these {what}, {EXAMPLES[what]} for instance; may be repeated{others}",
        )


def planned(options: argparse.Namespace, shards: "Sequence[Shard]" = ()) -> "Plan":
    """Return the plan of the preset and the part of it that the options name: with --set and --frames too.

    shards: with some, the plan of their scenes alone.

    Raises InputError where there is no such preset, and for what is wrong in it or its files.
    """
    from ..core.presets.preset import read_preset
    from ..planning import make_plan
    from .shipped import no_such_preset

    data = data_folder(options)
    if not options.preset.exists():
        raise no_such_preset(options.preset)
    preset = read_preset(options.preset, options.overrides, data=data, scenes=options.scenes, settings=options.settings)
    return make_plan(preset, options.frames, shards)


def recipe_part(recipe: "Recipe", options: argparse.Namespace) -> "Plan":
    """Return the plan of the part of a recipe that the options name: with --frames too.

    Raises InputError where an input is missing or is not the one that the recipe was made from.
    """
    from ..recipes.making import plan_of

    return plan_of(recipe, data_folder(options), options.scenes, options.settings, options.frames)


def data_folder(options: argparse.Namespace) -> Path | None:
    """Return the folder that --data names, None without it."""
    from ..core.errors import NoisyWorldError

    try:
        return None if options.data is None else with_home(options.data)
    except LookupError as error:
        raise NoisyWorldError(f"--data: {error}") from error


def part_words(options: argparse.Namespace, *, anywhere: bool = False) -> list[str]:
    """Return the words of a command line that repeat --data, --scenes and --settings.

    anywhere: whether they are read in another folder, or on another machine that sees the same disks.
    """
    words: list[str] = []
    if options.data is not None:
        words.append(f"--data={with_home(options.data).resolve() if anywhere else options.data}")
    for what in ("scenes", "settings"):
        words += [f"--{what}={text}" for text in getattr(options, what)]
    return words
