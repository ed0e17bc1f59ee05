# SPDX-License-Identifier: GPL-3.0-or-later
"""Publishing: a finished dataset in a folder, packed at an address."""

import threading
from dataclasses import dataclass
from pathlib import Path

from ..core.progress import Progress
from .address import Address
from .content import read_content
from .packing import pack


@dataclass(frozen=True)
class Published:
    """What publishing did. new: False where the address held the dataset. sequences, frames: how many it has."""

    new: bool
    sequences: int
    frames: int


def publish(folder: Path, address: Address, progress: Progress, stop: threading.Event) -> Published:
    """Pack the finished dataset of a folder at an address; each file's hash is checked on the way.

    Raises StorageError where the folder holds no finished dataset, where a file is not as it was written, and where the
    address cannot be written or holds another dataset; InterruptedRunError where `stop` is set.
    """
    content = read_content(folder)
    address.check()
    new = pack(content, content.read_image, address, progress, stop)
    return Published(new, len(content.sequences), sum(content.manifest["frames"].values()))
