# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tars of a packed dataset hold, hashed: each is read once, from its beginning to its end."""

import contextlib
import hashlib
import io
import json
import tarfile
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

from ..core.errors import InterruptedRunError
from ..core.frame_table import FRAMES, FrameRecord, joined_records, records_in
from ..core.lens import DEPTH_CAMERA, DepthCamera
from ..core.machine import done_ahead
from ..layouts import Modality
from .finished import FRAMES_FOLDER, Content, FrameImages, ImageReaders, ReadImage, tar_name
from .store import Store

READERS = 4  # tars that are read at once: stores answer late; chosen: 30 MB of memory each
PIECE_BYTES = 2**20


@dataclass(frozen=True)
class TarContent:
    """A tar's files. digests: the SHA-256 of each by its name in the dataset, links too. records: of its frames.jsonl.

    sha256: of the tar. Of one that is damaged, what lies behind the damage may be missing here.
    """

    digests: dict[str, str]
    records: dict[int, FrameRecord]
    sha256: str

    def of_layout(self, sequence: str) -> dict[str, str]:
        """Return the files that unpacking gives, samples aside: SHA-256 by name in the sequence's folder."""
        start = f"{sequence}/"
        names = (name for name in self.digests if name.startswith(start))
        return {
            name.removeprefix(start): self.digests[name]
            for name in names
            if not name.startswith(f"{start}{FRAMES_FOLDER}/")
        }

    def beside(self, sequence: str) -> dict[str, str]:
        """Return the files beside the sequence's folder: SHA-256 by name in the dataset."""
        return {name: digest for name, digest in self.digests.items() if not name.startswith(f"{sequence}/")}


def tar_contents(
    store: Store, sequences: list[str], sizes: dict[str, int], stop: threading.Event
) -> Iterator[tuple[str, TarContent]]:
    """Yield the sequences with what their tars hold, in order; several are read at a time.

    sizes: of the files in the store. Raises StorageError where the store refuses, InterruptedRunError where `stop` is
    set.
    """
    ending = threading.Event()  # so that nobody waits for tars that are not asked for any more

    def read(sequence: str) -> TarContent:
        return read_tar(store, sequence, sizes[tar_name(sequence)], lambda: stop.is_set() or ending.is_set())

    with closing(done_ahead(read, sequences, threads=READERS, ahead=READERS, name="tar-reader")) as contents:
        try:
            yield from contents
        finally:
            ending.set()


def read_tar(store: Store, sequence: str, size: int, stopped: Callable[[], bool]) -> TarContent:
    """Return what the tar of a sequence holds. Raises InterruptedRunError where `stopped` says so."""
    stream = _Hashed(store.pieces(tar_name(sequence), size), stopped)
    found = _TarMembers()
    # ValueError: of numbers in a damaged header
    with (
        contextlib.suppress(tarfile.TarError, EOFError, ValueError),
        tarfile.open(fileobj=stream, mode="r|", bufsize=PIECE_BYTES) as tar,
    ):
        for member in tar:
            found.add(tar, member)
    while stream.read(PIECE_BYTES):
        pass
    records = joined_records(records_in(found.lines(sequence)))
    return TarContent(found.digests, records, stream.sha256)


def texts_of(data: bytes, sequence: str) -> dict[str, bytes]:
    """Return the text files of a sequence by name, of a tar's end that begins with a header.

    Of an end that is damaged, what lies behind the damage may be missing.
    """
    found = _TarMembers()
    with contextlib.suppress(tarfile.TarError, EOFError, ValueError), tarfile.open(fileobj=io.BytesIO(data)) as tar:
        for member in tar:
            found.add(tar, member)
    start = f"{sequence}/"
    named = {name.removeprefix(start): stored for name, stored in found.stored.items() if name.startswith(start)}
    return {name: found.texts[stored] for name, stored in named.items() if stored in found.texts}


