# SPDX-License-Identifier: GPL-3.0-or-later
"""Mutated video files, in three containers, with and without a folder of depth beside them."""

import functools
import json
import tempfile
from pathlib import Path

import cv2
import numpy as np
from fuzz.mutation import mutate_bytes, pick

from noisy_world.core.errors import InputError
from noisy_world.core.schema import ConfigPath
from noisy_world.core.frame_request import FrameRequest
from noisy_world.sources.video import read_video_source

COUNT, SIZE = 4, (32, 24)
CODECS = {"walk.avi": "MJPG", "walk.mkv": "MJPG", "walk.mp4": "mp4v"}
MOST = 100  # frames that are read
TASK = "task.json"


@functools.cache
def _whole(name):
    """Return a video as bytes, each frame of an even grey of its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*CODECS[name]), 10.0, SIZE)
        for k in range(COUNT):
            writer.write(np.full((SIZE[1], SIZE[0], 3), 50 + 40 * k, np.uint8))
        writer.release()
        return path.read_bytes()


def write(folder, rng):
    """Write a video, in half of the cases with depth, and mutate one of the files."""
    name = pick(rng, tuple(CODECS))
    video = folder / name
    video.write_bytes(_whole(name))
    files = [video]
    deep, cut = bool(rng.integers(2)), ""
    if deep:
        (folder / "depth").mkdir()
        for k in range(COUNT):
            files.append(folder / f"depth/{k}.png")
            assert cv2.imwrite(str(files[-1]), rng.integers(0, 65536, SIZE[::-1], dtype=np.uint16))
    path = video if rng.integers(2) else pick(rng, files)
    data = path.read_bytes()
    match int(rng.integers(6)):
        case 0:
            path.write_bytes(data[: int(rng.integers(len(data)))])
            cut = path.name
        case 1:
            path.unlink()
        case 2:
            path.write_bytes(pick(rng, files).read_bytes())
        case _:
            path.write_bytes(mutate_bytes(data, rng))
    task = {"video": name, "deep": deep, "cut": cut, "scale": pick(rng, (0.1, 1000.0, 5000.0, 1e7))}
    (folder / TASK).write_text(json.dumps(task))


def read(folder):
    """Read every frame as a run does; return the task, and colour and depth of each."""
    task = json.loads((folder / TASK).read_text())
    depth = folder / "depth" if task["deep"] else None
    source = read_video_source(folder / task["video"], ConfigPath(folder / TASK), depth, task["scale"])
    if len(source.stamps_s) > MOST:
        raise InputError(folder, "has many frames")
    assert np.isfinite(source.stamps_s).all()
    assert (np.diff(source.stamps_s) > 0).all()
    notes, frames = [], []
    with source.prepare(source.camera(None), notes.append) as opened:
        for index in range(len(source.stamps_s)):
            frame = opened.frame(FrameRequest(index, 0.0, np.eye(4), np.eye(4)))
            depth_m = frame.depth_m
            assert depth_m is None or (np.isfinite(depth_m).all() and depth_m.shape == frame.rgb.shape[:2])
            frames.append((frame.rgb, depth_m))
    assert all(note.isprintable() for note in notes)
    source.hashes()
    return task, frames, notes


def differs(folder, meaning):
    """Return how a video that was not touched differs from what was written, and what is accepted that ends early."""
    task, frames, notes = meaning
    if task["cut"].endswith(".png"):  # nothing stands behind the end of these
        ended = (folder / "depth" / task["cut"]).read_bytes().endswith(b"IEND\xaeB`\x82")
        return "" if ended else f"{task['cut']} ends early, and is read"
    if task["cut"] and len(frames) < COUNT - 1 and not any("may be cut" in note for note in notes):
        return f"{task['cut']} ends early, {len(frames)} of its frames are read, and no note says so"
    if (folder / task["video"]).read_bytes() == _whole(task["video"]):
        if len(frames) != COUNT:
            return f"{len(frames)} frames of {COUNT}"
        for k, (rgb, _) in enumerate(frames):
            if np.abs(rgb.astype(int) - (50 + 40 * k)).max() > 12:
                return f"frame {k} has other pixels"
    return ""
