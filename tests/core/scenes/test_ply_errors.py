# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that are refused, each with the line that says why; none of them takes memory for what it promises."""

import itertools
import tracemalloc

from refusals import refused
from cases import cases
from ply_files import BINARY, ENCODINGS, MIXED, POINTS, QUADS, TRIANGLES, XYZ, assert_is, face, ply, vertex

from noisy_world.scenes.ply import read_ply


class TestErrors:
    @cases("data", [b"", b"\n", b"plyx\n", b"\x89PNG\r\n\x1a\n", b"x" * 100000])
    def test_not_a_ply(self, refuse, data):
        assert refuse(data).startswith("not a PLY file; ")

    @cases("words", ["binary 1.0", "ascii 2.0", "binary_middle_endian 1.0", "", "ascii"])
    def test_unknown_format(self, refuse, words):
        assert refuse(f"ply\nformat {words}\nend_header\n".encode()).startswith("header line 2: unknown format")

    def test_no_format(self, refuse):
        data = ply("ascii", vertex(), face(MIXED)).replace(b"format ascii 1.0\n", b"")
        assert refuse(data).startswith("header line 11: malformed: 'end_header'")

    @cases(
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

    @cases("encoding", BINARY)
    def test_truncated_vertices(self, refuse, encoding):
        header, body = ply(encoding, vertex(), face(MIXED)).split(b"end_header\n")
        message = refuse(header + b"end_header\n" + body[: 3 * 15 + 14])
        assert message.startswith("cut short: the header promises 6 x vertex, the file has room for 3; ")

    @cases("encoding", ENCODINGS)
    @cases("faces", [QUADS * 3, MIXED])
    def test_truncated_faces(self, refuse, encoding, faces):
        data = ply(encoding, vertex(), face(faces))
        message = refuse(data[:-5])
        assert message.startswith(f"cut short: the header promises {len(faces)} x face, the file has room for ")
        assert f"room for {len(faces) - 1}; " in message

    def test_truncated_in_an_element_after_the_faces(self, refuse):
        edge = ("edge", ("int vertex1", "int vertex2"), [(0, 1), (1, 2)])
        message = refuse(ply("binary_little_endian", vertex(), face(MIXED), edge)[:-1])
        assert "promises 2 x edge, the file has room for 1" in message

    @cases("encoding", ENCODINGS)
    @cases("value", [float("nan"), float("inf"), float("-inf")])
    def test_coordinates_not_finite(self, refuse, encoding, value):
        points = [*POINTS[:2], (0.0, value, 0.0), POINTS[3], (value, value, 0.0), POINTS[5]]
        message = refuse(ply(encoding, vertex(XYZ, points), face(QUADS)))
        assert message.startswith("vertex 2: a coordinate is NaN or infinite, at 2 of 6 vertices")

    @cases("encoding", ENCODINGS)
    def test_a_coordinate_beyond_float32(self, refuse, encoding):
        points = [*POINTS[:4], (0.0, 0.0, -1e39), (1e300, 0.0, 0.0)]
        data = ply(encoding, vertex(("double x", "double y", "double z"), points), face(QUADS))
        assert refuse(data).startswith("vertex 4: a coordinate is too large for float32; ")

    @cases("encoding", ENCODINGS)
    @cases("faces", [QUADS, MIXED, [(), (0, 1), (0, 1, 2)]])
    def test_index_out_of_range(self, refuse, encoding, faces):
        for bad in (6, -1, 2147483647, -2147483648):
            message = refuse(ply(encoding, vertex(), face([*faces, (), (0, 1, bad), (0, bad, bad)])))
            where = f"face {len(faces) + 1}"
            assert message.startswith(f"{where}: vertex index {bad} is none of the 6 vertices, 3 such in all")

    @cases("encoding", ENCODINGS)
    def test_index_beyond_int32(self, refuse, encoding):
        data = ply(encoding, vertex(), face([(0, 1, 4294967295)], ("list uchar uint vertex_indices",)))
        assert refuse(data).startswith("face 0: vertex index 4294967295 is none of the 6 vertices")

    @cases("row", [0, 1, 2])
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

    @cases("declarations", [XYZ[:2], ("float x", "float y", "list uchar float z"), ("float X",)])
    def test_no_coordinates(self, refuse, declarations):
        rows = [(0.0, 0.0, (0.0,))[: len(declarations)]] * 3
        assert "no vertices with x, y and z" in refuse(ply("ascii", vertex(declarations, rows), face(QUADS)))

    def test_point_cloud(self, refuse):
        for data in (ply("ascii", vertex()), ply("binary_little_endian", vertex(), face([]))):
            assert refuse(data) == "holds no faces: a point cloud; mesh it first"

    @cases("declaration", ["list uchar int corners", "list uchar float vertex_indices"])
    def test_no_index_list(self, refuse, declaration):
        data = ply("binary_little_endian", vertex(), ("face", (declaration,), [((0, 1, 2),)]))
        assert "no integer list vertex_indices" in refuse(data)

    def test_no_file_no_permission(self, tmp_path, monkeypatch):
        refused(read_ply, tmp_path / "none.ply", names=("none.ply: ", "No such file"))
        refused(read_ply, tmp_path, names=f"{tmp_path}: cannot be read: ")

        def refuse_to_open(*_args, **_kwargs):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr("os.open", refuse_to_open)
        refused(read_ply, tmp_path / "secret.ply", names=("secret.ply: ", "Permission denied"))


class TestHostileHeaders:
    @cases("encoding", ENCODINGS)
    @cases("element", ["vertex", "face", "edge", "lists"])
    def test_promises_allocate_nothing(self, refuse, encoding, element):
        others = [("edge", ("int a", "int b"), [(0, 1)])]
        others += [("lists", ("list uchar int a", "list uint double b"), [((1,), (2.5,))])]
        data = ply(encoding, *others, vertex(), face(MIXED))
        old = next(line for line in data.split(b"\n") if line.startswith(f"element {element} ".encode()))
        for rows in (10**6, 10**9, 10**15, 10**18 - 1):
            promise = data.replace(old, f"element {element} {rows}".encode())
            tracemalloc.start()
            try:
                assert f"promises {rows} x {element}" in refuse(promise)
                peak_bytes = tracemalloc.get_traced_memory()[1]
            finally:
                tracemalloc.stop()
            assert peak_bytes < 10_000_000

    @cases("encoding", ENCODINGS)
    def test_rows_of_no_bytes(self, read, encoding):
        data = ply(encoding, ("ghost", (), []), vertex(), face(MIXED))
        assert_is(read(data.replace(b"element ghost 0", b"element ghost 1000000000000000")), MIXED)

    @cases("encoding", BINARY)
    @cases("length", ["int", "uint"])
    @cases("index", ["char", "int", "uint"])
    def test_a_huge_length(self, refuse, encoding, length, index):
        data = ply(encoding, vertex(), face(TRIANGLES, (f"list {length} {index} vertex_indices",)))
        face_bytes = (len(data) - data.index(b"end_header\n") - 11 - 6 * 15) // 3
        hugest = (b"\x7f\xff\xff\xff", b"\x7f\xff\xff\x00", b"\x3f\xff\xff\xff")
        for row, huge in itertools.product((0, 1), hugest):
            at = len(data) - (3 - row) * face_bytes
            value = huge if encoding == "binary_big_endian" else huge[::-1]
            assert f"has room for {row}; " in refuse(data[:at] + value + data[at + 4 :])
