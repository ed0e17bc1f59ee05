# SPDX-License-Identifier: GPL-3.0-or-later
"""`shard`: make one shard of the dataset that a preset describes, on any machine that sees the dataset's folder."""

import argparse
from typing import TYPE_CHECKING

from .arguments import add_preset_options, out_address, out_folder, positive, preset_words, settled
from .ending import CONTINUES, ended
from .entry import BUSY, Entry
from .generate import need_blender
from .outcome import tell_outcome
from .parser import Parser
from .part import planned

if TYPE_CHECKING:
    from ..core.planning.plan import Plan
    from ..core.planning.shards import Shard


def main(arguments: list[str], entry: Entry) -> int:
    """Run the command line and return the exit status."""
    options = parse(arguments, entry)
    again = entry.pasteable([*preset_words(options), "--shard", options.shard])
    return ended(lambda: do(options, entry), entry, stopped=f"{CONTINUES}:\n  {again}", busy=BUSY, options=options)


def parse(arguments: list[str], entry: Entry) -> argparse.Namespace:
    """Parse the command line; exit with a usage line if it is wrong."""
    parser = Parser(
        prog=entry.name,
        description="Make one shard of a dataset: a range of source frames of one render, with every image that shows "
        "them. 'noisy-world plan PRESET --shards N' prints the commands, 'noisy-world merge' puts shards together.",
        epilog="The same command again resumes a shard that was stopped; of a finished one it checks every file.",
    )
    add_preset_options(parser)
    parser.add_argument(
        "--shard", metavar="NAME", required=True, type=shard_name, help="the shard, such as room0.000000-000100"
    )
    parser.add_argument(
        "--threads", metavar="N", type=positive, default=0, help="threads of the renderer (default: all there are)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace what is finished of the shard")
    parser.add_argument("--progress", choices=["text", "json"], default="text", help="as for generate")
    return settled(parser, parser.parse_args(arguments))


def shard_name(text: str) -> str:
    """Check the name of a shard."""
    from ..core.planning.shards import Shard

    try:
        return Shard.parse(text).name
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def do(options: argparse.Namespace, entry: Entry) -> int:
    """Make the shard, and print the outcome."""
    from ..core.planning.shards import Shard, render_of

    plan = planned(options)
    shard = Shard.parse(options.shard)
    render_of(plan, shard)
    need_blender(plan.only(render_of(plan, shard)), entry)
    if out_address(options) is not None:
        return make_there(plan, shard, options)
    return make(plan, shard, options)


def make(plan: "Plan", shard: "Shard", options: argparse.Namespace) -> int:
    """Make the shard in its folder in the dataset."""
    from ..core.datasets.dataset import Dataset
    from ..pipeline.shard import ShardMaker, shard_folder
    from .running import listener

    progress, stop = listener(options.progress)
    folder = shard_folder(out_folder(options), shard)
    there = Dataset(out_folder(options), plan.format)
    with ShardMaker(plan, progress=progress, stop=stop, threads=options.threads) as maker:
        maker.check_dataset(there, shard)
        report = maker.make(folder, shard, there, overwrite=options.overwrite)
    print(f"wrote {folder}")
    tell_outcome(report, options)
    return 0


def make_there(plan: "Plan", shard: "Shard", options: argparse.Namespace) -> int:
    """Make the shard in the scratch folder, and put it to the address."""
    from ..core.errors import StorageError
    from .at_address import run_at, told_of
    from .running import listener

    if options.overwrite:
        raise StorageError("--overwrite replaces shards in folders; remove the shard's .json at the address")
    progress, stop = listener(options.progress)
    run = run_at(plan, options, progress, stop)
    return told_of(run.make_shard(shard, threads=options.threads), options)
