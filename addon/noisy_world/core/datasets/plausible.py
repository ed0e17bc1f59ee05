# SPDX-License-Identifier: GPL-3.0-or-later
"""Which records can be those of a sequence: journals may have been changed by a disk, a tool or a person."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from .layouts import FrameNames
from .records import FrameRecord, joined_records


def plausible_records(records: Iterable[FrameRecord], names: FrameNames, count: int) -> dict[int, FrameRecord]:
    """Return by frame what records say of a sequence's frames and of files that these have; the rest is no record.

    names: of the frames' files. count: of the sequence's frames.
    """

    def parts() -> Iterator[FrameRecord]:
        for record in records:
            if 0 <= record.frame < count and (record.time_s, record.depth_time_s) == names.stamps.told(record.frame):
                own = names.of(record.frame)
                yield replace(record, files={name: digest for name, digest in record.files.items() if name in own})

    return joined_records(parts())
