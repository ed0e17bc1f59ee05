# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare datasets file by file, to see that a change of the code changes no pixel.

    python headless/tools/compare_datasets.py [--pixels] BEFORE AFTER [BEFORE AFTER ...]

Every image, pose and text file has to have the same bytes. run.json (times) and manifest.json (versions) may differ,
and so may the notes in frames.jsonl; the hashes in it may not. With --pixels, images and hashes may have other bytes,
but no other pixels. Exits with 1 where something differs.
"""

import json
import sys
from pathlib import Path

import cv2
import numpy as np

FREE = ("run.json", "manifest.json")  # files that may differ


def main(arguments: list[str]) -> int:
    """Compare folders two by two and return the exit status."""
    pixels = arguments[:1] == ["--pixels"]
    arguments = arguments[pixels:]
    if not arguments or len(arguments) % 2:
        print(f"usage: {__doc__ and __doc__.splitlines()[2].strip()}", file=sys.stderr)
        return 2
    same = True
    for before, after in zip(arguments[::2], arguments[1::2], strict=True):
        problems, count = differences(Path(before), Path(after), pixels=pixels)
        same = same and not problems
        print(
            f"{after}: {count} files, "
            + (f"{len(problems)} differ" if problems else f"the same {'pixels' if pixels else 'bytes'}")
        )
        for line in problems[:20]:
            print(f"  {line}")
    return 0 if same else 1


def differences(before: Path, after: Path, *, pixels: bool = False) -> tuple[list[str], int]:
    """Return the differences, one line for each file, and the number of files."""
    names = sorted({name for folder in (before, after) for name in _files(folder)})
    problems = []
    for name in names:
        left, right = before / name, after / name
        if not (left.is_file() and right.is_file()):
            problems.append(f"{name}: only in {before if left.is_file() else after}")
        elif _content(left, hashes=not pixels) != _content(right, hashes=not pixels):
            if not pixels or left.suffix not in (".png", ".jpg"):
                problems.append(f"{name}: other bytes")
            elif text := _other_pixels(left, right):
                problems.append(f"{name}: {text}")
    if not names:
        problems.append("no files")
    return problems, len(names)


def _files(folder: Path) -> list[str]:
    return [
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file() and path.name not in FREE
    ]


def _other_pixels(before: Path, after: Path) -> str:
    """Return how many values of two images differ, and by how much at most; "" where none does."""
    one, other = (np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)) for path in (before, after))
    if one.shape != other.shape or one.dtype != other.dtype:
        return "other sizes or kinds of pixels"
    apart = np.abs(one.astype(np.int32) - other)
    return f"{(apart > 0).mean():.2%} of the values differ, by at most {apart.max()}" if apart.any() else ""


def _content(path: Path, *, hashes: bool) -> object:
    if path.name != "frames.jsonl":
        return path.read_bytes()
    records = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return [(record["frame"], record["time_s"], record["sha256"] if hashes else None) for record in records]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
