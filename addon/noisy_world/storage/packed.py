# SPDX-License-Identifier: GPL-3.0-or-later
"""A packed dataset that is finished, to be read: its manifest, and what it says of its own files."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ..core.channels import in_order
from ..core.datasets.dataset_state import (
    IDENTITY,
    MANIFEST,
    WORK_FOLDER,
    DatasetState,
    manifest_problem,
    version_problem,
)
from ..core.datasets.json_text import parse_json, read_json
from ..core.datasets.layouts import Modality
from ..core.datasets.provenance import cameras_of
from ..core.datasets.records import FRAMES
from ..core.errors import InputError
from ..core.geometry import Intrinsics
from .address import Address, open_address
from .card import CARD
from .croissant import CROISSANT, PackedFile
from .frame_table import TABLE

NOTHING = "holds no dataset of Noisy World"
UNFINISHED = "its run has not come to its end"
READ_BYTES = 8 * 2**20  # fetched at once where a whole file is read; chosen: some frames


@dataclass(frozen=True)
class Packed:
    """A finished packed dataset. standing: what its manifest says, as of a dataset in a folder."""

    address: Address
    standing: DatasetState

    @property
    def manifest(self) -> dict[str, Any]:
        """What the dataset was made from, conventions, hashes."""
        assert self.standing.manifest is not None
        return self.standing.manifest

    @property
    def sequences(self) -> list[str]:
        """Its sequences, sorted."""
        return sorted(self.manifest["frames"])

    @property
    def modalities(self) -> tuple[Modality, ...]:
        """The names of its channels, in the registry's order."""
        return in_order(self.manifest["identity"]["output"]["modalities"])

    @cached_property
    def cameras(self) -> dict[str, Intrinsics]:
        """The intrinsics of each scene."""
        return cameras_of(self.manifest["identity"])

    @cached_property
    def described(self) -> dict[str, PackedFile]:
        """Its table and tars with their sizes and hashes, by name, as croissant.json says; {} without a usable one."""
        data = self.address.read(CROISSANT)
        try:
            items = () if data is None else parse_json(data.decode())["distribution"]
            return {file.name: file for item in items if (file := _file_of(item)) is not None}
        except (ValueError, KeyError, TypeError, AttributeError):
            return {}


def _file_of(item: Any) -> PackedFile | None:
    """Return a file of croissant.json's distribution; None for what is no file."""
    if item["@type"] != "cr:FileObject":
        return None
    return PackedFile(str(item["@id"]), int(item["contentSize"].removesuffix(" B")), str(item["sha256"]))


def is_packed(folder: Path) -> bool:
    """Tell whether a folder holds a packed dataset, finished or begun, and not one of files in folders."""
    if any(path.is_file() for path in folder.glob(f"*/*/{FRAMES}")):
        return False
    if (folder / TABLE).is_file():
        return True
    try:
        begun = read_json(folder / WORK_FOLDER / IDENTITY)
    except (FileNotFoundError, ValueError):
        return False
    return isinstance(begun, dict) and begun.keys() == {"identity", "chosen"}


def open_packed(text: str) -> Packed:
    """Return the finished packed dataset at an address.

    Raises InputError where there is none, or one that is not finished, StorageError where the store refuses,
    MissingDependencyError where a package that reaches it is missing.
    """
    address = open_address(text)
    standing = sealed_standing(address)
    if standing is None and address.read(f"{WORK_FOLDER}/{IDENTITY}") is not None:
        raise InputError(address.text, UNFINISHED, remedy="run the same command again; it goes on")
    if standing is None:
        raise InputError(address.text, NOTHING, remedy="name the place that generate or publish wrote")
    if standing.problem:
        raise InputError(address.text, standing.problem)
    return Packed(address, standing)


def sealed_standing(address: Address) -> DatasetState | None:
    """Return what the manifest at an address says; None where there is none."""
    data = address.read(MANIFEST)
    if data is None:
        return None
    value: Any = None
    try:
        value = parse_json(data.decode())
        problem = manifest_problem(value) or version_problem(value["identity"])
    except ValueError as error:
        problem = str(error)
    if problem:
        return DatasetState(None, None, frozenset(), holds_frames=True, problem=f"{MANIFEST} {problem}")
    identity = value["identity"]
    return DatasetState(identity, value, frozenset(identity["sequences"]), holds_frames=True)


def wrong_descriptions(packed: Packed, sizes: dict[str, int], *, check: bool) -> tuple[list[str], list[str]]:
    """Return which of the files that describe a packed dataset are lost, and which are damaged.

    sizes: of the files at the address. check: whether to hash the table; else its size is compared.
    """
    lost = [name for name in (TABLE, CROISSANT, CARD) if name not in sizes]
    damaged = [CROISSANT] if CROISSANT in sizes and not packed.described else []
    table = packed.described.get(TABLE)
    if table is not None and TABLE in sizes:
        whole = sizes[TABLE] == table.size
        if not whole or (check and file_sha256(packed.address, TABLE, table.size) != table.sha256):
            damaged.append(TABLE)
    return lost, damaged


def content_of(address: Address, name: str, size: int) -> Iterator[bytes]:
    """Yield the content of a file of this size in pieces; fewer bytes where it is shorter."""
    for start in range(0, size, READ_BYTES):
        piece = address.read_range(name, start, min(size, start + READ_BYTES))
        if not piece:
            return
        yield piece


def file_sha256(address: Address, name: str, size: int) -> str:
    """Return the SHA-256 of a file of this size, in hexadecimal."""
    digest = hashlib.sha256()
    for piece in content_of(address, name, size):
        digest.update(piece)
    return digest.hexdigest()
