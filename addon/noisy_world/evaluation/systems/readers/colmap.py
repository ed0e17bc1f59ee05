# SPDX-License-Identifier: GPL-3.0-or-later
"""COLMAP's `images.txt`: two lines an image, IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME, and its points.

Quaternion and translation are world-to-camera, x right, y down, z forward
(https://colmap.github.io/format.html#images-txt). The second line may be empty.
"""

from pathlib import Path, PurePosixPath

import numpy as np

from ....core.errors import InputError
from ....core.geometry import pose, rotation_from_quat_wxyz
from ....core.schema import shown
from ....core.trajectories.pose_text import read_text
from ...estimate import Estimate
from .frames import Index, check_finite, estimate_of_frames
from .stamped import NO_POSE

_WORDS = 10  # of an image's first line
_MOST_LINES = 2_000_000  # two of an image; each takes a hundred bytes of memory, though it be empty


def read(path: Path, index: Index) -> Estimate:
    """Return the estimate of the images, which are the frames' by the names of their files. Raises InputError.

    path: images.txt, or the folder that it is in.
    """
    file = path / "images.txt" if path.is_dir() else path
    numbers, values = [], []
    named = _frames_by_name(index)
    for where, words in _images(file):
        values.append(_numbers(file, where, words[1:8]))
        numbers.append(_frame(file, where, words[9], named))
    if not numbers:
        return NO_POSE
    table = np.array(values)
    check_finite(file, [f"frame {number}" for number in numbers], table)
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(table[:, :4], axis=1)
    if not (usable := (lengths > 0.0) & np.isfinite(lengths)).all():
        where = f"frame {numbers[int(np.argmin(usable))]}"
        raise InputError(file, "its rotation is a quaternion of zeros, or of numbers beyond 1e154", where=where)
    w2c = pose(rotation_from_quat_wxyz(table[:, :4] / lengths[:, None]), table[:, 4:])
    return estimate_of_frames(file, numbers, w2c, index, direction="w2c")


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


def _frames_by_name(index: Index) -> dict[str, list[int]]:
    """Return the numbers of the frames whose colour image has a name, without its folders."""
    named: dict[str, list[int]] = {}
    for number, frame in enumerate(index["frames"]):
        named.setdefault(PurePosixPath(Path(frame["colour"]).as_posix()).name, []).append(number)
    return named


def _frame(file: Path, where: str, name: str, named: dict[str, list[int]]) -> int:
    found = named.get(PurePosixPath(name).name, [])
    if len(found) != 1:
        problem = f"{shown(name)} is the name of {len(found)} frames' colour images"
        raise InputError(file, problem, where=where, remedy="each image has to be that of one frame")
    return found[0]
