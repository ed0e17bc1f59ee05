# SPDX-License-Identifier: GPL-3.0-or-later
"""Shards: the pieces of a plan that are made apart, in folders or at an address, and then merged."""

from __future__ import annotations

import contextlib
import hashlib
import heapq
import json
import os
import re
import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import FolderLock, Hasher, Mover, sha256_of_bytes, storage_errors, write_atomic
from ..core.errors import BusyError, CannotJoinError, InputError, did_you_mean
from ..core.file_access import canonical, read_json
from ..core.frame_table import (
    KEPT,
    FrameRecord,
    Journals,
    has_journal,
    joined_records,
    journal_line,
    journal_path,
    read_lines,
    record_of,
    remove_journals,
)
from ..layouts import OutputFormat
from .folder_state import (
    IDENTITY,
    MERGED,
    WORK_FOLDER,
    identity_mismatch,
    identity_sha256,
    read_dataset_state,
    remove_dataset,
    remove_work_folder,
)

if TYPE_CHECKING:
    from .plan import Plan, Render


LONGEST_FOLDER = 200  # characters; file systems hold 255 bytes, and names of scenes and settings may fill them


@dataclass(frozen=True)
class Shard:
    """The source frames start to stop-1 of one render, by the render's name.

    What is made of them are the images that show one of these source frames, in every sequence of the render.
    """

    render: str
    start: int
    stop: int

    @property
    def name(self) -> str:
        """The shard in words, such as "room0.000000-000100"."""
        return f"{self.render}.{self.start:06d}-{self.stop:06d}"

    @property
    def scene(self) -> str:
        """The name of its scene. A render along a path of its own is named "scene@setting"."""
        return self.render.partition("@")[0]

    @property
    def folder_name(self) -> str:
        """The name of its folder: its own or, where that is too long for one, as much as fits and a hash."""
        if len(self.name) <= LONGEST_FOLDER:
            return self.name
        return f"{self.name[: LONGEST_FOLDER - 17]}-{hashlib.sha256(self.name.encode()).hexdigest()[:16]}"

    @classmethod
    def parse(cls, name: str) -> Shard:
        """Return the shard of a name. Raises ValueError where it names none."""
        found = re.fullmatch(r"(.+)\.(\d{6,9})-(\d{6,9})", name, re.ASCII)
        shard = cls(found[1], int(found[2]), int(found[3])) if found else None
        if shard is None or shard.name != name or shard.start >= shard.stop:
            raise ValueError(f"{name!r} is no shard: RENDER.START-STOP, such as room0.000000-000100")
        return shard

    def frames_of(self, frames: Sequence[int]) -> list[int]:
        """Return those of some source frames that are the shard's."""
        return [frame for frame in frames if frame in self]

    def __contains__(self, source: int) -> bool:
        """Tell whether a source frame of the render is the shard's."""
        return self.start <= source < self.stop


def render_of(plan: Plan, shard: Shard) -> Render:
    """Return the render of a shard. Raises InputError where the plan has none of its source frames."""
    renders = {render.name: render for render in plan.renders}
    if shard.render not in renders:
        remedy = did_you_mean(shard.render, renders) or f"there are {', '.join(list(renders)[:8])}"
        raise InputError(plan.preset.path, f"has no render {shard.render} for the shard {shard.name}", remedy=remedy)
    frames = renders[shard.render].frames
    if not shard.frames_of(frames):
        there = f"has the source frames {frames[0]} to {frames[-1]}" if frames else "has no frames, by --frames"
        raise InputError(plan.preset.path, f"{shard.render} {there}, and none of the shard {shard.name}")
    return renders[shard.render]


