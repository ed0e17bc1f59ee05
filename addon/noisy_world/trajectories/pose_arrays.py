# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses as arrays of numpy, .npy and .npz, with or without stamps or numbers of frames; and SplaTAM's parameters.

GO-SLAM's `checkpoints/est_poses.npy` is one: camera-to-world, OpenCV's axes, a pose for every frame (terminate in
src/slam.py of https://github.com/youmi-zym/GO-SLAM).

SplaTAM's `params.npz`, as rgbd_slam in scripts/splatam.py and build_rotation in utils/slam_external.py of
https://github.com/spla-tam/SplaTAM have it: `cam_unnorm_rots` (1, 4, N), quaternions w first of any length, and
`cam_trans` (1, 3, N), metres: world-to-camera, where the world is the first camera. Axes are OpenCV's.
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

from ..core.errors import InputError
from ..core.file_access import open_regular
from ..core.geometry import pose, rotation_from_quat_wxyz
from .matrix_poses import AllLostError, rigid_poses
from .pose_files import (
    LARGEST_READ_BYTES,
    LEAST_NS,
    PER_SECOND,
    FilePoses,
    Float64,
    OverLimitError,
    PoseFile,
    ReadOptions,
    TrajectoryFormat,
    all_finite,
    named_rows,
    unit_quats,
)
from .stamped_poses import first_of_equal

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
ROTATIONS = "cam_unnorm_rots"
TRANSLATIONS = "cam_trans"
_NO_ARRAY = (ValueError, TypeError, EOFError, zipfile.BadZipFile, KeyError, NotImplementedError)
_NUMPY = b"\x93NUMPY"
_ARCHIVE = b"PK\x03\x04"


def _array_poses(file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read a .npy with the poses of all frames, or a .npz with stamps or numbers beside them.

    A matrix of zeros alone is a frame that the system has not come to: it is lost. Raises InputError, OverLimitError
    where its arrays have more than `options.largest_bytes`.
    """
    path = file.path
    arrays = load_arrays(path, largest_bytes=options.largest_bytes)
    name = _poses_name(path, arrays)
    poses = _matrices(path, _numbers(path, name, arrays[name]))
    stamped = next((item for item in STAMPS if item in arrays), None)
    numbered = next((item for item in NUMBERS if item in arrays), None)
    times = np.arange(len(poses), dtype=np.float64)
    if numbered is not None:
        times = _row(path, numbered, arrays[numbered], len(poses))
        if (times != np.floor(times)).any() or (np.abs(times) > 2.0**53).any():
            raise InputError(path, "are no whole numbers", where=numbered)
    elif stamped is not None:
        times = _row(path, stamped, arrays[stamped], len(poses))
        unit = options.stamp_unit or ("ns" if (times >= LEAST_NS).all() else "s")
        times = times / PER_SECOND[unit]
    by_stamps = stamped is not None and numbered is None
    tracked = np.flatnonzero(poses[:, :3, :].any(axis=(1, 2)))
    if not len(tracked):
        error = AllLostError(path, "holds no pose: all are zero", where=name)
        error.count = len(poses) if numbered is None and not by_stamps else 0
        raise error
    order = tracked[np.argsort(times[tracked], kind="stable")]
    places = [f"pose {row}" if by_stamps else f"frame {times[row]:.0f}" for row in order.tolist()]
    rows = named_rows(path, poses[order].reshape(-1, 16), places)
    c2w, times = rigid_poses(all_finite(rows)), times[order]
    direction = "w2c" if name == "w2c" else "c2w"
    if by_stamps:
        kept, notes = first_of_equal(times, lambda row: f"{places[row]}: {times[row]:.9f} s")
        return FilePoses("array", c2w[kept], times[kept], direction=direction, notes=notes)
    if (equal := np.flatnonzero(np.diff(times) == 0.0)).size:
        raise InputError(path, "has two poses", where=places[equal[0]])
    listed = None if numbered is not None else np.arange(len(poses), dtype=np.float64)
    sparse = numbered is not None
    return FilePoses("array", c2w, numbers=times, direction=direction, listed=listed, sparse=sparse)


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
    except (*_NO_ARRAY, zlib.error, RuntimeError) as error:
        raise InputError(path, "is no array of numbers as numpy writes it", remedy="a .npy or .npz file") from error


def _members(
    path: Path, archive: zipfile.ZipFile, wanted: Container[str] | None, largest_bytes: int
) -> dict[str, NDArray]:
    arrays: dict[str, NDArray] = {}
    total = 0
    for info in archive.infolist():
        name = info.filename.removesuffix(".npy")
        if wanted is not None and name not in wanted:
            continue
        with archive.open(info) as stream:
            total += _declared_bytes(stream, info.file_size)
        _check_bytes(path, total, largest_bytes)
        with archive.open(info) as stream:
            arrays[name] = np.lib.format.read_array(cast("IO[bytes]", stream), allow_pickle=False)
    return arrays


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


def _matrices(path: Path, values: Float64) -> Float64:
    """(N, 4, 4), (N, 3, 4), or their numbers row by row, (N, 16) or (N, 12) -> (N, 4, 4). Raises InputError."""
    if values.ndim == 2 and values.shape[1] in (12, 16):
        values = values.reshape(len(values), -1, 4)
    if values.ndim != 3 or values.shape[1:] not in ((4, 4), (3, 4)):
        shape = " x ".join(map(str, values.shape))
        raise InputError(path, f"its poses are an array of {shape}, but have to be N x 4 x 4")
    if values.shape[1] == 4:
        return values
    return np.concatenate([values, np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(values), 1, 4))], axis=1)


def _numbers(path: Path, name: str, array: NDArray) -> NDArray[np.float64]:
    if array.dtype.kind not in "fiu":
        raise InputError(path, f"holds {array.dtype}, but has to be numbers", where=name)
    if not array.ndim:
        raise InputError(path, "is one number, but has to have one entry for each pose", where=name)
    with np.errstate(invalid="ignore"):  # of NaN in float32
        return array.astype(np.float64)


def _row(path: Path, name: str, array: NDArray, count: int) -> NDArray[np.float64]:
    row = _numbers(path, name, array).reshape(-1)
    if len(row) != count or not np.isfinite(row).all():
        raise InputError(path, f"has to be {count} finite numbers, one for each pose", where=name)
    return row


def _splatam_poses(file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read SplaTAM's parameters: a pose for every frame. Raises InputError."""
    path = file.path
    arrays = load_arrays(path, (ROTATIONS, TRANSLATIONS), largest_bytes=options.largest_bytes)
    lacking = next((name for name in (ROTATIONS, TRANSLATIONS) if name not in arrays), None)
    if lacking is not None:
        raise InputError(path, f"holds no {lacking}")
    quats, translations = (_numbers(path, name, arrays[name]) for name in (ROTATIONS, TRANSLATIONS))
    count = quats.shape[-1]
    if quats.shape != (1, 4, count) or translations.shape != (1, 3, count) or not count:
        raise InputError(path, f"has {ROTATIONS} of {quats.shape} and {TRANSLATIONS} of {translations.shape}")
    values = np.concatenate([quats[0], translations[0]]).T
    rows = all_finite(named_rows(path, values, [f"frame {number}" for number in range(count)]))
    w2c = pose(rotation_from_quat_wxyz(unit_quats(rows, values[:, :4])), values[:, 4:])
    return FilePoses("splatam", w2c, numbers=np.arange(count, dtype=np.float64), direction="w2c")


def _is_splatam(file: PoseFile) -> bool:
    if not file.head.startswith(_ARCHIVE):
        return False
    try:
        with open_regular(file.path) as stream, open_archive(stream) as archive:
            return f"{ROTATIONS}.npy" in archive.namelist()
    except (OSError, *_NO_ARRAY):
        return False


ARRAY = TrajectoryFormat(
    "array",
    "Arrays",
    "numpy's .npy or .npz of N x 4 x 4",
    lambda file: file.head.startswith((_NUMPY, _ARCHIVE)) and not _is_splatam(file),
    _array_poses,
    reads_parts=True,
    looks_like="numpy's `.npy` or `.npz`: matrices N x 4 x 4 or N x 3 x 4 named `poses`, `c2w` or `w2c`, with "
    "`timestamps` or `frames` or neither",
    recognised_by="its first bytes",
    times="its own, or the frames' numbers / `rate_hz`",
    order=80,
)
SPLATAM = TrajectoryFormat(
    "splatam",
    "SplaTAM",
    "SplaTAM's params.npz",
    _is_splatam,
    _splatam_poses,
    one_convention=True,
    reads_parts=True,
    looks_like="SplaTAM's `params.npz`",
    recognised_by="`cam_unnorm_rots` in it",
    times="the frames' numbers / `rate_hz`",
    order=85,
)
FORMAT = ARRAY, SPLATAM
