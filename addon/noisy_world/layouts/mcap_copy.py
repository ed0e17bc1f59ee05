# SPDX-License-Identifier: GPL-3.0-or-later
"""A copy of an MCAP file with other data in some of its messages; all other records stay as they are.

Chunks keep their compression, and the summary is written anew: https://mcap.dev/spec.
"""

import io
import struct
from binascii import crc32
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, TypeAlias

from .bag_files import MCAP_MAGIC, McapPart, compressed, packed

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX, _CHUNK_INDEX, _ATTACHMENT = 2, 3, 4, 5, 6, 7, 8, 9
_ATTACHMENT_INDEX, _STATISTICS, _METADATA, _METADATA_INDEX, _SUMMARY_OFFSET, _DATA_END = 10, 11, 12, 13, 14, 15
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, number, time of recording, time of publishing

Make: TypeAlias = Callable[[], bytes | memoryview] | None
"""Makes the data of a message; None where it goes."""


@dataclass(frozen=True)
class Added:
    """A message that the file has not. channel: its number there."""

    log_ns: int
    channel: int
    make: Callable[[], bytes | memoryview]


def copy_mcap(part: McapPart, out: Path, changed: Mapping[tuple[int, int], Make], added: Sequence[Added]) -> None:
    """Write a copy. changed: by a message's chunk and place, as its index has them."""
    with out.open("xb") as file, part.reading():
        _Copy(part, file, changed, added).write()


