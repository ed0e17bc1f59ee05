# SPDX-License-Identifier: GPL-3.0-or-later
"""JPEGs whose bytes are damaged, half of them among the first 64, or whose segments are changed by structure."""

import json
import struct

import cv2
import numpy as np
from fuzz.mutation import pick
from fuzz.structure import as_cell, changed, note, whole

from noisy_world.images.image_files import read_colour

TASK, SOUND = "task.json", "sound.jpg"
FIRST = 64
DQT, DHT, SOF0, SOF2, SOS, DRI, APP0, EOI = 0xDB, 0xC4, 0xC0, 0xC2, 0xDA, 0xDD, 0xE0, 0xD9
SAMPLINGS = (0x411111, 0x221111, 0x211111, 0x121111, 0x111111)
UNKNOWABLE = (DQT, DHT, "scan")
"""Where what nobody can know to be damaged who does not know the image may be: steps of quantisation, values that are
exchanged for others that the standard has, and codes of a scan."""


def sound(rng):
    """Return a JPEG of a small image, with options of many kinds."""
    high, wide = (int(size) for size in rng.integers(9, 60, 2))
    y, x = np.mgrid[:high, :wide]
    waves = np.stack([127 + 110 * np.sin(x / 7 + k) * np.cos(y / (5 + k)) for k in range(3)], axis=-1)
    pixels = np.clip(waves + rng.normal(0, pick(rng, (0.5, 5, 60)), waves.shape), 0, 255).astype(np.uint8)
    options = [cv2.IMWRITE_JPEG_QUALITY, pick(rng, (30, 75, 90, 98, 100))]
    options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, pick(rng, SAMPLINGS)]
    options += [
        cv2.IMWRITE_JPEG_OPTIMIZE,
        int(rng.integers(2)),
        cv2.IMWRITE_JPEG_PROGRESSIVE,
        int(rng.integers(4) == 0),
    ]
    options += [cv2.IMWRITE_JPEG_RST_INTERVAL, pick(rng, (0, 0, 1, 3))]
    grey = rng.integers(6) == 0
    return cv2.imencode(".jpg", pixels[..., 0].copy() if grey else pixels, options)[1].tobytes()


def parts(data):
    """Return (marker or "scan", start, end) of what a sound JPEG consists of."""
    found, at = [], 2
    while data[at + 1] != EOI:
        end = at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        found.append((data[at + 1], at, end))
        if data[at + 1] == SOS:
            at = end
            while data[end] != 0xFF or data[end + 1] == 0 or 0xD0 <= data[end + 1] <= 0xD7:
                end += 1
            found.append(("scan", at, end))
        at = end
    return [*found, (EOI, at, at + 2)]


def damaged(data, rng):
    """Return a JPEG with some of its bytes changed, lost or added, and the part in which they are."""
    at = int(rng.integers(FIRST)) if rng.integers(2) else int(rng.integers(len(data)))
    span = min(int(2 ** rng.integers(0, 6)), len(data) - at)
    broken = bytearray(data)
    match int(rng.integers(7)):
        case 0:
            broken[at] ^= 1 << int(rng.integers(8))
        case 1:
            broken[at] = int(rng.integers(256))
        case 2:
            del broken[at : at + span]
        case 3:
            broken[at:at] = rng.bytes(span)
        case 4:
            broken[at : at + span] = bytes(span)
        case 5:
            del broken[at:]
        case _:
            broken[at : at + span] = rng.bytes(span)
    places = [k for k, (old, new) in enumerate(zip(data, broken, strict=False)) if old != new]
    if len(broken) == len(data):  # else all behind the first is elsewhere
        touched = [name for name, start, end in parts(data) if any(start <= place < end for place in places)]
    else:
        first = min(places, default=len(broken))
        touched = [name for name, start, end in parts(data) if start <= first < end]
    return bytes(broken), touched or ["start"]


# --- segments as trees ---


def _tree(data):
    """Return a JPEG's parts as a tree."""
    found = []
    for name, start, end in parts(data)[:-1]:
        if name == "scan":
            found.append({"data": list(data[start:end])[:0], "kept": [start, end]})
            continue
        content = data[start + 4 : end]
        found.append({"marker": name, "length": end - start - 2, "content": _fields(name, content)})
    return found


