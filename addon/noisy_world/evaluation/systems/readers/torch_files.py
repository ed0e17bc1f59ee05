# SPDX-License-Identifier: GPL-3.0-or-later
"""Checkpoints of torch.save read without torch, and without running anything that they name.

Both of its formats (torch/serialization.py): since 1.6 a zip archive with `data.pkl`, `byteorder` and a file for each
storage, `data/KEY`; before, and with _use_new_zipfile_serialization=False, one pickle after another: a magic number,
the protocol, the machine, the object, the keys of its storages; then each storage, its length before it.

A pickle can name any function. Here a name gives an inert stand-in or is refused, so nothing is ever called but what
this file defines; and its operations are looked through before they are done, so that a damaged one asks for no more
memory than the file has bytes.
"""

import io
import math
import mmap
import pickle
import pickletools
import struct
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from ....core.errors import InputError
from ....core.regular_files import open_regular
from ....core.schema import shown
from ..leavings import LARGEST_READ_BYTES, OverLimitError
from .archives import open_archive

MAGIC_NUMBER = 0x1950A86A20F9469CFC6C
PROTOCOL_VERSION = 1001
LARGEST_PICKLE = 64 * 2**20  # bytes of data.pkl; that of 2,000 frames has less than one
MOST_OPERATIONS = 3_000_000  # of a pickle; a pose has some 40, and a value some hundred bytes of memory
LONGEST_INTEGER_BITS = 64  # Python's mappings of longer ones can be made to take for ever

# Bytes of an element, and numpy's name of it, where it has one.
_STORAGES: dict[str, tuple[int, str]] = {
    "DoubleStorage": (8, "f8"),
    "FloatStorage": (4, "f4"),
    "HalfStorage": (2, "f2"),
    "BFloat16Storage": (2, ""),
    "LongStorage": (8, "i8"),
    "IntStorage": (4, "i4"),
    "ShortStorage": (2, "i2"),
    "CharStorage": (1, "i1"),
    "ByteStorage": (1, "u1"),
    "BoolStorage": (1, "b1"),
    "ComplexFloatStorage": (8, "c8"),
    "ComplexDoubleStorage": (16, "c16"),
    "UntypedStorage": (1, "u1"),
}
# Operations that no pickle of a checkpoint has: extensions, buffers outside it, instances of classes of old.
_REFUSED = {"EXT1", "EXT2", "EXT4", "BYTEARRAY8", "NEXT_BUFFER", "READONLY_BUFFER", "INST", "OBJ", "PERSID"}
_KEEPS = {"PUT", "BINPUT", "LONG_BINPUT"}
# What checkpoints hold beside tensors and is of no use here: numpy's arrays and numbers, and types and sizes of torch.
_INERT = {
    ("torch", "Size"),
    ("torch", "device"),
    ("torch._utils", "_rebuild_tensor_v3"),
    ("numpy", "dtype"),
    ("numpy", "ndarray"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("_codecs", "encode"),
}
# What unpickling data that are no pickle, or opening an archive that is none, may raise.
_BROKEN = (
    pickle.UnpicklingError, EOFError, AttributeError, IndexError, KeyError, TypeError, ValueError, OverflowError,
    MemoryError, RecursionError, ImportError, zipfile.BadZipFile, NotImplementedError, struct.error,
)  # fmt: skip


class Inert:
    """Stands for a value that is not read; it takes whatever arguments and state a pickle gives it."""

    def __init__(self, *arguments: object) -> None:
        del arguments

    def __call__(self, *arguments: object) -> "Inert":
        """Return itself, whatever it is called with."""
        del arguments
        return self

    def __setstate__(self, state: object) -> None:
        """Take a state and forget it."""
        del state


@dataclass(frozen=True)
class _Storage:
    key: str
    item_bytes: int
    dtype: str
    count: int


@dataclass(frozen=True)
class Tensor:
    """A tensor of a checkpoint that is open, whose numbers are read on request."""

    file: "_File"
    storage: _Storage
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]

    def array(self) -> NDArray[Any]:
        """Return its numbers. Raises InputError where its storage is damaged or of a kind that numpy does not know."""
        if not self.storage.dtype:
            raise InputError(self.file.path, "holds a tensor of bfloat16 where numbers are wanted")
        self.file.check(math.prod(self.shape) * self.storage.item_bytes)  # its steps may be 0
        data = self.file.read(self.storage)
        numbers = np.frombuffer(data, dtype=np.dtype(self.storage.dtype).newbyteorder(self.file.order))
        last = self.offset + sum((size - 1) * step for size, step in zip(self.shape, self.strides, strict=True))
        if min((self.offset, *self.shape, *self.strides)) < 0 or (0 not in self.shape and last >= len(numbers)):
            raise InputError(self.file.path, "is damaged: a tensor reaches beyond its numbers")
        strides = [step * numbers.itemsize for step in self.strides]
        try:
            if 0 in self.shape:
                return np.zeros(self.shape, numbers.dtype)
            return np.lib.stride_tricks.as_strided(numbers[self.offset :], self.shape, strides).copy()
        except ValueError as error:  # more axes than numpy has, or longer ones
            raise InputError(self.file.path, f"is damaged: a tensor of {len(self.shape)} axes") from error


