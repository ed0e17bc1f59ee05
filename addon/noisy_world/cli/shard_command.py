# SPDX-License-Identifier: GPL-3.0-or-later
"""`shard`: make shards of the dataset that a preset describes, on any machine that sees the dataset's folder."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING

from ..core.exit_statuses import BUSY
from .arguments import add_preset_options, add_progress_option, out_address, positive, preset_words, settled
from .command import Command
from .destinations import destination_of
from .entry import Entry
from .generate import need_blender
from .outcome import tell_outcome
from .parser import Parser
from .part import planned

if TYPE_CHECKING:
    from ..core.progress import Progress


def _shard_options(parser: Parser) -> None:
    add_preset_options(parser)
    parser.add_argument(
        "--shard",
        metavar="NAME",
        nargs="+",
        required=True,
        type=_shard_name,
        help="the shards, such as room0.000000-000100",
    )
    parser.add_argument(
        "--threads", metavar="N", type=positive, default=0, help="threads of the renderer (default: all there are)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace what is finished of the shard")
    add_progress_option(parser)


def _shard_name(text: str) -> str:
    """Check the name of a shard."""
    from ..core.planning.shards import Shard

    try:
        return Shard.parse(text).name
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _make_shards(options: argparse.Namespace, entry: Entry) -> int:
    """Make the shards, and print the outcome of each. Of several, the others are made where one cannot be."""
    from ..core.datasets.shard_record import shard_folder
    from ..core.planning.shards import Shard, render_of
    from ..executors.jobs import InProcess, Job, Perform, TaskOutcome, carry_out
    from ..pipeline.report import Report
    from .running import listener
    from .shard_tasks import tasks_of

    shards = tuple(map(Shard.parse, options.shard))
    plan = planned(options, shards)
    for render in {render_of(plan, shard).name: render_of(plan, shard) for shard in shards}.values():
        need_blender(plan.only(render), entry)
    progress, stop = listener(options.progress)
    place = destination_of(plan, options)

    @contextmanager
    def ready(_: str, heard: "Progress") -> Iterator[Perform]:
        with place.making(heard, stop, threads=options.threads, overwrite=options.overwrite) as make:
            yield lambda name: asdict(make(Shard.parse(name)))

    def done(outcome: TaskOutcome) -> None:
        print(f"wrote {out_address(options) or shard_folder(place.folder, Shard.parse(outcome.name))}")
        tell_outcome(Report(**(outcome.report or {})), options)

    job = Job("shards", "made", "shard", "", tasks_of(plan, shards))
    carry_out(job, InProcess(ready, goes_on=len(shards) > 1), done, progress, stop)
    return 0


SHARD = Command(
    name="shard",
    group="make a dataset",
    help="make one shard of a dataset, on any machine that sees its folder",
    description="Make shards of a dataset, one after another: each is a range of source frames of one render, with "
    "every image that shows them. 'noisy-world plan PRESET --shards N' prints the commands, 'noisy-world merge' "
    "puts shards together.",
    epilog="The same command again resumes a shard that was stopped; of a finished one it checks every file. Where "
    "one of several cannot be made, the others are.",
    options=_shard_options,
    settle=settled,
    run=_make_shards,
    again=lambda options, _: [*preset_words(options), "--shard", *options.shard],
    busy=BUSY,
)
