# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses as arrays of numpy: N matrices of 4 x 4 (or 3 x 4), with or without stamps or numbers of frames.

GO-SLAM's `checkpoints/est_poses.npy` is one: camera-to-world, OpenCV's axes, a pose for every frame (terminate in
src/slam.py of https://github.com/youmi-zym/GO-SLAM).
"""

import io
import math
import os
import zipfile
import zlib
from collections.abc import Container
from pathlib import Path
from typing import IO, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.file_access import open_regular
from ...core.trajectory import convert_convention
from . import LARGEST_READ_BYTES, Asked, EstimateFormat, OverLimitError, ReadPoses, rigid, whole_matrices

# Zip archives that anybody may have made: their lists of content are read up to a size.


LARGEST_LIST_BYTES = 16 * 2**20  # chosen: of some hundred thousand files


class _Pieces(io.RawIOBase):
    """A file of which no piece is read that is larger than a list of content may be."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def read(self, size: int = -1, /) -> bytes:
        """Read a piece. Raises BadZipFile where it is too large."""
        if size > LARGEST_LIST_BYTES:
            raise zipfile.BadZipFile("the list of its content is too large")
        return self._stream.read(size)

    def seek(self, place: int, whence: int = 0, /) -> int:
        """Go to a place."""
        return self._stream.seek(place, whence)

    def tell(self) -> int:
        """Return the place."""
        return self._stream.tell()

    def seekable(self) -> bool:
        """Tell that one may go to any place."""
        return True

    def readable(self) -> bool:
        """Tell that one may read."""
        return True


def open_archive(stream: BinaryIO) -> zipfile.ZipFile:
    """Open an archive. Raises BadZipFile, and what zipfile raises beside it."""
    file = cast("BinaryIO", _Pieces(stream))
    return zipfile.ZipFile(file)


POSES = ("poses", "c2w", "w2c", "pose")
STAMPS = ("stamps_s", "timestamps", "stamps", "times", "tstamps")
NUMBERS = ("frames", "indices", "numbers")
_ARCHIVE = b"PK\x03\x04"


def read(path: Path, asked: Asked) -> ReadPoses:
    """Read a .npy with the poses of all frames, or a .npz with stamps or numbers beside them.

    A matrix of zeros alone is a frame that the system has not come to: it is lost. Raises InputError, OverLimitError
    where its arrays have more than `asked.largest_bytes`.
    """
    arrays = load_arrays(path, largest_bytes=asked.largest_bytes)
    name = _poses_name(path, arrays)
    poses = whole_matrices(path, _numbers(path, name, arrays[name]))
    stamped = [item for item in STAMPS if item in arrays]
    numbered = [item for item in NUMBERS if item in arrays]
    stamps_s, numbers = None, np.arange(len(poses))
    if numbered:
        values = _row(path, numbered[0], arrays[numbered[0]], len(poses))
        if (values != np.floor(values)).any() or (np.abs(values) > 2.0**53).any():
            raise InputError(path, "are no whole numbers", where=numbered[0])
        numbers = values.astype(np.int64)
    elif stamped:
        stamps_s = _row(path, stamped[0], arrays[stamped[0]], len(poses))
    kept = np.flatnonzero(poses[:, :3, :].any(axis=(1, 2)))
    places = [f"pose {row}" if stamped and not numbered else f"frame {numbers[row]}" for row in kept.tolist()]
    c2w = convert_convention(
        rigid(path, places, poses[kept]),
        direction="c2w" if asked.direction == "auto" else asked.direction,
        axes="opencv" if asked.axes == "auto" else asked.axes,
    )
    if stamps_s is not None:
        return ReadPoses("array", c2w, stamps_s=stamps_s[kept], places=tuple(places))
    count = None if numbered else len(poses)
    return ReadPoses("array", c2w, numbers=numbers[kept], places=tuple(places), count=count)


def load_arrays(
    path: Path, wanted: Container[str] | None = None, *, largest_bytes: int = LARGEST_READ_BYTES
) -> dict[str, NDArray]:
    """Return the arrays of a .npz by name, or that of a .npy as "poses"; pickled objects are refused with InputError.

    wanted: the names of those to be read, where the others may be large. largest_bytes: of all that are read, as their
    headers declare them, before any of it is; OverLimitError where they have more.
    """
    try:
        with open_regular(path) as stream:
            if stream.read(len(_ARCHIVE)) != _ARCHIVE:
                stream.seek(0)
                size = os.fstat(stream.fileno()).st_size
                _check_bytes(path, _declared_bytes(stream, size), largest_bytes)
                return {"poses": np.lib.format.read_array(stream, allow_pickle=False)}
            with open_archive(stream) as archive:
                return _members(path, archive, wanted, largest_bytes)
    except InputError:
        raise
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    # What numpy and zipfile raise for bytes that are no array, an archive that is cut off or packed in an unknown way.
    except (ValueError, EOFError, zipfile.BadZipFile, KeyError, NotImplementedError, zlib.error, RuntimeError) as error:
        raise InputError(path, "is no array of numbers as numpy writes it", remedy="a .npy or .npz file") from error


def _members(
    path: Path, archive: zipfile.ZipFile, wanted: Container[str] | None, largest_bytes: int
) -> dict[str, NDArray]:
    found: dict[str, NDArray] = {}
    total = 0
    for info in archive.infolist():
        name = info.filename.removesuffix(".npy")
        if wanted is not None and name not in wanted:
            continue
        with archive.open(info) as stream:
            total += _declared_bytes(stream, info.file_size)
        _check_bytes(path, total, largest_bytes)
        with archive.open(info) as stream:
            found[name] = np.lib.format.read_array(cast("IO[bytes]", stream), allow_pickle=False)
    return found


def _declared_bytes(stream: IO[bytes], size: int) -> int:
    """Return how many bytes an array has by its header, and go back to the beginning.

    size: of the file. Raises ValueError where that holds fewer, which numpy would make room for nevertheless.
    """
    version = np.lib.format.read_magic(stream)
    read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in read_header:
        raise ValueError(f"version {version}")
    shape, _, dtype = read_header[version](stream)
    count = math.prod(shape) * max(dtype.itemsize, 1)
    if min(shape, default=0) < 0 or (not dtype.hasobject and count > size):
        raise ValueError("more numbers than bytes")
    stream.seek(0)
    return count


def _check_bytes(path: Path, count: int, largest_bytes: int) -> None:
    if count > largest_bytes:
        problem = (
            f"holds arrays of {count / 1e6:.0f} MB, more than the {largest_bytes / 1e6:g} MB of limits.estimate_mb"
        )
        raise OverLimitError(path, problem)


def _poses_name(path: Path, arrays: dict[str, NDArray]) -> str:
    named = [name for name in POSES if name in arrays]
    if named:
        return named[0]
    shaped = [name for name, array in arrays.items() if array.ndim == 3 and array.shape[1:] in ((4, 4), (3, 4))]
    if len(shaped) != 1:
        remedy = f"name the poses {', '.join(POSES[:-1])} or {POSES[-1]}"
        raise InputError(path, f"holds {len(shaped)} arrays of N x 4 x 4", remedy=remedy)
    return shaped[0]


def _numbers(path: Path, name: str, array: NDArray) -> NDArray[np.float64]:
    if array.dtype.kind not in "fiu":
        raise InputError(path, f"holds {array.dtype}, but has to be numbers", where=name)
    if not array.ndim:
        raise InputError(path, "is one number, but has to have one entry for each pose", where=name)
    return array.astype(np.float64)


def _row(path: Path, name: str, array: NDArray, count: int) -> NDArray[np.float64]:
    row = _numbers(path, name, array).reshape(-1)
    if len(row) != count or not np.isfinite(row).all():
        raise InputError(path, f"has to be {count} finite numbers, one for each pose", where=name)
    return row


def _recognises(path: Path, head: bytes) -> bool:
    del path
    return head.startswith((b"\x93NUMPY", _ARCHIVE))


FORMAT = EstimateFormat(
    "array", "numpy's .npy or .npz of N x 4 x 4", read, _recognises, any_convention=True, reads_parts=True
)