@dataclass
class _TarMembers:
    """The members of a tar so far. stored: what links lead to. texts: the content of text files, as they are stored."""

    digests: dict[str, str] = field(default_factory=dict)
    stored: dict[str, str] = field(default_factory=dict)
    texts: dict[str, bytes] = field(default_factory=dict)

    def add(self, tar: tarfile.TarFile, member: tarfile.TarInfo) -> None:
        """Hash a member; a link is what it leads to."""
        if member.islnk() and member.linkname in self.digests:
            self.digests[member.name] = self.digests[member.linkname]
            self.stored[member.name] = member.linkname
        elif member.isreg() and (file := tar.extractfile(member)) is not None:
            digest = hashlib.sha256()
            kept: list[bytes] | None = [] if f"/{FRAMES_FOLDER}/texts/" in member.name else None
            while piece := file.read(PIECE_BYTES):
                digest.update(piece)
                if kept is not None:
                    kept.append(piece)
            self.digests[member.name] = digest.hexdigest()
            if kept is not None:
                self.texts[member.name] = b"".join(kept)

    def lines(self, sequence: str) -> list[str]:
        """Return the lines of the sequence's frames.jsonl."""
        data = self.texts.get(self.stored.get(f"{sequence}/{FRAMES}", ""), b"")
        return data.decode(errors="replace").splitlines(keepends=True)


class _Hashed(io.RawIOBase):
    """Pieces of a file, read as one stream and hashed on the way."""

    def __init__(self, pieces: Iterator[bytes], stopped: Callable[[], bool]) -> None:
        super().__init__()
        self._pieces = pieces
        self._stopped = stopped
        self._left = b""
        self._at = 0
        self._digest = hashlib.sha256()

    @property
    def sha256(self) -> str:
        """The SHA-256 of what was read, in hexadecimal."""
        return self._digest.hexdigest()

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes, as many as are at hand; none at the end."""
        if self._at == len(self._left):
            if self._stopped():
                raise InterruptedRunError("stopped; nothing was written")
            self._left, self._at = next(self._pieces, b""), 0
            self._digest.update(self._left)
        stop = len(self._left) if size < 0 else self._at + size
        data = self._left[self._at : stop]
        self._at += len(data)
        return data


# Tars that are the same to the byte whenever and wherever they are written, and written without going back.


BLOCK = tarfile.BLOCKSIZE


class Sink(Protocol):
    """What a tar is written to."""

    def write(self, data: bytes, /) -> int:
        """Write the next bytes."""
        ...

    def tell(self) -> int:
        """Return how many bytes were written."""
        ...


class TarStream:
    """A tar of plain files and of links to these, in the order in which they are added.

    Owner, mode and time are the same for all: 0, rw-r--r--, 1 January 1970. POSIX's pax format says in a block of its
    own what the older format cannot hold: names of more than 100 bytes.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink

    def add(self, name: str, data: bytes) -> int:
        """Add a file; return where its content begins in the tar."""
        info = _entry(name)
        info.size = len(data)
        self._head(info)
        offset = self._sink.tell()
        self._sink.write(data)
        self._fill(BLOCK)
        return offset

    def link(self, name: str, target: str) -> None:
        """Add another name of a file that was added; unpacked, it is a hard link."""
        info = _entry(name)
        info.type = tarfile.LNKTYPE
        info.linkname = target
        self._head(info)

    def close(self) -> None:
        """Write the tar's end."""
        self._sink.write(bytes(2 * BLOCK))
        self._fill(tarfile.RECORDSIZE)

    def _head(self, info: tarfile.TarInfo) -> None:
        self._sink.write(info.tobuf(tarfile.PAX_FORMAT, "utf-8", "strict"))

    def _fill(self, block: int) -> None:
        """Write zeros up to the next block."""
        self._sink.write(bytes(-self._sink.tell() % block))


def _entry(name: str) -> tarfile.TarInfo:
    info = tarfile.TarInfo(name)
    info.mode = 0o644
    return info


# A sequence as one tar, which serves two kinds of readers.
#
# Streams take `SETTING/SCENE/frames/000012.rgb.jpg`, `.depth.png` and `.json`, which follow one another: a sample of
# WebDataset's, with all that a reader needs in its JSON. Unpacked, the tar is the folder that loaders of the layout
# read: each image and text has the layout's name too, as a hard link, which streams pass over. Text files are stored
# under names without a dot, by which streams pass over them as well.


