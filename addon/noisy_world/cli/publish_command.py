# SPDX-License-Identifier: GPL-3.0-or-later
"""`publish`: pack a finished dataset as tars, with tables that describe it, at an address or in a folder."""

import argparse

from .ending import ended
from .entry import Entry
from .parser import Parser
from .places import path, place


def main(arguments: list[str], entry: Entry) -> int:
    """Run the command line and return the exit status."""
    options = parse_arguments(arguments, entry)
    return ended(lambda: pack(options), entry, stopped="finished tars stay, and the same command continues from there")


def pack(options: argparse.Namespace) -> int:
    """Pack the dataset, and print what was written."""
    from ..storage.finished import read_content
    from ..storage.open_store import open_store
    from ..storage.publishing import publish
    from .running import listener

    read_content(options.dataset)  # first: what is wrong with it comes before what packing needs
    progress, stop = listener("text")
    try:
        store = open_store(options.address)
        done = publish(options.dataset, store, progress, stop)
    finally:
        progress.finish()
    if done.new:
        print(f"wrote {store.text}: {done.sequences} tars, {done.frames} frames")
    else:
        print(f"{store.text}: holds this dataset already; nothing to do")
    return 0


def parse_arguments(arguments: list[str], entry: Entry) -> argparse.Namespace:
    """Parse the command line; exit with a usage line if it is wrong."""
    parser = Parser(
        prog=entry.name,
        description="Pack a finished dataset: a tar for each sequence, a table of all frames, metadata and a card.",
        epilog="The same command again goes on where it was stopped. Packing needs the extra 'cloud', into a folder "
        "too.",
    )
    parser.add_argument("dataset", metavar="DATASET", type=path, help="the folder that generate wrote")
    parser.add_argument(
        "address",
        metavar="PLACE",
        type=place,
        help="where to: s3://bucket/name, another address of fsspec's, or a folder",
    )
    return parser.parse_args(arguments)
