# SPDX-License-Identifier: GPL-3.0-or-later
"""Digests of a sequence's files in a few bytes a frame: one for a block of frames of a series of images.

A series is what the images of one kind are called in a sequence, with * for the frame: `results/frame*.jpg`. A block is
BLOCK_FRAMES frames by their numbers. Its digest is that of a list with a line for each of its frames, in order: the
file's SHA-256 and its name. So a file that is damaged is found to the block, and a dataset's own frames.jsonl, whose
hashes the block's digest confirms, names the file.
"""

import base64
import hashlib
import re
from collections.abc import Mapping
from itertools import groupby

from .frame_numbers import FrameNumbers

# Chosen: 1,000 sequences of 2,000 frames take some 600 kB; a block of 10 would take ten times that.
BLOCK_FRAMES = 100
DIGEST_BYTES = 15  # 120 bits: 20 letters without padding; nobody finds another file for one, nor does chance
DIGEST_LETTERS = DIGEST_BYTES * 4 // 3


def short_digest(data: bytes) -> str:
    """Return the first bytes of the SHA-256 of some bytes, as URL-safe base64 (RFC 4648)."""
    return short_of_hex(hashlib.sha256(data).hexdigest())


def short_of_hex(sha256: str) -> str:
    """Return a SHA-256 in hexadecimal as a short digest."""
    return base64.urlsafe_b64encode(bytes.fromhex(sha256)[:DIGEST_BYTES]).decode()


def series_of(name: str) -> str:
    """Return the series of an image, with * for its number or stamp: "results/frame*.jpg"."""
    stem, _, suffix = name.rpartition(".")
    number = stem[len(stem.rstrip("0123456789.")) :].lstrip(".")
    if not number or not re.fullmatch("[a-z]+", suffix):
        return name
    return f"{stem.removesuffix(number)}*.{suffix}"


def block_digests(files: Mapping[int, tuple[str, str]]) -> dict[int, str]:
    """Return a digest by the number of the block. files: name and SHA-256 by frame, of one series."""
    found: dict[int, str] = {}
    for block, frames in groupby(sorted(files), key=lambda frame: frame // BLOCK_FRAMES):
        lines = (f"{files[frame][1]} {files[frame][0]}\n" for frame in frames)
        found[block] = short_digest("".join(lines).encode())
    return found


def split_digests(text: str) -> list[str]:
    """Return the digests that stand in a text without anything between them. Raises ValueError."""
    if len(text) % DIGEST_LETTERS or not re.fullmatch("[A-Za-z0-9_-]*", text):
        raise ValueError("is no text of digests")
    return [text[at : at + DIGEST_LETTERS] for at in range(0, len(text), DIGEST_LETTERS)]


def blocks_of(frames: FrameNumbers) -> list[int]:
    """Return the numbers of the blocks that hold some of the frames, in order."""
    held = (range(part.start // BLOCK_FRAMES, (part.stop - 1) // BLOCK_FRAMES + 1) for part in frames.ranges if part)
    return sorted({block for blocks in held for block in blocks})


def block_slice(block: int) -> slice:
    """Return the frames of a block."""
    return slice(block * BLOCK_FRAMES, (block + 1) * BLOCK_FRAMES)