def shards_of(plan: Plan, count: int, work: Mapping[str, Sequence[int]] | None = None) -> tuple[Shard, ...]:
    """Divide a plan into about `count` shards that take equally long; at least one for each render.

    work: the source frames that are to be made, by the render's name; by default all. Each of them is in one shard.
    The same plan, count and work give the same shards.
    """
    from .estimate import frame_seconds

    wanted = {render.name: render.frames for render in plan.renders} if work is None else work
    renders = [render for render in plan.renders if wanted.get(render.name, ())]
    # Of one render at a time: a plan may have hundreds, with a million frames each.
    seconds = [float(frame_seconds(plan, render, wanted[render.name]).sum()) for render in renders]
    counts = _counts(seconds, [len(wanted[render.name]) for render in renders], count)
    shards: list[Shard] = []
    for render, pieces in zip(renders, counts, strict=True):
        frames = wanted[render.name]
        shards += _cut(render, frames, frame_seconds(plan, render, frames).cumsum(), pieces)
    return tuple(shards)


def seconds_of(plan: Plan, shards: Sequence[Shard]) -> tuple[float, ...]:
    """Estimate what each of several shards of a plan takes on two cores, without loading the scene, in seconds."""
    from .estimate import frame_seconds
    from .sequence import array_of

    named = {shard.render for shard in shards}
    until_s = {
        render.name: np.concatenate([[0.0], frame_seconds(plan, render, render.frames).cumsum()])
        for render in plan.renders
        if render.name in named
    }
    frames = {render.name: array_of(render.frames) for render in plan.renders if render.name in named}

    def seconds(shard: Shard) -> float:
        first, last = np.searchsorted(frames[shard.render], (shard.start, shard.stop))
        return float(until_s[shard.render][last] - until_s[shard.render][first])

    return tuple(map(seconds, shards))


def _counts(seconds: list[float], most: list[int], count: int) -> list[int]:
    """Return how many shards each render is cut into: one, and then whichever has the longest shards one more.

    most: how many frames each has.
    """
    counts = [1] * len(seconds)
    longest = [(-value, number) for number, value in enumerate(seconds) if most[number] > 1]
    heapq.heapify(longest)
    for _ in range(count - len(counts)):
        if not longest:
            break
        _, number = heapq.heappop(longest)
        counts[number] += 1
        if counts[number] < most[number]:
            heapq.heappush(longest, (-seconds[number] / counts[number], number))
    return counts


def _cut(render: Render, frames: Sequence[int], until_s: NDArray[np.float64], pieces: int) -> list[Shard]:
    """Cut a render's frames where the time until each is nearest to equal parts; no piece is empty.

    until_s: (N,) the seconds of the frames up to each, with it.
    """
    wanted_s = until_s[-1] * np.arange(1, pieces) / pieces
    ends = np.searchsorted(until_s, wanted_s - 1e-9 * until_s[-1]) + 1
    least = np.arange(1, pieces)  # as many frames before the end of each piece as there are pieces
    ends = np.maximum.accumulate(np.maximum(ends, least) - least) + least
    ends = np.minimum(ends, len(frames) - pieces + least)
    bounds = [0, *(int(end) for end in ends), len(frames)]
    return [Shard(render.name, frames[first], frames[last - 1] + 1) for first, last in pairwise(bounds)]


# Merging shards into the dataset: their files are moved, not copied, and every one is hashed on the way.
#
# Files first, then records, then the shard's folder goes: a process that ends in between leaves what the next one
# merges again, and a file that is in its place already, as the record says, counts.


# The record of a finished shard, `shard.json`: what it was made from, and every file with its SHA-256.
#
# It is written last and whole, so a folder that has one is finished.


SHARDS = "shards"  # in the working folder of a dataset: a folder for each shard
SHARD = "shard.json"
FORMAT = 1  # version of the record; raised when its keys change


