# SPDX-License-Identifier: GPL-3.0-or-later
"""ONNX files written by hand, field by field, as onnx.proto numbers them: no library of it is needed."""


def _field(number, value):
    """One field of a protocol buffer: a whole number, or bytes with their length."""
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    return _varint(number << 3 | 2) + _varint(len(value)) + value


def _varint(value):
    out = b""
    while True:
        value, low = value >> 7, value & 127
        out += bytes([low | (128 if value else 0)])
        if not value:
            return out


def _tensor_value(name, sizes):
    shape = b"".join(_field(1, _field(1, size)) for size in sizes)
    return _field(1, name.encode()) + _field(2, _field(1, _field(1, 1) + _field(2, shape)))


def _node(kind, inputs, output, *attributes):
    names = b"".join(_field(1, name.encode()) for name in inputs)
    return names + _field(2, output.encode()) + _field(4, kind.encode()) + b"".join(_field(5, a) for a in attributes)


def mean_difference(height, width, names=("in0", "in1"), output_sizes=(1, 1, 1, 1)):
    """A model whose output is the mean of |first - second| of images (1, 3, height, width)."""
    axes = _field(1, b"axes") + b"".join(_field(8, axis) for axis in (1, 2, 3)) + _field(20, 7)
    keep = _field(1, b"keepdims") + _field(3, 1) + _field(20, 2)
    whole = len(output_sizes) == 4 and output_sizes[2] == 1
    nodes = [_node("Sub", names, "difference"), _node("Abs", ["difference"], "size" if whole else "out")]
    nodes += [_node("ReduceMean", ["size"], "out", axes, keep)] if whole else []
    graph = b"".join(_field(1, node) for node in nodes) + _field(2, b"difference")
    graph += b"".join(_field(11, _tensor_value(name, (1, 3, height, width))) for name in names)
    graph += _field(12, _tensor_value("out", output_sizes))
    return _field(1, 8) + _field(7, graph) + _field(8, _field(1, b"") + _field(2, 13))
