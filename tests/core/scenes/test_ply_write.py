# SPDX-License-Identifier: GPL-3.0-or-later
"""Files written, taken apart by struct alone; and a file that is whole or not there."""

import struct
from pathlib import Path

import numpy as np
import pytest
from refusals import refused
from cases import cases
from ply_files import BYTES, MIXED, NORMAL, POINTS, QUADS, RGB, TRIANGLES, XYZ, assert_is, face, ply, polygons, vertex

from noisy_world.core.errors import StorageError
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.scenes.ply import read_ply
from noisy_world.scenes.ply_writer import write_ply


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

    @cases("faces", [TRIANGLES, QUADS, MIXED])
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

    @cases("triangulate", [False, True])
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

    @cases("shift_m", [0.0, 1e6])
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

    @cases("failure", [OSError(28, "No space left on device"), KeyboardInterrupt(), MemoryError()])
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
        refused(
            write_ply, tmp_path / "out.ply", self.MESH, normals=np.zeros((2, 3)), names="broadcast", error=ValueError
        )
        assert list(tmp_path.iterdir()) == []

    def test_no_folder(self, tmp_path):
        path = tmp_path / "none" / "out.ply"
        refused(write_ply, path, self.MESH, names=(str(path), "No such file"), error=StorageError)

    def test_a_folder_in_its_place(self, tmp_path):
        (tmp_path / "out.ply").mkdir()
        refused(write_ply, tmp_path / "out.ply", self.MESH, names="cannot be written", error=StorageError)
        assert list(tmp_path.iterdir()) == [tmp_path / "out.ply"]


class TestColoursOfCorners:
    def test_a_vertex_is_split_where_its_faces_differ(self, tmp_path):
        # two triangles of one colour and one of another around the edge 0 2
        faces = np.array([0, 1, 2, 0, 2, 3, 0, 3, 4], np.int32)
        colours = np.array([[10, 20, 30], [10, 20, 30], [200, 0, 255]])
        points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 0, 1]])
        corner_rgb = (np.repeat(colours, 3, axis=0) / 255).astype(np.float32)
        mesh = Mesh(points, None, faces, np.array([0, 3, 6], np.int32), corner_rgb=corner_rgb)
        write_ply(tmp_path / "out.ply", mesh)
        read = read_ply(tmp_path / "out.ply")
        assert len(read.vertices_m) == 7  # of five, 0 and 3 have two colours
        np.testing.assert_array_equal(read.vertices_m[read.corner_vertices], points[faces])
        shown = np.rint(read.rgb[read.corner_vertices] * 255).astype(int)
        np.testing.assert_array_equal(shown, np.repeat(colours, 3, axis=0))

    def test_split_vertices_keep_their_normals(self, tmp_path):
        points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        corner_rgb = np.repeat([[0.0, 0, 0], [1, 1, 1]], 3, axis=0).astype(np.float32)
        mesh = Mesh(
            points, None, np.array([0, 1, 2, 0, 2, 3], np.int32), np.array([0, 3], np.int32), corner_rgb=corner_rgb
        )
        write_ply(tmp_path / "out.ply", mesh)
        data = (tmp_path / "out.ply").read_bytes()
        rows = np.frombuffer(data.split(b"end_header\n")[1][: 6 * 27], np.dtype([("v", "<f4", 6), ("c", "u1", 3)]))
        np.testing.assert_array_equal(rows["v"][:, 3:], [[0, 0, 1]] * 6)