@dataclass
class _File:
    """Where the numbers of a checkpoint's storages are."""

    path: Path
    fetch: Callable[[str], bytes]
    largest_bytes: int
    order: Literal["<", ">"] = "<"
    _held: dict[str, bytes] = field(default_factory=dict)

    def read(self, storage: _Storage) -> bytes:
        """Return the bytes of a storage; each is read once, and all that are read are within the limit."""
        if storage.key not in self._held:
            self.check(sum(map(len, self._held.values())) + storage.count * storage.item_bytes)
            self._held[storage.key] = self._fetched(storage)
        return self._held[storage.key]

    def check(self, count: int) -> None:
        """Raise OverLimitError where so many bytes are more than the limit."""
        if count > self.largest_bytes:
            most = f"{self.largest_bytes / 1e6:g} MB of limits.estimate_mb"
            raise OverLimitError(self.path, f"holds poses of {count / 1e6:.0f} MB, more than the {most}")

    def _fetched(self, storage: _Storage) -> bytes:
        try:
            data = self.fetch(storage.key)
        except (*_BROKEN, OSError) as error:
            raise InputError(self.path, f"is damaged: the numbers {shown(storage.key)} cannot be read") from error
        if len(data) != storage.count * storage.item_bytes:
            raise InputError(self.path, f"is damaged: the numbers {shown(storage.key)} are not as many as it says")
        return data


