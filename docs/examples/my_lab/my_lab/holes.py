# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world holes`: how much of a dataset's depth is void."""

import argparse
from pathlib import Path

import noisy_world
from noisy_world.extend import Command, Entry


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=Path, help="the dataset's folder")


def run(options: argparse.Namespace, entry: Entry) -> int:
    """Print a line for each sequence."""
    for name, sequence in noisy_world.open(options.dataset).items():
        shares = [float((frame.depth_m == 0).mean()) for frame in sequence]
        print(f"{name}: {sum(shares) / len(shares):.1%} void")
    return 0


COMMAND = Command(
    name="holes",
    group="look at what there is",
    help="say how much of a dataset's depth is void",
    description="Say how much of a dataset's depth is void, sequence by sequence.",
    options=add_options,
    run=run,
)
