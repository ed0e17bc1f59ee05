# SPDX-License-Identifier: GPL-3.0-or-later
"""COLMAP's `images.txt`: two lines an image, IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME, and its points.

Quaternion and translation are world-to-camera, x right, y down, z forward
(https://colmap.github.io/format.html#images-txt). The second line may be empty.
"""

from pathlib import Path

import numpy as np

from ...core.errors import InputError
from ...core.geometry import pose, rotation_from_quat_wxyz
from ...core.trajectory import convert_convention
from ...trajectories.pose_files import read_text
from . import Asked, EstimateFormat, ReadPoses, check_finite, no_pose, unit_quats

NAME = "images.txt"

_WORDS = 10  # of an image's first line
_MOST_LINES = 2_000_000  # two of an image; each takes a hundred bytes of memory, though it be empty


def read(path: Path, asked: Asked) -> ReadPoses:
    """Read the images, which are the frames' by the names of their files. Raises InputError.

    path: images.txt, or the folder that it is in.
    """
    del asked
    file = path / NAME if path.is_dir() else path
    images = _images(file)
    if not images:
        return no_pose("colmap")
    places, names = [where for where, _ in images], tuple(words[9] for _, words in images)
    table = np.array([_numbers(file, where, words[1:8]) for where, words in images])
    check_finite(file, places, table)
    w2c = pose(rotation_from_quat_wxyz(unit_quats(file, places, table[:, :4])), table[:, 4:])
    c2w = convert_convention(w2c, direction="w2c", axes="opencv")
    return ReadPoses("colmap", c2w, names=names, places=tuple(places))


def _images(file: Path) -> list[tuple[str, list[str]]]:
    """Return for each image where its line is, and that line's words; the name, which may hold blanks, is the last."""
    text = read_text(file)
    if text.count("\n") > _MOST_LINES:
        raise InputError(file, f"has more than {_MOST_LINES} lines")
    lines = [(number, line) for number, line in enumerate(text.split("\n"), 1) if not line.startswith("#")]
    while lines and not lines[0][1].strip():
        lines.pop(0)
    while len(lines) > 1 and not lines[-1][1].strip() and not lines[-2][1].strip():
        lines.pop()
    if lines and not lines[-1][1].strip() and len(lines) % 2:  # the end of the last line
        lines.pop()
    found = []
    for number, line in lines[::2]:
        words = line.strip().split(maxsplit=_WORDS - 1)
        if len(words) != _WORDS:
            remedy = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and a line of points, which may be empty"
            raise InputError(file, f"is no image: {len(words)} words", where=f"line {number}", remedy=remedy)
        found.append((f"line {number}", words))
    return found


def _numbers(file: Path, where: str, words: list[str]) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError:
        raise InputError(file, "holds a pose that is no numbers", where=where) from None


def _recognises(path: Path, head: bytes) -> bool:
    del head
    return path.name == NAME


FORMAT = EstimateFormat("colmap", "COLMAP's images.txt", read, _recognises)
