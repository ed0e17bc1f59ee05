# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY files of every dialect, whole and damaged, built and taken apart here with struct alone."""

import itertools
import random
import struct
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest

from noisy_world.core.errors import InputError, StorageError
from noisy_world.core.mesh import Mesh
from noisy_world.core.ply import read_ply, write_ply

REAL_ROOM = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "real_room"

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


@pytest.fixture
def read(tmp_path):
    def read_bytes(data):
        path = tmp_path / "mesh.ply"
        path.write_bytes(data)
        return read_ply(path)

    return read_bytes


@pytest.fixture
def refuse(read):
    """The one line of the error that these bytes give, without the path."""

    def message(data):
        with pytest.raises(InputError) as caught:
            read(data)
        text = str(caught.value)
        assert "\n" not in text
        assert caught.value.file.endswith("mesh.ply")
        assert text.startswith(caught.value.file + ": ")
        return text.removeprefix(caught.value.file + ": ")

    return message


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


class TestFormats:
    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("faces", [TRIANGLES, QUADS, MIXED, [(0, 1, 2)], [tuple(range(6))]])
    def test_encoding_and_face_sizes(self, read, encoding, faces):
        assert_is(read(ply(encoding, vertex(), face(faces))), faces)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("length", ["char", "uchar", "short", "ushort", "int", "uint", "int8", "uint16", "int32"])
    @pytest.mark.parametrize("index", ["char", "uchar", "short", "ushort", "int", "uint", "uint8", "int16", "uint32"])
    def test_list_types(self, read, encoding, length, index):
        for faces in (QUADS, MIXED):
            data = ply(encoding, vertex(), face(faces, (f"list {length} {index} vertex_indices",)))
            assert_is(read(data), faces)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("name", ["vertex_indices", "vertex_index"])
    def test_index_name(self, read, encoding, name):
        assert_is(read(ply(encoding, vertex(), face(MIXED, (f"list uchar int {name}",)))), MIXED)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("kind", CODES)
    def test_every_type_name_as_coordinate(self, read, encoding, kind):
        points = [(0, 1, 2), (3, 4, 5), (6, 7, 127)]
        mesh = read(ply(encoding, vertex([f"{kind} {axis}" for axis in "xyz"], points), face([(0, 1, 2)])))
        np.testing.assert_array_equal(mesh.vertices_m, points)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_doubles_keep_every_bit(self, read, encoding):
        numbers = np.random.default_rng(1)
        points = (numbers.normal(size=(500, 3)) * 10.0 ** numbers.integers(-12, 12, (500, 3))).tolist()
        mesh = read(ply(encoding, vertex(("double x", "double y", "double z"), points), face([(0, 1, 2)])))
        np.testing.assert_array_equal(mesh.vertices_m, points)

    @pytest.mark.parametrize("encoding", BINARY)
    def test_floats_keep_every_bit(self, read, encoding):
        points = np.random.default_rng(2).normal(size=(500, 3)).astype(np.float32)
        mesh = read(ply(encoding, vertex(XYZ, points.tolist()), face([(0, 1, 2)])))
        np.testing.assert_array_equal(mesh.vertices_m, points.astype(np.float64))

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_crlf_header_comments_and_obj_info(self, read, encoding):
        extra = ["comment made by hand", "comment", "obj_info num_cols 512", "comment élan", "comment element vertex 9"]
        assert_is(read(ply(encoding, vertex(), face(MIXED), end="\r\n", extra=extra)), MIXED)

    def test_crlf_text_body(self, read):
        data = ply("ascii", vertex(), face(MIXED)).replace(b"\n", b"\r\n")
        assert_is(read(data), MIXED)

    @pytest.mark.parametrize("order", ["<", ">"])
    def test_first_byte_of_the_data_may_be_a_line_feed(self, read, order):
        encoding = {"<": BINARY[0], ">": BINARY[1]}[order]
        number = struct.unpack(order + "f", b"\n\r\n\n")[0]
        points = [(number, 0.0, 0.0), *POINTS[1:]]
        mesh = read(ply(encoding, vertex(XYZ, points), face(QUADS)))
        assert mesh.vertices_m[0, 0] == number

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_faces_before_vertices(self, read, encoding):
        assert_is(read(ply(encoding, face(MIXED), vertex())), MIXED)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("faces", [QUADS, MIXED])
    def test_normals_alpha_and_other_scalars_are_skipped(self, read, encoding, faces):
        declarations = ("uchar flags", *XYZ, *NORMAL, *RGB, "uchar alpha", "double quality")
        rows = [(9, *p, 0.5, 0.25, -1.0, *c, 0, 1e300) for p, c in zip(POINTS, BYTES, strict=True)]
        assert_is(read(ply(encoding, vertex(declarations, rows), face(faces))), faces)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("uneven", [False, True])
    def test_lists_of_vertices_are_skipped(self, read, encoding, uneven):
        declarations = ("list uchar short before", *XYZ, "list int double between", *RGB, "list ushort char after")
        rows = []
        for i, (point, colour) in enumerate(zip(POINTS, BYTES, strict=True)):
            k = i if uneven else 2
            rows.append(((7,) * (k % 3), *point, (0.5,) * (k % 2), *colour, (-1,) * k))
        assert_is(read(ply(encoding, vertex(declarations, rows), face(MIXED))), MIXED)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("faces", [QUADS, MIXED])
    def test_face_properties_around_the_indices(self, read, encoding, faces):
        declarations = (
            "int object_id",
            "list uchar float texcoord",
            "list uint uint vertex_indices",
            "uchar flags",
            "list uchar uchar names",
            "double area",
        )
        rows = [(7, (0.5,) * 2 * len(f), f, 3, (1,) * (i % 3), 2.5) for i, f in enumerate(faces)]
        assert_is(read(ply(encoding, vertex(), ("face", declarations, rows))), faces)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("faces", [QUADS, MIXED])
    def test_object_id_as_habitat_writes_it(self, read, encoding, faces):
        for declarations in (("int object_id", *INDICES), (*INDICES, "int object_id")):
            rows = [(41, f) if declarations[0] == "int object_id" else (f, 41) for f in faces]
            assert_is(read(ply(encoding, vertex(), ("face", declarations, rows))), faces)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("places", [(0, 1, 2, 3), (2, 0, 3, 1), (3, 1, 2, 0), (1, 3, 0, 2)])
    def test_other_elements_anywhere(self, read, encoding, places):
        edge = ("edge", ("int vertex1", "int vertex2", "uchar red"), [(0, 1, 9), (1, 2, 8)])
        strips = ("camera", ("float view_px", "list int float frame"), [(1.5, (1.0, 2.0)), (2.5, ()), (3.5, (4.0,))])
        elements = [vertex(), face(MIXED), edge, strips]
        assert_is(read(ply(encoding, *(elements[i] for i in places))), MIXED)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_empty_elements(self, read, encoding):
        empty = [("edge", ("int a", "list uchar int b"), []), ("nothing", (), [])]
        assert_is(read(ply(encoding, empty[0], vertex(), empty[1], face(MIXED))), MIXED)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_the_mesh_owns_its_arrays(self, read, encoding):
        mesh = read(ply(encoding, vertex(), face(MIXED)))
        for array in (mesh.vertices_m, mesh.rgb, mesh.corner_vertices, mesh.face_starts):
            assert array.flags.owndata
            assert array.flags.writeable
            assert array.flags.c_contiguous


