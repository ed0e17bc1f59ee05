# SPDX-License-Identifier: GPL-3.0-or-later
"""Packing a dataset at an address: a tar for each sequence, what describes them, and the shards that it is made from.

Each sequence's tar counts once a small file in the working folder says its size and hash, so a run that is killed goes
on behind the last of them. The manifest is written last; with it the dataset is finished, and the working folder goes.
"""

import json
import re
import threading
from collections.abc import Callable, Iterator
from collections.abc import Sequence as Many
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS
from ..core.atomic_files import sha256_of_bytes
from ..core.errors import InterruptedRunError, StorageError
from ..core.file_access import canonical, parse_json, read_bytes
from ..core.lens import DEPTH_CAMERA, DepthCamera
from ..core.machine import done_ahead
from ..core.packages import missing_packages
from ..core.progress import Progress
from ..layouts import Modality
from .folder_state import IDENTITY, MANIFEST, OVERVIEW, RUN, WORK_FOLDER, first_difference
from .identity import CONVENTIONS, FORMAT
from .shards import SHARDS, Shard, ShardRecord
from .store import Store, missing
from .stored import FolderDataset, FrameImages, ImageReaders, ReadImage, finished_folder, sealed_state
from .tar_files import CARD, CROISSANT, FRAMES_FOLDER, TABLE, FrameSpans, PackedFile, Sink, Span, TarStream, tar_name

# README.md of a packed dataset: the dataset card that people and Hugging Face's hub read, made from its Croissant.


HUB_SIZES = ((10**3, "n<1K"), (10**4, "1K<n<10K"), (10**5, "10K<n<100K"), (10**6, "100K<n<1M"), (10**7, "1M<n<10M"))


def card(content: FolderDataset, described: dict[str, Any], tables_by: str) -> str:
    """Return the card. described: what croissant.json says. tables_by: the version of what wrote the table."""
    frames = sum(content.manifest["frames"].values())
    settings = sorted({name.split("/")[0] for name in content.sequences})
    scenes = sorted({name.split("/")[1] for name in content.sequences})
    tars = [item for item in described["distribution"] if item["encodingFormat"] == "application/x-tar"]
    size = sum(int(item["contentSize"].removesuffix(" B")) for item in tars)
    first, suffix = content.sequences[0], content.suffix("rgb")
    versions = ", ".join(f"{name} {version}" for name, version in sorted(content.identity["versions"].items()))
    conventions = "\n".join(f"- {name}: {text}" for name, text in sorted(content.manifest["conventions"].items()))
    return f"""\
{_front_matter(described, settings, frames)}
# {described["name"]}

{described["description"]}

**Licence**: {described["license"]}

| | |
|---|---|
| sequences | {len(tars)} |
| settings | {len(settings)} |
| scenes | {len(scenes)}: {", ".join(scenes)} |
| frames | {frames} |
| bytes in tars | {size} |

## Files

- `SETTING/SCENE.tar`: a sequence; `tar -xf` gives the folder that loaders of the {content.layout.label} layout read.
- `{TABLE}`: a row for every frame: pose, time stamps, what was done, hashes, and where its files lie in the tars.
- `manifest.json`: all that the dataset was made from, its conventions, and the hashes of its text files.
- `croissant.json`: this description for programs.

## Reading

As samples of WebDataset, without unpacking; `json` holds pose, intrinsics, depth scale, stamps and what was done:

```python
import io, numpy as np, webdataset as wds
from PIL import Image

steps = wds.handle_extension("depth.png", lambda data: np.array(Image.open(io.BytesIO(data))))
for frame in wds.WebDataset("{first}.tar", shardshuffle=False).decode(steps, "rgb8"):
    rgb, told = frame["rgb.{suffix}"], frame["json"]
    depth_m, c2w = frame["depth.png"] / told["depth_scale_per_m"], np.array(told["c2w"])
```

As a stream of Hugging Face's `datasets`: `load_dataset("webdataset", data_files="{first}.tar", streaming=True)`.

## Conventions

{conventions}

## Made with

{versions}; the table with {tables_by}.
"""


