# SPDX-License-Identifier: GPL-3.0-or-later
"""What a mesh is read in spite of, and the notes that say so."""

import random

import numpy as np
from cases import cases
from ply_files import BINARY, ENCODINGS, MIXED, RGB, XYZ, assert_is, face, ply, polygons, vertex


class TestRepairs:
    @cases("encoding", ENCODINGS)
    def test_small_faces_are_dropped(self, read, encoding):
        faces = [(), (0, 1, 2), (3,), (0, 1), (2, 3, 4, 5), ()]
        note = "4 faces had fewer than 3 different corners: dropped"
        assert_is(read(ply(encoding, vertex(), face(faces))), [(0, 1, 2), (2, 3, 4, 5)], notes=(note,))

    @cases("encoding", ENCODINGS)
    @cases("quad", [(0, 0, 1, 2), (0, 1, 1, 2), (0, 1, 2, 2), (0, 1, 2, 0)])
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

    @cases("faces", [[()], [(0, 1)], [(0, 0, 0)], [(0, 1, 1), (2, 2, 3, 3)], [(), (0,)]])
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

    @cases("encoding", ENCODINGS)
    @cases("tail", [b"\n\n", b"0 1 2 3", b"\x00\x01\xff", b"the end"])
    def test_what_follows_the_data(self, read, encoding, tail):
        mesh = read(ply(encoding, vertex(), face(MIXED)) + tail)
        if encoding == "ascii" and not tail.strip():
            assert_is(mesh, MIXED)
        else:
            assert_is(mesh, MIXED, notes=("the file goes on after its data: the rest was ignored",))


class TestPrecision:
    FAR = ((10000.0, 0.0, 0.0), (10001.0, 0.0, 0.0), (10001.0, 1.0, 0.0))
    NOTE = "coordinates near 10001 m are stored as float32, 0.98 mm apart: finer shape is lost in the file itself"

    @cases("encoding", BINARY)
    @cases("sign", [1, -1])
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

    @cases(("encoding", "kind"), [("binary_little_endian", "double"), ("ascii", "double"), ("ascii", "float")])
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