def _fields(marker, content):
    """Return a segment's content as a tree; of what has no structure, its bytes as numbers."""
    if marker == DQT:
        tables = [content[at : at + 65] for at in range(0, len(content), 65)]
        return [{"number": table[0], "steps": list(table[1:])} for table in tables]
    if marker == DHT:
        found = []
        while content:
            count = sum(content[1:17])
            found.append(
                {"number": content[0], "counts": list(content[1:17]), "values": list(content[17 : 17 + count])}
            )
            content = content[17 + count :]
        return found
    if marker in (SOF0, SOF2):
        bits, high, wide, count = struct.unpack(">BHHB", content[:6])
        return {"bits": bits, "size": [high, wide], "count": count, "components": _triples(content[6:])}
    if marker == SOS:
        pairs = [list(content[at : at + 2]) for at in range(1, len(content) - 3, 2)]
        return {"count": content[0], "components": pairs, "end": list(content[-3:])}
    return list(content)


def _triples(content):
    return [list(content[at : at + 3]) for at in range(0, len(content), 3)]


def _written(tree, data):
    """Return a tree as a file. data: of the sound one, of which scans are taken."""
    found = b"\xff\xd8"
    for part in tree if isinstance(tree, list) else [tree]:
        match part:
            case {"kept": [int(start), int(end)]}:
                found += data[max(0, start) : max(0, min(end, len(data)))]
            case {"marker": marker, "content": content, **rest}:
                inside = b"".join(_bytes(content))
                length = rest.get("length", len(inside) + 2)
                found += bytes([0xFF, whole(marker, 0, 255)]) + struct.pack(">H", whole(length, 0, 65535)) + inside
            case _:
                found += as_cell(part)
    return found + b"\xff\xd9"


def _bytes(value, name=""):
    """Yield the bytes of a tree's numbers: two for sizes, one for all others."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _bytes(each, key)
    elif isinstance(value, list):
        for each in value:
            yield from _bytes(each, name)
    elif name == "size":
        yield struct.pack(">H", whole(value, 0, 65535))
    else:
        yield bytes([whole(value, 0, 255)])


def write(folder, rng):
    """Write image.jpg, and the sound one beside it."""
    data = sound(rng)
    (folder / SOUND).write_bytes(data)
    if rng.integers(3):
        broken, touched = damaged(data, rng)
        told = [str(touched)] if broken != data else []
    else:
        tree, told = changed(_tree(data), rng, raws=())
        broken, touched = _written(tree, data) if told else data, None
    (folder / "image.jpg").write_bytes(broken)
    (folder / TASK).write_text(json.dumps(touched))
    note(folder, told)


def read(folder):
    """Read the image as one of a sequence, whose size is known."""
    whole_one = cv2.imdecode(np.frombuffer((folder / SOUND).read_bytes(), np.uint8), cv2.IMREAD_COLOR)
    return read_colour(folder / "image.jpg", whole_one.shape[1::-1]), whole_one


def differs(folder, meaning):
    """Say which change was taken that can be known to be damage: pixels are others, and not by steps or a scan."""
    pixels, whole_one = meaning
    touched = json.loads((folder / TASK).read_text())
    if np.array_equal(pixels[..., ::-1], whole_one) or touched is None:
        return ""
    if all(name in UNKNOWABLE for name in touched) or _other_tables(folder):
        return ""
    return f"damage in {touched} is taken"


def _other_tables(folder):
    """Tell whether nothing but the numbers of tables is another in the headers of the frame and its scans."""
    data, broken = ((folder / name).read_bytes() for name in (SOUND, "image.jpg"))
    numbers = set()
    for name, start, end in parts(data):
        if name in (SOF0, SOF2):
            numbers |= set(range(start + 12, end, 3))
        elif name == SOS:
            numbers |= set(range(start + 6, end - 3, 2))
    pairs = enumerate(zip(data, broken, strict=False))
    return len(data) == len(broken) and {k for k, (one, other) in pairs if one != other} <= numbers
