# SPDX-License-Identifier: GPL-3.0-or-later
"""Drops records that cannot belong to a sequence; a disk, a tool or a person may have changed a journal."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import TypeAlias

from .layouts import FrameNames
from .records import FrameRecord, joined_records

AsPlanned: TypeAlias = Callable[[FrameRecord], bool]
"""Tells whether a record says that to its files was done what is planned."""


def plausible_records(records: Iterable[FrameRecord], names: FrameNames, count: int) -> dict[int, FrameRecord]:
    """Return by frame what records say of a sequence's frames and of files that these have; the rest is no record.

    names: of the frames' files. count: of the sequence's frames.
    """
    return joined_records(_plausible(records, names, count))


def planned_records(
    records: Iterable[FrameRecord], names: FrameNames, count: int, as_planned: AsPlanned
) -> tuple[dict[int, FrameRecord], str]:
    """Return what `plausible_records` does, without records of what is not planned, and a note on these, or ""."""
    planned: list[FrameRecord] = []
    changed: list[int] = []
    for record in _plausible(records, names, count):
        planned.append(record) if as_planned(record) else changed.append(record.frame)
    if not changed:
        return joined_records(planned), ""
    message = f"{len(changed)} records of its journals, of frame {changed[0]} the first, do not say what is planned"
    return joined_records(planned), f"{message}; what they tell of is made again"


def _plausible(records: Iterable[FrameRecord], names: FrameNames, count: int) -> Iterator[FrameRecord]:
    for record in records:
        if 0 <= record.frame < count and (record.time_s, record.depth_time_s) == names.stamps.frame_times(record.frame):
            own = names.of(record.frame)
            yield replace(record, files={name: digest for name, digest in record.files.items() if name in own})
