# SPDX-License-Identifier: GPL-3.0-or-later
"""`plan`: print what a preset comes to, or the commands that make its dataset in shards."""

import argparse
import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.progress import duration_text
from .arguments import add_preset_options, out_address, out_folder, positive, settled
from .command import Command
from .command_lines import merge_words, shard_beginning, shard_words
from .entry import Entry
from .listing import print_plan
from .parser import Parser
from .part import planned

MERGED_BYTES_PER_S = 1e8  # of a shared disk with a file for each frame: low, so that the merging job is not ended early

if TYPE_CHECKING:
    from ..core.planning.plan import Plan
    from ..executors.jobs import Task


def _plan(options: argparse.Namespace, _: Entry) -> int:
    """Plan, and print what was asked for."""
    plan = planned(options)
    if options.shards is None:
        print_plan(plan, out_address(options) or out_folder(options))
        return 0
    return _print_shards(plan, options)


def _plan_options(parser: Parser) -> None:
    add_preset_options(parser)
    parser.add_argument(
        "--shards", metavar="N", type=positive, help="about how many shards, of equal cost; at least one a render"
    )
    parser.add_argument("--format", choices=["text", "json"], default="text", help="how shards are printed")
    parser.add_argument(
        "--slurm",
        action="store_true",
        help="print the shards as a bash script for Slurm instead, which submits them and a job that merges them",
    )
    parser.add_argument(
        "--cpus", metavar="N", type=positive, default=2, help="with --slurm: processors for each shard (default: 2)"
    )


def _settle_plan(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    if options.slurm and options.shards is None:
        parser.error("--slurm needs --shards N")
    return settled(parser, options)


def _print_shards(plan: "Plan", options: argparse.Namespace) -> int:
    """Print the shards, each with its command, and the command that merges them."""
    from ..core.planning.shards import shards_of
    from .shard_tasks import tasks_of

    tasks = tasks_of(plan, shards_of(plan, options.shards))
    merging = merge_words(options, options.shards)
    if options.slurm:
        print(_slurm(plan, options, tasks), end="")
        return 0
    if options.format == "json":
        listed = [
            {"name": task.name, "command": shard_words(options, task), "seconds": round(task.seconds, 1)}
            for task in tasks
        ]
        print(json.dumps({"shards": listed, "merge": merging}, indent=1))
        return 0
    for task in tasks:
        print(shlex.join(shard_words(options, task)))
    longest = duration_text(max((task.seconds for task in tasks), default=0.0))
    print(f"# {len(tasks)} shards, {longest} each at most on two cores (rough); when all have ended:")
    print(f"# {shlex.join(merging)}")
    return 0


def _slurm(plan: "Plan", options: argparse.Namespace, tasks: "tuple[Task, ...]") -> str:
    """Return the script for Slurm. tasks: the shards, with what each takes on two cores."""
    from ..core.planning.estimate import estimate
    from ..executors.slurm import SlurmJob, slurm_script

    job = SlurmJob(
        name=f"noisy-{options.preset.stem}",
        folder=Path.cwd(),
        shards=[replace(task, seconds=task.seconds * 2 / min(options.cpus, 2)) for task in tasks],
        shard=shard_beginning(options, "--threads", str(options.cpus)),
        merge=merge_words(options, options.shards),
        merge_s=estimate(plan).bytes_written / MERGED_BYTES_PER_S,
        cpus=options.cpus,
    )
    return slurm_script(job)


PLAN = Command(
    name="plan",
    group="make a dataset",
    help="print what a preset comes to, or the commands that make it in shards",
    description="Print what a preset comes to; with --shards the commands that make its dataset in shards, one a "
    "line, in any order and on any machines that see the dataset's folder, and last the one that merges them.",
    options=_plan_options,
    settle=_settle_plan,
    run=_plan,
)
