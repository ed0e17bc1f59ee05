# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of a dataset, hashed: in a folder, or in the tars of a packed dataset."""

import os
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TypeAlias

from ..core.datasets.dataset_state import MANIFEST, OVERVIEW, RUN, WORK_FOLDER, read_dataset_state
from ..core.datasets.hashing import Hasher
from ..core.datasets.records import FRAMES, FrameRecord, joined_records, read_records
from ..core.errors import InputError, InterruptedRunError
from .finished import NOTHING, Packed, is_packed, open_packed
from .packed_names import CARD, CROISSANT, TABLE, TAR_SUFFIX, tar_name
from .packed_tar import TarContent, tar_contents

# --- in a folder ---


class FolderFiles:
    """The files of a dataset in a folder. state: what it is. A file with several names is hashed once."""

    def __init__(self, folder: Path) -> None:
        """Look at the folder. Raises InputError where it holds no dataset."""
        state = read_dataset_state(folder)
        if state is None:
            raise InputError(folder, NOTHING, remedy="name the folder that has a manifest.json")
        self.state = state
        self._folder = folder
        self._hasher = Hasher()

    def has(self, sequence: str) -> bool:
        """Tell whether there is a folder of a sequence."""
        return (self._folder / sequence).is_dir()

    def recorded(self) -> set[str]:
        """Return the sequences whose frames.jsonl is there."""
        return {path.parent.relative_to(self._folder).as_posix() for path in self._folder.glob(f"*/*/{FRAMES}")}

    def each(self, sequences: list[str], stop: threading.Event) -> Iterator[tuple[str, "SequenceInFolder"]]:
        """Yield some sequences with their files, which are hashed in threads."""
        for name in sequences:
            if stop.is_set():
                raise InterruptedRunError("stopped; nothing was written, and verify begins at the beginning")
            yield name, SequenceInFolder(self._folder / name, self._hasher)

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file, None where it is not there."""
        return self._hasher.sha256(self._folder / name)

    def own_problems(self) -> tuple[list[str], list[str]]:
        """Return the manifest, where it is missing."""
        return [MANIFEST] if self.state.manifest is None else [], []

    def beside(self, sequences: set[str]) -> set[str]:
        """Return the files that lie in no sequence of these and not in a run's working folder."""
        found: set[str] = set()
        for base, folders, names in os.walk(self._folder):
            here = Path(base).relative_to(self._folder)
            inside = [name for name in folders if (here / name).as_posix() not in sequences]
            folders[:] = [name for name in inside if (here / name).as_posix() != WORK_FOLDER]
            found |= {(here / name).as_posix() for name in names}
        return found - {MANIFEST, RUN, OVERVIEW}


class SequenceInFolder:
    """The files of a sequence in a folder. Their names are relative to it."""

    def __init__(self, folder: Path, hasher: Hasher) -> None:
        self._folder = folder
        self._hasher = hasher

    def records(self) -> dict[int, FrameRecord]:
        """Return what its frames.jsonl says, by frame."""
        return joined_records(read_records(self._folder / FRAMES))

    def digests(self, names: list[str]) -> Iterator[str | None]:
        """Yield the SHA-256 of files; None for one that is not there."""
        return self._hasher.ahead(f"{self._folder}/{name}" for name in names)

    def names(self) -> set[str]:
        """Return the names of all files."""
        walked = ((Path(base), names) for base, _, names in os.walk(self._folder))
        return {(base / name).relative_to(self._folder).as_posix() for base, names in walked for name in names}

    def damaged_whole(self) -> str:
        """Return "": nothing holds the files."""
        return ""


# --- packed ---


