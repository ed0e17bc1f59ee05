# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings with one or two mutated files, read as a run reads them: undistorted and registered where a task says so.
Their images are compared with those of the file before and, where there is one, of another decoder.
"""

import json
import struct
import zlib

import cv2
import numpy as np
from fuzz import recorded
from fuzz.mutation import NUMBERS, mutate_bytes, mutate_mixed, pick
from stored_sequences import write_euroc, write_vslamlab

from noisy_world.core.errors import InputError
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.schema import ConfigPath
from noisy_world.core.trajectories.frame_request import FrameRequest
from noisy_world.sources.recording import read_recording

WORDS = (
    *NUMBERS, "#", "rgb/", "depth/", "../", "/", ".png", ".jpg", "\n", "\r", "\t", ",", "\0", "{", "}", "[", "]", '"',
    ":", "camera", "scale", "fx", "null", "true", "NaN", "Infinity", "[" * 3000, '{"a":' * 3000,
)  # fmt: skip
TEXTS = (".txt", ".json", ".yaml", ".csv", ".log", ".freiburg")
CUT = "cut.json"  # the names of images that end early
TASK = "task.json"  # what is asked for of the recording
LENS = {"model": "radial-tangential", "coefficients": [0.1, -0.05, 0.001, 0.002]}
TURNED = [[1, 0, 0, 0.02], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
DEPTH_CAMERA = {"w": 8, "h": 6, "fx": 5.0, "fy": 5.5, "cx": 3.0, "cy": 2.0, "rgb_from_depth": TURNED}


def _images(rng, folder, count, *, names, depth_names, size=(8, 6)):
    for k in range(count):
        pixels = rng.integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
        for name in (folder / names(k), folder / depth_names(k)):
            name.parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(folder / names(k)), pixels)
        depth = rng.integers(0, 65536, (size[1], size[0]), dtype=np.uint16)
        assert cv2.imwrite(str(folder / depth_names(k)), depth)


def replica(folder, rng):
    """Write a recording as Replica's."""
    jpg = pick(rng, ("jpg", "png"))
    _images(
        rng, folder, 3, names=lambda k: f"results/frame{k:06d}.{jpg}", depth_names=lambda k: f"results/depth{k:06d}.png"
    )
    rows = "".join(f"1 0 0 {k / 10} 0 1 0 0 0 0 1 0 0 0 0 1\n" for k in range(3))
    (folder / "traj.txt").write_text(rows)
    camera = {"w": 8, "h": 6, "fx": 6.0, "fy": 6.0, "cx": 3.5, "cy": 2.5, "scale": 6553.5}
    (folder / "cam_params.json").write_text(json.dumps({"camera": camera, **_optics(rng)}, indent=2))


def _optics(rng):
    """Return what cam_params.json says of a lens and of a camera of depth's own, each in some."""
    return {name: value for name, value in (("distortion", LENS), ("depth_camera", DEPTH_CAMERA)) if rng.integers(2)}


def tum(folder, rng):
    """Write a recording as TUM's."""
    _images(
        rng,
        folder,
        3,
        names=lambda k: f"rgb/{1000 + k / 30:.6f}.png",
        depth_names=lambda k: f"depth/{1000 + k / 30:.6f}.png",
    )
    for kind in ("rgb", "depth"):
        rows = "".join(f"{1000 + k / 30:.6f} {kind}/{1000 + k / 30:.6f}.png\n" for k in range(3))
        (folder / f"{kind}.txt").write_text("# images\n# file: 'a'\n# timestamp filename\n" + rows)
    rows = "".join(f"{1000 + k / 30:.6f} {k / 10} 0 0 0 0 0 1\n" for k in range(3))
    (folder / "groundtruth.txt").write_text("# poses\n# file: 'a'\n# timestamp tx ty tz qx qy qz qw\n" + rows)
    if rng.integers(2):
        camera = {"w": 8, "h": 6, "fx": 6.0, "fy": 6.0, "cx": 3.5, "cy": 2.5, "scale": 5000.0}
        (folder / "cam_params.json").write_text(json.dumps({"camera": camera, **_optics(rng)}, indent=2))


