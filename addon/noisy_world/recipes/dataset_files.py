# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of a dataset that is held against a recipe: in a folder, or in the tars of a packed dataset."""

import os
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

from ..core.datasets.dataset_state import MANIFEST, OVERVIEW, RUN, WORK_FOLDER, DatasetState, read_dataset_state
from ..core.datasets.records import FRAMES, FrameRecord, joined_records, read_records
from ..core.datasets.storage import sha256_of_regular_file
from ..core.errors import InputError, InterruptedRunError
from ..core.machine import available_threads
from ..storage.card import CARD
from ..storage.croissant import CROISSANT
from ..storage.frame_table import TABLE
from ..storage.packed import Packed, file_sha256, wrong_descriptions
from ..storage.packed_tar import TarContent, tar_contents
from ..storage.sequence_tar import TAR_SUFFIX, tar_name
from .findings import DAMAGED, MISSING

WAITING = 256  # files that are hashed ahead; more would only take memory


class SequenceFiles(Protocol):
    """The files of a sequence. Their names are relative to its folder."""

    def records(self) -> dict[int, FrameRecord]:
        """Return what its frames.jsonl says, by frame."""
        ...

    def digests(self, names: list[str]) -> Iterator[str | None]:
        """Yield the SHA-256 of files; None for one that is not there."""
        ...

    def names(self) -> set[str]:
        """Return the names of all files."""
        ...

    def damaged_whole(self) -> str:
        """Return the name of the tar that holds the files where it is not as it was written; "" without one."""
        ...


class DatasetFiles(Protocol):
    """The files of a dataset. standing: what it is."""

    standing: DatasetState

    def has(self, sequence: str) -> bool:
        """Tell whether there is a folder or a tar of a sequence."""
        ...

    def recorded(self) -> set[str]:
        """Return the sequences that are there whole, as far as names tell."""
        ...

    def each(self, sequences: list[str], stop: threading.Event) -> Iterator[tuple[str, SequenceFiles]]:
        """Yield some sequences that are there with their files, in order.

        Raises InterruptedRunError where `stop` is set.
        """
        ...

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file beside the sequences, None where it is not there; after `each`."""
        ...

    def own_problems(self) -> Iterator[tuple[str, str]]:
        """Yield what is missing or damaged of the files that describe the dataset: which of both, and the name."""
        ...

    def beside(self, sequences: set[str]) -> set[str]:
        """Return the files that lie in no sequence of these, nor in a working folder, nor describe the dataset."""
        ...


# --- in a folder ---


class FolderFiles:
    """The files of a dataset in a folder. One with several names is hashed once."""

    def __init__(self, folder: Path) -> None:
        """Look at the folder. Raises InputError where it holds no dataset."""
        standing = read_dataset_state(folder)
        if standing is None:
            problem, remedy = "holds no dataset of Noisy World", "name the folder that has a manifest.json"
            raise InputError(folder, problem, remedy=remedy)
        self.standing = standing
        self._folder = folder
        self._linked: dict[tuple[int, int], str | None] = {}

    def has(self, sequence: str) -> bool:
        """Tell whether there is a folder of a sequence."""
        return (self._folder / sequence).is_dir()

    def recorded(self) -> set[str]:
        """Return the sequences whose frames.jsonl is there."""
        return {path.parent.relative_to(self._folder).as_posix() for path in self._folder.glob(f"*/*/{FRAMES}")}

    def each(self, sequences: list[str], stop: threading.Event) -> Iterator[tuple[str, SequenceFiles]]:
        """Yield some sequences with their files, which are hashed in threads."""
        with ThreadPoolExecutor(available_threads()) as pool:
            for name in sequences:
                if stop.is_set():
                    raise InterruptedRunError("stopped; nothing was written, and verify begins at the beginning")
                yield name, _SequenceInFolder(self._folder / name, pool, self.digest_of)

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file, None where it is not there."""
        return sha256_of_regular_file(self._folder / name)

    def digest_of(self, path: Path) -> str | None:
        """Return the SHA-256 of an image, None where it is not there."""
        try:
            status = path.stat()
        except OSError:
            return None
        key = (status.st_dev, status.st_ino)
        if status.st_nlink == 1:
            return sha256_of_regular_file(path)
        if key not in self._linked:
            self._linked[key] = sha256_of_regular_file(path)
        return self._linked[key]

    def own_problems(self) -> Iterator[tuple[str, str]]:
        """Yield the manifest, where it is missing."""
        if self.standing.manifest is None:
            yield MISSING, MANIFEST

    def beside(self, sequences: set[str]) -> set[str]:
        """Return the files that lie in no sequence of these and not in a run's working folder."""
        found: set[str] = set()
        for base, folders, names in os.walk(self._folder):
            here = Path(base).relative_to(self._folder)
            inside = [name for name in folders if (here / name).as_posix() not in sequences]
            folders[:] = [name for name in inside if (here / name).as_posix() != WORK_FOLDER]
            found |= {(here / name).as_posix() for name in names}
        return found - {MANIFEST, RUN, OVERVIEW}