class TestText:
    def coordinates(self, read, words):
        """The numbers that the reader makes of words in a text file."""
        words = [*words, *["0"] * (-len(words) % 3)]
        lines = [" ".join(words[i : i + 3]) for i in range(0, len(words), 3)]
        header = ply("ascii", ("vertex", ("double x", "double y", "double z"), []), face([])).decode()
        header = header.replace("vertex 0", f"vertex {len(lines)}").replace("face 0", "face 1")
        return read(f"{header}{'\n'.join(lines)}\n3 0 1 2\n".encode()).vertices_m.ravel()

    def test_number_forms(self, read):
        words = """
            0 -0 +1 1. .5 -.5 +.5 5.e2 1e5 1E5 1e+05 1e-05 -1.5e-07 000.5 0.1 123456789012345 12345678901234567
            9007199254740993 9007199254740991e22 0.30000000000000004 1.7976931348623157e308 2.2250738585072014e-308
            4.9e-324 1e22 1e23 -1e-22 99999999999999999999 -9223372036854775808 0.000000000000000000000000001
            123456.789012345e-30 8.5e15 1e0005
        """
        for word in words.split():
            got = self.coordinates(read, [word, "7.25", "-3"] * 3)
            np.testing.assert_array_equal(got, [float(word), 7.25, -3.0] * 3, err_msg=word)

    @pytest.mark.parametrize("form", ["%.6f", "%.3f", "%g", "%.9g", "%.17g", "%.18e", "%d", "%.1e", "%.20f"])
    def test_each_number_is_the_nearest_double(self, read, form):
        numbers = np.random.default_rng(3)
        values = numbers.normal(size=3000) * 10.0 ** numbers.integers(-6, 7, 3000)
        words = [form % value for value in values]
        np.testing.assert_array_equal(self.coordinates(read, words), [float(word) for word in words])

    def test_numbers_may_stand_on_any_line(self, read):
        data = ply("ascii", vertex(), face(MIXED))
        head, body = data.split(b"end_header\n")
        for blank in (b"\n", b"\t", b"   ", b" \r\n \n", b"\x0b\x0c"):
            assert_is(read(head + b"end_header\n" + blank.join(body.split()) + b"\n"), MIXED)

    def test_long_files_are_read_in_blocks(self, read):
        numbers = np.random.default_rng(4)
        points = numbers.normal(size=(30000, 3)).round(5)
        points[20000, 1] = 1 / 3  # a number that the fast conversion leaves to the general one
        faces = [tuple(f) for f in (np.arange(29990)[:, None] + [0, 1, 2, 3]).tolist()]
        mesh = read(ply("ascii", vertex(XYZ, points.tolist()), face(faces)))
        np.testing.assert_array_equal(mesh.vertices_m, points)
        np.testing.assert_array_equal(mesh.corner_vertices.reshape(-1, 4), faces)

    def test_a_missing_last_line_end_is_noted(self, read):
        mesh = read(ply("ascii", vertex(), face(MIXED)).rstrip())
        assert polygons(mesh) == MIXED
        assert len(mesh.notes) == 1
        assert "no line end" in mesh.notes[0]

    @pytest.mark.parametrize(
        "word",
        [
            "abc",
            "1.5.2",
            "1-2",
            "--1",
            "1e",
            "e5",
            "1e5e6",
            "1e5.5",
            "1e+",
            ".",
            "-",
            "+.",
            ".-5",
            "0x10",
            "1,5",
            "1_0",
        ],
    )
    @pytest.mark.parametrize("place", [0, 1, 3000])
    def test_garbage_names_its_line(self, refuse, word, place):
        points = [(float(i), 0.125, 2.5) for i in range(3001)]
        lines = ply("ascii", vertex(XYZ, points), face([(0, 1, 2)])).decode().split("\n")
        first = lines.index("end_header") + 1
        lines[first + place] = f"{place} {word} 0.5"
        message = refuse("\n".join(lines).encode())
        assert message.startswith(f"line {first + place + 1}: '{word}' is not a number")

    @pytest.mark.parametrize("junk", [b"\x00", b"\xff\xfe", b"\x1c", b"1\x002", "½".encode()])
    def test_binary_garbage(self, refuse, junk):
        data = ply("ascii", vertex(), face(MIXED)).replace(b"\n0.5 0.5", b"\n" + junk + b" 0.5")
        assert "is not a number" in refuse(data)

    @pytest.mark.parametrize("length", ["3.5", "nan", "inf", "1e300", "-1", "-inf"])
    @pytest.mark.parametrize("row", [0, 1])
    def test_odd_list_lengths(self, refuse, length, row):
        data = ply("ascii", vertex(), face(TRIANGLES)).decode()
        lines = data.split("\n")
        lines[-4 + row] = lines[-4 + row].replace("3", length, 1)
        assert refuse("\n".join(lines).encode()).startswith(f"face {row}: a list of ")

    def test_fractional_index(self, refuse):
        data = ply("ascii", vertex(), face(QUADS)).replace(b"4 2 3 4 5", b"4 2 3.5 4 5")
        assert refuse(data).startswith("face 1: vertex index 3.5 is none of the 6 vertices")

    def test_not_a_number_as_index(self, refuse):
        data = ply("ascii", vertex(), face(QUADS)).replace(b"4 2 3 4 5", b"4 2 nan 4 5")
        assert refuse(data).startswith("face 1: vertex index nan is none of the 6 vertices")