class PackedFiles:
    """The files of a packed dataset. state: what it is. Each tar is read once, from its beginning to its end."""

    def __init__(self, packed: Packed, *, check: bool = True) -> None:
        """List the files. check: whether to hash the table; else its size is compared."""
        self.state = packed.state
        self._packed = packed
        self._check = check
        self._sizes = packed.store.sizes("")
        self._beside: dict[str, str] = {}  # of the text files beside the sequences, which several tars hold

    def has(self, sequence: str) -> bool:
        """Tell whether there is a tar of a sequence."""
        return tar_name(sequence) in self._sizes

    def recorded(self) -> set[str]:
        """Return the sequences whose tar is there."""
        tars = (name for name in self._sizes if name.endswith(TAR_SUFFIX) and not name.startswith(f"{WORK_FOLDER}/"))
        return {name.removesuffix(TAR_SUFFIX) for name in tars if name.count("/") == 1}

    def each(self, sequences: list[str], stop: threading.Event) -> Iterator[tuple[str, "SequenceInTar"]]:
        """Yield some sequences with what their tars hold."""
        for name, content in tar_contents(self._packed.store, sequences, self._sizes, stop):
            for text, digest in content.beside(name).items():
                if self._beside.get(text) in (None, self.state.files.get(text)):
                    self._beside[text] = digest  # of several, one that is not as it was written stays
            yield name, SequenceInTar(name, content, self._packed)

    def beside_has(self, name: str) -> bool:
        """Tell whether there is a file beside the tars."""
        return name in self._sizes

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file beside the sequences, as the tars hold it; None where none does."""
        if name == OVERVIEW and name in self._sizes:
            return self._packed.store.sha256(name, self._sizes[name])
        return self._beside.get(name)

    def own_problems(self) -> tuple[list[str], list[str]]:
        """Return what is missing or damaged of the table, the metadata and the card."""
        lost = [name for name in (TABLE, CROISSANT, CARD) if name not in self._sizes]
        damaged = [CROISSANT] if CROISSANT in self._sizes and not self._packed.described else []
        table = self._packed.described.get(TABLE)
        if table is not None and TABLE in self._sizes:
            whole = self._sizes[TABLE] == table.size
            if not whole or (self._check and self._packed.store.sha256(TABLE, table.size) != table.sha256):
                damaged.append(TABLE)
        return lost, damaged

    def beside(self, sequences: set[str]) -> set[str]:
        """Return the files that are no tars of these sequences, and what else tars hold beside them."""
        known = {MANIFEST, RUN, OVERVIEW, TABLE, CROISSANT, CARD, *map(tar_name, sequences)}
        files = {name for name in self._sizes if not name.startswith(f"{WORK_FOLDER}/")}
        return (files - known) | self._beside.keys()


class SequenceInTar:
    """The files of a sequence in its tar, by the names that they have when it is unpacked."""

    def __init__(self, name: str, content: TarContent, packed: Packed) -> None:
        self._name = name
        self._content = content
        self._files: Mapping[str, str] = content.of_layout(name)
        self._packed = packed

    def records(self) -> dict[int, FrameRecord]:
        """Return what its frames.jsonl says, by frame."""
        return self._content.records

    def digest(self, name: str, wanted: str = "") -> str | None:
        """Return the SHA-256 of a file, whatever it was to be; None where it is not there."""
        del wanted
        return self._files.get(name)

    def digests(self, names: list[str]) -> Iterator[str | None]:
        """Yield the SHA-256 of files; None for one that is not there."""
        return map(self._files.get, names)

    def names(self) -> set[str]:
        """Return the names of all files."""
        return set(self._files)

    def damaged_whole(self) -> str:
        """Return the name of the tar where it is not as it was written, else ""."""
        tar = tar_name(self._name)
        description = self._packed.described.get(tar)
        return tar if description is not None and description.sha256 != self._content.sha256 else ""


DatasetFiles: TypeAlias = FolderFiles | PackedFiles
"""The files of a dataset: which sequences there are, and after `each`, the SHA-256 of all that lies beside them."""

SequenceFiles: TypeAlias = SequenceInFolder | SequenceInTar
"""The files of a sequence."""


def files_of(place: Path | str) -> DatasetFiles:
    """Return the files of the dataset in a folder or at an address. Raises InputError where there is none."""
    return PackedFiles(open_packed(place)) if is_packed(place) else FolderFiles(Path(place))
