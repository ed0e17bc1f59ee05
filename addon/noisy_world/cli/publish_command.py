# SPDX-License-Identifier: GPL-3.0-or-later
"""`publish`: pack a finished dataset as tars, with tables that describe it, at an address or in a folder."""

import argparse

from .command import Command
from .entry import Entry
from .parser import Parser
from .places import path, place


def _publish(options: argparse.Namespace, _: Entry) -> int:
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


def _publish_options(parser: Parser) -> None:
    parser.add_argument("dataset", metavar="DATASET", type=path, help="the folder that generate wrote")
    parser.add_argument(
        "address",
        metavar="PLACE",
        type=place,
        help="where to: s3://bucket/name, another address of fsspec's, or a folder",
    )


PUBLISH = Command(
    name="publish",
    group="share a dataset, and make it again",
    help="pack a finished dataset as tars, in an object store or a folder",
    description="Pack a finished dataset: a tar for each sequence, a table of all frames, metadata and a card.",
    epilog="The same command again goes on where it was stopped. Packing needs the extra 'cloud', into a folder too.",
    options=_publish_options,
    run=_publish,
    stopped="finished tars stay, and the same command continues from there",
)