class TestColours:
    def colours(self, read, declarations, rows, encoding="binary_little_endian"):
        data = ply(
            encoding,
            vertex(XYZ + declarations, [(*p, *c) for p, c in zip(POINTS, rows, strict=False)]),
            face([(0, 1, 2)]),
        )
        return read(data)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("names", ["red green blue", "r g b", "diffuse_red diffuse_green diffuse_blue"])
    def test_names(self, read, encoding, names):
        mesh = self.colours(read, tuple(f"uchar {name}" for name in names.split()), BYTES, encoding)
        assert as_bytes(mesh) == BYTES
        assert mesh.notes == ()

    @pytest.mark.parametrize("encoding", ENCODINGS)
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

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_ushort(self, read, encoding):
        rows = [(0, 65535, 257), (32768, 1, 2), (3, 4, 65534)]
        mesh = self.colours(read, ("ushort red", "ushort green", "ushort blue"), rows * 2, encoding)
        np.testing.assert_allclose(mesh.rgb[:3], np.array(rows) / 65535, rtol=1e-6)
        assert mesh.notes == ()

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("kind", ["float", "double"])
    def test_floats_of_unit_range(self, read, encoding, kind):
        rows = [(0.0, 0.5, 1.0), (0.25, 1.0, 0.0), (1.0000001, -1e-8, 0.75)]
        mesh = self.colours(read, tuple(f"{kind} {name}" for name in ("red", "green", "blue")), rows * 2, encoding)
        np.testing.assert_allclose(mesh.rgb[:3], np.clip(rows, 0, 1), atol=1e-7)
        assert mesh.rgb.min() == 0
        assert mesh.rgb.max() == 1
        assert mesh.notes == ()

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("kind", ["float", "double", "int", "short", "uint"])
    def test_byte_range_in_other_types(self, read, encoding, kind):
        rows = [tuple(float(c) for c in row) if kind in {"float", "double"} else row for row in BYTES]
        mesh = self.colours(read, tuple(f"{kind} {name}" for name in ("red", "green", "blue")), rows, encoding)
        assert as_bytes(mesh) == BYTES
        assert len(mesh.notes) == 1
        assert "255" in mesh.notes[0]
        assert "read as 0..255" in mesh.notes[0]

    @pytest.mark.parametrize("declarations", [(), RGB[:2], ("uchar red", "uchar green", "list uchar uchar blue")])
    def test_without_colours(self, read, declarations):
        rows = [(*p, *((1, 2, (3, 4))[: len(declarations)])) for p in POINTS]
        mesh = read(ply("binary_big_endian", vertex(XYZ + declarations, rows), face(QUADS)))
        assert_is(mesh, QUADS, colours=None, notes=("no vertex colours: shown in neutral grey",))

    @pytest.mark.parametrize(
        ("kind", "value"), [("float", 300.0), ("float", -0.5), ("int", 256), ("short", -1), ("char", -3)]
    )
    def test_out_of_range(self, read, kind, value):
        rows = [(0, 0, 0), (0, value, 0), (0, 0, 0)]
        with pytest.raises(InputError, match="colours lie between"):
            self.colours(read, tuple(f"{kind} {name}" for name in ("red", "green", "blue")), rows * 2)

    def test_too_large_for_a_byte_in_text(self, refuse):
        data = ply("ascii", vertex(), face(QUADS)).replace(b"255 254 253", b"256 254 253")
        assert "colours lie between 0 and 256" in refuse(data)

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
    def test_not_finite(self, read, encoding, value):
        rows = [(0.5, 0.5, 0.5), (0.5, 0.5, value), (value, 0.5, 0.5)] * 2
        with pytest.raises(InputError, match="vertex 1: a colour is NaN or infinite, at 4 of 6 vertices"):
            self.colours(read, ("float red", "float green", "float blue"), rows, encoding)