def _front_matter(described: dict[str, Any], settings: list[str], frames: int) -> str:
    """Return what the hub reads: the licence, and a configuration for each setting. JSON's texts are YAML's."""
    licence = described["license"]
    known = re.fullmatch(r"[a-z0-9]+([.-][a-z0-9]+)*", licence)
    size = next((name for limit, name in HUB_SIZES if frames < limit), "n>10M")
    rows = [f"license: {licence}"] if known else ["license: other", f"license_name: {json.dumps(licence)}"]
    rows += [f"pretty_name: {json.dumps(described['name'])}", f"size_categories: [{json.dumps(size)}]"]
    rows += [f"tags: {json.dumps(described['keywords'])}", "configs:"]
    for setting in settings:
        rows += [f"  - config_name: {json.dumps(setting)}", f"    data_files: {json.dumps(f'{setting}/*.tar')}"]
    return "\n".join(["---", *rows, "---"])


# manifest.parquet: a row for every frame of a packed dataset.


def table_columns(modalities: Many[Modality]) -> dict[str, tuple[str, str]]:
    """Return the columns by name: the type, as pyarrow calls it, and what it means. pose: 16 numbers, 4 x 4 by rows."""
    columns = {
        "setting": ("string", "the setting: what was done to the sequence"),
        "scene": ("string", "the scene"),
        "frame": ("int32", "the frame's number in its sequence"),
        "time_s": ("float64", "when its colour was taken, seconds"),
        "depth_time_s": ("float64", "when its depth was taken, seconds"),
        "c2w": ("pose", f"the colour camera's pose, 4 x 4 row by row; {CONVENTIONS['pose']}"),
        "perturbed": ("string", "what was done to the frame, as JSON"),
        "tar": ("string", "the tar that holds the frame"),
        "json_offset": ("int64", "where the frame's JSON begins in the tar, bytes"),
        "json_size": ("int64", "the size of the frame's JSON, bytes"),
    }
    for modality in modalities:
        what = CHANNELS[modality].spoken
        columns |= {
            f"{modality}_file": ("string", f"the {what} image's name in the layout, inside the sequence's folder"),
            f"{modality}_sha256": ("string", f"SHA-256 of the {what} image"),
            f"{modality}_offset": ("int64", f"where the {what} image begins in the tar, bytes"),
            f"{modality}_size": ("int64", f"the size of the {what} image, bytes"),
        }
    return columns


def need_writer(store: Store) -> None:
    """Raise MissingDependencyError where the package that writes the table is missing: before anything is made."""
    if missing_packages(["pyarrow"]):
        raise missing(store.text, "pyarrow")


class FrameTable:
    """The table while it is written; memory holds a sequence of it. made_with: the version of what writes it."""

    def __init__(self, sink: Sink, content: FolderDataset) -> None:
        import pyarrow
        import pyarrow.parquet

        self._content = content
        self._pyarrow = pyarrow
        types = {"pose": pyarrow.list_(pyarrow.float64(), 16)}
        fields = [
            pyarrow.field(name, types.get(kind) or pyarrow.type_for_alias(kind), nullable=False)
            for name, (kind, _) in table_columns(content.modalities).items()
        ]
        self.made_with = f"pyarrow {pyarrow.__version__}"
        versions = {"noisy_world": content.identity["versions"]["noisy_world"], "pyarrow": pyarrow.__version__}
        self._schema = pyarrow.schema(fields, metadata=versions)
        self._writer: Any = pyarrow.parquet.ParquetWriter(
            pyarrow.PythonFile(_Writable(sink), mode="w"), self._schema, compression="zstd"
        )

    def add(self, sequence: str, frames: list[FrameImages], spans: list[FrameSpans]) -> None:
        """Write the rows of a sequence."""
        setting, scene = sequence.split("/")
        rows: dict[str, list[Any]] = {
            "setting": [setting] * len(frames),
            "scene": [scene] * len(frames),
            "frame": [frame.number for frame in frames],
            "time_s": [frame.record.time_s for frame in frames],
            "depth_time_s": [frame.depth_time_s for frame in frames],
            "c2w": [frame.c2w.ravel().tolist() for frame in frames],
            "perturbed": [perturbed_text(frame) for frame in frames],
            "tar": [tar_name(sequence)] * len(frames),
            "json_offset": [span.json.offset for span in spans],
            "json_size": [span.json.size for span in spans],
        }
        for modality in self._content.modalities:
            rows[f"{modality}_file"] = [frame.images[modality][0] for frame in frames]
            rows[f"{modality}_sha256"] = [frame.images[modality][1] for frame in frames]
            rows[f"{modality}_offset"] = [span.images[modality].offset for span in spans]
            rows[f"{modality}_size"] = [span.images[modality].size for span in spans]
        self._writer.write_table(self._pyarrow.table(rows, schema=self._schema))

    def __enter__(self) -> "FrameTable":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the table's end, unless an error ended the writing."""
        if kind is None:
            self._writer.close()
        else:
            self._writer.is_open = False  # or it would be written when it is collected


