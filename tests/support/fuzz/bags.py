# SPDX-License-Identifier: GPL-3.0-or-later
"""Mutated bags: what messages say, what containers say of them, and bytes. rosbags writes the sound ones."""

import functools
import shutil
import sqlite3
import struct
from contextlib import closing

import made_bags as made
import numpy as np
from fuzz.mutation import mutate_bytes, mutate_mixed, pick
from fuzz.structure import HUGE, is_sound, kept, note

from noisy_world.core.errors import InputError
from noisy_world.core.frame_request import FrameRequest
from noisy_world.core.schema import ConfigPath
from noisy_world.layouts.described import BagTopics
from noisy_world.sources.recording import read_bag

FRAMES, MOST = 3, 100
COMPRESSIONS = {"ros1": (None, "bz2", "lz4"), "db3": (None, "message"), "mcap": (None, "storage", "message")}
ALL = tuple((form, compression) for form, kinds in COMPRESSIONS.items() for compression in kinds)
TEXTS = (
    "", "rgb8", "16UC1", "32FC1", "bayer_rggb8", "yuv422", "mono16", "é", "x" * 3000, "/", "a\0b", "\x1b[31m", "map",
    "base_link", "camera_optical", "16UC1; compressedDepth", "32FC1; compressedDepth", "jpeg", "equidistant", "none",
)  # fmt: skip
NUMBERS = (0, 1, 2, 7, 8, 255, 256, 65535, 2**31 - 1, 2**31, 2**32 - 1)
REALS = (0.0, -0.0, 1.0, -1.0, 0.5, 1e-300, 1e300, float("nan"), float("inf"), -float("inf"), 1e9)
WORDS = (
    "rosbag2_bagfile_information",
    "relative_file_paths",
    "- ../walk.db3",
    "null",
    "[]",
    "{}",
    "version: 99",
    "!!x",
)


@functools.cache
def _sound(form, compression):
    """Return the path of a sound bag, made once in a process."""
    return made.walk(kept("bags"), form, frames=FRAMES, compression=compression)


def write(folder, rng):
    """Write a bag, in some cases with messages that lie, and change some of its bytes, numbers or rows."""
    form, compression = pick(rng, ALL)
    told = []
    if rng.integers(3) == 0:
        path, told = _of_messages(folder, form, rng)
    else:
        sound = _sound(form, compression)
        path = folder / sound.name
        (shutil.copytree if sound.is_dir() else shutil.copyfile)(sound, path)
    file = path if path.is_file() else path / f"walk.{form}"
    match int(rng.integers(8)):
        case 0:
            pass
        case 1 if path.is_dir():
            metadata = path / "metadata.yaml"
            metadata.write_bytes(mutate_mixed(metadata.read_text(), rng, WORDS))
            told.append("metadata.yaml")
        case 2 if form == "db3":
            told.append(_rows_changed(file, rng))
        case 3:
            data = file.read_bytes()
            file.write_bytes(data[: int(rng.integers(len(data)))])
            told.append("cut")
        case 4:
            file.write_bytes(mutate_bytes(file.read_bytes(), rng))
            told.append("bytes")
        case _ if not told:
            told.append(_numbers_changed(file, rng))
        case _:
            pass
    (folder / "bag.txt").write_text(path.relative_to(folder).as_posix())
    note(folder, told)


def _of_messages(folder, form, rng):
    """Write a bag whose messages are changed by their fields; return its path and what was changed."""
    told = []

    def change(written):
        ros = written.ros
        for number in range(int(rng.integers(1, 4))):
            stamp_ns = made.START_NS + number * made.STEP_NS
            topic, message = pick(rng, _messages(ros, stamp_ns, number))
            told.append(f"{topic}: {_field_changed(message, rng)}")
            try:
                written.add(stamp_ns, topic, message)
            except Exception:  # noqa: BLE001 - rosbags refuses it
                told.append("which cannot be written")

    return made.walk(folder, form, frames=2, change=change), told


def _messages(ros, at, number):
    values = made.body(number)
    return [
        ("/camera/color/image_raw", ros.image(at, made.colour(number), "rgb8")),
        ("/camera/depth/image_raw", ros.image(at, made.depth_mm(number), "16UC1")),
        ("/camera/color/camera_info", ros.camera_info(at, made.SIZE, made.K, d=(0.1, 0.0, 0.0, 0.0, 0.0))),
        ("/imu/data", ros.imu(at, *made.sample(number))),
        ("/tf", ros.tf(ros.transform(at, made.WORLD, made.BODY, values))),
        ("/tf_static", ros.tf(ros.transform(at, made.BODY, made.OPTICAL, values))),
        ("/odom", ros.odometry(at, values)),
        (
            "/extra/compressed",
            ros.compressed(at, made.compressed_depth(made.depth_mm(0)), pick(np.random.default_rng(at), TEXTS)),
        ),
    ]


