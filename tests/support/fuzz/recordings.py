# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings of every layout with changed files, read as a run reads them: undistorted and registered where asked.

Of the area `recordings`, bytes and words of one or two files are changed; of `recording_files`, the structure of texts
is, and files are renamed, lost and mixed up. Images are compared with those of another decoder, where one is here.
"""

import functools
import json
import shutil
import struct
import zlib

import numpy as np
from fuzz.mutation import NUMBERS, mutate_bytes, mutate_mixed, pick
from fuzz.peers import image_by_pillow
from fuzz.structure import beside, kept, note, text_changed
from recorded_layouts import WRITERS, WRITTEN

from noisy_world.core.errors import InputError
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.schema import ConfigPath
from noisy_world.core.frame_request import FrameRequest
from noisy_world.sources.recording import read_recording

LAYOUTS = WRITTEN | WRITERS
WORDS = (
    *NUMBERS, "#", "rgb/", "depth/", "../", "/", ".png", ".jpg", "\n", "\r", "\t", ",", "\0", "{", "}", "[", "]", '"',
    ":", "camera", "scale", "fx", "null", "true", "NaN", "Infinity", "[" * 3000, '{"a":' * 3000,
)  # fmt: skip
NAMES = (
    "camera", "fx", "scale", "timestamp", "rgb/", "depth/", "../sequence/traj.txt", "data.csv", "radial-tangential",
    "PINHOLE",
    "1403636579760000000", "OPENCV_FISHEYE", "m_depthShift", "=", "frames", "file_path", "k1", "nan",
)  # fmt: skip
TEXTS = (".txt", ".json", ".yaml", ".csv", ".log", ".freiburg")
TASK = "task.json"  # what is asked for of the recording, and the names of images that end early
LENS = {"model": "radial-tangential", "coefficients": [0.1, -0.05, 0.001, 0.002]}
TURNED = [[1, 0, 0, 0.02], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
DEPTH_CAMERA = {"w": 64, "h": 48, "fx": 50.0, "fy": 55.0, "cx": 30.0, "cy": 25.0, "rgb_from_depth": TURNED}


@functools.cache
def _sound(layout):
    """Return the folder of a recording, made once in a process."""
    folder = kept("recordings") / layout
    folder.mkdir()
    LAYOUTS[layout](folder)
    return folder


def _written(folder, rng):
    """Write a recording, in some with a lens and a camera of depth's own; return its folder and its texts."""
    beside(folder)
    sequence = folder / "sequence"
    shutil.copytree(_sound(pick(rng, tuple(LAYOUTS))), sequence)
    told = sequence / "cam_params.json"
    if told.exists():
        optics = (("distortion", LENS), ("depth_camera", DEPTH_CAMERA))
        more = {name: value for name, value in optics if rng.integers(2)}
        told.write_text(json.dumps({**json.loads(told.read_text()), **more}, indent=2))
    return sequence, sorted(path for path in sequence.rglob("*") if path.suffix in TEXTS)


def _tell(folder, rng, *, often=0.1, cut=(), sound=False):
    """Write what is asked for of a recording: of one that is sound, what it can do."""
    poses = "drop" if sound else pick(rng, ("drop", "drop", "drop", "keep", "none", "require"))
    asked = {name: not sound and bool(rng.random() < often) for name in ("undistort", "register")}
    (folder / TASK).write_text(json.dumps({"asked": {"poses": poses, **asked}, "cut": list(map(str, cut))}))


def write(folder, rng):
    """Write a recording, and mutate one or two of its files."""
    sequence, texts = _written(folder, rng)
    paths = sorted(path for path in sequence.rglob("*") if path.is_file())
    cut = []
    for _ in range(int(rng.integers(1, 3))):
        path = pick(rng, texts if rng.integers(2) else paths)
        data = path.read_bytes() if path.exists() else b""
        match int(rng.integers(8)):
            case 0:
                path.unlink(missing_ok=True)
            case 1:
                path.write_bytes(b"")
            case 2:
                other = pick(rng, paths)
                path.write_bytes(other.read_bytes() if other.exists() else b"")
            case _ if path.suffix in TEXTS:
                path.write_bytes(mutate_mixed(data.decode("utf-8", "replace"), rng, WORDS))
            case 3 if len(data) > 1:
                path.write_bytes(data[: int(rng.integers(1, len(data)))])
                cut.append(path)
            case 4 if data.startswith(b"\x89PNG") and len(data) > 33:
                path.write_bytes(with_header(data, rng))
            case _:
                path.write_bytes(mutate_bytes(data, rng))
    _tell(folder, rng, cut=cut)


def with_header(data, rng):
    """Return a PNG with another header: a size, bits or a kind, with the right sum."""
    values = list(struct.unpack(">IIBBBBB", data[16:29]))
    others = (
        ((0, 1, 5, 60_000, 2**31 - 1, 2**32 - 1),) * 2 + ((1, 2, 3, 4, 8, 16),) + ((0, 2, 3, 4, 6),) + ((0, 1),) * 3
    )
    at = int(rng.integers(len(values)))
    values[at] = pick(rng, others[at])
    header = b"IHDR" + struct.pack(">IIBBBBB", *values)
    return data[:12] + header + struct.pack(">I", zlib.crc32(header)) + data[33:]


