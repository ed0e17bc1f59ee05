# SPDX-License-Identifier: GPL-3.0-or-later
"""The numbers of text files: every form, every place, and the words that are none."""

import numpy as np
from cases import cases
from ply_files import MIXED, QUADS, TRIANGLES, XYZ, assert_is, face, ply, polygons, vertex


class TestText:
    def coordinates(self, read, words):
        """The numbers that the reader makes of words in a text file."""
        words = [*words, *["0"] * (-len(words) % 3)]
        lines = [" ".join(words[i : i + 3]) for i in range(0, len(words), 3)]
        header = ply("ascii", ("vertex", ("double x", "double y", "double z"), []), face([])).decode()
        header = header.replace("vertex 0", f"vertex {len(lines)}").replace("face 0", "face 1")
        return read((header + "\n".join([*lines, "3 0 1 2\n"])).encode()).vertices_m.ravel()

    def test_number_forms(self, read):
        words = """
            0 -0 +1 1. .5 -.5 +.5 5.e2 1e5 1E5 1e+05 1e-05 -1.5e-07 000.5 0.1 123456789012345 12345678901234567
            9007199254740993 9007199254740991e22 0.30000000000000004 1.7976931348623157e38 2.2250738585072014e-308
            4.9e-324 1e22 1e23 -1e-22 99999999999999999999 -9223372036854775808 0.000000000000000000000000001
            123456.789012345e-30 8.5e15 1e0005 1.4725505404367673
        """
        for word in words.split():
            got = self.coordinates(read, [word, "7.25", "-3"] * 3)
            np.testing.assert_array_equal(got, [float(word), 7.25, -3.0] * 3, err_msg=word)

    @cases("form", ["%.6f", "%.3f", "%g", "%.9g", "%.17g", "%.18e", "%d", "%.1e", "%.20f"])
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
        points = numbers.normal(size=(12000, 3)).round(5)
        points[11000, 1] = 1 / 3  # a number that the fast conversion leaves to the general one, in the second of three
        faces = [tuple(f) for f in (np.arange(11990)[:, None] + [0, 1, 2, 3]).tolist()]
        mesh = read(ply("ascii", vertex(XYZ, points.tolist()), face(faces)))
        np.testing.assert_array_equal(mesh.vertices_m, points)
        np.testing.assert_array_equal(mesh.corner_vertices.reshape(-1, 4), faces)

    def test_a_missing_last_line_end_is_noted(self, read):
        mesh = read(ply("ascii", vertex(), face(MIXED)).rstrip())
        assert polygons(mesh) == MIXED
        assert len(mesh.notes) == 1
        assert "no line end" in mesh.notes[0]

    @cases(
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
    def test_garbage_is_named(self, refuse, word):
        self.refused(refuse, word, 1)

    @cases("place", [0, 3000, 16000])  # the last lies in the second block
    def test_garbage_names_its_line(self, refuse, place):
        self.refused(refuse, "1.5.2", place)

    @staticmethod
    def refused(refuse, word, place):
        points = [(float(i), 0.125, 2.5) for i in range(place + 10)]
        lines = ply("ascii", vertex(XYZ, points), face([(0, 1, 2)])).decode().split("\n")
        first = lines.index("end_header") + 1
        lines[first + place] = f"{place} {word} 0.5"
        message = refuse("\n".join(lines).encode())
        assert message.startswith(f"line {first + place + 1}: '{word}' is not a number")

    @cases("junk", [b"\x00", b"\xff\xfe", b"\x1c", b"1\x002", "½".encode()])
    def test_binary_garbage(self, refuse, junk):
        data = ply("ascii", vertex(), face(MIXED)).replace(b"\n0.5 0.5", b"\n" + junk + b" 0.5")
        assert "is not a number" in refuse(data)

    @cases("length", ["3.5", "nan", "inf", "1e300", "-1", "-inf"])
    @cases("row", [0, 1])
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
