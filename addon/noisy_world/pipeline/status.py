# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a dataset has come: what is done, what is missing or damaged, and how long the rest will take.

Everything is read from the dataset's folder, while a run writes to it or after that; the preset is not needed.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.datasets.dataset_state import (
    IDENTITY,
    MANIFEST,
    RUN,
    UNCHECKED,
    WORK_FOLDER,
    DatasetState,
    manifest_is_changed,
    read_dataset_state,
)
from ..core.datasets.file_inventory import Digests, FileInventory, ImageLocation, counted, journals_of, tally
from ..core.datasets.json_text import read_json
from ..core.datasets.merging import merged_identity
from ..core.datasets.place import check_no_links
from ..core.errors import StorageError
from ..core.perturbing.reading import Registry
from ..core.planning.described import Described, described_sequences
from ..core.progress import Progress
from .pace import Pace, pace_of
from .shard_status import Shards, read_shards


@dataclass(frozen=True)
class SequenceStatus:
    """A sequence: how many of its frames are done, of how many (None where that is unknown), and what is wrong."""

    setting: str
    scene: str
    of: int | None
    tally: FileInventory

    @property
    def whole(self) -> bool:
        """Whether every frame is done."""
        return self.of is not None and self.tally.done >= self.of


@dataclass(frozen=True)
class Status:
    """How far a dataset has come.

    out: its folder or address. ended: whether the last run has come to its end. checked: whether every file was hashed.
    lost, damaged: files of the dataset that are not there, or are not as they were written, relative to its place.
    total_s: how long the run took that has ended, if it says so. shards: those in its folder, or at its address.
    """

    out: Path | str
    ended: bool
    checked: bool
    sequences: tuple[SequenceStatus, ...]
    lost: tuple[str, ...]
    damaged: tuple[str, ...]
    pace: Pace
    total_s: float | None
    shards: Shards
    notes: tuple[str, ...]

    @property
    def done(self) -> int:
        """The frames that are done."""
        return sum(item.tally.done for item in self.sequences)

    @property
    def of(self) -> int | None:
        """The frames of all sequences; None where those of one are unknown."""
        counts = [item.of for item in self.sequences if item.of is not None]
        return sum(counts) if len(counts) == len(self.sequences) else None

    @property
    def whole(self) -> bool:
        """Whether the run has ended and every file is there, and as it was written where that was checked."""
        return self.ended and all(item.whole for item in self.sequences) and not (self.lost or self.damaged)


def read_status(
    out: Path, registry: Registry, progress: Progress, *, chosen: slice | None = None, check: bool = False
) -> Status:
    """Return how far the dataset in a folder has come.

    registry: the perturbations that there are. chosen: the frames of each sequence that are asked for, if not all.
    check: whether to hash every file.

    Raises StorageError where the folder holds no dataset, or one that cannot be understood.
    """
    if not out.is_dir():
        raise StorageError(f"{out}: {'is not a folder' if out.exists() else 'there is no such folder'}")
    shards = read_shards(out)
    standing = _standing(out, shards)
    assert standing.identity is not None
    check_no_links(out, standing.sequences)
    described = described_sequences(standing.identity, registry, chosen)
    begun = (out / WORK_FOLDER / IDENTITY).exists() or bool(shards.finished or shards.unfinished)
    ended = standing.manifest is not None and not begun
    reader = _Reader(out, standing, shards, ended=ended, digest=Digests() if check else None)
    progress.start("checking", sum(len(item.frames or ()) for item in described))
    found: list[SequenceStatus] = []
    for item in described:
        found.append(reader.sequence(item, chosen))
        progress.advance(len(item.frames or ()))
    progress.finish()
    lost, damaged = reader.texts()
    notes = [standing.note] if standing.note else []
    if check and ended:
        changed = manifest_is_changed(out)
        damaged += [MANIFEST] if changed else []
        notes += [UNCHECKED] if changed is None else []
    for item in found:
        folder = f"{item.setting}/{item.scene}"
        lost += [f"{folder}/{name}" for name in item.tally.lost]
        damaged += [f"{folder}/{name}" for name in item.tally.damaged]
    costs = {item.folder: item.seconds_each for item in described}
    left = {f"{item.setting}/{item.scene}": item.of - item.tally.done for item in found if item.of is not None}
    written = [(f"{item.setting}/{item.scene}", part) for item in found for part in item.tally.written]
    known = len(left) == len(found)
    return Status(
        out,
        ended,
        check,
        tuple(found),
        tuple(lost),
        tuple(damaged),
        pace_of(written, costs, left if known else None, time.time()),
        total_s_of(_run(out)) if ended else None,
        shards,
        (*notes, *shards.notes),
    )


