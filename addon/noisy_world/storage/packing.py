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
from .card import card
from .croissant import croissant
from .finished import Content, ImageReaders, sealed_state
from .frame_table import FrameTable, need_writer
from .packed_names import CARD, CROISSANT, TABLE, PackedFile, tar_name
from .sequence_tar import FrameSpans, Span, write_sequence
from .store import Store

ELSEWHERE = "choose another address"
CLAIM = f"{WORK_FOLDER}/{IDENTITY}"
PACKED_SEQUENCES = f"{WORK_FOLDER}/sequences"  # a small file for each sequence whose tar is written
PACKERS = 4  # sequences that are written at once: stores answer late and take much; chosen: 50 MB of memory each

WrittenTar: TypeAlias = tuple[PackedFile, list[FrameSpans]]
"""A sequence's tar, and where its frames lie in it."""


def pack(
    content: Content,
    images: ImageReaders,
    store: Store,
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
    with store.writing(TABLE) as sink, FrameTable(sink, content) as table:
        for sequence, (tar, spans) in _packed_sequences(content, images, store, stop):
            table.add(sequence, content.frames(sequence), spans)
            tars.append(tar)
            progress.advance(content.manifest["frames"][sequence])
    described = croissant(content, store.name, tars, PackedFile(TABLE, sink.size, sink.sha256))
    store.write(CROISSANT, canonical(described).encode())
    store.write(CARD, card(content, described, table.made_with).encode())
    if content.overview is not None:
        store.write(OVERVIEW, content.overview)
    for name, data in beside().items():
        store.write(name, data)
    store.write(MANIFEST, canonical(content.manifest).encode())
    remove_work(store)
    progress.finish()


def take(
    store: Store,
    identity: dict[str, Any],
    chosen: list[int | None] | None,
    difference: Callable[[dict[str, Any]], str],
    finished_otherwise: Callable[[dict[str, Any]], str],
) -> bool:
    """Begin to write a dataset to an address, or go on with it; False where it is there already, finished.

    chosen: start and stop of the frames that are made of each sequence, None for all. difference: returns in which way
    what an identity says is another dataset, "" where it is the same. finished_otherwise: the same of the manifest of
    one that is finished, whose identity does not differ. Raises StorageError where something else is there,
    MissingDependencyError where it could not be finished.
    """
    store.check()
    state = sealed_state(store)
    if state is not None:
        if state.problem or state.manifest is None:
            raise StorageError(state.problem, file=store.text, remedy=ELSEWHERE)
        if problem := difference(state.manifest["identity"]) or finished_otherwise(state.manifest):
            remedy = f"a dataset at an address does not grow: {ELSEWHERE}"
            raise StorageError(f"holds another dataset: {problem}", file=store.text, remedy=remedy)
        remove_work(store)
        return False
    need_writer(store)
    begun = {"identity": identity, "chosen": chosen}
    there = claimed(store)
    if there is None:
        if store.holds_anything() and not store.sizes(WORK_FOLDER):
            raise StorageError("is not empty and holds no dataset of Noisy World", file=store.text, remedy=ELSEWHERE)
        store.write(CLAIM, canonical(begun).encode())
        there = claimed(store) or begun
    problem = difference(there["identity"])
    if not problem and there["chosen"] != chosen:
        problem = f"other frames: --frames was {_spoken(there['chosen'])}, is {_spoken(chosen)}"
    if problem:
        raise StorageError(f"another dataset is being made there: {problem}", file=store.text, remedy=ELSEWHERE)
    return True


def _spoken(chosen: list[int | None] | None) -> str:
    if chosen is None:
        return "not given"
    start, stop = chosen
    return f"{start or 0}:{'' if stop is None else stop}"


def claimed(store: Store) -> dict[str, Any] | None:
    """Return what is begun at an address, a mapping of `identity` and `chosen`; None where nothing is.

    Raises StorageError where it cannot be understood.
    """
    begun = store.read(CLAIM)
    if begun is None:
        return None
    try:
        there = parse_json(begun.decode())
        if there["identity"]["format"] == FORMAT and "chosen" in there:
            return there
    except (ValueError, KeyError, TypeError):
        pass
    raise StorageError(
        "is not of this version of Noisy World", file=store.of(CLAIM), remedy=f"{ELSEWHERE}, or remove {WORK_FOLDER}"
    )


def remove_work(store: Store) -> None:
    """Remove what a run left at an address while it worked, the identity last: until then it can be resumed."""
    left = store.sizes(WORK_FOLDER)
    identity = f"{WORK_FOLDER}/{IDENTITY}"
    for name in sorted(left, key=lambda name: name == identity):
        store.remove(name)


def _packed_sequences(
    content: Content, images: ImageReaders, store: Store, stop: threading.Event
) -> Iterator[tuple[str, WrittenTar]]:
    """Yield each sequence with its tar, in order; several are written at a time."""

    def packed(sequence: str) -> WrittenTar:
        return _packed_sequence(content, sequence, images, store, stop)

    with closing(done_ahead(packed, content.sequences, threads=PACKERS, ahead=PACKERS, name="packer")) as sequences:
        yield from sequences


def _packed_sequence(
    content: Content, sequence: str, images: ImageReaders, store: Store, stop: threading.Event
) -> WrittenTar:
    """Return a sequence's tar at the address and where its frames lie in it; write it, unless it is there."""
    name, note = tar_name(sequence), f"{PACKED_SEQUENCES}/{sequence}.json"
    by = content.identity["versions"]["noisy_world"]
    made_of = sha256_of_bytes(canonical({"texts": content.texts(sequence), "by": by}).encode())
    there = _noted(store.read(note), made_of)
    if there is not None and store.size(name) == there["size"]:
        return PackedFile(name, there["size"], there["sha256"]), _spans_of(there["spans"])
    with store.writing(name) as sink:
        spans = write_sequence(content, sequence, images, sink, stop)
    description = {
        "made_of": made_of,
        "size": sink.size,
        "sha256": sink.sha256,
        "spans": [asdict(span) for span in spans],
    }
    store.write(note, json.dumps(description, separators=(",", ":")).encode())
    return PackedFile(name, sink.size, sink.sha256), spans


def _noted(data: bytes | None, made_of: str) -> dict[str, Any] | None:
    """Return what is noted of a finished tar; None where it is of something else, torn, or missing."""
    try:
        description = None if data is None else parse_json(data.decode())
    except ValueError:
        return None
    return description if isinstance(description, dict) and description.get("made_of") == made_of else None


def _spans_of(spans: list[dict[str, Any]]) -> list[FrameSpans]:
    return [
        FrameSpans(Span(**item["json"]), {modality: Span(**span) for modality, span in item["images"].items()})
        for item in spans
    ]
