# SPDX-License-Identifier: GPL-3.0-or-later
"""The record of a finished shard, `shard.json`: what it was made from, and every file with its SHA-256.

It is written last and whole, so a folder that has one is finished.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..planning.shards import Shard
from .dataset_state import WORK_FOLDER
from .identity_mismatch import identity_sha256
from .json_text import read_json
from .records import FrameRecord, record_of
from .storage import sha256_of_bytes

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
    def of_content(cls, value: Any) -> "ShardRecord":
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
