# SPDX-License-Identifier: GPL-3.0-or-later
"""Packing a dataset at an address: a tar for each sequence, and what describes them.

Each sequence's tar counts once a small file in the working folder says its size and hash, so a run that is killed goes
on behind the last of them. The manifest is written last; with it the dataset is finished, and the working folder goes.
"""

import json
import threading
from dataclasses import asdict
from typing import Any

from ..core.datasets.json_text import parse_json
from ..core.datasets.standing import IDENTITY, MANIFEST, OVERVIEW, WORK_FOLDER
from ..core.datasets.storage import sha256_of_bytes
from ..core.errors import InterruptedRunError, StorageError
from ..core.presets.preset import canonical
from ..core.progress import Progress
from .address import Address
from .card import CARD, card
from .content import Content, ReadImage
from .croissant import CROISSANT, PackedFile, croissant
from .frame_table import TABLE, FrameTable
from .sequence_tar import FrameSpans, Span, tar_name, write_sequence


def pack(content: Content, read: ReadImage, address: Address, progress: Progress, stop: threading.Event) -> bool:
    """Write a dataset's tars, tables and manifest to an address. read: gives the content of an image.

    What is there already stays. Returns False where all was there. Raises StorageError where another dataset is there
    and where a file is not as it was written, InterruptedRunError where `stop` is set.
    """
    manifest = canonical(content.manifest).encode()
    if is_sealed(address, manifest):
        remove_work(address)
        return False
    claim(address, canonical(content.identity).encode())
    progress.start("packing", sum(content.manifest["frames"].values()))
    tars: list[PackedFile] = []
    with address.writing(TABLE) as sink:
        table = FrameTable(sink, content)
        for sequence in content.sequences:
            if stop.is_set():
                raise InterruptedRunError("stopped")
            tar, spans = _packed_sequence(content, sequence, read, address)
            table.add(sequence, content.frames(sequence), spans)
            tars.append(tar)
            progress.advance(content.manifest["frames"][sequence])
        table.close()
    described = croissant(content, address.name, tars, PackedFile(TABLE, sink.size, sink.sha256))
    address.write(CROISSANT, canonical(described).encode())
    address.write(CARD, card(content, described, table.made_with).encode())
    if content.overview is not None:
        address.write(OVERVIEW, content.overview)
    address.write(MANIFEST, manifest)
    remove_work(address)
    progress.finish()
    return True


def is_sealed(address: Address, manifest: bytes) -> bool:
    """Tell whether an address holds the finished dataset of a manifest. Raises StorageError where it holds another."""
    there = address.read(MANIFEST)
    if there is not None and there != manifest:
        raise StorageError(
            f"{address.text}: holds another dataset, which is finished; a dataset at an address does not grow: grow it "
            "in a folder and publish that to another address"
        )
    return there is not None


def claim(address: Address, identity: bytes) -> None:
    """Begin to write a dataset of this identity to an address. Raises StorageError where something else is there."""
    name = f"{WORK_FOLDER}/{IDENTITY}"
    there = address.read(name)
    if there is None:
        if address.holds_anything() and address.read(MANIFEST) is None:
            raise StorageError(f"{address.text}: is not empty and holds no dataset of Noisy World; choose another address")
        address.write(name, identity)
    elif there != identity:
        raise StorageError(
            f"{address.text}: another dataset is being made there; choose another address, or remove {WORK_FOLDER} there"
        )


def remove_work(address: Address) -> None:
    """Remove what a run left at an address while it worked, the identity last: until then it can be resumed."""
    left = address.sizes(WORK_FOLDER)
    identity = f"{WORK_FOLDER}/{IDENTITY}"
    for name in sorted(left, key=lambda name: name == identity):
        address.remove(name)


def _packed_sequence(
    content: Content, sequence: str, read: ReadImage, address: Address
) -> tuple[PackedFile, list[FrameSpans]]:
    """Return a sequence's tar at the address and where its frames lie in it; write it, unless it is there."""
    name, note = tar_name(sequence), f"{WORK_FOLDER}/sequences/{sequence}.json"
    by = content.identity["versions"]["noisy_world"]
    made_of = sha256_of_bytes(canonical({"texts": content.texts(sequence), "by": by}).encode())
    there = _noted(address.read(note), made_of)
    if there is not None and address.size(name) == there["size"]:
        return PackedFile(name, there["size"], there["sha256"]), _spans_of(there["spans"])
    with address.writing(name) as sink:
        spans = write_sequence(content, sequence, read, sink)
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
