# SPDX-License-Identifier: GPL-3.0-or-later
"""`bag`: write a sequence of the layout euroc as a bag of ROS 2, without ROS."""

import argparse
from collections import Counter
from pathlib import Path

from .command import Command
from .entry import Entry
from .parser import Parser
from .places import out_path, path

STORAGES = ("mcap", "sqlite3")


def _bag_options(parser: Parser) -> None:
    parser.add_argument("sequence", metavar="SEQUENCE", type=path, help="the sequence's folder, which holds mav0")
    parser.add_argument("out", metavar="OUT", type=out_path, help="the bag, a folder that is not there yet")
    parser.add_argument("--storage", choices=STORAGES, default=STORAGES[0], help="what the bag is (default: mcap)")


def _write_bag(options: argparse.Namespace, _: Entry) -> int:
    """Write the bag beside its place, and move it there when it is whole."""
    from ..core.datasets.storage import made_beside
    from ..core.errors import StorageError
    from ..core.extras import need

    need(("rosbags",), "ros")
    if options.out.exists():
        raise StorageError("is there already", file=options.out, remedy="choose another folder, or remove it")
    with made_beside(options.out) as made:
        counts = _fill_bag(options.sequence, made, options.storage)
    said = ", ".join(f"{count} {topic}" for topic, count in counts.items())
    print(f"wrote {options.out}: {said}")
    return 0


def _fill_bag(sequence: Path, out: Path, storage: str) -> Counter[str]:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    from ..core.datasets.bag_messages import TOPICS, BagMessages

    typestore = get_typestore(Stores.ROS2_HUMBLE)
    messages = BagMessages(sequence, typestore.types)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    counts: Counter[str] = Counter()
    # Version 8 is read by Humble and later.
    with Writer(out, version=8, storage_plugin=plugin) as writer:
        connections = {name: writer.add_connection(name, kind, typestore=typestore) for name, kind in TOPICS.items()}
        for stamp_ns, topic, message in messages.in_order():
            writer.write(connections[topic], stamp_ns, typestore.serialize_cdr(message, TOPICS[topic]))
            counts[topic] += 1
    return counts


BAG = Command(
    name="bag",
    group="prepare and convert",
    help="write a sequence of the layout euroc as a bag of ROS 2",
    description="Write a sequence of the layout euroc as a bag of ROS 2: images, depth in metres, cameras, the "
    "IMU if there is one, and the true poses as transforms.",
    options=_bag_options,
    run=_write_bag,
    needs=("numpy", "cv2"),
    stopped="nothing was written",
)