@dataclass(frozen=True)
class Span:
    """Where the content of a file lies in its tar. offset, size: in bytes."""

    offset: int
    size: int


@dataclass(frozen=True)
class FrameSpans:
    """Where a frame lies in its sequence's tar: its JSON and its images."""

    json: Span
    images: dict[Modality, Span]


def member_name(sequence: str, frame: int, ending: str) -> str:
    """Return the name of a file of a frame inside the tar; ending: "json" for instance."""
    return f"{sequence}/{FRAMES_FOLDER}/{frame:06d}.{ending}"


def write_sequence(
    content: Content, sequence: str, images: ImageReaders, sink: Sink, stop: threading.Event
) -> list[FrameSpans]:
    """Write the tar of a sequence; return where its frames lie. Raises InterruptedRunError where `stop` is set."""
    tar = TarStream(sink)
    frames = content.frames(sequence)
    read = images.reader(sequence, frames)
    spans: list[FrameSpans] = []
    for frame in frames:
        if stop.is_set():
            raise InterruptedRunError("stopped")
        spans.append(_write_frame(tar, content, sequence, frame, read))
    for name, digest in content.texts(sequence).items():
        stored = f"{sequence}/{FRAMES_FOLDER}/texts/{name.removeprefix(f'{sequence}/').replace('.', '_')}"
        tar.add(stored, content.file(name, digest))
        tar.link(name, stored)
    tar.close()
    return spans


def _write_frame(tar: TarStream, content: Content, sequence: str, frame: FrameImages, read: ReadImage) -> FrameSpans:
    images: dict[Modality, Span] = {}
    links: dict[str, str] = {}
    for modality, (name, digest) in frame.images.items():
        stored = member_name(sequence, frame.number, f"{modality}.{content.suffix(modality)}")
        data = read(name, digest)
        images[modality] = Span(tar.add(stored, data), len(data))
        links[f"{sequence}/{name}"] = stored
    metadata = json.dumps(frame_metadata(content, sequence, frame), separators=(",", ":")).encode()
    at = tar.add(member_name(sequence, frame.number, "json"), metadata)
    for name, stored in links.items():
        tar.link(name, stored)
    return FrameSpans(Span(at, len(metadata)), images)


def frame_metadata(content: Content, sequence: str, frame: FrameImages) -> dict[str, Any]:
    """Return what the JSON of a frame says: the same keys with values of the same types for every frame of a dataset.

    c2w: 4 x 4. camera: its intrinsics in pixels, and where a lens of the dataset distorts, its own. depth_camera: that
    of depth, where any of the dataset's has another than colour. perturbed: what was done to the frame, as a text of
    JSON, since it has other keys for other perturbations.
    """
    setting, scene = sequence.split("/")
    return {
        "setting": setting,
        "scene": scene,
        "frame": frame.number,
        "time_s": frame.record.time_s,
        "depth_time_s": frame.depth_time_s,
        "c2w": frame.c2w.tolist(),
        "camera": asdict(content.camera(sequence)) | (_lens(content, sequence) if content.distorts else {}),
        **(_depth_camera(content, sequence) if content.seen_apart else {}),
        "depth_scale_per_m": content.depth_scale_per_m,
        "perturbed": perturbed_text(frame),
    }


def _lens(content: Content, sequence: str) -> dict[str, Any]:
    lens = content.optics(sequence).distortion
    return {"distortion": {"model": "pinhole", "coefficients": []} if lens is None else lens.content()}


def _depth_camera(content: Content, sequence: str) -> dict[str, Any]:
    own = content.optics(sequence).depth or DepthCamera(content.camera(sequence))
    return {DEPTH_CAMERA: own.content() | {"rgb_from_depth": own.matrix.tolist()}}


def perturbed_text(frame: FrameImages) -> str:
    """Return what was done to a frame, as a text of JSON."""
    return json.dumps(frame.record.perturbed, separators=(",", ":"))