@dataclass(frozen=True)
class ShardRecord:
    """A finished shard.

    identity: what its frames were made from: that of a dataset, but with the scene and the settings of its render
    alone. frames: the records of its frames by the sequence's folder; a frame whose colour and depth are in different
    shards has a record in each. size_bytes: of its files; one that has several names counts once. report: what making
    it took, as in run.json.
    """

    shard: Shard
    identity: dict[str, Any]
    frames: dict[str, tuple[FrameRecord, ...]]
    size_bytes: int
    report: dict[str, Any]

    @property
    def identity_sha256(self) -> str:
        """The SHA-256 of what decides its bytes, apart from the processor."""
        return identity_sha256(self.identity)

    @property
    def frame_count(self) -> int:
        """How many records of frames it has."""
        return sum(map(len, self.frames.values()))

    def files(self) -> Iterator[tuple[str, str, str]]:
        """Yield the name of each file in the shard's folder, its name in the sequence's, and its SHA-256."""
        for folder, records in self.frames.items():
            for record in records:
                for name, digest in record.files.items():
                    yield f"{folder}/{name}", name, digest

    def content(self) -> dict[str, Any]:
        """The record as plain JSON values; `sha256` is the hash of all the others, by name, without spaces."""
        said = {
            "format": FORMAT,
            "shard": self.shard.name,
            "identity_sha256": self.identity_sha256,
            "versions": self.identity["versions"],
            "processor": self.identity["processor"],
            "identity": self.identity,
            "frames": {folder: [item.content() for item in records] for folder, records in self.frames.items()},
            "bytes": self.size_bytes,
            "report": self.report,
        }
        return {**said, "sha256": sha256_of_bytes(_text(said))}

    def summary(self) -> dict[str, Any]:
        """What is kept of a shard that was merged, for run.json."""
        return {"shard": self.shard.name, "processor": self.identity["processor"], "report": self.report}

    def text(self) -> bytes:
        """The record as the content of its file: in one line, as thousands of frames would be too slow otherwise."""
        return _text(self.content())

    @classmethod
    def of_content(cls, value: Any) -> ShardRecord:
        """Return the record of plain JSON values. Raises ValueError with the reason, in a few words."""
        if not isinstance(value, dict) or value.get("format") != FORMAT:
            raise ValueError("is not the record of a shard, or one of another version of Noisy World")
        said = {name: part for name, part in value.items() if name != "sha256"}
        if value.get("sha256") != sha256_of_bytes(_text(said)):
            raise ValueError("is not as it was written")
        frames = {folder: tuple(map(record_of, items)) for folder, items in said["frames"].items()}
        whole = {folder: tuple(item for item in items if item) for folder, items in frames.items()}
        if whole != frames:
            raise ValueError("is not the record of a shard")
        return cls(Shard.parse(said["shard"]), said["identity"], whole, said["bytes"], said["report"])


def _text(value: dict[str, Any]) -> bytes:
    # Keys as they come: those of a frame's record are in the order of its line in frames.jsonl.
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode() + b"\n"


def read_shard(folder: Path) -> ShardRecord | None:
    """Return the record of the shard in a folder; None where it is not finished.

    Raises ValueError with the reason where the record cannot be used.
    """
    try:
        return ShardRecord.of_content(read_json(folder / SHARD))
    except FileNotFoundError:
        return None


def shard_folder(out: Path, shard: Shard) -> Path:
    """Return the folder of a shard in a dataset."""
    return out / WORK_FOLDER / SHARDS / shard.folder_name


def shard_folders(out: Path) -> list[Path]:
    """Return the folders of a dataset's shards, finished or not, in order."""
    place = out / WORK_FOLDER / SHARDS
    return sorted(path for path in place.glob("*") if path.is_dir() and not path.is_symlink() and _is_shard(path))


def _is_shard(folder: Path) -> bool:
    """Tell whether a folder is a shard's: beside them may be that of a setting called `shards`."""
    return (folder / SHARD).is_file() or (folder / WORK_FOLDER).is_dir()


PATIENCE_S = 2.0  # how long the lock of a process is waited for that may have been killed; chosen

Frames: TypeAlias = dict[str, tuple[FrameRecord, ...]]
"""Records of frames by the sequence's folder."""


