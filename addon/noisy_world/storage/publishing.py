# SPDX-License-Identifier: GPL-3.0-or-later
"""Publishing: a finished dataset in a folder, packed at an address."""

import threading
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.datasets.dataset_state import RUN
from ..core.errors import StorageError
from ..core.progress import Progress
from ..core.regular_files import read_bytes
from .address import Address
from .content import FolderImages, read_content
from .packing import ELSEWHERE, claim, pack, remove_work, sealed_manifest


@dataclass(frozen=True)
class Publication:
    """What publishing did. new: False where the address held the dataset. sequences, frames: how many it has."""

    new: bool
    sequences: int
    frames: int


def publish(folder: Path, address: Address, progress: Progress, stop: threading.Event) -> Publication:
    """Pack the finished dataset of a folder at an address; each file's hash is checked on the way.

    Raises StorageError where the folder holds no finished dataset, where a file is not as it was written, and where the
    address cannot be written or holds another dataset; InterruptedRunError where `stop` is set.
    """
    content = read_content(folder)
    address.check()
    found = Publication(True, len(content.sequences), sum(content.manifest["frames"].values()))
    sealed = sealed_manifest(address)
    if sealed is not None:
        if sealed != content.manifest:
            remedy = "a dataset at an address does not grow: choose another address"
            raise StorageError(f"{address.text}: holds another dataset, which is finished; {remedy}")
        remove_work(address)
        return replace(found, new=False)
    if claim(address, content.identity, None) != {"identity": content.identity, "chosen": None}:
        raise StorageError(f"{address.text}: another dataset is being made there; {ELSEWHERE}")
    pack(content, FolderImages(content), address, progress, stop, beside=lambda: _run_text(folder))
    return found


def _run_text(folder: Path) -> dict[str, bytes]:
    """Return what the run that made a dataset took, where the folder says it."""
    path = folder / RUN
    return {RUN: read_bytes(path)} if path.is_file() else {}
