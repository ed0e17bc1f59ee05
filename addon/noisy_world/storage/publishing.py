# SPDX-License-Identifier: GPL-3.0-or-later
"""Publishing: a finished dataset in a folder, packed at an address."""

import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.datasets.dataset_state import RUN
from ..core.datasets.differences import first_difference
from ..core.progress import Progress
from ..core.regular_files import read_bytes
from .finished import read_content
from .packing import pack, take
from .store import Store


@dataclass(frozen=True)
class Publication:
    """What publishing did. new: False where the address held the dataset. sequences, frames: how many it has."""

    new: bool
    sequences: int
    frames: int


def publish(folder: Path, store: Store, progress: Progress, stop: threading.Event) -> Publication:
    """Pack the finished dataset of a folder at an address; each file's hash is checked on the way.

    Raises StorageError where the folder holds no finished dataset, where a file is not as it was written, where the
    address cannot be written or holds another dataset; BusyError where another process writes it; InterruptedRunError
    where `stop` is set.
    """
    content = read_content(folder)

    def difference(there: dict[str, Any]) -> str:
        return first_difference(there, content.identity) or ""

    def finished_otherwise(manifest: dict[str, Any]) -> str:
        return "" if manifest == content.manifest else "other frames or files"

    with store.locked():
        new = take(store, content.identity, None, difference, finished_otherwise)
        if new:
            pack(content, content, store, progress, stop, beside=lambda: _run_text(folder))
    return Publication(new, len(content.sequences), sum(content.manifest["frames"].values()))


def _run_text(folder: Path) -> dict[str, bytes]:
    """Return what the run that made a dataset took, where the folder says it."""
    path = folder / RUN
    return {RUN: read_bytes(path)} if path.is_file() else {}