class Receiver(Protocol):
    """A dataset that shards are merged into, and which is open."""

    out: Path
    scratch: Path
    format: OutputFormat

    def make_folders(self, folder: str) -> None:
        """Create the folders of a sequence."""
        ...

    def append_merged(self, frames: Mapping[str, Iterable[FrameRecord]]) -> None:
        """Record frames whose files were moved here from a shard, by the sequence's folder."""
        ...

    def append_summary(self, summary: dict[str, Any]) -> None:
        """Record a shard that was merged."""
        ...


@dataclass(frozen=True)
class Merged:
    """What merging a shard did.

    frames: how many records went to the dataset. damaged: the files that are not as their records say, by their names
    in the dataset; they were not merged, so their frames are missing. record: of the shard; None where it was not
    finished.
    """

    frames: int
    damaged: tuple[str, ...]
    record: ShardRecord | None


@dataclass(frozen=True)
class ShardRules:
    """Which shards are merged.

    unfinished: also the finished frames of those that are unfinished, where nobody is making them. any_processor: also
    those of another kind of processor than the dataset's.
    """

    unfinished: bool
    any_processor: bool


@dataclass(frozen=True)
class Gathered:
    """What became of all the shards of a dataset.

    merged: those that were merged. refused: by folder, why a shard does not belong to the dataset. left: those that are
    unfinished, or under way.
    """

    merged: list[Merged]
    refused: dict[Path, str]
    left: list[Path]


def merge_shard(dataset: Receiver, folder: Path, record: ShardRecord | None = None) -> Merged:
    """Move what is finished of a shard into a dataset, which is open, and remove the shard's folder.

    folder: on any file system. record: of the shard, where it has been read. A file that is not as its record says is
    not merged. Raises BusyError where the shard is being made, ValueError where its record cannot be used, StorageError
    where the disk refuses.
    """
    lock = FolderLock(folder / WORK_FOLDER / "lock")
    try:
        record = record or read_shard(folder)
        frames = _recorded(folder) if record is None else record.frames
        merged, damaged = _move(dataset, folder, frames)
        dataset.append_merged(merged)
        if record is not None:
            dataset.append_summary(record.summary())
        _remove(folder)
    finally:
        lock.release()
    return Merged(sum(map(len, merged.values())), tuple(damaged), record)


def merge_shards(dataset: Receiver, identity: dict[str, Any], rules: ShardRules) -> Gathered:
    """Merge the shards in a dataset's own folder that were made from what an identity says."""
    found = Gathered([], {}, [])
    for folder in shard_folders(dataset.out):
        record, made_from, reason = _made_from(folder)
        if made_from is not None and not reason:
            reason = identity_mismatch(identity, made_from, any_processor=rules.any_processor)
        if reason:
            found.refused[folder] = reason
        elif rules.unfinished or record is not None:
            merged = _merge_when_free(dataset, folder, record)
            if merged is None:
                found.left.append(folder)
            else:
                found.merged.append(merged)
        else:
            found.left.append(folder)
    return found


def take_up(folder: Path, record: ShardRecord) -> None:
    """Make a finished shard, whose lock is held, an unfinished one again: its records become journals."""
    work = folder / WORK_FOLDER
    unfinished = work / "unfinished"
    with storage_errors(folder):
        unfinished.mkdir(parents=True, exist_ok=True)
    for scene in {sequence.split("/")[1] for sequence in record.frames}:
        own = ((sequence, item) for sequence, items in record.frames.items() for item in items)
        lines = "".join(journal_line(*line) for line in own if line[0].split("/")[1] == scene)
        write_atomic(journal_path(work, KEPT, scene), lines.encode(), unfinished)
    write_atomic(work / IDENTITY, canonical(record.identity).encode(), unfinished)
    with storage_errors(folder):
        (folder / SHARD).unlink()


def finish_shard(folder: Path, record: ShardRecord) -> None:
    """Write the record of a shard, whose lock is held, and remove what was needed while it was made."""
    work = folder / WORK_FOLDER
    write_atomic(folder / SHARD, record.text(), work / "unfinished")
    tidy(folder)


def tidy(folder: Path) -> None:
    """Remove from a finished shard, whose lock is held, what was needed while it was made."""
    work = folder / WORK_FOLDER
    with storage_errors(work):
        remove_journals(work)
    remove_work_folder(work, work / "unfinished")


