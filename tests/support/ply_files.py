# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY files of every dialect, built here by hand with struct alone, and what a test asks of the mesh that is read."""

import itertools
import struct

import numpy as np

ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")
BINARY = ENCODINGS[1:]
CODES = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f", "float64": "d",
}  # fmt: skip

XYZ = ("float x", "float y", "float z")
NORMAL = ("float nx", "float ny", "float nz")
RGB = ("uchar red", "uchar green", "uchar blue")
INDICES = ("list uchar int vertex_indices",)

POINTS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0), (0.5, 0.5, 1.0), (-0.25, 0.5, 2.0)]
BYTES = [(0, 1, 2), (255, 254, 253), (128, 127, 126), (10, 20, 30), (77, 88, 99), (200, 100, 50)]
TRIANGLES = [(0, 1, 2), (0, 2, 3), (4, 5, 0)]
QUADS = [(0, 1, 2, 3), (2, 3, 4, 5)]
MIXED = [(0, 1, 2, 3), (0, 1, 4), (0, 1, 2, 4, 5), (1, 2, 4), (5, 4, 3, 2, 1, 0)]


def encode(encoding, kind, value):
    if encoding == "ascii":
        return f"{value!r} ".encode()
    return struct.pack({"binary_little_endian": "<", "binary_big_endian": ">"}[encoding] + CODES[kind], value)


def ply(encoding, *elements, end="\n", extra=()):
    """The bytes of a file; an element is (name, declarations, rows), and a list's value is a tuple."""
    lines = ["ply", f"format {encoding} 1.0", *extra]
    body = bytearray()
    for name, declarations, rows in elements:
        lines += [f"element {name} {len(rows)}", *(f"property {declaration}" for declaration in declarations)]
        for row in rows:
            for declaration, value in zip(declarations, row, strict=True):
                words = declaration.split()
                if words[0] == "list":
                    body += encode(encoding, words[1], len(value))
                    body += b"".join(encode(encoding, words[2], item) for item in value)
                else:
                    body += encode(encoding, words[0], value)
            body += b"\n" if encoding == "ascii" else b""
    return "".join(line + end for line in (*lines, "end_header")).encode() + body


def vertex(declarations=XYZ + RGB, rows=None):
    return "vertex", declarations, rows or [(*point, *colour) for point, colour in zip(POINTS, BYTES, strict=True)]


def face(faces, declarations=INDICES):
    return "face", declarations, [(indices,) for indices in faces]


def polygons(mesh):
    bounds = [*mesh.face_starts.tolist(), len(mesh.corner_vertices)]
    return [tuple(mesh.corner_vertices[a:b].tolist()) for a, b in itertools.pairwise(bounds)]


def as_bytes(mesh):
    return [tuple(row) for row in np.rint(mesh.rgb * 255).astype(int).tolist()]


def assert_is(mesh, faces, points=POINTS, colours=BYTES, notes=()):
    assert mesh.vertices_m.dtype == np.float64
    assert mesh.corner_vertices.dtype == np.int32
    assert mesh.face_starts.dtype == np.int32
    np.testing.assert_array_equal(mesh.vertices_m, np.array(points))
    assert polygons(mesh) == [tuple(indices) for indices in faces]
    if colours is None:
        assert mesh.rgb is None
    else:
        assert mesh.rgb.dtype == np.float32
        assert as_bytes(mesh) == list(colours)
    assert mesh.notes == notes