class _Writable:
    """What pyarrow asks of a file that it writes."""

    closed = False

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self.tell = sink.tell

    def write(self, data: Any) -> int:
        return self._sink.write(bytes(data))

    def flush(self) -> None:
        """Do nothing: what was written is on its way."""

    def close(self) -> None:
        """Leave the sink open; who opened it closes it."""


# croissant.json: a packed dataset in the words of MLCommons' Croissant 1.0, for catalogues and loaders.


MEDIA_TYPES = {"jpg": "image/jpeg", "png": "image/png", "exr": "image/x-exr", "npy": "application/x-npy"}
CONFORMS_TO = "http://mlcommons.org/croissant/1.0"
# As the specification gives it: https://docs.mlcommons.org/croissant/docs/croissant-spec.html
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataBiases": "cr:dataBiases",
    "dataCollection": "cr:dataCollection",
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "personalSensitiveInformation": "cr:personalSensitiveInformation",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
NO_LICENCE = "The licences of the scenes apply; the dataset states none of its own."
TYPES = {"string": "sc:Text", "int32": "sc:Integer", "int64": "sc:Integer", "float64": "sc:Float", "pose": "sc:Float"}


def croissant(content: FolderDataset, name: str, tars: list[PackedFile], table: PackedFile) -> dict[str, Any]:
    """Return the content of croissant.json. name: the dataset's. tars: of the sequences. table: manifest.parquet."""
    frames = [
        {
            "@type": "cr:Field",
            "@id": f"frames/{column}",
            "name": column,
            "description": meaning,
            "dataType": TYPES[kind],
            **({"repeated": True} if kind == "pose" else {}),
            "source": {"fileObject": {"@id": TABLE}, "extract": {"column": column}},
        }
        for column, (kind, meaning) in table_columns(content.modalities).items()
    ]
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": name,
        "description": _description(content),
        "license": content.identity["preset"].get("output", {}).get("licence") or NO_LICENCE,
        "version": "1.0.0",
        "keywords": ["RGB-D", "SLAM", "robustness", "synthetic data"],
        "isLiveDataset": False,
        "distribution": [
            _file(
                table,
                "application/x-parquet",
                "a row for every frame: pose, time stamps, what was done, hashes, places",
            ),
            *(_file(tar, "application/x-tar", f"the sequence {tar.name.removesuffix('.tar')}") for tar in tars),
            *(_images(content, modality, tars) for modality in content.modalities),
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "frames",
                "name": "frames",
                "description": "every frame of every sequence",
                "key": [{"@id": f"frames/{column}"} for column in ("setting", "scene", "frame")],
                "field": frames,
            }
        ],
    }


def _file(file: PackedFile, encoding: str, description: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": file.name,
        "name": file.name,
        "description": description,
        "contentUrl": file.name,
        "contentSize": f"{file.size} B",
        "encodingFormat": encoding,
        "sha256": file.sha256,
    }


def _images(content: FolderDataset, modality: Modality, tars: list[PackedFile]) -> dict[str, Any]:
    suffix = content.suffix(modality)
    ending = f"{modality}.{suffix}"
    what = CHANNELS[modality].describe_files(content.depth_scale_per_m, suffix)
    return {
        "@type": "cr:FileSet",
        "@id": f"{modality}-images",
        "name": f"{modality}-images",
        "description": f"{what} images, named SETTING/SCENE/{FRAMES_FOLDER}/NUMBER.{ending}",
        "containedIn": [{"@id": tar.name} for tar in tars],
        "encodingFormat": MEDIA_TYPES[suffix],
        "includes": f"*/*/{FRAMES_FOLDER}/*.{ending}",
    }


def _description(content: FolderDataset) -> str:
    settings, scenes = ({name.split("/")[place] for name in content.sequences} for place in (0, 1))
    several = "s" if len(settings) > 1 else ""
    return (
        f"RGB-D sequences with exact poses: {len(scenes)} scene{'s' if len(scenes) > 1 else ''} under {len(settings)} "
        f"setting{several}, {sum(content.manifest['frames'].values())} frames; made by Noisy World "
        f"{content.identity['versions']['noisy_world']}, seed {content.identity['seed']}."
    )