def _merge_when_free(dataset: Receiver, folder: Path, record: ShardRecord | None) -> Merged | None:
    """Merge a shard; None where another process is making it. A process that was just killed is waited for."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return merge_shard(dataset, folder, record)
        except BusyError:
            if time.monotonic() > end_s:
                return None
            time.sleep(0.05)


def drop_unfinished(folders: Iterable[Path]) -> None:
    """Remove shards that are unfinished and that nobody is making, when all their frames are in the dataset."""
    for folder in folders:
        with contextlib.suppress(BusyError):
            if not (folder / SHARD).exists():
                remove_shard(folder)


def merged_shards(out: Path) -> list[dict[str, Any]]:
    """Return the summaries of the shards that were merged since the dataset was last complete, each shard's once."""
    summaries = (summary for path in sorted((out / WORK_FOLDER).glob(MERGED)) for summary in read_lines(path))
    by_shard = {summary["shard"]: summary for summary in summaries}
    return [by_shard[name] for name in sorted(by_shard)]


def remove_shard(folder: Path) -> None:
    """Remove a shard. Raises BusyError where it is being made, StorageError where the disk refuses."""
    lock = FolderLock(folder / WORK_FOLDER / "lock")
    try:
        _remove(folder)
    finally:
        lock.release()


def remove_shards(out: Path) -> None:
    """Remove the shards of a dataset that nobody is making, finished or not. Raises StorageError."""
    for folder in shard_folders(out):
        with contextlib.suppress(BusyError):
            remove_shard(folder)


def shards_hold_frames(out: Path) -> bool:
    """Tell whether a shard of a dataset has finished a frame."""
    return any((path / SHARD).is_file() or has_journal(path / WORK_FOLDER) for path in shard_folders(out))


def _made_from(folder: Path) -> tuple[ShardRecord | None, dict[str, Any] | None, str]:
    """Return a shard's record, if it is finished; what it was made from, if it has a frame; why that is unknown."""
    try:
        record = read_shard(folder)
    except ValueError as error:
        return None, None, f"{SHARD} {error}"
    if record is not None:
        return record, record.identity, ""
    state = read_dataset_state(folder)
    if state is None or not state.holds_frames:
        return None, None, ""
    return None, state.identity, state.problem or state.note


def _recorded(folder: Path) -> Frames:
    """Return what the journals of an unfinished shard say."""
    journals = Journals(folder / WORK_FOLDER)
    journals.read_on()
    return {
        sequence: tuple(joined_records(journals.records(sequence)).values()) for sequence in sorted(journals.sequences)
    }


def _move(dataset: Receiver, folder: Path, frames: Frames) -> tuple[dict[str, list[FrameRecord]], list[str]]:
    """Move the files that are as the records say; return the records of these, and the names of the others.

    Files are hashed ahead, in threads; they are moved one after another, or a whole sequence at once.
    """
    hasher, mover = Hasher(), Mover(dataset.scratch)
    merged: dict[str, list[FrameRecord]] = {}
    damaged: list[str] = []
    places = frozenset(dataset.format.folders)
    names = (f"{folder}/{sequence}/{name}" for sequence, name in _names(frames, places))

    with contextlib.closing(Hasher(links=False).ahead(names)) as digests:
        for sequence, records in frames.items():
            source, target = f"{folder}/{sequence}", f"{dataset.out}/{sequence}"
            found = {name: next(digests) for record in records for name in record.files if _is_image(name, places)}
            if _move_whole(source, target, records, found):
                merged[sequence] = list(records)
                continue
            dataset.make_folders(sequence)
            for record in records:
                there: dict[str, str] = {}
                for name, digest in record.files.items():
                    if name not in found:
                        continue
                    path = Path(f"{target}/{name}")
                    if hasher.sha256(path) == digest:  # moved by a process that was killed then, or made twice
                        there[name] = digest
                    elif found[name] == digest:
                        mover.move(Path(f"{source}/{name}"), path)
                        there[name] = digest
                damaged += [f"{sequence}/{name}" for name in record.files if name not in there]
                if there:
                    whole = len(there) == len(record.files)
                    merged.setdefault(sequence, []).append(record if whole else replace(record, files=there))
    return merged, damaged