class TestRepairs:
    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_small_faces_are_dropped(self, read, encoding):
        faces = [(), (0, 1, 2), (3,), (0, 1), (2, 3, 4, 5), ()]
        note = "4 faces had fewer than 3 different corners: dropped"
        assert_is(read(ply(encoding, vertex(), face(faces))), [(0, 1, 2), (2, 3, 4, 5)], notes=(note,))

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("quad", [(0, 0, 1, 2), (0, 1, 1, 2), (0, 1, 2, 2), (0, 1, 2, 0)])
    def test_a_quad_that_is_a_triangle(self, read, encoding, quad):
        for faces in ([quad, (2, 3, 4, 5)], [(2, 3, 4, 5), quad], [(3, 4, 5), quad, (3, 4, 5)]):
            mesh = read(ply(encoding, vertex(), face(faces)))
            expected = [(0, 1, 2) if f is quad else f for f in faces]
            assert_is(mesh, expected, notes=("1 faces repeated a corner: the repeats were removed",))

    def test_neighbouring_faces_may_share_corners(self, read):
        faces = [(0, 1, 2), (2, 3, 0), (0, 4, 5)]
        assert_is(read(ply("binary_little_endian", vertex(), face(faces))), faces)

    def test_faces_that_vanish(self, read):
        faces = [(0, 0, 0, 0), (0, 1, 2), (0, 0, 1, 1), (1, 2, 3), (0, 1, 0), (3, 3, 3, 4, 4, 5)]
        mesh = read(ply("binary_little_endian", vertex(), face(faces)))
        assert polygons(mesh) == [(0, 1, 2), (1, 2, 3), (3, 4, 5)]
        assert mesh.notes == (
            "1 faces repeated a corner: the repeats were removed",
            "3 faces had fewer than 3 different corners: dropped",
        )

    @pytest.mark.parametrize("faces", [[()], [(0, 1)], [(0, 0, 0)], [(0, 1, 1), (2, 2, 3, 3)], [(), (0,)]])
    def test_nothing_left(self, refuse, faces):
        assert "no face has three different corners" in refuse(ply("binary_little_endian", vertex(), face(faces)))

    def test_against_a_loop(self, read):
        dice = random.Random(5)
        faces = [tuple(dice.randrange(4) for _ in range(dice.randrange(7))) for _ in range(2000)]
        faces += [(0, 1, 2)]
        expected = []
        for f in faces:
            kept = tuple(v for i, v in enumerate(f) if v != f[(i + 1) % len(f)])
            if len(kept) >= 3:
                expected.append(kept)
        assert polygons(read(ply("binary_big_endian", vertex(), face(faces)))) == expected

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("tail", [b"\n\n", b"0 1 2 3", b"\x00\x01\xff", b"the end"])
    def test_what_follows_the_data(self, read, encoding, tail):
        mesh = read(ply(encoding, vertex(), face(MIXED)) + tail)
        if encoding == "ascii" and not tail.strip():
            assert_is(mesh, MIXED)
        else:
            assert_is(mesh, MIXED, notes=("the file goes on after its data: the rest was ignored",))


class TestPrecision:
    FAR = ((10000.0, 0.0, 0.0), (10001.0, 0.0, 0.0), (10001.0, 1.0, 0.0))
    NOTE = "coordinates near 10001 m are stored as float32, 0.98 mm apart: finer shape is lost in the file itself"

    @pytest.mark.parametrize("encoding", BINARY)
    @pytest.mark.parametrize("sign", [1, -1])
    def test_far_floats_are_noted(self, read, encoding, sign):
        points = [tuple(sign * c for c in p) for p in self.FAR]
        rows = [(*p, 1, 2, 3) for p in points]
        mesh = read(ply(encoding, vertex(XYZ + RGB, rows), face([(0, 1, 2)])))
        np.testing.assert_array_equal(mesh.vertices_m, points)
        assert mesh.notes == (self.NOTE,)

    def test_threshold(self, read):
        for far_m, noted in ((1000.0, False), (1023.9, False), (1024.0, True), (2000.0, True)):
            rows = [(far_m, 0.0, 0.0, 1, 2, 3), (0.0, 0.0, 0.0, 1, 2, 3), (0.0, 1.0, 0.0, 1, 2, 3)]
            mesh = read(ply("binary_little_endian", vertex(XYZ + RGB, rows), face([(0, 1, 2)])))
            assert bool(mesh.notes) == noted

    @pytest.mark.parametrize(
        ("encoding", "kind"), [("binary_little_endian", "double"), ("ascii", "double"), ("ascii", "float")]
    )
    def test_doubles_and_decimals_are_not(self, read, encoding, kind):
        declarations = tuple(f"{kind} {axis}" for axis in "xyz") + RGB
        rows = [(x + 1 / 3, y, z, 1, 2, 3) for x, y, z in self.FAR]
        mesh = read(ply(encoding, vertex(declarations, rows), face([(0, 1, 2)])))
        np.testing.assert_array_equal(mesh.vertices_m[:, 0], [row[0] for row in rows])
        assert mesh.notes == ()

    def test_integers_are_not(self, read):
        rows = [(*(int(c) for c in p), 1, 2, 3) for p in self.FAR]
        declarations = ("int x", "int y", "int z", *RGB)
        assert read(ply("binary_little_endian", vertex(declarations, rows), face([(0, 1, 2)]))).notes == ()