def _field_changed(message, rng):
    """Change a field of a message, or of one in it; return its name."""
    while True:
        names = [name for name in message.__dataclass_fields__ if not name.startswith("__")]
        name = pick(rng, names)
        value = getattr(message, name)
        if isinstance(value, list) and value:
            value = pick(rng, value)
        if hasattr(value, "__dataclass_fields__"):
            message = value
            continue
        if isinstance(value, str):
            new = pick(rng, TEXTS)
        elif isinstance(value, np.ndarray):
            new = _array_changed(value, rng)
        elif isinstance(value, float):
            new = pick(rng, REALS)
        else:
            new = pick(rng, NUMBERS)
        setattr(message, name, new)
        return f"{name} {str(new)[:40]}"


def _array_changed(value, rng):
    match int(rng.integers(3)):
        case 0:
            return value[: int(rng.integers(len(value) + 1))].copy()
        case 1:
            return np.tile(value, 2)
        case _:
            new = value.copy()
            if len(new):
                at = int(rng.integers(len(new)))
                new[at] = pick(rng, REALS) if new.dtype.kind == "f" else int(rng.integers(256))
            return new


def _numbers_changed(file, rng):
    """Put other numbers of 16, 32 or 64 bits where lengths, offsets and times are, or near them."""
    data = bytearray(file.read_bytes())
    for _ in range(int(rng.integers(1, 4))):
        marks = (
            b"size=",
            b"conn=",
            b"count=",
            b"index_pos=",
            b"chunk_pos=",
            b"op=",
            b"time=",
            b"/camera",
            b"sensor_msgs",
        )
        mark = pick(rng, marks)
        places = [at for at in range(len(data)) if data.startswith(mark, at)] if rng.integers(2) else []
        at = pick(rng, places) + len(mark) if places else int(rng.integers(len(data)))
        code = pick(rng, ("<B", "<H", "<I", "<Q"))
        width = struct.calcsize(code)
        number = pick(rng, [item for item in HUGE if isinstance(item, int) and item >= 0])
        data[at : at + width] = struct.pack(code, number % 2 ** (8 * width))
    file.write_bytes(bytes(data))
    return "numbers"


def _rows_changed(file, rng):
    """Change values of a database, in their type too."""
    table, column = pick(rng, (("messages", "data"), ("messages", "timestamp"), ("messages", "topic_id"),
                               ("topics", "name"), ("topics", "type"), ("topics", "serialization_format"),
                               ("topics", "id"), ("messages", "id")))  # fmt: skip
    value = pick(
        rng,
        (
            None,
            "",
            "x",
            b"",
            b"\0\1\0\0",
            0,
            -1,
            2**40,
            -(2**62),
            1.5,
            "é",
            b"\xff" * 50,
            "/tf",
            "tf2_msgs/msg/TFMessage",
        ),
    )
    with closing(sqlite3.connect(file)) as database, database:
        chosen = f"{table}.rowid = (SELECT rowid FROM {table} LIMIT 1 OFFSET {int(rng.integers(8))})"
        try:
            database.execute(f"UPDATE {table} SET {column} = ? WHERE {chosen}", (value,))
        except sqlite3.Error as error:
            return f"{table}.{column} cannot be {value!r}: {error}"[:100]
    return f"{table}.{column} = {value!r}"


def read(folder):
    """Read every frame as a run does; return what was found."""
    path = folder / (folder / "bag.txt").read_text()
    source = read_bag(path, ConfigPath(folder / "preset.yaml"), BagTopics(), "keep")
    stored = source.stored
    if len(stored.stamps) > MOST:
        raise InputError(path, "has many frames")
    assert (np.diff(stored.stamps.rgb.seconds) > 0).all()
    assert np.isfinite(stored.trajectory.c2w).all()
    notes, frames = [], []
    if stored.known_camera is None:
        raise InputError(path, "says no camera")
    with source.prepare(source.camera(None), notes.append) as opened:
        for index in range(len(stored.stamps)):
            frame = opened.frame(FrameRequest(index, 0.0, np.eye(4), np.eye(4)))
            depth_m = frame.depth_m
            assert frame.rgb.shape == (*stored.size_px[::-1], 3)
            assert depth_m is None or (np.isfinite(depth_m).all() and depth_m.min() >= 0)
            frames.append((frame.rgb, depth_m))
    assert all(note.isprintable() for note in notes)
    source.hashes()
    return stored, frames


def differs(folder, found):
    """Return how a sound bag differs from what was written."""
    if not is_sound(folder):
        return ""
    _, frames = found
    for number, (rgb, depth_m) in enumerate(frames):
        if not np.array_equal(rgb, made.colour(number)):
            return f"colour of frame {number} is another"
        if not np.array_equal(np.rint(depth_m * 1000), made.depth_mm(number)):
            return f"depth of frame {number} is another"
    return ""