def _string(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def _text_at(data: bytes, at: int) -> bytes:
    (length,) = struct.unpack_from("<I", data, at)
    return data[at + 4 : at + 4 + length]


@dataclass(eq=False)
class _Copy:
    part: McapPart
    file: BinaryIO
    changed: Mapping[tuple[int, int], Make]
    added: Sequence[Added]
    described: dict[tuple[int, int], bytes] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    chunks: list[bytes] = field(default_factory=list)
    attachments: list[bytes] = field(default_factory=list)
    metadata: list[bytes] = field(default_factory=list)
    span_ns: list[int] = field(default_factory=list)
    numbers: Counter[int] = field(default_factory=Counter)

    def write(self) -> None:
        """Copy the records up to the end of the data, and write what stands behind."""
        self.file.write(MCAP_MAGIC)
        at, chunk, part = len(MCAP_MAGIC), -1, self.part
        while True:
            kind, length = _RECORD.unpack(part.at(at, _RECORD.size))
            start = at + _RECORD.size
            if kind == _CHUNK:
                chunk += 1
                self._chunk(*self._inside(chunk), part.chunks[chunk].compression)
            elif kind == _MESSAGE:
                self._message(self.file, part.at(start, length), (-1, start))
            elif kind in (_DATA_END, _FOOTER):
                break
            elif kind != _INDEX:
                self._other(kind, part.at(start, length))
            at = start + length
        self._last()
        self._record(self.file, _DATA_END, struct.pack("<I", 0))
        self._summary()

    def _record(self, out: BinaryIO, kind: int, content: bytes) -> int:
        """Write a record; return where it begins."""
        at = out.tell()
        out.write(_RECORD.pack(kind, len(content)))
        out.write(content)
        return at

    def _other(self, kind: int, content: bytes) -> None:
        """Copy a record of another kind, and note what the summary tells of it."""
        at = self._record(self.file, kind, content)
        where = struct.pack("<QQ", at, self.file.tell() - at)
        if kind in (_SCHEMA, _CHANNEL):
            self._describe(kind, content)
        elif kind == _ATTACHMENT:
            name = _text_at(content, 16)
            media = _text_at(content, 20 + len(name))
            (size,) = struct.unpack_from("<Q", content, 24 + len(name) + len(media))
            self.attachments.append(where + content[:16] + struct.pack("<Q", size) + _string(name) + _string(media))
        elif kind == _METADATA:
            self.metadata.append(where + _string(_text_at(content, 0)))

    def _describe(self, kind: int, content: bytes) -> None:
        (number,) = struct.unpack_from("<H", content)
        self.described.setdefault((kind, number), content)

    def _message(self, out: BinaryIO, content: bytes, place: tuple[int, int]) -> tuple[int, int, int] | None:
        """Write a message; return its channel, time and place; None where it goes."""
        channel, _, log_ns, _ = _MESSAGE_HEAD.unpack_from(content)
        if place in self.changed:
            if (make := self.changed[place]) is None:
                return None
            data = packed(bytes(make()), content[_MESSAGE_HEAD.size :][:4])
            content = content[: _MESSAGE_HEAD.size] + data
        return self._counted(out, channel, log_ns, content)

    def _counted(self, out: BinaryIO, channel: int, log_ns: int, content: bytes) -> tuple[int, int, int]:
        self.counts[channel] += 1
        self.span_ns = [min([log_ns, *self.span_ns[:1]]), max([log_ns, *self.span_ns[1:]])]
        return channel, log_ns, self._record(out, _MESSAGE, content)

    def _inside(self, number: int) -> tuple[bytes, list[tuple[int, int, int]]]:
        """Return what a chunk holds now, and where its messages lie in it."""
        part, out, found, at = self.part, io.BytesIO(), list[tuple[int, int, int]](), 0
        while at < part.chunks[number].whole_bytes:
            kind, length = _RECORD.unpack(part.part_of_chunk(number, at, _RECORD.size))
            content = part.part_of_chunk(number, at + _RECORD.size, length)
            if kind == _MESSAGE:
                if (message := self._message(out, content, (number, at))) is not None:
                    found.append(message)
            else:
                self._record(out, kind, content)
                if kind in (_SCHEMA, _CHANNEL):
                    self._describe(kind, content)
            at += _RECORD.size + length
        return out.getvalue(), found

    def _chunk(self, whole: bytes, messages: list[tuple[int, int, int]], compression: str) -> None:
        """Write a chunk, and the indexes of its messages behind it."""
        if not whole:
            return
        times = [log_ns for _, log_ns, _ in messages] or [0]
        stored = compressed(whole, compression, self.part.path)
        head = struct.pack("<QQQI", min(times), max(times), len(whole), crc32(whole)) + _string(compression.encode())
        at = self._record(self.file, _CHUNK, head + struct.pack("<Q", len(stored)) + stored)
        end = self.file.tell()
        places: dict[int, int] = {}
        for channel in dict.fromkeys(channel for channel, _, _ in messages):
            entries = [struct.pack("<QQ", log_ns, place) for of, log_ns, place in messages if of == channel]
            content = struct.pack("<HI", channel, 16 * len(entries)) + b"".join(entries)
            places[channel] = self._record(self.file, _INDEX, content)
        mapped = b"".join(struct.pack("<HQ", *item) for item in places.items())
        index = struct.pack("<QQQQ", min(times), max(times), at, end - at) + _string(mapped)
        index += struct.pack("<Q", self.file.tell() - end) + _string(compression.encode())
        self.chunks.append(index + struct.pack("<QQ", len(stored), len(whole)))

    def _last(self) -> None:
        """Write the messages that the file has not: in a chunk of their own, where it has chunks."""
        out, found = io.BytesIO(), list[tuple[int, int, int]]()
        for item in sorted(self.added, key=lambda item: item.log_ns):
            content = _MESSAGE_HEAD.pack(item.channel, 0, item.log_ns, item.log_ns) + bytes(item.make())
            found.append(self._counted(out if self.chunks else self.file, item.channel, item.log_ns, content))
        if self.chunks:
            self._chunk(out.getvalue(), found, self.part.chunks[-1].compression)

    def _summary(self) -> None:
        """Write the summary, where its groups are, and the footer."""
        first_ns, last_ns = self.span_ns or (0, 0)
        kinds = Counter(kind for kind, _ in self.described)
        statistics = struct.pack("<QHI", self.counts.total(), kinds[_SCHEMA], kinds[_CHANNEL])
        statistics += struct.pack("<III", len(self.attachments), len(self.metadata), len(self.chunks))
        counted = b"".join(struct.pack("<HQ", *item) for item in sorted(self.counts.items()))
        groups: list[tuple[int, list[bytes]]] = [
            (_SCHEMA, [content for (kind, _), content in self.described.items() if kind == _SCHEMA]),
            (_CHANNEL, [content for (kind, _), content in self.described.items() if kind == _CHANNEL]),
            (_STATISTICS, [statistics + struct.pack("<QQ", first_ns, last_ns) + _string(counted)]),
            (_CHUNK_INDEX, self.chunks),
            (_ATTACHMENT_INDEX, self.attachments),
            (_METADATA_INDEX, self.metadata),
        ]
        start, offsets = self.file.tell(), list[bytes]()
        for kind, contents in groups:
            at = self.file.tell()
            for content in contents:
                self._record(self.file, kind, content)
            if contents:
                offsets.append(struct.pack("<BQQ", kind, at, self.file.tell() - at))
        behind = self.file.tell()
        for content in offsets:
            self._record(self.file, _SUMMARY_OFFSET, content)
        self._record(self.file, _FOOTER, struct.pack("<QQI", start, behind, 0))
        self.file.write(MCAP_MAGIC)
