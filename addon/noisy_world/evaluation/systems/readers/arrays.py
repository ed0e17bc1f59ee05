# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses as arrays of numpy: N matrices of 4 x 4 (or 3 x 4), with or without stamps or numbers of frames.

GO-SLAM's `checkpoints/est_poses.npy` is one: camera-to-world, OpenCV's axes, a pose for every frame (terminate in
src/slam.py of https://github.com/youmi-zym/GO-SLAM).
"""

import math
import os
import zipfile
import zlib
from collections.abc import Container
from pathlib import Path
from typing import IO, cast

import numpy as np
from numpy.typing import NDArray

from ....core.errors import InputError
from ....core.regular_files import open_regular
from ....core.trajectories.trajectory import Axes, Direction
from ...estimate import Estimate
from ..leavings import LARGEST_READ_BYTES, OverLimitError
from .archives import open_archive
from .frames import Index, check_every_frame, estimate_of_frames

POSES = ("poses", "c2w", "w2c", "pose")
STAMPS = ("stamps_s", "timestamps", "stamps", "times", "tstamps")
NUMBERS = ("frames", "indices", "numbers")
_ARCHIVE = b"PK\x03\x04"


def read(
    path: Path,
    index: Index,
    *,
    direction: Direction = "c2w",
    axes: Axes = "opencv",
    largest_bytes: int = LARGEST_READ_BYTES,
) -> Estimate:
    """Return the estimate of a .npy with the poses of all frames, or of a .npz with stamps or numbers beside them.

    Raises InputError, OverLimitError where its arrays have more than `largest_bytes`.
    """
    arrays = load_arrays(path, largest_bytes=largest_bytes)
    name = _poses_name(path, arrays)
    poses = _numbers(path, name, arrays[name])
    stamped = [item for item in STAMPS if item in arrays]
    numbered = [item for item in NUMBERS if item in arrays]
    if stamped and not numbered:
        return _stamped(path, poses, _row(path, stamped[0], arrays[stamped[0]], len(poses)), direction, axes)
    if numbered:
        numbers = _row(path, numbered[0], arrays[numbered[0]], len(poses))
        if (numbers != np.floor(numbers)).any():
            raise InputError(path, "are no whole numbers", where=numbered[0])
        frames = numbers.astype(np.int64).tolist()
        return estimate_of_frames(path, frames, poses, index, direction=direction, axes=axes)
    check_every_frame(path, len(poses), index)
    return estimate_of_frames(path, range(len(poses)), poses, index, direction=direction, axes=axes)


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


def _stamped(
    path: Path, poses: NDArray[np.float64], stamps_s: NDArray[np.float64], direction: Direction, axes: Axes
) -> Estimate:
    order = np.argsort(stamps_s, kind="stable")
    if (np.diff(stamps_s[order]) <= 0.0).any():
        raise InputError(path, "has two poses of one time stamp")
    own = {"frames": [{"stamp_s": stamp_s} for stamp_s in stamps_s[order].tolist()]}
    return estimate_of_frames(path, range(len(order)), poses[order], own, direction=direction, axes=axes)