# A sequence as one tar, which serves two kinds of readers.
#
# Streams take `SETTING/SCENE/frames/000012.rgb.jpg`, `.depth.png` and `.json`, which follow one another: a sample of
# WebDataset's, with all that a reader needs in its JSON. Unpacked, the tar is the folder that loaders of the layout
# read: each image and text has the layout's name too, as a hard link, which streams pass over. Text files are stored
# under names without a dot, by which streams pass over them as well.


def member_name(sequence: str, frame: int, ending: str) -> str:
    """Return the name of a file of a frame inside the tar; ending: "json" for instance."""
    return f"{sequence}/{FRAMES_FOLDER}/{frame:06d}.{ending}"


def write_sequence(
    content: FolderDataset, sequence: str, images: ImageReaders, sink: Sink, stop: threading.Event
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


def _write_frame(
    tar: TarStream, content: FolderDataset, sequence: str, frame: FrameImages, read: ReadImage
) -> FrameSpans:
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


def frame_metadata(content: FolderDataset, sequence: str, frame: FrameImages) -> dict[str, Any]:
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


def _lens(content: FolderDataset, sequence: str) -> dict[str, Any]:
    lens = content.optics(sequence).distortion
    return {"distortion": {"model": "pinhole", "coefficients": []} if lens is None else lens.content()}


def _depth_camera(content: FolderDataset, sequence: str) -> dict[str, Any]:
    own = content.optics(sequence).depth or DepthCamera(content.camera(sequence))
    return {DEPTH_CAMERA: own.content() | {"rgb_from_depth": own.matrix.tolist()}}


def perturbed_text(frame: FrameImages) -> str:
    """Return what was done to a frame, as a text of JSON."""
    return json.dumps(frame.record.perturbed, separators=(",", ":"))


ELSEWHERE = "choose another address"
CLAIM = f"{WORK_FOLDER}/{IDENTITY}"
PACKED_SEQUENCES = f"{WORK_FOLDER}/sequences"  # a small file for each sequence whose tar is written
PACKERS = 4  # sequences that are written at once: stores answer late and take much; chosen: 50 MB of memory each

WrittenTar: TypeAlias = tuple[PackedFile, list[FrameSpans]]
"""A sequence's tar, and where its frames lie in it."""


def pack(
    content: FolderDataset,
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
    content: FolderDataset, images: ImageReaders, store: Store, stop: threading.Event
) -> Iterator[tuple[str, WrittenTar]]:
    """Yield each sequence with its tar, in order; several are written at a time."""

    def packed(sequence: str) -> WrittenTar:
        return _packed_sequence(content, sequence, images, store, stop)

    with closing(done_ahead(packed, content.sequences, threads=PACKERS, ahead=PACKERS, name="packer")) as sequences:
        yield from sequences


def _packed_sequence(
    content: FolderDataset, sequence: str, images: ImageReaders, store: Store, stop: threading.Event
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


# Publishing: a finished dataset in a folder, packed at an address.


@dataclass(frozen=True)
class Publication:
    """What publishing did. new: False where the address held the dataset. sequences, frames: how many it has."""

    new: bool
    sequences: int
    frames: int


def publish(folder: Path, store: Store, progress: Progress, stop: threading.Event) -> Publication:
    """Pack the finished dataset of a folder at an address; each file's hash is checked on the way.

    Raises StorageError where the folder holds no finished dataset, where a file is not as it was written, where the
    address cannot be written or holds another dataset; BusyError where another process writes it; InterruptedRunError
    where `stop` is set.
    """
    content = finished_folder(folder)

    def difference(there: dict[str, Any]) -> str:
        return first_difference(there, content.identity) or ""

    def finished_otherwise(manifest: dict[str, Any]) -> str:
        return "" if manifest == content.manifest else "other frames or files"

    with store.locked():
        new = take(store, content.identity, None, difference, finished_otherwise)
        if new:
            pack(content, content, store, progress, stop, beside=lambda: _run_text(folder))
    return Publication(new, len(content.sequences), sum(content.manifest["frames"].values()))


def _run_text(folder: Path) -> dict[str, bytes]:
    """Return what the run that made a dataset took, where the folder says it."""
    path = folder / RUN
    return {RUN: read_bytes(path)} if path.is_file() else {}


# Shards at an address: each a tar of its files and, written after it, the shard's record, by which it counts.
#
# In the tar lies each content once, whatever names it has, sorted by sequence and name, so that what a sequence takes
# from a shard lies together. The record says where each content is, by its SHA-256.


PLACE = f"{WORK_FOLDER}/{SHARDS}"
CHUNK_BYTES = 8 * 2**20  # read at once, where what is needed lies together; chosen: some frames


@dataclass(frozen=True)
class StoredShard:
    """A finished shard at an store. spans: where each content begins in its tar, and its size, by SHA-256."""

    record: ShardRecord
    spans: dict[str, tuple[int, int]]


def tar_of(shard: Shard) -> str:
    """Return the name of a shard's tar, from the address on."""
    return f"{PLACE}/{shard.folder_name}.tar"


def record_of_shard(shard: Shard) -> str:
    """Return the name of a shard's record, from the address on."""
    return f"{PLACE}/{shard.folder_name}.json"


def put_shard(store: Store, folder: Path, record: ShardRecord) -> StoredShard:
    """Put a finished shard to an address; return it. folder: holds its files.

    Raises StorageError where a file is not as its record says, and where the store refuses.
    """
    spans: dict[str, tuple[int, int]] = {}
    with store.writing(tar_of(record.shard)) as sink:
        tar = TarStream(sink)
        for name, _, digest in sorted(record.files()):
            if digest in spans:
                continue
            data = read_bytes(folder / name)
            if sha256_of_bytes(data) != digest:
                raise StorageError("is not as it was written", file=folder / name, remedy="make the shard again")
            spans[digest] = (tar.add(name, data), len(data))
        tar.close()
    description = {"record": record.content(), "spans": spans, "size": sink.size, "sha256": sink.sha256}
    store.write(
        record_of_shard(record.shard), json.dumps(description, separators=(",", ":"), ensure_ascii=False).encode()
    )
    return StoredShard(record, spans)


def get_shard(store: Store, name: str) -> StoredShard | None:
    """Return a finished shard by the name of its record; None where there is none, or a torn one."""
    data = store.read(name)
    try:
        description: Any = None if data is None else parse_json(data.decode())
        if not isinstance(description, dict):
            return None
        record = ShardRecord.of_content(description["record"])
        spans = {str(digest): (int(span[0]), int(span[1])) for digest, span in description["spans"].items()}
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        return None
    whole = store.size(tar_of(record.shard)) == description["size"] and all(
        digest in spans for *_, digest in record.files()
    )
    return StoredShard(record, spans) if whole else None


def shard_records(store: Store) -> list[str]:
    """Return the names of the records of shards at an address, sorted."""
    return [name for name in store.sizes(PLACE) if name.endswith(".json")]


def damaged_contents(store: Store, stored: StoredShard) -> frozenset[str]:
    """Return the contents of a shard's tar that are not as they were written, by the SHA-256 that they should have."""
    tar = tar_of(stored.record.shard)
    digests = sorted(stored.spans, key=lambda digest: stored.spans[digest])
    wrong: set[str] = set()
    for chunk, start, stop in _chunks(stored, digests):
        data = store.read_range(tar, start, stop)
        for digest in chunk:
            offset, size = stored.spans[digest]
            if sha256_of_bytes(data[offset - start : offset - start + size]) != digest:
                wrong.add(digest)
    return frozenset(wrong)


def _chunks(stored: StoredShard, digests: list[str]) -> Iterator[tuple[list[str], int, int]]:
    """Yield contents that lie together, with where the first begins and the last ends."""
    chunk: list[str] = []
    for digest in digests:
        offset, size = stored.spans[digest]
        if chunk and offset + size - stored.spans[chunk[0]][0] > CHUNK_BYTES:
            yield chunk, stored.spans[chunk[0]][0], sum(stored.spans[chunk[-1]])
            chunk = []
        chunk.append(digest)
    if chunk:
        yield chunk, stored.spans[chunk[0]][0], sum(stored.spans[chunk[-1]])


class ShardImages:
    """The images of a dataset in the shards at an address: 56 bytes of memory for each content."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._shards: list[Shard] = []
        self._parts: list[tuple[NDArray[np.bytes_], NDArray[np.int64]]] = []
        self._digests = np.zeros(0, dtype="S32")
        self._places = np.zeros((0, 3), dtype=np.int64)  # shard, offset, size

    def add(self, stored: StoredShard) -> None:
        """Add what a shard holds."""
        number = len(self._shards)
        self._shards.append(stored.record.shard)
        digests = np.array([bytes.fromhex(digest) for digest in stored.spans], dtype="S32")
        places = np.array([(number, *span) for span in stored.spans.values()], dtype=np.int64).reshape(-1, 3)
        self._parts.append((digests, places))

    def reader(self, sequence: str, frames: list[FrameImages]) -> ReadImage:
        """Return what reads a sequence's images in ranges of the shards' tars, a few megabytes at once."""
        self._join()
        reads = {
            modality: _Chunks(self, [image.images[modality][1] for image in frames])
            for modality in (frames[0].images if frames else ())
        }
        of_name = {name: reads[modality] for frame in frames for modality, (name, _) in frame.images.items()}

        return lambda name, sha256: self._checked(of_name[name].read(sha256), sha256, f"{sequence}/{name}")

    def read_one(self, name: str, sha256: str) -> bytes:
        """Return a single image. name: in the dataset."""
        self._join()
        shard, offset, size = self.place(sha256)
        return self._checked(self.fetch(shard, offset, offset + size), sha256, name)

    def _join(self) -> None:
        """Sort what was added by its hash."""
        if self._parts:
            digests = np.concatenate([self._digests, *(part for part, _ in self._parts)])
            places = np.concatenate([self._places, *(part for _, part in self._parts)])
            order = np.argsort(digests, kind="stable")
            self._digests, self._places = digests[order], places[order]
            self._parts.clear()

    def place(self, sha256: str) -> tuple[int, int, int]:
        """Return where a content is: the shard's number, the offset in its tar, the size."""
        digest = np.array(bytes.fromhex(sha256), dtype="S32")
        row = int(np.searchsorted(self._digests, digest))
        if row == len(self._digests) or self._digests[row] != digest:
            raise RuntimeError(f"no shard holds {sha256}")
        shard, offset, size = self._places[row].tolist()
        return shard, offset, size

    def fetch(self, shard: int, start: int, stop: int) -> bytes:
        """Return bytes of a shard's tar."""
        return self._store.read_range(tar_of(self._shards[shard]), start, stop)

    def _checked(self, data: bytes, sha256: str, name: str) -> bytes:
        """Return a file's content. If it is not as it was written, its shard is forgotten, so that it is made again."""
        if sha256_of_bytes(data) == sha256:
            return data
        shard = self._shards[self.place(sha256)[0]]
        self._store.remove(record_of_shard(shard))
        raise StorageError(
            f"{name} in it is not as it was written",
            file=self._store.of(tar_of(shard)),
            remedy="the shard is dropped, and the same command makes it again",
        )


class _Chunks:
    """Contents that are read one after another: those that lie together in a tar are fetched at once."""

    def __init__(self, images: ShardImages, digests: list[str]) -> None:
        self._images = images
        places = [images.place(digest) for digest in digests]
        self._chunk_of: dict[str, tuple[int, int, int]] = {}  # shard, start, stop
        self._place_of = dict(zip(digests, places, strict=True))
        first = 0
        for k in range(1, len(places) + 1):
            if k < len(places) and _together(places[first], places[k - 1], places[k]):
                continue
            shard, start, _ = places[first]
            stop = places[k - 1][1] + places[k - 1][2]
            for digest in digests[first:k]:
                self._chunk_of.setdefault(digest, (shard, start, stop))
            first = k
        self._held: tuple[tuple[int, int, int], bytes] | None = None

    def read(self, sha256: str) -> bytes:
        chunk = self._chunk_of[sha256]
        if self._held is None or self._held[0] != chunk:
            self._held = (chunk, self._images.fetch(*chunk))
        _, offset, size = self._place_of[sha256]
        start = offset - chunk[1]
        return self._held[1][start : start + size]


def _together(first: tuple[int, int, int], last: tuple[int, int, int], following: tuple[int, int, int]) -> bool:
    """Tell whether a content lies right behind another in one tar, headers aside, and within a chunk from the first."""
    behind = following[1] - (last[1] + last[2])
    within = following[1] + following[2] - first[1] <= CHUNK_BYTES
    return first[0] == following[0] and 0 <= behind <= 4096 and within
