# SPDX-License-Identifier: GPL-3.0-or-later
"""`publish`, `recipe`, `verify`, `remake`, `render-clean`: a dataset shared, and made again from its recipe."""

import argparse
import sys
from dataclasses import replace

from ..core.errors import InputError
from ..core.progress import counted
from .arguments import Parser, add_part_options, folder, frame_slice, out_path, path, place, positive, recipe_part
from .command import Command, as_given, own_entry
from .entry import Entry, listener, say
from .generate import need_blender


def _publish(options: argparse.Namespace, _: Entry) -> int:
    """Pack the dataset, and print what was written."""
    from ..dataset.packing import publish
    from ..dataset.store import open_store
    from ..dataset.stored import finished_folder

    finished_folder(options.dataset)  # first: what is wrong with it comes before what packing needs
    progress, stop = listener("text")
    try:
        store = open_store(options.address)
        done = publish(options.dataset, store, progress, stop)
    finally:
        progress.finish()
    if done.new:
        print(f"wrote {store.text}: {counted(done.sequences, 'tar')}, {counted(done.frames, 'frame')}")
    else:
        print(f"{store.text}: holds this dataset already; nothing to do")
    return 0


def _publish_options(parser: Parser) -> None:
    parser.option("dataset DATASET", "the folder that generate wrote", type=path)
    parser.option("address PLACE", "where to: s3://bucket/name, another address of fsspec's, or a folder", type=place)


PUBLISH = Command(
    name="publish",
    order=90,
    group="share a dataset, and make it again",
    help="pack a finished dataset as tars, in an object store or a folder",
    description="Pack a finished dataset: a tar for each sequence, a table of all frames, metadata and a card.",
    epilog="The same command again goes on where it was stopped. Packing needs the extra 'cloud', into a folder too.",
    options=_publish_options,
    run=_publish,
    stopped="finished tars stay, and the same command continues from there",
)


# --- `recipe` ---


def _recipe_options(parser: Parser) -> None:
    parser.option("dataset DATASET", "the dataset's folder or address", type=place)
    parser.option("--out FILE", "the file to write (default: standard output)", type=out_path)


def _write_recipe(options: argparse.Namespace, _: Entry) -> int:
    """Write the recipe."""
    from ..core.atomic_files import ELSEWHERE, storage_errors
    from ..dataset.recipe import recipe_of
    from ..dataset.remaking import unnamed_sequences

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
    order=100,
    group="share a dataset, and make it again",
    help="write what makes a dataset, and the digests of its files",
    description="Write the recipe of a finished dataset: its preset, versions, the hashes of its inputs, and "
    "digests of its files. Images are not read; 'noisy-world verify' hashes them.",
    options=_recipe_options,
    run=_write_recipe,
)


# --- `verify` ---


def _verify_options(parser: Parser) -> None:
    parser.option("recipe RECIPE", "the recipe, from 'noisy-world recipe'", type=path)
    parser.option("dataset DATASET", "the dataset's folder or address", type=place)


def _verify(options: argparse.Namespace, _: Entry) -> int:
    """Compare, and print what differs; return 0 where all that is there is as the recipe says."""
    from ..dataset.recipe import read_recipe
    from ..dataset.remaking import verify

    progress, stop = listener("text")
    findings = verify(read_recipe(options.recipe), options.dataset, progress, stop)
    for line in [*findings.lines(), *findings.summary_lines()]:
        print(line)
    return 0 if findings.as_the_recipe else 1


VERIFY = Command(
    name="verify",
    order=110,
    group="share a dataset, and make it again",
    help="hash a dataset's files and compare them with a recipe",
    description="Hash every file of a dataset and say what is missing, damaged, extra, or not as a recipe says. A "
    "dataset with a part of the recipe's settings, scenes or frames is compared in that part.",
    options=_verify_options,
    run=_verify,
    stopped="nothing was written, and verify begins at the beginning",
)


# --- `remake` ---


def _remake_options(parser: Parser) -> None:
    parser.option("recipe RECIPE", "the recipe, from 'noisy-world recipe'", type=path)
    parser.option("--out DIR", "the dataset's folder", type=folder, required=True)
    add_part_options(parser)
    parser.option("--frames A:B", "only frames A to B-1; they keep their numbers", type=frame_slice)
    parser.option("--jobs N", "processes that render (default: 1)", type=positive, default=1)


def _remake(options: argparse.Namespace, entry: Entry) -> int:
    """Make the dataset, verify it, and return the exit status: 0 where all is as it can be here."""
    from ..dataset.recipe import read_recipe
    from ..dataset.remaking import verify
    from .generate import generate

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
    order=120,
    group="share a dataset, and make it again",
    help="make a recipe's dataset again, or a part of it, and verify it",
    description="Make a recipe's dataset again, or a part of it, from the inputs that the recipe names, and verify "
    "every file. The same command again resumes, and other parts can be added to the same folder.",
    options=_remake_options,
    run=_remake,
    again=as_given,
)


# --- `render-clean` ---


def _clean_options(parser: Parser) -> None:
    parser.option("recipe RECIPE", "the recipe, from 'noisy-world recipe'", type=path)
    parser.option("--out DIR", "the folder of clean frames", type=folder, required=True)
    add_part_options(parser)
    parser.option("--frames A:B", "only what frames A to B-1 of each sequence show", type=frame_slice)


def _render(options: argparse.Namespace, entry: Entry) -> int:
    """Render the frames, and print how many."""
    from ..dataset.clean_store import make_store, rendered
    from ..dataset.recipe import read_recipe

    recipe = read_recipe(options.recipe)
    plan = recipe_part(recipe, options)
    if not plan.renders_anything:
        raise InputError(options.recipe, "its scenes are recordings, which noisy_world.open reads as they are")
    need_blender(plan, entry)
    progress, stop = listener("text")
    made = make_store(plan, options.out, progress, stop)
    print(f"{options.out}: {counted(made, 'frame')} rendered, {rendered(plan).frame_count - made} kept")
    return 0


RENDER_CLEAN = Command(
    name="render-clean",
    order=130,
    group="share a dataset, and make it again",
    help="render the clean frames that noisy_world.open makes a recipe's frames of",
    description="Render the clean frames of a recipe into a folder, lossless, for noisy_world.open(RECIPE, "
    "clean=DIR). A frame of 1200 x 680 takes 13 MB, so a part is chosen as a rule: settings that move the camera "
    "have frames of their own. The same command again resumes, and other parts can be added.",
    options=_clean_options,
    run=_render,
    again=as_given,
)

COMMAND = PUBLISH, RECIPE, VERIFY, REMAKE, RENDER_CLEAN
