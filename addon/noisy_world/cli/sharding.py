# SPDX-License-Identifier: GPL-3.0-or-later
"""`plan`, `shard`, `merge`: a dataset made in shards by any number of machines."""

import argparse
import json
import shlex
import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import BUSY, StorageError
from ..core.progress import duration_text
from .arguments import (
    Parser,
    add_preset_options,
    add_progress_option,
    destination_of,
    out_address,
    out_folder,
    planned,
    positive,
    preset_words,
    settled,
)
from .command import PROGRAM, Command
from .entry import Entry, listener
from .generate import need_blender, tell_outcome
from .plan_text import print_plan

if TYPE_CHECKING:
    from ..core.errors import StorageError
    from ..core.progress import Progress
    from ..dataset.plan import Plan
    from ..dataset.run import Work
    from ..dataset.shards import Shard
    from ..executors.jobs import Task


def shard_words(options: argparse.Namespace, shard: "Shard | Task") -> list[str]:
    """Return the command that makes a shard. options: those that name the dataset."""
    return [*shard_beginning(options), shard.name]


def shard_beginning(options: argparse.Namespace, *more: str) -> list[str]:
    """Return the command that makes shards, whose names come last. more: options of it."""
    return [*_own_words(), "shard", *preset_words(options, anywhere=True), *more, "--shard"]


def merge_words(options: argparse.Namespace, count: int | None = None) -> list[str]:
    """Return the command that merges shards. count: into how many the plan was cut."""
    cut = [] if count is None else ["--shards", str(count)]
    return [*_own_words(), "merge", *preset_words(options, anywhere=True), *cut]


def shard_lines(options: argparse.Namespace, shards: Iterable["Shard"]) -> Iterator[str]:
    """Yield a line for each shard."""
    return (shlex.join(shard_words(options, shard)) for shard in shards)


def _own_words() -> list[str]:
    """Return the command, or how this Python starts it where the shell does not find it."""
    return [PROGRAM] if shutil.which(PROGRAM) else [sys.executable, "-m", "noisy_world"]


# --- `plan` ---


MERGED_BYTES_PER_S = 1e8  # of a shared disk with a file for each frame: low, so that the merging job is not ended early


def _plan(options: argparse.Namespace, _: Entry) -> int:
    """Plan, and print what was asked for."""
    plan = planned(options)
    if options.shards is None:
        print_plan(plan, out_address(options) or out_folder(options))
        return 0
    return _print_shards(plan, options)


def _plan_options(parser: Parser) -> None:
    add_preset_options(parser)
    parser.option("--shards N", "about how many shards, of equal cost; at least one a render", type=positive)
    parser.option("--format", "how shards are printed", choices=["text", "json"], default="text")
    parser.flag(
        "--slurm", "print the shards as a bash script for Slurm instead, which submits them and a job that merges them"
    )
    parser.option("--cpus N", "with --slurm: processors for each shard (default: 2)", type=positive, default=2)


def _settle_plan(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    if options.slurm and options.shards is None:
        parser.error("--slurm needs --shards N")
    return settled(parser, options)


def _print_shards(plan: "Plan", options: argparse.Namespace) -> int:
    """Print the shards, each with its command, and the command that merges them."""
    from ..dataset.shards import shards_of
    from .shard_workers import tasks_of

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
    from ..dataset.estimate import estimate
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
    order=20,
    group="make a dataset",
    help="print what a preset comes to, or the commands that make it in shards",
    description="Print what a preset comes to; with --shards the commands that make its dataset in shards, one a "
    "line, in any order and on any machines that see the dataset's folder, and last the one that merges them.",
    options=_plan_options,
    settle=_settle_plan,
    run=_plan,
)


# --- `shard` ---


def _shard_options(parser: Parser) -> None:
    add_preset_options(parser)
    parser.option("--shard NAME", "the shards, such as room0.000000-000100", nargs="+", default=[], type=_shard_name)
    parser.option("--part K/N", "instead, those of the K-th of N tasks, as render farms number them", type=_part)
    parser.option("--threads N", "threads of the renderer (default: all there are)", type=positive, default=0)
    parser.flag("--overwrite", "replace what is finished of the shard")
    add_progress_option(parser)


def _shard_name(text: str) -> str:
    """Check the name of a shard."""
    from ..dataset.shards import Shard

    try:
        return Shard.parse(text).name
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _part(text: str) -> tuple[int, int]:
    """Return K and N of "K/N"."""
    first, _, count = text.partition("/")
    if not (first.isdecimal() and count.isdecimal() and 1 <= int(first) <= int(count)):
        raise argparse.ArgumentTypeError(f"{text!r} is not K/N with K from 1 to N, such as 17/200")
    return int(first), int(count)


def _settle_shard(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    if bool(options.shard) == (options.part is not None):
        parser.error("name the shards by --shard, or give --part K/N")
    return settled(parser, options)


def _asked(options: argparse.Namespace) -> "tuple[Plan, tuple[Shard, ...]]":
    """Return the shards that a command asks for, and a plan that has them."""
    from ..dataset.shards import Shard, shards_of

    if options.part is None:
        shards = tuple(map(Shard.parse, options.shard))
        return planned(options, shards), shards
    part, count = options.part
    plan = planned(options)
    return plan, shards_of(plan, count)[part - 1 :: count]


def _make_shards(options: argparse.Namespace, entry: Entry) -> int:
    """Make the shards, and print the outcome of each. Of several, the others are made where one cannot be."""
    from ..dataset.making import Report
    from ..dataset.shards import Shard, render_of, shard_folder
    from ..executors.jobs import InProcess, Job, Perform, TaskOutcome, carry_out
    from .shard_workers import tasks_of

    plan, shards = _asked(options)
    if not shards:
        print("nothing to make: the plan has fewer shards than there are parts")
        return 0
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


def _which(options: argparse.Namespace) -> list[str]:
    """Return the words that name the same shards again."""
    return ["--shard", *options.shard] if options.part is None else ["--part", "/".join(map(str, options.part))]


SHARD = Command(
    name="shard",
    order=30,
    group="make a dataset",
    help="make one shard of a dataset, on any machine that sees its folder",
    description="Make shards of a dataset, one after another: each is a range of source frames of one render, with "
    "every image that shows them. 'noisy-world plan PRESET --shards N' prints the commands, 'noisy-world merge' "
    "puts shards together. --part 17/200 is for render farms, whose tasks know their number alone.",
    epilog="The same command again resumes a shard that was stopped; of a finished one it checks every file. Where "
    "one of several cannot be made, the others are.",
    options=_shard_options,
    settle=_settle_shard,
    run=_make_shards,
    again=lambda options, _: [*preset_words(options), *_which(options)],
    busy=BUSY,
)


# --- `merge` ---


def _merge_options(parser: Parser) -> None:
    add_preset_options(parser)
    parser.option("--shards N", "into how many shards the plan was cut; missing ones are named so", type=positive)
    add_progress_option(parser)


def _merge(options: argparse.Namespace, _: Entry) -> int:
    """Merge, and print the outcome."""
    from ..dataset.run import Run

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
    from ..dataset.shards import Shard, shards_of

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
    order=40,
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

COMMAND = PLAN, SHARD, MERGE
