# SPDX-License-Identifier: GPL-3.0-or-later
"""The records of finished frames: the lines of a sequence's journals during a run, and of its frames.jsonl after it."""

import contextlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..regular_files import open_text
from .depth_range import OutOfRange
from .json_text import finite_number, parse_json

LARGEST_S = 1e15  # far beyond any time stamp; a whole number of JSON may be too large for a float
FRAMES = "frames.jsonl"
COMPLETED = "depth_completed"  # the key in what was done to a frame
OUT_OF_RANGE = "depth_out_of_range"  # the key in a record, and in the manifest
_LINES = json.JSONEncoder(separators=(", ", ": "))  # one for all lines: json.dumps makes one for each


@dataclass(frozen=True)
class FrameRecord:
    """The finished part of a frame: its number, its time stamp, and the SHA-256 of each file by name in the sequence.

    perturbed: what was done to it: for colour and depth a list of steps with name, stream, severity and parameters; for
    pairing and motion what the frame shows. out_of_range: the depth that its image cannot hold, None if it holds all.
    depth_time_s: the time stamp of its depth, where it is another.
    """

    frame: int
    time_s: float
    files: dict[str, str]
    perturbed: dict[str, Any] = field(default_factory=dict)
    out_of_range: OutOfRange | None = None
    depth_time_s: float | None = None

    def content(self) -> dict[str, Any]:
        """The record as plain JSON values."""
        record: dict[str, Any] = {"frame": self.frame, "time_s": self.time_s}
        if self.depth_time_s is not None:
            record["depth_time_s"] = self.depth_time_s
        record["sha256"] = self.files
        if self.out_of_range is not None:
            record[OUT_OF_RANGE] = self.out_of_range.content()
        if self.perturbed:
            record["perturbed"] = self.perturbed
        return record

    def line(self) -> str:
        """The record as a line of JSON."""
        return _LINES.encode(self.content()) + "\n"

    def with_motion(self, motion: dict[str, Any]) -> "FrameRecord":
        """Return the record with what motion did to the frame."""
        perturbed = {**self.perturbed, "motion": motion}
        return replace(self, perturbed={name: perturbed[name] for name in sorted(perturbed)})

    def joined(self, other: "FrameRecord") -> "FrameRecord":
        """Return both records as one: colour and depth of a frame may be finished at different times."""
        files = {**self.files, **other.files}
        perturbed = {**self.perturbed, **other.perturbed}
        return FrameRecord(
            self.frame,
            self.time_s,
            {name: files[name] for name in sorted(files, reverse=True)},
            {name: perturbed[name] for name in sorted(perturbed)},
            other.out_of_range or self.out_of_range,
            self.depth_time_s,
        )


def read_records(path: Path) -> Iterator[FrameRecord]:
    """Yield the records of a journal or a frames.jsonl, without torn lines; none where there is no such file.

    Of a file that cannot be read on, the lines before that count.
    """
    if not path.is_file():
        return
    with contextlib.suppress(OSError), open_text(path, errors="replace") as file:
        for line in file:
            if record := read_record(line):
                yield record


def read_record(line: str) -> FrameRecord | None:
    """Read a line of a journal; None for a torn line and for what no run wrote."""
    try:
        return record_of(parse_json(line))
    except ValueError:
        return None


def record_of(record: Any) -> FrameRecord | None:
    """Return the record of plain JSON values; None for what no run wrote."""
    try:
        lost = OutOfRange.of_content(record[OUT_OF_RANGE]) if OUT_OF_RANGE in record else None
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        return None
    match record:
        case {"frame": int(frame), "time_s": int() | float() as time_s, "sha256": dict(files)}:
            done = record.get("perturbed", {})
            depth_time_s = finite_number(record.get("depth_time_s"))
        case _:
            return None
    valid = isinstance(done, dict) and all(isinstance(digest, str) for digest in files.values())
    if not valid or isinstance(frame, bool) or isinstance(time_s, bool) or abs(time_s) > LARGEST_S:
        return None
    return FrameRecord(frame, float(time_s), files, done, lost, depth_time_s)


def joined_records(records: Iterable[FrameRecord]) -> dict[int, FrameRecord]:
    """Return one record for each frame, by frame, in order."""
    found: dict[int, FrameRecord] = {}
    for record in records:
        there = found.get(record.frame)
        found[record.frame] = there.joined(record) if there else record
    return {frame: found[frame] for frame in sorted(found)}
