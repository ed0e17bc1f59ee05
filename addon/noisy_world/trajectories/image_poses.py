# SPDX-License-Identifier: GPL-3.0-or-later
"""COLMAP's `images.txt`: two lines an image, IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME, and its points.

Quaternion and translation are world-to-camera, x right, y down, z forward
(https://colmap.github.io/format.html#images-txt). The second line may be empty. Which frame an image is, its name says.
"""

import re
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.geometry import pose, rotation_from_quat_wxyz
from .pose_files import (
    COLMAP_IMAGES,
    FilePoses,
    PoseFile,
    ReadOptions,
    TrajectoryFormat,
    all_finite,
    named_rows,
    read_text,
    unit_quats,
)

_WORDS = 10  # of an image's first line
_MOST_LINES = 2_000_000  # two of an image; each takes a hundred bytes of memory, though it be empty
_NOTE = "its lengths are in COLMAP's own scale"


def _image_poses(file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read the images of an images.txt, or of the folder that it is in. Raises InputError."""
    del options
    path = file.path / COLMAP_IMAGES if file.is_folder else file.path
    images = sorted(_images(path), key=lambda image: _natural(image[1][-1]))
    if not images:
        raise InputError(path, "holds no pose", remedy="a reconstruction of one image or more")
    places, names = [where for where, _ in images], [words[-1] for _, words in images]
    values = np.array([_numbers(path, where, words[1:8]) for where, words in images])
    rows = all_finite(named_rows(path, values, places))
    w2c = pose(rotation_from_quat_wxyz(unit_quats(rows, values[:, :4])), values[:, 4:])
    numbers = np.arange(len(w2c), dtype=np.float64)
    return FilePoses(
        "colmap",
        w2c,
        numbers=numbers,
        direction="w2c",
        notes=(_NOTE,),
        sparse=True,
        names=tuple(names),
        places=tuple(places),
    )


def _natural(name: str) -> list[tuple[int, int, str]]:
    """Return what sorts names with numbers in them by these: 9.png before 10.png."""
    parts = re.split(r"([0-9]{1,300})", name)
    return [(1, int(part), "") if part.isdecimal() and part.isascii() else (0, 0, part) for part in parts]


def _images(file: Path) -> list[tuple[str, list[str]]]:
    """Return for each image where its line is, and that line's words; the name, which may hold blanks, is the last."""
    text = read_text(file)
    if text.count("\n") > _MOST_LINES:
        raise InputError(file, f"has more than {_MOST_LINES} lines")
    lines = [
        (number, line)
        for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), 1)
        if not line.startswith("#")
    ]
    while lines and not lines[0][1].strip():
        lines.pop(0)
    while len(lines) > 1 and not lines[-1][1].strip() and not lines[-2][1].strip():
        lines.pop()
    if lines and not lines[-1][1].strip() and len(lines) % 2:  # the end of the last line
        lines.pop()
    images = []
    for number, line in lines[::2]:
        words = line.strip().split(maxsplit=_WORDS - 1)
        if len(words) != _WORDS:
            remedy = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and a line of points, which may be empty"
            raise InputError(file, f"is no image: {len(words)} words", where=f"line {number}", remedy=remedy)
        images.append((f"line {number}", words))
    return images


def _numbers(file: Path, where: str, words: list[str]) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError:
        raise InputError(file, "holds a pose that is no numbers", where=where) from None


def _recognises(file: PoseFile) -> bool:
    if file.is_folder:
        return (file.path / COLMAP_IMAGES).is_file()
    named = file.path.name == COLMAP_IMAGES or b"IMAGE_ID" in file.head
    return named and not file.first_widths and file.begins_with("#", *"0123456789")


FORMAT = TrajectoryFormat(
    "colmap",
    "COLMAP",
    "COLMAP's images.txt",
    _recognises,
    _image_poses,
    reads_folders=True,
    one_convention=True,
    looks_like="COLMAP's `images.txt`, or the folder that it is in: two lines an image",
    recognised_by="`IMAGE_ID` in its first lines; a folder with `images.txt`",
    times="by the images' names, in their order / `rate_hz`",
    order=75,
)