def write_files(folder, rng):
    """Write a recording, and change some of its texts by their structure, or its files."""
    sequence, texts = _written(folder, rng)
    told = []
    for _ in range(int(rng.integers(1, 3))):
        path = pick(rng, texts)
        if rng.integers(5) == 0:
            told.append(_files_changed(sequence, rng))
        elif path.is_file():
            told += text_changed(path, rng, words=NAMES)
    _tell(folder, rng, often=0.2, sound=not told)
    note(folder, told)


def _files_changed(sequence, rng):
    """Rename, remove, repeat or replace a file of a recording; return what was done."""
    paths = sorted(path for path in sequence.rglob("*") if path.is_file() and not path.is_symlink())
    if not paths:
        return "nothing is left"
    path, other = pick(rng, paths), pick(rng, paths)
    data = path.read_bytes()
    match int(rng.integers(8)):
        case 0:
            path.unlink()
        case 1:
            path.replace(path.with_name(pick(rng, ("x", "é", "a" * 200, "-1", "1e3", "000000", " ")) + path.suffix))
        case 2:
            path.with_name(path.stem + "0" + path.suffix).write_bytes(data)
        case 3:
            path.write_bytes(other.read_bytes())
        case 4:
            path.unlink()
            path.mkdir()
        case 5:
            path.unlink()
            path.symlink_to(other)
        case 6:
            path.replace(path.with_suffix(path.suffix.upper()))
        case _:
            path.with_suffix(".bak").write_bytes(data)
            path.write_bytes(b"")
    return f"{path.name}: another file"


def read(folder):
    """Read every frame as a run does; return the sequence with its images, as they are stored."""
    task = json.loads((folder / TASK).read_text())
    recording = read_recording(folder / "sequence", ConfigPath(folder / TASK), **task["asked"])
    stored = recording.stored
    assert min(stored.size_px) > 0
    count = len(stored.trajectory)
    if count > 100:
        raise InputError(folder, "has many frames")
    notes, images = [], []
    asked = Intrinsics(*stored.size_px, 6.0, 6.0, 3.0, 2.0) if stored.known_camera is None else None
    with recording.prepare(recording.camera(asked), notes.append) as opened:
        for index in range(count):
            frame = opened.frame(FrameRequest(index, 0.0, np.eye(4), np.eye(4)))
            stored_m = None if frame.stored.depth_file is None else frame.stored.depth_m
            for rgb, depth_m in ((frame.rgb, frame.depth_m), (frame.stored.rgb, stored_m)):
                assert rgb.dtype in (np.uint8, np.float32)
                assert rgb.ndim == 3
                assert depth_m is None or (np.isfinite(depth_m).all() and depth_m.min() >= 0)
            images.append((frame.stored, rgb, depth_m))
    assert all(note.isprintable() for note in notes)
    recording.hashes()
    return images


def differs(folder, images):
    """Return which image is accepted that ends early, and how the images differ from another decoder's, if one is here.

    A file that is cut may have been mutated again, or its frame left out.
    """
    cut = set(json.loads((folder / TASK).read_text())["cut"])
    for frame, rgb, depth_m in images:
        held = [(frame.rgb_file, rgb, 1.0), (frame.depth_file, depth_m, frame.depth_scale_per_m)]
        for path, ours, scale in held if frame.depth_file is not None else held[:1]:
            if str(path) in cut and _is_cut(path.read_bytes()):
                return f"{path.name} ends early, and is read"
            theirs = None if path.suffix == ".jpg" else image_by_pillow(path)  # a JPEG's scans have no checksum
            if theirs is None:
                continue  # a kind that the other decoder does not know
            if isinstance(theirs, str):
                return f"{path.name} is read, but the other decoder says: {theirs}"
            if ours.ndim == 3 and theirs.ndim == 2:
                theirs = np.repeat(theirs[..., None], 3, axis=2)
            if theirs.shape[:2] != ours.shape[:2]:
                return f"{path.name} has {ours.shape} pixels, and {theirs.shape} in the other decoder"
            divisor, near = (65535.0, 1e-6) if ours.dtype == np.float32 and path == frame.rgb_file else (scale, 1e-3)
            seen = ours > 0 if path == frame.depth_file else ...  # some layouts say void by the largest number
            if theirs.shape == ours.shape and np.abs(theirs / divisor - ours)[seen].max(initial=0.0) > near:
                return f"{path.name} has other pixels in the other decoder"
    return ""


def _is_cut(data):
    """Tell by its end alone whether an image of these writers, which put nothing behind the end, is cut."""
    return not data.endswith((b"IEND\xaeB`\x82", b"\xff\xd9"))
