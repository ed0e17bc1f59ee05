# SPDX-License-Identifier: GPL-3.0-or-later
"""Pickles of protocol 2 written by hand from a tree, as torch.save writes a checkpoint, without torch."""

import io
import struct
import zipfile
from dataclasses import dataclass

import numpy as np
from fuzz.structure import Raw


@dataclass(frozen=True)
class Call:
    """A call that a pickle asks for: of module.name, with arguments."""

    function: str
    arguments: tuple


@dataclass(frozen=True)
class Name:
    """A name that a pickle asks for: module.name."""

    name: str


@dataclass(frozen=True)
class Persistent:
    """What a pickle leaves to its reader: a storage by its number."""

    key: object


def pickled(tree):
    """Return the bytes of a pickle."""
    return b"\x80\x02" + _written(tree) + b"."


def _written(tree):  # noqa: PLR0911, C901 - a case for each kind
    match tree:
        case None:
            return b"N"
        case bool():
            return b"\x88" if tree else b"\x89"
        case int():
            data = tree.to_bytes(tree.bit_length() // 8 + 1, "little", signed=True)
            return (
                b"\x8a" + bytes([len(data)]) + data
                if len(data) < 256
                else b"\x8b" + struct.pack("<i", len(data)) + data
            )
        case float():
            return b"G" + struct.pack(">d", tree)
        case str():
            data = tree.encode("utf-8", "surrogatepass")
            return b"X" + struct.pack("<I", len(data)) + data
        case Raw():
            return b"X" + struct.pack("<I", len(tree.data)) + tree.data
        case list():
            return b"](" + b"".join(map(_written, tree)) + b"e"
        case tuple():
            return b"(" + b"".join(map(_written, tree)) + b"t"
        case dict():
            return b"}(" + b"".join(_written(_key(key)) + _written(value) for key, value in tree.items()) + b"u"
        case Call():
            return _written(Name(tree.function)) + _written(tree.arguments) + b"R"
        case Name():
            module, _, name = tree.name.rpartition(".")
            return f"c{module}\n{name}\n".encode("utf-8", "surrogatepass")
        case Persistent():
            return _written(tree.key) + b"Q"
    raise TypeError(f"{tree!r} is not written")


def _key(key):
    """Return a key; digits are a number, as frames are in the trees here."""
    return int(key) if isinstance(key, str) and key.isdecimal() and key.isascii() and len(key) < 300 else key


def tensor(array, number):
    """Return a tree for a tensor, whose numbers are the storage of a number: mappings, so that it can be changed."""
    strides = [step // array.itemsize for step in array.strides]
    kind = {"<f4": "FloatStorage", "<f8": "DoubleStorage", "<i8": "LongStorage"}[array.dtype.str]
    return {
        "tensor": "torch._utils._rebuild_tensor_v2",
        "storage": ["storage", f"torch.{kind}", str(number), "cpu", int(array.size)],
        "offset": 0,
        "shape": list(array.shape),
        "strides": strides,
    }


def _tensors(tree):
    """Return a tree in which the mappings of tensors are the calls that make them."""
    match tree:
        case {"tensor": str(function), "storage": [name, str(kind), *rest], "offset": offset} if "." in function + kind:
            storage = Persistent((_tensors(name), Name(kind), *map(_tensors, rest)))
            shape, strides = (_tuple(tree.get(each)) for each in ("shape", "strides"))
            return Call(function, (storage, _tensors(offset), shape, strides, False, {}))
        case dict():
            return {key: _tensors(value) for key, value in tree.items()}
        case list():
            return [_tensors(value) for value in tree]
    return tree


def _tuple(value):
    return tuple(map(_tensors, value)) if isinstance(value, list) else _tensors(value)


def checkpoint(tree, arrays, *, folder="archive"):
    """Return a checkpoint as torch.save writes it since 1.6. tree: may hold what `tensor` returns."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(f"{folder}/data.pkl", pickled(_tensors(tree)))
        archive.writestr(f"{folder}/byteorder", "little")
        for number, array in enumerate(arrays):
            archive.writestr(f"{folder}/data/{number}", np.ascontiguousarray(array).tobytes())
    return file.getvalue()
