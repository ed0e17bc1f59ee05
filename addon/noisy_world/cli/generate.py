# SPDX-License-Identifier: GPL-3.0-or-later
"""`generate`: make the dataset that a preset describes."""

import argparse
from functools import partial
from typing import TYPE_CHECKING

from ..core.extras import need
from .arguments import (
    add_executor_options,
    add_preset_options,
    add_progress_option,
    out_address,
    out_folder,
    positive,
    preset_words,
    settled,
)
from .command import Command
from .entry import Entry
from .listing import HELD, KNOWN, list_known, list_plan, print_plan
from .missing import blender_lacks, blender_problem
from .outcome import tell_outcome
from .parser import Parser
from .part import planned
from .running import work_on

if TYPE_CHECKING:
    from pathlib import Path
    from threading import Event

    from ..core.planning.plan import Plan
    from ..core.progress import Progress
    from ..pipeline.report import Report


def _generate_options(parser: Parser) -> None:
    add_preset_options(parser)
    parser.add_argument("--overwrite", action="store_true", help="replace the dataset that is in DIR")
    parser.add_argument("--dry-run", action="store_true", help="print what would be done, and do nothing")
    parser.add_argument(
        "--list",
        metavar="WHAT",
        nargs="?",
        const="sequences",
        choices=[*KNOWN, *HELD],
        help="list keys (all that a preset may have), layouts (of the files), channels (the images of a frame), "
        "perturbations (with their parameters and severities), presets (those shipped), or this preset's scenes, "
        "settings or sequences (default); then end",
    )
    message = "processes that render (default: 1); no more than there are processors and frames"
    add_executor_options(parser, "shard", 1, message, cpus=2)
    parser.add_argument(
        "--shards",
        metavar="N",
        type=positive,
        help="with --ray: about how many shards, at least one a render (default: of two minutes each, by the estimate)",
    )
    add_progress_option(parser)


def _settle_generate(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    return settled(parser, options, known=options.list in KNOWN or options.worker)


def _generate(options: argparse.Namespace, entry: Entry) -> int:
    """Carry out the options."""
    if options.worker:
        from .shard_tasks import ready_for_shards

        return work_on(ready_for_shards)
    if options.list in KNOWN:
        return list_known(options.list)
    plan = planned(options)
    if options.list:
        return list_plan(plan, options.list)
    if options.dry_run:
        print_plan(plan, out_address(options) or out_folder(options))
        need_packages(plan, options, entry)
        return 0
    return generate(plan, options, entry)


def generate(plan: "Plan", options: argparse.Namespace, entry: Entry) -> int:
    """Make the dataset, and print the outcome."""
    from .as_video import is_video
    from .running import listener
    from .shard_tasks import make_dataset

    progress, stop = listener(options.progress)
    if (address := out_address(options)) is None and is_video(out_folder(options)):
        return generate_videos(plan, options, entry, progress, stop)
    report = make_dataset(plan, options, entry, progress, stop, partial(need_blender, plan, entry))
    for written in [address] if address else _written(plan, out_folder(options)):
        print(f"wrote {written}")
    tell_outcome(report, options)
    return 0


def _written(plan: "Plan", out: "Path") -> list["Path"]:
    """Return what of a dataset in a folder is told: the sequences' folders and the contact sheet."""
    folders = [out / sequence.folder for sequence in plan.sequences if sequence.frames]
    return [*folders, *([out / "overview.png"] if plan.preset.spec.output.overview else [])]


def generate_videos(
    plan: "Plan", options: argparse.Namespace, entry: Entry, progress: "Progress", stop: "Event"
) -> int:
    """Make videos of the sequences' colour, and print the outcome."""
    from .as_video import make_videos, videos_of
    from .shard_tasks import make_dataset

    out = out_folder(options)
    videos = videos_of(plan, out, overwrite=options.overwrite)
    reports: list[Report] = []
    need = partial(need_blender, plan, entry)
    make_videos(
        plan,
        videos,
        lambda folder: reports.append(make_dataset(plan, options, entry, progress, stop, need, folder=folder)),
    )
    for path in videos.values():
        print(f"wrote {path}")
    tell_outcome(reports[0], options)
    return 0


def need_blender(plan: "Plan", entry: Entry) -> None:
    """Raise MissingDependencyError where a plan's frames cannot be made for want of Blender."""
    from ..core.errors import MissingDependencyError

    if plan.needs_blender and (problem := blender_problem(entry)):
        raise MissingDependencyError(problem + _without_blender(plan))


def _without_blender(plan: "Plan") -> str:
    """Return what makes a plan's frames without Blender, as the end of a line; "" where nothing does."""
    if not plan.renders_in_blender:
        return "; or add --set render.backend=reference, which needs no Blender"
    capabilities = [scene.source.capabilities for scene in plan.scenes]
    if any(
        item.rendered and item.own is not None for item in capabilities
    ):  # only Blender knows their materials and lights
        return ""
    backend = " render.backend=reference" if plan.composites else ""
    return f"; or add --set render.engine=embree{backend}, which needs no Blender but the extra embree"


def need_packages(plan: "Plan", options: argparse.Namespace, entry: Entry) -> None:
    """Raise NoisyWorldError where a package, a library or memory that a run needs is missing. Starts nothing."""
    from ..core.errors import MissingDependencyError
    from ..core.planning.memory import check_memory

    if options.ray is None:
        check_memory(plan)
    if plan.needs_blender and (problem := blender_lacks(entry)):
        raise MissingDependencyError(problem + _without_blender(plan))
    if "embree" in plan.engines:
        from ..rays.embree import embree_version

        embree_version()
    if (address := out_address(options)) is not None:
        from ..storage.frame_table import need_writer
        from ..storage.open_store import open_store

        need_writer(open_store(address))
    if options.ray is not None:
        need(["ray"], "cluster", for_what="--ray")


def _again(options: argparse.Namespace, _: list[str]) -> list[str] | None:
    """Return the arguments that repeat a run whose preset and folder are named."""
    if options.preset is None or options.out is None:
        return None
    words = preset_words(options)
    words += ["--jobs", str(options.jobs)] if options.jobs > 1 else []
    if options.ray is not None:
        words += ["--ray", options.ray, "--cpus", str(options.cpus)]
        words += ["--shards", str(options.shards)] if options.shards is not None else []
    return words


GENERATE = Command(
    name="generate",
    group="make a dataset",
    help="make the RGB-D dataset that a preset describes",
    description="Make the RGB-D dataset that a preset describes.",
    epilog="The same command again resumes a run that was stopped: finished frames are kept, and the result is the "
    "same to the byte. In a Blender program: blender -b -P headless/generate.py -- PRESET [options].",
    options=_generate_options,
    settle=_settle_generate,
    run=_generate,
    again=_again,
)
