# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex colours: their names, types, orders and ranges."""

import numpy as np
from refusals import refused
from cases import cases
from ply_files import BYTES, ENCODINGS, POINTS, QUADS, RGB, XYZ, as_bytes, assert_is, face, ply, vertex


class TestColours:
    def colours(self, read, declarations, rows, encoding="binary_little_endian"):
        data = ply(
            encoding,
            vertex(XYZ + declarations, [(*p, *c) for p, c in zip(POINTS, rows, strict=False)]),
            face([(0, 1, 2)]),
        )
        return read(data)

    @cases("encoding", ENCODINGS)
    @cases("names", ["red green blue", "r g b", "diffuse_red diffuse_green diffuse_blue"])
    def test_names(self, read, encoding, names):
        mesh = self.colours(read, tuple(f"uchar {name}" for name in names.split()), BYTES, encoding)
        assert as_bytes(mesh) == BYTES
        assert mesh.notes == ()

    @cases("encoding", ENCODINGS)
    def test_any_order_of_channels(self, read, encoding):
        mesh = self.colours(
            read, ("uchar blue", "uchar red", "uchar green"), [(b, r, g) for r, g, b in BYTES], encoding
        )
        assert as_bytes(mesh) == BYTES

    def test_every_byte_comes_back(self, read):
        rows = [(0.0, 0.0, float(i), i, 255 - i, i) for i in range(256)]
        mesh = read(ply("binary_little_endian", vertex(XYZ + RGB, rows), face([(0, 1, 2)])))
        assert as_bytes(mesh) == [row[3:] for row in rows]
        np.testing.assert_array_equal(mesh.rgb[:, 0], np.arange(256, dtype=np.float32) / np.float32(255))

    @cases("encoding", ENCODINGS)
    def test_ushort(self, read, encoding):
        rows = [(0, 65535, 257), (32768, 1, 2), (3, 4, 65534)]
        mesh = self.colours(read, ("ushort red", "ushort green", "ushort blue"), rows * 2, encoding)
        np.testing.assert_allclose(mesh.rgb[:3], np.array(rows) / 65535, rtol=1e-6)
        assert mesh.notes == ()

    @cases("encoding", ENCODINGS)
    @cases("kind", ["float", "double"])
    def test_floats_of_unit_range(self, read, encoding, kind):
        rows = [(0.0, 0.5, 1.0), (0.25, 1.0, 0.0), (1.0000001, -1e-8, 0.75)]
        mesh = self.colours(read, tuple(f"{kind} {name}" for name in ("red", "green", "blue")), rows * 2, encoding)
        np.testing.assert_allclose(mesh.rgb[:3], np.clip(rows, 0, 1), atol=1e-7)
        assert mesh.rgb.min() == 0
        assert mesh.rgb.max() == 1
        assert mesh.notes == ()

    @cases("encoding", ENCODINGS)
    @cases("kind", ["float", "double", "int", "short", "uint"])
    def test_byte_range_in_other_types(self, read, encoding, kind):
        rows = [tuple(float(c) for c in row) if kind in {"float", "double"} else row for row in BYTES]
        mesh = self.colours(read, tuple(f"{kind} {name}" for name in ("red", "green", "blue")), rows, encoding)
        assert as_bytes(mesh) == BYTES
        assert len(mesh.notes) == 1
        assert "255" in mesh.notes[0]
        assert "read as 0..255" in mesh.notes[0]

    @cases("declarations", [(), RGB[:2], ("uchar red", "uchar green", "list uchar uchar blue")])
    def test_without_colours(self, read, declarations):
        rows = [(*p, *((1, 2, (3, 4))[: len(declarations)])) for p in POINTS]
        mesh = read(ply("binary_big_endian", vertex(XYZ + declarations, rows), face(QUADS)))
        assert_is(mesh, QUADS, colours=None, notes=("no colours: shown in neutral grey",))

    @cases(("kind", "value"), [("float", 300.0), ("float", -0.5), ("int", 256), ("short", -1), ("char", -3)])
    def test_out_of_range(self, read, kind, value):
        rows = [(0, 0, 0), (0, value, 0), (0, 0, 0)]
        rgb = tuple(f"{kind} {name}" for name in ("red", "green", "blue"))
        refused(self.colours, read, rgb, rows * 2, names="colours lie between")

    @cases(("kind", "most"), [("float", 1.01), ("float", 1.5), ("double", 2.0), ("float", 15.9)])
    def test_floats_of_no_known_range(self, read, kind, most):
        rows = [(0, 0.25, 1.0), (0.5, most, 0), (0, 0, 0)] * 2
        rgb = tuple(f"{kind} {name}" for name in ("red", "green", "blue"))
        refused(self.colours, read, rgb, rows, names=(f"up to {most:g}", "store them as uchar"))

    def test_whole_numbers_are_bytes_however_dark(self, read):
        rows = [(0, 1, 2), (3, 0, 1), (0, 0, 0)] * 2
        mesh = self.colours(read, ("int red", "int green", "int blue"), rows)
        np.testing.assert_allclose(mesh.rgb[:2] * 255, rows[:2], rtol=1e-6)

    def test_too_large_for_a_byte_in_text(self, refuse):
        data = ply("ascii", vertex(), face(QUADS)).replace(b"255 254 253", b"256 254 253")
        assert "colours lie between 0 and 256" in refuse(data)

    @cases("encoding", ENCODINGS)
    @cases("value", [float("nan"), float("inf"), float("-inf")])
    def test_not_finite(self, read, encoding, value):
        rows = [(0.5, 0.5, 0.5), (0.5, 0.5, value), (value, 0.5, 0.5)] * 2
        rgb = ("float red", "float green", "float blue")
        refused(self.colours, read, rgb, rows, encoding, names=("vertex 1: ", "4 of 6 vertices"))