class TestErrors:
    @pytest.mark.parametrize("data", [b"", b"\n", b"OFF\n3 1 0\n", b"plyx\n", b"\x89PNG\r\n\x1a\n", b"x" * 100000])
    def test_not_a_ply(self, refuse, data):
        assert refuse(data).startswith("not a PLY file; ")

    @pytest.mark.parametrize("words", ["binary 1.0", "ascii 2.0", "binary_middle_endian 1.0", "", "ascii"])
    def test_unknown_format(self, refuse, words):
        assert refuse(f"ply\nformat {words}\nend_header\n".encode()).startswith("header line 2: unknown format")

    def test_no_format(self, refuse):
        data = ply("ascii", vertex(), face(MIXED)).replace(b"format ascii 1.0\n", b"")
        assert refuse(data).startswith("header line 11: malformed: 'end_header'")

    @pytest.mark.parametrize(
        "line",
        [
            "element vertex",
            "element vertex -3",
            "element vertex 3.5",
            "element vertex 1e3",
            "element vertex ٣",
            "element vertex 1000000000000000000000000000000",
            f"element vertex {'9' * 5000}",
            "element face 1",
            "property x",
            "property float",
            "property quad x",
            "property float x y",
            "property float a",
            "property list uchar int a",
            "property list uchar vertex_indices",
            "property list float int b",
            "property list double int b",
            "property list uchar quad b",
            "property list list int b",
            "properti float x",
            "\x00\x01",
        ],
    )
    def test_malformed_line(self, refuse, line):
        head = "ply\nformat ascii 1.0\ncomment fine\nelement face 0\nproperty float a\n"
        assert refuse(f"{head}{line}\nend_header\n".encode()).startswith("header line 6: malformed: ")

    def test_property_before_any_element(self, refuse):
        assert refuse(b"ply\nformat ascii 1.0\nproperty float x\nend_header\n").startswith("header line 3: malformed")

    def test_header_without_end(self, refuse):
        data = ply("ascii", vertex(), face(MIXED)).split(b"end_header")[0]
        assert refuse(data).startswith("cut short: its header has no end_header")

    @pytest.mark.parametrize("encoding", BINARY)
    def test_truncated_vertices(self, refuse, encoding):
        header, body = ply(encoding, vertex(), face(MIXED)).split(b"end_header\n")
        message = refuse(header + b"end_header\n" + body[: 3 * 15 + 14])
        assert message.startswith("cut short: the header promises 6 x vertex, the file has room for 3; ")

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("faces", [QUADS * 3, MIXED])
    def test_truncated_faces(self, refuse, encoding, faces):
        data = ply(encoding, vertex(), face(faces))
        message = refuse(data[:-5])
        assert message.startswith(f"cut short: the header promises {len(faces)} x face, the file has room for ")
        assert f"room for {len(faces) - 1}; " in message

    def test_truncated_in_an_element_after_the_faces(self, refuse):
        edge = ("edge", ("int vertex1", "int vertex2"), [(0, 1), (1, 2)])
        message = refuse(ply("binary_little_endian", vertex(), face(MIXED), edge)[:-1])
        assert "promises 2 x edge, the file has room for 1" in message

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
    def test_coordinates_not_finite(self, refuse, encoding, value):
        points = [*POINTS[:2], (0.0, value, 0.0), POINTS[3], (value, value, 0.0), POINTS[5]]
        message = refuse(ply(encoding, vertex(XYZ, points), face(QUADS)))
        assert message.startswith("vertex 2: a coordinate is NaN or infinite, at 2 of 6 vertices")

    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("bad", [6, -1, 2147483647, -2147483648])
    @pytest.mark.parametrize("faces", [QUADS, MIXED, [(), (0, 1), (0, 1, 2)]])
    def test_index_out_of_range(self, refuse, encoding, bad, faces):
        broken = [*faces, (), (0, 1, bad), (0, bad, bad)]
        message = refuse(ply(encoding, vertex(), face(broken)))
        assert message.startswith(f"face {len(faces) + 1}: vertex index {bad} is none of the 6 vertices, 3 such in all")

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_index_beyond_int32(self, refuse, encoding):
        data = ply(encoding, vertex(), face([(0, 1, 4294967295)], ("list uchar uint vertex_indices",)))
        assert refuse(data).startswith("face 0: vertex index 4294967295 is none of the 6 vertices")

    @pytest.mark.parametrize("row", [0, 1, 2])
    def test_negative_length(self, refuse, row):
        faces = [MIXED[0]] * row + MIXED[1:]
        data = ply("binary_little_endian", vertex(), face(faces, ("list char int vertex_indices",)))
        at = data.index(b"end_header\n") + 11 + len(POINTS) * 15 + row * 17
        assert data[at] == 3
        assert refuse(data[:at] + b"\xfd" + data[at + 1 :]).startswith(f"face {row}: a list of -3 items cannot be")

    def test_no_vertices(self, refuse):
        assert refuse(ply("ascii", face([]))).startswith("holds no vertices")
        assert refuse(ply("ascii", ("vertex", XYZ, []), face(QUADS))).startswith("holds no vertices")
        assert refuse(b"ply\nformat ascii 1.0\nelement vertex 1000000000000000\nend_header\n").startswith(
            "holds no vert"
        )

    @pytest.mark.parametrize("declarations", [XYZ[:2], ("float x", "float y", "list uchar float z"), ("float X",)])
    def test_no_coordinates(self, refuse, declarations):
        rows = [(0.0, 0.0, (0.0,))[: len(declarations)]] * 3
        assert "no vertices with x, y and z" in refuse(ply("ascii", vertex(declarations, rows), face(QUADS)))

    def test_point_cloud(self, refuse):
        for data in (ply("ascii", vertex()), ply("binary_little_endian", vertex(), face([]))):
            assert refuse(data) == "holds no faces: a point cloud; mesh it first"

    @pytest.mark.parametrize("declaration", ["list uchar int corners", "list uchar float vertex_indices"])
    def test_no_index_list(self, refuse, declaration):
        data = ply("binary_little_endian", vertex(), ("face", (declaration,), [((0, 1, 2),)]))
        assert "no integer list vertex_indices" in refuse(data)

    def test_missing_file(self, tmp_path):
        with pytest.raises(InputError, match=r"none\.ply: cannot be read: No such file"):
            read_ply(tmp_path / "none.ply")

    def test_directory(self, tmp_path):
        with pytest.raises(InputError, match="cannot be read: "):
            read_ply(tmp_path)

    def test_no_permission(self, tmp_path, monkeypatch):
        def refuse_to_open(*_args, **_kwargs):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(Path, "open", refuse_to_open)
        with pytest.raises(InputError, match="cannot be read: Permission denied"):
            read_ply(tmp_path / "secret.ply")