def _standing(out: Path, shards: Shards) -> DatasetState:
    """Return what the folder holds; where no run has begun to merge, what its shards say."""
    standing = read_dataset_state(out)
    if standing is None and shards.identities:
        identity = shards.identities[0]
        for other in shards.identities[1:]:
            identity = merged_identity(other, identity, set(other["sequences"]) - set(identity["sequences"]))
        note = "only the shards that were begun are known, as no run has begun to merge; the preset may have more"
        return DatasetState(identity, None, frozenset(identity["sequences"]), holds_frames=True, note=note)
    if standing is None:
        raise StorageError(f"{out}: holds no dataset of Noisy World, nor one that was begun")
    if standing.problem:
        raise StorageError(f"{out}: {standing.problem}")
    return standing


class _Reader:
    """Looks at the files of a dataset."""

    def __init__(
        self, out: Path, standing: DatasetState, shards: Shards, *, ended: bool, digest: Digests | None
    ) -> None:
        self._out = out
        self._work = out / WORK_FOLDER
        self._standing = standing
        self._shards = shards
        self._ended = ended
        self._digest = digest
        assert standing.identity is not None
        self._images_each = len(standing.identity["output"].get("modalities") or ("rgb", "depth"))

    def sequence(self, item: Described, chosen: slice | None) -> SequenceStatus:
        """Return how far a sequence has come."""
        frames = item.frames
        count = None if frames is None else len(frames)
        made = self._standing.manifest["frames"].get(item.folder) if self._standing.manifest else None
        if self._ended and chosen is None and made is not None:
            count = made  # by --frames it may have fewer than its path
        places = self._places(item.folder)
        quick = self._digest is None and chosen is None and made is not None
        quick = quick and not any(place.journals or place.records for place in places)
        found = counted(self._out / item.folder, made or 0, self._images_each) if quick else None
        if found is None:
            asked = None if chosen is None or frames is None else frozenset(frames)
            found = tally(places, self._images_each, asked, self._digest)
        return SequenceStatus(item.setting, item.scene, count, found)

    def _places(self, folder: str) -> tuple[ImageLocation, ...]:
        own = ImageLocation(self._out / folder, journals_of(self._work / folder))
        return (*self._shards.places.get(folder, ()), own)

    def texts(self) -> tuple[list[str], list[str]]:
        """Return the dataset's files other than images that are lost, and those that are damaged."""
        named: dict[str, str] = {}
        for name, content in self._standing.files.items():
            named |= {name: content} if isinstance(content, str) else {f"{name}/{k}": v for k, v in content.items()}
        lost = [name for name in named if not (self._out / name).is_file()]
        if self._digest is None:
            return lost, []
        gone = set(lost)
        return lost, [name for name in named if name not in gone and self._digest(self._out / name) != named[name]]


def _run(out: Path) -> Any:
    """Return what run.json says; None where it says nothing."""
    try:
        return read_json(out / RUN)
    except (FileNotFoundError, ValueError):
        return None


def total_s_of(run: Any) -> float | None:
    """Return how long the run took that has ended, by what run.json says; None where it does not say so."""
    found = run.get("total_s") if isinstance(run, dict) else None
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else None