@contextmanager
def open_torch(path: Path, largest_bytes: int = LARGEST_READ_BYTES) -> Iterator[Any]:
    """Open a checkpoint; yield what it holds, with a `Tensor` for each tensor, which can be read while it is open.

    largest_bytes: of the tensors' numbers that are read; OverLimitError where they are more.
    Raises InputError where the file is no checkpoint, is damaged, or names anything but what checkpoints of tensors,
    numbers, texts, lists and mappings need.
    """
    with ExitStack() as opened:
        try:
            stream = opened.enter_context(open_regular(path))
            if zipfile.is_zipfile(stream):
                value = _unzipped(path, opened.enter_context(open_archive(stream)), largest_bytes)
            else:
                # A mapping, unlike a file, gives no more than there is, however much is asked for.
                held = opened.enter_context(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
                value = _legacy(path, held, largest_bytes)
        except OSError as error:
            raise InputError(path, f"cannot be read: {error.strerror or error}") from error
        except _BROKEN as error:
            raise InputError(path, "is no checkpoint of torch, or a damaged one") from error
        yield value


def _unzipped(path: Path, archive: zipfile.ZipFile, largest_bytes: int) -> Any:
    pickles = [name for name in archive.namelist() if name == "data.pkl" or name.endswith("/data.pkl")]
    if len(pickles) != 1 or archive.getinfo(pickles[0]).file_size > LARGEST_PICKLE:
        raise InputError(path, "is a zip archive, but no checkpoint of torch")
    root = pickles[0].removesuffix("data.pkl")
    order = next((item for item in archive.infolist() if item.filename == f"{root}byteorder"), None)
    big = order is not None and order.file_size == len(b"big") and archive.read(order) == b"big"

    def fetch(key: str) -> bytes:
        info = archive.getinfo(f"{root}data/{key}")
        if info.compress_type != zipfile.ZIP_STORED:
            raise zipfile.BadZipFile("compressed")
        return archive.read(info)

    data = io.BytesIO(archive.read(pickles[0]))
    return _Unpickler(data, _File(path, fetch, largest_bytes, ">" if big else "<")).value()


def _legacy(path: Path, stream: mmap.mmap, largest_bytes: int) -> Any:
    at: dict[str, tuple[int, int]] = {}

    def fetch(key: str) -> bytes:
        place, size = at[key]
        stream.seek(place)
        return stream.read(size)

    file = _File(path, fetch, largest_bytes)
    if _Unpickler(stream, file).value() != MAGIC_NUMBER or _Unpickler(stream, file).value() != PROTOCOL_VERSION:
        raise InputError(path, "is no checkpoint of torch")
    machine = _Unpickler(stream, file).value()
    if not isinstance(machine, dict) or machine.get("little_endian") is not True:
        raise InputError(path, "is no checkpoint of torch, or of a machine that is not little-endian")
    reader = _Unpickler(stream, file)
    value = reader.value()
    keys = _Unpickler(stream, file).value()
    if not isinstance(keys, list) or not all(key in reader.storages for key in keys):
        raise InputError(path, "is damaged: it does not list its numbers")
    for key in keys:
        count = stream.read(8)
        if len(count) != 8:
            raise InputError(path, "is damaged: it ends too early")
        size = int.from_bytes(count, "little") * reader.storages[key].item_bytes
        if size > len(stream) - stream.tell():
            raise InputError(path, "is damaged: it ends too early")
        at[key] = (stream.tell(), size)
        stream.seek(size, 1)
    return value


def _look_through(stream: io.BytesIO | mmap.mmap) -> None:
    """Look through the operations of the next pickle of a stream, and go back to its beginning.

    Raises UnpicklingError for one that has no place in a checkpoint, and for a number of a kept value that is not one
    of so many: the unpickler makes room for it.
    """
    begin = stream.tell()
    for count, (operation, number, _) in enumerate(pickletools.genops(cast("IO[bytes]", stream))):
        far = operation.name in _KEEPS and isinstance(number, int) and number > count
        long = type(number) is int and number.bit_length() > LONGEST_INTEGER_BITS and number != MAGIC_NUMBER
        if operation.name in _REFUSED or far or long or count > MOST_OPERATIONS:
            raise pickle.UnpicklingError(operation.name)
    stream.seek(begin)


class _Unpickler(pickle.Unpickler):
    """Makes plain values, `Tensor` and `Inert` of a pickle, and refuses every other name."""

    def __init__(self, stream: io.BytesIO | mmap.mmap, file: _File) -> None:
        super().__init__(stream)
        self.storages: dict[str, _Storage] = {}
        self._stream = stream
        self._file = file
        self._refused = ""

    def value(self) -> Any:
        """Return the next value of the stream. Raises InputError."""
        try:
            _look_through(self._stream)
            return self.load()
        except _BROKEN as error:
            if self._refused:
                remedy = "a checkpoint holds tensors, numbers, texts, lists and mappings; nothing else is read"
                raise InputError(self._file.path, f"holds {self._refused}", remedy=remedy) from None
            raise InputError(self._file.path, "is no checkpoint of torch, or a damaged one") from error

    def find_class(self, module: str, name: str, /) -> Any:
        """Return what stands for a name of a pickle."""
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return self._tensor
        if (module, name) == ("torch._utils", "_rebuild_parameter"):
            return _parameter
        if module in ("torch", "torch.cuda", "torch.storage") and name in _STORAGES:
            return _STORAGES[name]
        if (module, name) in _INERT or (module == "torch" and name in _TYPES):
            return Inert
        self._refused = shown(f"{module}.{name}")
        raise pickle.UnpicklingError(self._refused)

    def persistent_load(self, pid: Any, /) -> _Storage:
        """Return the storage that a pickle names: ("storage", its type, its key, its device, its length, ...)."""
        kind, (item_bytes, dtype), key, _, count = pid[:5]
        if kind != "storage" or not isinstance(key, str) or not isinstance(count, int) or count < 0:
            raise pickle.UnpicklingError("no storage")
        if len(pid) > 5 and pid[5] is not None:
            self._refused = "a view of a storage, as torch wrote it before 0.4"
            raise pickle.UnpicklingError(self._refused)
        storage = _Storage(key, item_bytes, dtype, count)
        return self.storages.setdefault(key, storage)

    def _tensor(self, storage: object, offset: object, shape: object, strides: object, *rest: object) -> Tensor:
        del rest  # whether it needs gradients, hooks
        numbers = (offset, *shape, *strides) if isinstance(shape, tuple) and isinstance(strides, tuple) else (None,)
        if not isinstance(storage, _Storage) or not all(type(number) is int for number in numbers):
            raise pickle.UnpicklingError("no tensor")
        assert isinstance(offset, int)
        assert isinstance(shape, tuple)
        assert isinstance(strides, tuple)
        if len(shape) != len(strides):
            raise pickle.UnpicklingError("no tensor")
        return Tensor(self._file, storage, offset, shape, strides)


_TYPES = {
    "float16", "float32", "float64", "bfloat16", "int8", "int16", "int32", "int64", "uint8", "bool", "complex64",
    "complex128",
}  # fmt: skip


def _parameter(data: object, *rest: object) -> object:
    """Return the tensor of a parameter."""
    del rest
    return data