class TestHostileHeaders:
    @pytest.mark.parametrize("encoding", ENCODINGS)
    @pytest.mark.parametrize("rows", [10**6, 10**9, 10**15, 10**18 - 1])
    @pytest.mark.parametrize("element", ["vertex", "face", "edge", "lists"])
    def test_promises_allocate_nothing(self, refuse, encoding, rows, element):
        others = [("edge", ("int a", "int b"), [(0, 1)])]
        others += [("lists", ("list uchar int a", "list uint double b"), [((1,), (2.5,))])]
        data = ply(encoding, *others, vertex(), face(MIXED))
        old = next(line for line in data.split(b"\n") if line.startswith(f"element {element} ".encode()))
        data = data.replace(old, f"element {element} {rows}".encode())
        tracemalloc.start()
        try:
            assert f"promises {rows} x {element}" in refuse(data)
            peak_bytes = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak_bytes < 10_000_000

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_rows_of_no_bytes(self, read, encoding):
        data = ply(encoding, ("ghost", (), []), vertex(), face(MIXED))
        assert_is(read(data.replace(b"element ghost 0", b"element ghost 1000000000000000")), MIXED)

    @pytest.mark.parametrize("encoding", BINARY)
    @pytest.mark.parametrize("length", ["int", "uint"])
    @pytest.mark.parametrize("index", ["char", "int", "uint"])
    @pytest.mark.parametrize("row", [0, 1])
    def test_a_huge_length(self, refuse, encoding, length, index, row):
        data = ply(encoding, vertex(), face(TRIANGLES, (f"list {length} {index} vertex_indices",)))
        face_bytes = (len(data) - data.index(b"end_header\n") - 11 - 6 * 15) // 3
        at = len(data) - (3 - row) * face_bytes
        for huge in (b"\x7f\xff\xff\xff", b"\x7f\xff\xff\x00", b"\x3f\xff\xff\xff"):
            value = huge if encoding == "binary_big_endian" else huge[::-1]
            assert f"has room for {row}; " in refuse(data[:at] + value + data[at + 4 :])


class TestDamage:
    """Whatever happened to a file, it is read or refused: no other exception, and no warning."""

    @staticmethod
    def sample(encoding, faces):
        declarations = (*XYZ, "double quality", *("float red", "float green", "float blue"), "list uchar short tags")
        rows = [(*p, 0.5, 0.25, 0.5, 0.75, (1,) * (i % 2)) for i, p in enumerate(POINTS)]
        edge = ("edge", ("int vertex1", "int vertex2"), [(0, 1), (1, 2)])
        faces = ("face", ("int object_id", "list uchar int vertex_indices"), [(3, f) for f in faces])
        return ply(encoding, vertex(declarations, rows), edge, faces)

    @pytest.mark.parametrize("faces", [QUADS, MIXED])
    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_every_truncation_is_refused(self, refuse, encoding, faces):
        data = self.sample(encoding, faces)
        # a text file that lost the end of its very last number is a whole file to any reader
        whole = len(data.rstrip()[: -len(data.split()[-1])]) if encoding == "ascii" else len(data)
        for size in range(whole):
            refuse(data[:size])

    def test_random_truncations_of_a_larger_file(self, refuse):
        dice = random.Random(6)
        faces = [tuple(dice.randrange(6) for _ in range(dice.choice((3, 4, 5)))) for _ in range(5000)]
        for encoding in BINARY:
            data = self.sample(encoding, faces)
            for _ in range(30):
                refuse(data[: dice.randrange(len(data))])

    @pytest.mark.parametrize("faces", [QUADS, MIXED])
    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_flipped_bytes(self, read, encoding, faces):
        dice = random.Random(7)
        data = self.sample(encoding, faces)
        begin = data.index(b"end_header\n") + 11
        outcomes = set()
        for round_number in range(500):
            damaged = bytearray(data)
            for _ in range(dice.choice((1, 1, 2, 8))):
                at = dice.randrange(begin if round_number % 3 else 0, len(data))
                damaged[at] = dice.randrange(256) if round_number % 2 else damaged[at] ^ (1 << dice.randrange(8))
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                try:
                    mesh = read(bytes(damaged))
                except InputError as error:
                    assert "\n" not in str(error)  # noqa: PT017
                    outcomes.add("refused")
                    continue
            outcomes.add("read")
            assert np.isfinite(mesh.vertices_m).all()
            assert mesh.rgb is None or (mesh.rgb.min() >= 0 and mesh.rgb.max() <= 1)
            assert mesh.corner_vertices.min() >= 0
            assert mesh.corner_vertices.max() < len(mesh.vertices_m)
            assert mesh.face_sizes.min() >= 3
        assert outcomes == {"read", "refused"}

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_noise_after_a_good_header(self, refuse, encoding):
        dice = random.Random(8)
        header = self.sample(encoding, MIXED).split(b"end_header\n")[0] + b"end_header\n"
        for size in (1, 10, 100, 1000, 10000):
            for _ in range(20):
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    refuse(header + dice.randbytes(size))


