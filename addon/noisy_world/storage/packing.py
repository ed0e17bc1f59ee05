# SPDX-License-Identifier: GPL-3.0-or-later
"""Packing a dataset at an address: a tar for each sequence, and what describes them.

Each sequence's tar counts once a small file in the working folder says its size and hash, so a run that is killed goes
on behind the last of them. The manifest is written last; with it the dataset is finished, and the working folder goes.
"""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict
from typing import Any, TypeAlias

from ..core.datasets.dataset_state import IDENTITY, MANIFEST, OVERVIEW, WORK_FOLDER
from ..core.datasets.json_text import parse_json
from ..core.datasets.provenance import FORMAT
from ..core.datasets.storage import sha256_of_bytes
from ..core.errors import StorageError
from ..core.presets.preset import canonical
from ..core.progress import Progress
from ..core.working_ahead import done_ahead
from .address import Address
from .card import CARD, card
from .content import Content, Images
from .croissant import CROISSANT, PackedFile, croissant
from .frame_table import TABLE, FrameTable
from .sequence_tar import FrameSpans, Span, tar_name, write_sequence

ELSEWHERE = "choose another address"
CLAIM = f"{WORK_FOLDER}/{IDENTITY}"
PACKED_SEQUENCES = f"{WORK_FOLDER}/sequences"  # a small file for each sequence whose tar is written
PACKERS = 4  # sequences that are written at once: stores answer late and take much; chosen: 50 MB of memory each

Packed: TypeAlias = tuple[PackedFile, list[FrameSpans]]
"""A sequence's tar, and where its frames lie in it."""


def pack(
    content: Content,
    images: Images,
    address: Address,
    progress: Progress,
    stop: threading.Event,
    *,
    beside: Callable[[], dict[str, bytes]] = dict,
) -> None:
    """Write a dataset's tars, tables and manifest to an address that is claimed for it; tars that are there stay.

    images: where its images are. beside: returns other files, by name, that are written beside the manifest. Raises
    StorageError where a file is not as it was written or the store refuses, InterruptedRunError where `stop` is set.
    """
    progress.start("packing", sum(content.manifest["frames"].values()))
    tars: list[PackedFile] = []
    with address.writing(TABLE) as sink, FrameTable(sink, content) as table:
        for sequence, (tar, spans) in _packed_sequences(content, images, address, stop):
            table.add(sequence, content.frames(sequence), spans)
            tars.append(tar)
            progress.advance(content.manifest["frames"][sequence])
    described = croissant(content, address.name, tars, PackedFile(TABLE, sink.size, sink.sha256))
    address.write(CROISSANT, canonical(described).encode())
    address.write(CARD, card(content, described, table.made_with).encode())
    if content.overview is not None:
        address.write(OVERVIEW, content.overview)
    for name, data in beside().items():
        address.write(name, data)
    address.write(MANIFEST, canonical(content.manifest).encode())
    remove_work(address)
    progress.finish()


def sealed_manifest(address: Address) -> dict[str, Any] | None:
    """Return the manifest of the finished dataset at an address; None where there is none.

    Raises StorageError where what is there is no manifest of this version.
    """
    data = address.read(MANIFEST)
    if data is None:
        return None
    try:
        value = parse_json(data.decode())
        if value["identity"]["format"] == FORMAT and isinstance(value["frames"], dict):
            return value
    except (ValueError, KeyError, TypeError):
        pass
    raise StorageError(f"{address.of(MANIFEST)}: is not of this version of Noisy World; choose another address")


def claim(address: Address, identity: dict[str, Any], chosen: list[int | None] | None) -> dict[str, Any]:
    """Begin to write a dataset of this identity to an address, unless one is begun there; return what is begun there.

    chosen: start and stop of the frames that are made of each sequence, None for all. Returns a mapping of `identity`
    and `chosen`. Raises StorageError where something else is there.
    """
    there = claimed(address)
    if there is None:
        if address.holds_anything() and not address.sizes(WORK_FOLDER):
            raise StorageError(f"{address.text}: is not empty and holds no dataset of Noisy World; {ELSEWHERE}")
        address.write(CLAIM, canonical({"identity": identity, "chosen": chosen}).encode())
        there = claimed(address)
    return {"identity": identity, "chosen": chosen} if there is None else there


def claimed(address: Address) -> dict[str, Any] | None:
    """Return what is begun at an address, as `claim` does; None where nothing is.

    Raises StorageError where it cannot be understood.
    """
    begun = address.read(CLAIM)
    if begun is None:
        return None
    try:
        there = parse_json(begun.decode())
        if there["identity"]["format"] == FORMAT and "chosen" in there:
            return there
    except (ValueError, KeyError, TypeError):
        pass
    raise StorageError(
        f"{address.of(CLAIM)}: is not of this version of Noisy World; {ELSEWHERE}, or remove {WORK_FOLDER}"
    )


def remove_work(address: Address) -> None:
    """Remove what a run left at an address while it worked, the identity last: until then it can be resumed."""
    left = address.sizes(WORK_FOLDER)
    identity = f"{WORK_FOLDER}/{IDENTITY}"
    for name in sorted(left, key=lambda name: name == identity):
        address.remove(name)


def _packed_sequences(
    content: Content, images: Images, address: Address, stop: threading.Event
) -> Iterator[tuple[str, Packed]]:
    """Yield each sequence with its tar, in order; several are written at a time."""

    def packed(sequence: str) -> Packed:
        return _packed_sequence(content, sequence, images, address, stop)

    with closing(done_ahead(packed, content.sequences, threads=PACKERS, ahead=PACKERS, name="packer")) as sequences:
        yield from sequences


def _packed_sequence(
    content: Content, sequence: str, images: Images, address: Address, stop: threading.Event
) -> Packed:
    """Return a sequence's tar at the address and where its frames lie in it; write it, unless it is there."""
    name, note = tar_name(sequence), f"{PACKED_SEQUENCES}/{sequence}.json"
    by = content.identity["versions"]["noisy_world"]
    made_of = sha256_of_bytes(canonical({"texts": content.texts(sequence), "by": by}).encode())
    there = _noted(address.read(note), made_of)
    if there is not None and address.size(name) == there["size"]:
        return PackedFile(name, there["size"], there["sha256"]), _spans_of(there["spans"])
    with address.writing(name) as sink:
        spans = write_sequence(content, sequence, images, sink, stop)
    told = {"made_of": made_of, "size": sink.size, "sha256": sink.sha256, "spans": [asdict(span) for span in spans]}
    address.write(note, json.dumps(told, separators=(",", ":")).encode())
    return PackedFile(name, sink.size, sink.sha256), spans


def _noted(data: bytes | None, made_of: str) -> dict[str, Any] | None:
    """Return what is noted of a finished tar; None where it is of something else, torn, or missing."""
    try:
        told = None if data is None else parse_json(data.decode())
    except ValueError:
        return None
    return told if isinstance(told, dict) and told.get("made_of") == made_of else None


def _spans_of(told: list[dict[str, Any]]) -> list[FrameSpans]:
    return [
        FrameSpans(Span(**item["json"]), {modality: Span(**span) for modality, span in item["images"].items()})
        for item in told
    ]