class _SequenceInFolder:
    def __init__(self, folder: Path, pool: ThreadPoolExecutor, digest: Callable[[Path], str | None]) -> None:
        self._folder = folder
        self._pool = pool
        self._digest = digest

    def records(self) -> dict[int, FrameRecord]:
        return joined_records(read_records(self._folder / FRAMES))

    def digests(self, names: list[str]) -> Iterator[str | None]:
        for at in range(0, len(names), WAITING):
            yield from self._pool.map(self._digest, [self._folder / name for name in names[at : at + WAITING]])

    def names(self) -> set[str]:
        walked = ((Path(base), names) for base, _, names in os.walk(self._folder))
        return {(base / name).relative_to(self._folder).as_posix() for base, names in walked for name in names}

    def damaged_whole(self) -> str:
        return ""


# --- packed ---


class PackedFiles:
    """The files of a packed dataset. Each tar is read once, from its beginning to its end."""

    def __init__(self, packed: Packed) -> None:
        """List the files."""
        self.standing = packed.standing
        self._packed = packed
        self._sizes = packed.address.sizes("")
        self._beside: dict[str, str] = {}  # of the text files beside the sequences, which several tars hold

    def has(self, sequence: str) -> bool:
        """Tell whether there is a tar of a sequence."""
        return tar_name(sequence) in self._sizes

    def recorded(self) -> set[str]:
        """Return the sequences whose tar is there."""
        tars = (name for name in self._sizes if name.endswith(TAR_SUFFIX) and not name.startswith(f"{WORK_FOLDER}/"))
        return {name.removesuffix(TAR_SUFFIX) for name in tars if name.count("/") == 1}

    def each(self, sequences: list[str], stop: threading.Event) -> Iterator[tuple[str, SequenceFiles]]:
        """Yield some sequences with what their tars hold."""
        for name, content in tar_contents(self._packed.address, sequences, self._sizes, stop):
            for text, digest in content.beside(name).items():
                if self._beside.get(text) in (None, self.standing.files.get(text)):
                    self._beside[text] = digest  # of several, one that is not as it was written stays
            yield name, _SequenceInTar(name, content, self._packed)

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file beside the sequences, as the tars hold it; None where none does."""
        if name == OVERVIEW and name in self._sizes:
            return file_sha256(self._packed.address, name, self._sizes[name])
        return self._beside.get(name)

    def own_problems(self) -> Iterator[tuple[str, str]]:
        """Yield what is missing or damaged of the table, the metadata and the card."""
        lost, damaged = wrong_descriptions(self._packed, self._sizes, check=True)
        yield from ((MISSING, name) for name in lost)
        yield from ((DAMAGED, name) for name in damaged)

    def beside(self, sequences: set[str]) -> set[str]:
        """Return the files that are no tars of these sequences, and what else tars hold beside them."""
        known = {MANIFEST, RUN, OVERVIEW, TABLE, CROISSANT, CARD, *map(tar_name, sequences)}
        files = {name for name in self._sizes if not name.startswith(f"{WORK_FOLDER}/")}
        return (files - known) | self._beside.keys()


class _SequenceInTar:
    def __init__(self, name: str, content: TarContent, packed: Packed) -> None:
        self._name = name
        self._content = content
        self._files: Mapping[str, str] = content.of_layout(name)
        self._packed = packed

    def records(self) -> dict[int, FrameRecord]:
        return self._content.records

    def digests(self, names: list[str]) -> Iterator[str | None]:
        return map(self._files.get, names)

    def names(self) -> set[str]:
        return set(self._files)

    def damaged_whole(self) -> str:
        tar = tar_name(self._name)
        told = self._packed.described.get(tar)
        return tar if told is not None and told.sha256 != self._content.sha256 else ""