@pytest.mark.skipif(not REAL_ROOM.is_dir(), reason="the scanned room is not here: ../shared/data/real_room")
class TestRealRoom:
    def test_the_whole_room(self):
        mesh = read_ply(REAL_ROOM / "real_room.ply")
        data = (REAL_ROOM / "real_room.ply").read_bytes()
        begin = data.index(b"end_header\n") + 11
        assert mesh.vertices_m.shape == (377719, 3)
        assert len(mesh.face_starts) == 719524
        assert set(mesh.face_sizes.tolist()) == {3}
        assert mesh.notes == ()
        for i in (0, 1, 1234, 377718):
            x, y, z, *_, r, g, b = struct.unpack_from("<6f3B", data, begin + 27 * i)
            assert mesh.vertices_m[i].tolist() == [x, y, z]
            assert as_bytes(Mesh(mesh.vertices_m[:0], mesh.rgb[i : i + 1], *[mesh.face_starts] * 2)) == [(r, g, b)]
        for i in (0, 1, 4321, 719523):
            count, *corners = struct.unpack_from("<B3i", data, begin + 27 * 377719 + 13 * i)
            assert count == 3
            assert mesh.corner_vertices[3 * i : 3 * i + 3].tolist() == corners

    def test_the_small_rooms_are_one(self):
        text, big, quads = (read_ply(REAL_ROOM / f"real_room_{name}.ply") for name in ("ascii", "be", "quads"))
        for mesh in (text, big, quads):
            assert mesh.vertices_m.shape == (11204, 3)
            assert mesh.notes == ()
            np.testing.assert_array_equal(mesh.rgb, big.rgb)
        np.testing.assert_array_equal(big.vertices_m, quads.vertices_m)
        np.testing.assert_allclose(text.vertices_m, big.vertices_m, atol=5.1e-7, rtol=0)
        np.testing.assert_array_equal(text.corner_vertices, big.corner_vertices)
        np.testing.assert_array_equal(text.face_starts, big.face_starts)

    def test_the_quads_cover_the_triangles(self):
        big, quads = (read_ply(REAL_ROOM / f"real_room_{name}.ply") for name in ("be", "quads"))
        assert set(quads.face_sizes.tolist()) == {3, 4}
        assert int((quads.face_sizes - 2).sum()) == len(big.face_starts)

        def rim(mesh):
            """Directed edges less their opposites: the same for a quad and for the two triangles that it replaces."""
            edges = set()
            for corners in polygons(mesh):
                for edge in zip(corners, corners[1:] + corners[:1], strict=True):
                    edges ^= {edge}
            return {edge for edge in edges if edge[::-1] not in edges}

        assert rim(quads) == rim(big)


