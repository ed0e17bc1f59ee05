# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY files of every dialect: encodings, types, orders and company; and the scanned room."""

import struct
from pathlib import Path

import numpy as np
import pytest
from cases import cases
from ply_files import (
    BINARY,
    BYTES,
    CODES,
    ENCODINGS,
    INDICES,
    MIXED,
    NORMAL,
    POINTS,
    QUADS,
    RGB,
    TRIANGLES,
    XYZ,
    as_bytes,
    assert_is,
    face,
    ply,
    polygons,
    vertex,
)

from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.scenes.ply import read_ply

REAL_ROOM = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "real_room"


class TestFormats:
    @cases("encoding", ENCODINGS)
    @cases("faces", [TRIANGLES, QUADS, MIXED, [(0, 1, 2)], [tuple(range(6))]])
    def test_encoding_and_face_sizes(self, read, encoding, faces):
        assert_is(read(ply(encoding, vertex(), face(faces))), faces)

    @cases("encoding", ENCODINGS)
    @cases("length", ["char", "uchar", "short", "ushort", "int", "uint", "int8", "uint16", "int32"])
    def test_list_types(self, read, encoding, length):
        widths, others = ("char", "ushort", "int"), ("uchar", "short", "uint", "uint8", "int16", "uint32")
        for index in widths + others * (length == "uchar"):
            for faces in (QUADS, MIXED):
                data = ply(encoding, vertex(), face(faces, (f"list {length} {index} vertex_indices",)))
                assert_is(read(data), faces)

    @cases("encoding", ENCODINGS)
    @cases("name", ["vertex_indices", "vertex_index"])
    def test_index_name(self, read, encoding, name):
        assert_is(read(ply(encoding, vertex(), face(MIXED, (f"list uchar int {name}",)))), MIXED)

    @cases("encoding", ENCODINGS)
    @cases("kind", CODES)
    def test_every_type_name_as_coordinate(self, read, encoding, kind):
        points = [(0, 1, 2), (3, 4, 5), (6, 7, 127)]
        mesh = read(ply(encoding, vertex([f"{kind} {axis}" for axis in "xyz"], points), face([(0, 1, 2)])))
        np.testing.assert_array_equal(mesh.vertices_m, points)

    @cases("encoding", ENCODINGS)
    def test_doubles_keep_every_bit(self, read, encoding):
        numbers = np.random.default_rng(1)
        points = (numbers.normal(size=(500, 3)) * 10.0 ** numbers.integers(-12, 12, (500, 3))).tolist()
        mesh = read(ply(encoding, vertex(("double x", "double y", "double z"), points), face([(0, 1, 2)])))
        np.testing.assert_array_equal(mesh.vertices_m, points)

    @cases("encoding", BINARY)
    def test_floats_keep_every_bit(self, read, encoding):
        points = np.random.default_rng(2).normal(size=(500, 3)).astype(np.float32)
        mesh = read(ply(encoding, vertex(XYZ, points.tolist()), face([(0, 1, 2)])))
        np.testing.assert_array_equal(mesh.vertices_m, points.astype(np.float64))

    @cases("encoding", ENCODINGS)
    def test_crlf_header_comments_and_obj_info(self, read, encoding):
        extra = ["comment made by hand", "comment", "obj_info num_cols 512", "comment élan", "comment element vertex 9"]
        assert_is(read(ply(encoding, vertex(), face(MIXED), end="\r\n", extra=extra)), MIXED)

    def test_crlf_text_body(self, read):
        data = ply("ascii", vertex(), face(MIXED)).replace(b"\n", b"\r\n")
        assert_is(read(data), MIXED)

    @cases("order", ["<", ">"])
    def test_first_byte_of_the_data_may_be_a_line_feed(self, read, order):
        encoding = {"<": BINARY[0], ">": BINARY[1]}[order]
        number = struct.unpack(order + "f", b"\n\r\n\n")[0]
        points = [(number, 0.0, 0.0), *POINTS[1:]]
        mesh = read(ply(encoding, vertex(XYZ, points), face(QUADS)))
        assert mesh.vertices_m[0, 0] == number

    @cases("encoding", ENCODINGS)
    def test_faces_before_vertices(self, read, encoding):
        assert_is(read(ply(encoding, face(MIXED), vertex())), MIXED)

    @cases("encoding", ENCODINGS)
    @cases("faces", [QUADS, MIXED])
    def test_normals_alpha_and_other_scalars_are_skipped(self, read, encoding, faces):
        declarations = ("uchar flags", *XYZ, *NORMAL, *RGB, "uchar alpha", "double quality")
        rows = [(9, *p, 0.5, 0.25, -1.0, *c, 0, 1e300) for p, c in zip(POINTS, BYTES, strict=True)]
        assert_is(read(ply(encoding, vertex(declarations, rows), face(faces))), faces)

    @cases("encoding", ENCODINGS)
    @cases("uneven", [False, True])
    def test_lists_of_vertices_are_skipped(self, read, encoding, uneven):
        declarations = ("list uchar short before", *XYZ, "list int double between", *RGB, "list ushort char after")
        rows = []
        for i, (point, colour) in enumerate(zip(POINTS, BYTES, strict=True)):
            k = i if uneven else 2
            rows.append(((7,) * (k % 3), *point, (0.5,) * (k % 2), *colour, (-1,) * k))
        assert_is(read(ply(encoding, vertex(declarations, rows), face(MIXED))), MIXED)

    @cases("encoding", ENCODINGS)
    @cases("faces", [QUADS, MIXED])
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
        note = "it has texture coordinates, but no line 'comment TextureFile NAME': they are left out"
        assert_is(read(ply(encoding, vertex(), ("face", declarations, rows))), faces, notes=(note,))

    @cases("encoding", ENCODINGS)
    @cases("faces", [QUADS, MIXED])
    def test_object_id_as_habitat_writes_it(self, read, encoding, faces):
        for declarations in (("int object_id", *INDICES), (*INDICES, "int object_id")):
            rows = [(41, f) if declarations[0] == "int object_id" else (f, 41) for f in faces]
            assert_is(read(ply(encoding, vertex(), ("face", declarations, rows))), faces)

    @cases("encoding", ENCODINGS)
    @cases("places", [(0, 1, 2, 3), (2, 0, 3, 1), (3, 1, 2, 0), (1, 3, 0, 2)])
    def test_other_elements_anywhere(self, read, encoding, places):
        edge = ("edge", ("int vertex1", "int vertex2", "uchar red"), [(0, 1, 9), (1, 2, 8)])
        strips = ("camera", ("float view_px", "list int float frame"), [(1.5, (1.0, 2.0)), (2.5, ()), (3.5, (4.0,))])
        elements = [vertex(), face(MIXED), edge, strips]
        assert_is(read(ply(encoding, *(elements[i] for i in places))), MIXED)

    @cases("encoding", ENCODINGS)
    def test_empty_elements(self, read, encoding):
        empty = [("edge", ("int a", "list uchar int b"), []), ("nothing", (), [])]
        assert_is(read(ply(encoding, empty[0], vertex(), empty[1], face(MIXED))), MIXED)

    @cases("encoding", ENCODINGS)
    def test_the_mesh_owns_its_arrays(self, read, encoding):
        mesh = read(ply(encoding, vertex(), face(MIXED)))
        for array in (mesh.vertices_m, mesh.rgb, mesh.corner_vertices, mesh.face_starts):
            assert array.flags.owndata
            assert array.flags.writeable
            assert array.flags.c_contiguous


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
