# SPDX-License-Identifier: GPL-3.0-or-later
"""A sequence as one tar, which serves two kinds of readers.

Streams take `SETTING/SCENE/frames/000012.rgb.jpg`, `.depth.png` and `.json`, which follow one another: a sample of
WebDataset's, with all that a reader needs in its JSON. Unpacked, the tar is the folder that loaders of the layout read:
each image and text has the layout's name too, as a hard link, which streams pass over. Text files are stored under
names without a dot, by which streams pass over them as well.
"""

import json
import threading
from dataclasses import asdict, dataclass
from typing import Any

from ..core.datasets.layouts import Modality
from ..core.errors import InterruptedRunError
from ..core.optics import DEPTH_CAMERA, DepthCamera
from .finished import Content, FrameImages, ImageReaders, ReadImage
from .packed_names import FRAMES_FOLDER
from .tar_stream import Sink, TarStream


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