def euroc(folder, rng):
    """Write a recording as EuRoC's."""
    write_euroc(folder, colour=bool(rng.integers(2)), columns=pick(rng, (8, 17)))


def vslamlab(folder, rng):
    """Write a recording as VSLAM-LAB's."""
    write_vslamlab(folder, depth_late_ns=int(rng.integers(-(10**9), 10**9)))


def write(folder, rng):
    """Write a recording, and mutate one or two of its files."""
    sequence = folder / "sequence"
    sequence.mkdir()
    pick(rng, (replica, tum, euroc, vslamlab, *recorded.WRITERS))(sequence, rng)
    paths = sorted(path for path in sequence.rglob("*") if path.is_file())
    cut = []
    for _ in range(int(rng.integers(1, 3))):
        texts = [path for path in paths if path.suffix in TEXTS]
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
                cut.append(str(path))
            case 4 if data.startswith(b"\x89PNG") and len(data) > 33:
                path.write_bytes(with_header(data, rng))
            case _:
                path.write_bytes(mutate_bytes(data, rng))
    (folder / CUT).write_text(json.dumps(cut))
    task = {"poses": pick(rng, ("drop", "drop", "drop", "keep", "none", "require"))}
    task |= {name: bool(rng.random() < 0.1) for name in ("undistort", "register")}
    (folder / TASK).write_text(json.dumps(task))


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


def read(folder):
    """Read every frame as a run does; return the sequence with its images, as they are stored."""
    task = json.loads((folder / TASK).read_text())
    recording = read_recording(folder / "sequence", ConfigPath(folder / TASK), **task)
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
            for rgb, depth_m in ((frame.rgb, frame.depth_m), (frame.stored.rgb, frame.stored.depth_m)):
                assert rgb.dtype in (np.uint8, np.float32)
                assert rgb.ndim == 3
                assert np.isfinite(depth_m).all()
                assert depth_m.min() >= 0
            images.append((frame.stored, rgb, depth_m))
    assert all(note.isprintable() for note in notes)
    recording.hashes()
    return stored, images


def differs(folder, meaning, peer=None):
    """Return which image is accepted that ends early, and how the images differ from another decoder's, if one is here.

    A file that is cut may have been mutated again, or its frame left out.
    """
    _, images = meaning
    cut = set(json.loads((folder / CUT).read_text()))
    for frame, _, _ in images:
        for path in (frame.rgb_file, frame.depth_file):
            if str(path) in cut and _is_cut(path.read_bytes()):
                return f"{path.name} ends early, and is read"
    if peer is None:
        return ""
    for frame, rgb, depth_m in images:
        for path, ours, scale in ((frame.rgb_file, rgb, 1.0), (frame.depth_file, depth_m, frame.depth_scale_per_m)):
            theirs = None if path.suffix == ".jpg" else peer.image(path)  # a JPEG's scans have no checksum
            if theirs is None:
                continue  # a kind that the other decoder does not know
            if isinstance(theirs, str):
                return f"{path.name} is read, but the other decoder says: {theirs}"
            if ours.ndim == 3 and theirs.ndim == 2:
                theirs = np.repeat(theirs[..., None], 3, axis=2)
            if theirs.shape[:2] != ours.shape[:2]:
                return f"{path.name} has {ours.shape} pixels, and {theirs.shape} in the other decoder"
            divisor, near = (65535.0, 1e-6) if ours.dtype == np.float32 and path == frame.rgb_file else (scale, 1e-3)
            if theirs.shape == ours.shape and np.abs(theirs / divisor - ours).max() > near:
                return f"{path.name} has other pixels in the other decoder"
    return ""


def _is_cut(data):
    """Tell by its end alone whether an image of these writers, which put nothing behind the end, is cut."""
    return not data.endswith((b"IEND\xaeB`\x82", b"\xff\xd9"))