def _move_whole(source: str, target: str, records: Iterable[FrameRecord], found: dict[str, str | None]) -> bool:
    """Move the folder of a sequence with all that is in it; False where nothing was moved.

    found: the SHA-256 of the images that records name. It can be moved where the dataset has nothing of the sequence,
    and where it holds these images alone, all as they were written.
    """
    if any(found.get(name) != digest for record in records for name, digest in record.files.items()):
        return False
    if os.path.lexists(target) or sum(len(files) for _, _, files in os.walk(source)) != len(found):
        return False
    setting, setting_there = os.path.dirname(source), os.path.dirname(target)  # noqa: PTH120 - of thousands
    try:
        if not os.path.lexists(setting_there) and len(os.listdir(setting)) == 1:  # noqa: PTH208
            os.rename(setting, setting_there)  # noqa: PTH104
        else:
            os.makedirs(setting_there, exist_ok=True)  # noqa: PTH103
            os.rename(source, target)  # noqa: PTH104
    except OSError:  # on another file system, for instance: then file by file
        return False
    return True


def _names(frames: Frames, places: Collection[str]) -> Iterator[tuple[str, str]]:
    """Yield the sequence and the name of each image that records name. places: the folders of images."""
    for sequence, records in frames.items():
        yield from ((sequence, name) for record in records for name in record.files if _is_image(name, places))


def _is_image(name: str, places: Collection[str]) -> bool:
    return name.rpartition("/")[0] in places


def _remove(folder: Path) -> None:
    """Remove the folder of a shard, whose lock is held; what is not ours stays in it."""
    with storage_errors(folder):
        (folder / SHARD).unlink(missing_ok=True)  # first: what a kill leaves is no finished shard
    work = folder / WORK_FOLDER
    inside = [path for path in folder.glob("*/*") if WORK_FOLDER not in path.parts[-2:]]
    remove_dataset(folder, work, [path.relative_to(folder).as_posix() for path in inside if path.is_dir()])
    remove_work_folder(work, work / "unfinished")
    for empty in (*(path for path in folder.iterdir() if path.name != WORK_FOLDER), folder):
        with contextlib.suppress(OSError):  # a setting whose only sequence was moved whole
            empty.rmdir()


# A run that another process has opened, and that this one takes part in.


class OpenRun:
    """The run that is open in a dataset's folder. What it makes is read once: each shard asks, of maybe thousands."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._read: tuple[tuple[int, int, int], dict[str, Any] | None] | None = None  # by the file's version

    def join(self, identity: dict[str, Any], *, any_processor: bool = False) -> None:
        """Take part in the run, which was opened with the same `identity`, or with more than that.

        any_processor: whether frames of another kind of processor are good enough. Raises CannotJoinError where no run
        is open, or where this process has another identity and would write other bytes.
        """
        opened = self._identity()
        if opened is None:
            raise CannotJoinError("no run is open here", file=self._out)
        if difference := identity_mismatch(opened, identity, any_processor=any_processor):
            raise CannotJoinError(
                f"the run was opened with another identity ({difference})",
                file=self._out,
                remedy="do not change its inputs while it runs, and start it again",
            )

    def _identity(self) -> dict[str, Any] | None:
        """Return what the run makes; None where no run is open, or where that cannot be read."""
        work = self._out / WORK_FOLDER
        try:
            found = (work / IDENTITY).stat()
        except OSError:
            return None
        version = found.st_ino, found.st_size, found.st_mtime_ns
        if self._read is None or self._read[0] != version:
            there = read_dataset_state(self._out, ()) if (work / "unfinished").is_dir() else None
            self._read = version, None if there is None or there.problem else there.identity
        return self._read[1]