def take_apart(path):
    """What a file of write_ply holds: (header lines, rows of vertices, faces), by struct alone."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + 11
    header = data[:end].decode("ascii").splitlines()
    vertex_count = int(next(line for line in header if line.startswith("element vertex")).split()[2])
    face_count = int(next(line for line in header if line.startswith("element face")).split()[2])
    row = "<6f3B" if "property uchar red" in header else "<6f"
    length = {"uchar": "<B", "uint": "<I"}[header[-2].split()[2]]
    rows = [struct.unpack_from(row, data, end + i * struct.calcsize(row)) for i in range(vertex_count)]
    at, faces = end + vertex_count * struct.calcsize(row), []
    for _ in range(face_count):
        (size,) = struct.unpack_from(length, data, at)
        at += struct.calcsize(length)
        faces.append(struct.unpack_from(f"<{size}i", data, at))
        at += 4 * size
    assert at == len(data)
    return header, rows, faces


def make_mesh(points, faces, colours=None):
    sizes = [len(f) for f in faces]
    return Mesh(
        np.array(points, np.float64),
        None if colours is None else np.array(colours, np.float32) / np.float32(255),
        np.array([v for f in faces for v in f], np.int32),
        (np.cumsum(sizes) - sizes).astype(np.int32),
    )


class TestWrite:
    HEADER = (
        "ply",
        "format binary_little_endian 1.0",
        "element vertex 6",
        *("property float x", "property float y", "property float z"),
        *("property float nx", "property float ny", "property float nz"),
        *("property uchar red", "property uchar green", "property uchar blue"),
        "element face 5",
        "property list uchar int vertex_indices",
        "end_header",
    )

    def test_layout_of_replica(self, tmp_path):
        write_ply(tmp_path / "out.ply", make_mesh(POINTS, MIXED, BYTES))
        header, rows, faces = take_apart(tmp_path / "out.ply")
        assert header == list(self.HEADER)
        assert [row[:3] for row in rows] == POINTS
        assert [row[6:] for row in rows] == BYTES
        assert faces == MIXED

    @pytest.mark.parametrize("faces", [TRIANGLES, QUADS, MIXED])
    def test_read_back(self, tmp_path, faces):
        write_ply(tmp_path / "out.ply", make_mesh(POINTS, faces, BYTES))
        assert_is(read_ply(tmp_path / "out.ply"), faces)

    def test_without_colours(self, tmp_path):
        write_ply(tmp_path / "out.ply", make_mesh(POINTS, QUADS))
        header, rows, faces = take_apart(tmp_path / "out.ply")
        assert header == [*self.HEADER[:9], "element face 2", *self.HEADER[13:]]
        assert [row[:3] for row in rows] == POINTS
        assert faces == QUADS
        assert read_ply(tmp_path / "out.ply").rgb is None

    def test_colours_are_rounded(self, tmp_path):
        mesh = make_mesh(POINTS, QUADS, [(0.4, 0.6, 254.4), (254.6, 255.4, -3), *[(0, 0, 0)] * 4])
        write_ply(tmp_path / "out.ply", mesh)
        assert [row[6:] for row in take_apart(tmp_path / "out.ply")[1]][:2] == [(0, 1, 254), (255, 255, 0)]

    def test_triangulated(self, tmp_path):
        write_ply(tmp_path / "out.ply", make_mesh(POINTS, MIXED, BYTES), triangulate=True)
        expected = [(f[0], f[k], f[k + 1]) for f in MIXED for k in range(1, len(f) - 1)]
        header, rows, faces = take_apart(tmp_path / "out.ply")
        assert f"element face {len(expected)}" in header
        assert faces == expected
        assert [row[:3] for row in rows] == POINTS

    def test_more_corners_than_a_byte_counts(self, tmp_path):
        angles = np.linspace(0, 2 * np.pi, 300, endpoint=False)
        points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        mesh = make_mesh(points, [(0, 1, 2), tuple(range(300)), (5, 6, 7, 8)])
        write_ply(tmp_path / "out.ply", mesh)
        header, _, faces = take_apart(tmp_path / "out.ply")
        assert header[-2] == "property list uint int vertex_indices"
        assert faces == polygons(mesh)
        assert polygons(read_ply(tmp_path / "out.ply")) == faces
        write_ply(tmp_path / "out.ply", mesh, triangulate=True)
        assert take_apart(tmp_path / "out.ply")[0][-2] == "property list uchar int vertex_indices"

    @pytest.mark.parametrize("triangulate", [False, True])
    def test_vertices_alone(self, tmp_path, triangulate):
        write_ply(tmp_path / "out.ply", make_mesh(POINTS, [], BYTES), triangulate=triangulate)
        _, rows, faces = take_apart(tmp_path / "out.ply")
        assert [row[:3] for row in rows] == POINTS
        assert [row[3:6] for row in rows] == [(0, 0, 0)] * 6
        assert faces == []

    def test_given_normals(self, tmp_path):
        normals = np.arange(18).reshape(6, 3) / 8
        write_ply(tmp_path / "out.ply", make_mesh(POINTS, MIXED, BYTES), normals=normals)
        np.testing.assert_array_equal([row[3:6] for row in take_apart(tmp_path / "out.ply")[1]], normals)

    def test_normals_of_a_box_corner(self, tmp_path):
        """Three rectangles of areas 6, 10 and 15 meet at the first vertex: each weighs in by its area."""
        a, b, c = 2.0, 3.0, 5.0
        points = [(0, 0, 0), (a, 0, 0), (a, b, 0), (0, b, 0), (0, b, c), (0, 0, c), (a, 0, c), (9, 9, 9)]
        faces = [(0, 3, 2, 1), (0, 5, 4, 3), (0, 1, 6, 5)]
        write_ply(tmp_path / "out.ply", make_mesh(points, faces))
        normals = np.array([row[3:6] for row in take_apart(tmp_path / "out.ply")[1]])
        expected = -np.array([b * c, a * c, a * b])
        np.testing.assert_allclose(normals[0], expected / np.linalg.norm(expected), atol=1e-6)
        np.testing.assert_allclose(normals[2], (0, 0, -1), atol=1e-6)
        np.testing.assert_array_equal(normals[7], (0, 0, 0))

    @pytest.mark.parametrize("shift_m", [0.0, 1e6])
    def test_normals_against_a_loop(self, tmp_path, shift_m):
        numbers = np.random.default_rng(9)
        points = numbers.normal(size=(40, 3))
        faces = [tuple(numbers.choice(39, k, replace=False).tolist()) for k in (3, 4, 5, 6, 7) * 8]
        expected = np.zeros((40, 3))
        for f in faces:
            area = sum(np.cross(points[f[k]], points[f[(k + 1) % len(f)]]) for k in range(len(f)))
            for v in f:
                expected[v] += area
        lengths = np.linalg.norm(expected, axis=1)
        expected[lengths > 0] /= lengths[lengths > 0, None]
        write_ply(tmp_path / "out.ply", make_mesh(points + shift_m, faces))
        normals = [row[3:6] for row in take_apart(tmp_path / "out.ply")[1]]
        np.testing.assert_allclose(normals, expected, atol=1e-5 if shift_m == 0 else 1e-3)

    def test_read_write_read_keeps_a_replica_file(self, tmp_path, read):
        rows = [(*p, 0.0, 0.0, 1.0, *c) for p, c in zip(POINTS, BYTES, strict=True)]
        data = ply("binary_little_endian", vertex(XYZ + NORMAL + RGB, rows), face(QUADS))
        write_ply(tmp_path / "out.ply", read(data), normals=np.tile((0.0, 0.0, 1.0), (6, 1)))
        assert (tmp_path / "out.ply").read_bytes() == data


class TestAtomicWrite:
    MESH = make_mesh(POINTS, MIXED, BYTES)

    def test_replaces_and_leaves_nothing_else(self, tmp_path):
        path = tmp_path / "out.ply"
        path.write_bytes(b"old")
        write_ply(path, self.MESH)
        assert_is(read_ply(path), MIXED)
        assert list(tmp_path.iterdir()) == [path]

    def test_permissions_are_the_usual_ones(self, tmp_path):
        write_ply(tmp_path / "out.ply", self.MESH)
        (tmp_path / "plain").touch()
        assert (tmp_path / "out.ply").stat().st_mode == (tmp_path / "plain").stat().st_mode

    @pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt(), MemoryError()])
    def test_failure_keeps_the_old_file(self, tmp_path, monkeypatch, failure):
        path = tmp_path / "out.ply"
        path.write_bytes(b"old")

        def fail(*_args, **_kwargs):
            raise failure

        monkeypatch.setattr(Path, "replace", fail)
        monkeypatch.setattr("os.replace", fail)
        with pytest.raises(StorageError if isinstance(failure, OSError) else type(failure)) as caught:
            write_ply(path, self.MESH)
        if isinstance(failure, OSError):
            assert str(caught.value) == f"{path}: cannot be written: No space left on device"
        assert path.read_bytes() == b"old"
        assert list(tmp_path.iterdir()) == [path]

    def test_bad_normals_leave_nothing(self, tmp_path):
        with pytest.raises(ValueError, match="broadcast"):
            write_ply(tmp_path / "out.ply", self.MESH, normals=np.zeros((2, 3)))
        assert list(tmp_path.iterdir()) == []

    def test_no_folder(self, tmp_path):
        with pytest.raises(StorageError, match="cannot be written: No such file or directory"):
            write_ply(tmp_path / "none" / "out.ply", self.MESH)

    def test_a_folder_in_its_place(self, tmp_path):
        (tmp_path / "out.ply").mkdir()
        with pytest.raises(StorageError, match="cannot be written"):
            write_ply(tmp_path / "out.ply", self.MESH)
        assert list(tmp_path.iterdir()) == [tmp_path / "out.ply"]
