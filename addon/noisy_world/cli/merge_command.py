# SPDX-License-Identifier: GPL-3.0-or-later
"""`merge`: move the finished shards of a dataset into their places, check every file, and complete the dataset."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .arguments import add_preset_options, add_progress_option, positive, settled
from .command import Command
from .command_lines import shard_lines
from .destinations import destination_of
from .entry import Entry
from .outcome import tell_outcome
from .parser import Parser
from .part import planned

if TYPE_CHECKING:
    from ..core.errors import StorageError
    from ..core.planning.plan import Plan
    from ..core.planning.shards import Shard
    from ..pipeline.destination import Work


def _merge_options(parser: Parser) -> None:
    add_preset_options(parser)
    parser.add_argument(
        "--shards",
        metavar="N",
        type=positive,
        help="into how many shards the plan was cut; missing ones are named so",
    )
    add_progress_option(parser)


def _merge(options: argparse.Namespace, _: Entry) -> int:
    """Merge, and print the outcome."""
    from ..pipeline.run import Run
    from .running import listener

    plan = planned(options)
    out = destination_of(plan, options)
    progress, stop = listener(options.progress)

    def missing(work: "Work", left: list[Path]) -> "StorageError":
        shards = missing_shards(plan, work, options.shards)
        for line in shard_lines(options, shards):
            print(line)
        return _error(plan, str(out), work, shards, left)

    report = Run(plan, out, progress=progress, stop=stop).merge(missing)
    print(f"wrote {out}")
    tell_outcome(report, options)
    return 0


def missing_shards(plan: "Plan", work: "Work", count: int | None) -> tuple["Shard", ...]:
    """Return the shards that make missing frames: of the cut into `count`, or else as long as frames follow each other.

    work: the missing source frames by render.
    """
    from ..core.planning.shards import Shard, shards_of

    if count is not None:
        return tuple(shard for shard in shards_of(plan, count) if shard.frames_of(work.get(shard.render, ())))
    shards: list[Shard] = []
    for render in plan.renders:
        for frame in work.get(render.name, ()):
            last = shards[-1] if shards else None
            if last is not None and (last.render, last.stop) == (render.name, frame):
                shards[-1] = Shard(render.name, last.start, frame + 1)
            else:
                shards.append(Shard(render.name, frame, frame + 1))
    return tuple(shards)


def _error(plan: "Plan", out: str, work: "Work", shards: tuple["Shard", ...], left: list[Path]) -> "StorageError":
    from ..core.errors import StorageError

    count = sum(map(len, work.values()))
    names = ", ".join(shard.name for shard in shards[:3]) + (f" and {len(shards) - 3} more" * (len(shards) > 3))
    begun = f"; {len(left)} shards are unfinished or under way" if left else ""
    return StorageError(
        f"{count} of {plan.frame_count} source frames are missing{begun}",
        file=out,
        remedy=f"make the shards {names} (the commands are on standard output), and merge again",
    )


MERGE = Command(
    name="merge",
    group="make a dataset",
    help="merge the shards of a dataset, and complete it",
    description="Merge the finished shards of a dataset, check every file, and complete the dataset. Where frames "
    "are missing, the commands that make them are printed, and the exit status is 1.",
    epilog="Nothing is lost when it is stopped; the same command again continues.",
    options=_merge_options,
    settle=settled,
    run=_merge,
    stopped="what was merged stays, and the same command continues from there",
)
