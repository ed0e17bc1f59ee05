# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours of faces: each corner has that of its face, whatever becomes of the file's other corners and faces."""

import numpy as np
from refusals import refused
from cases import cases
from ply_files import BYTES, ENCODINGS, INDICES, MIXED, POINTS, QUADS, RGB, XYZ, as_bytes, ply, polygons, vertex


FACE_BYTES = [(9, 8, 7), (255, 0, 128), (1, 2, 3), (250, 251, 252), (64, 32, 16)]


def faces_of(faces, colours, declarations=RGB):
    return "face", (*INDICES, *declarations), [(f, *c) for f, c in zip(faces, colours, strict=False)]


def bare_vertices(points=POINTS):
    return vertex(XYZ, list(points))


def corner_bytes(mesh):
    """The colours of each face's corners, as bytes."""
    rounded = np.rint(mesh.corner_rgb * 255).astype(int)
    ends = np.cumsum(mesh.face_sizes)
    return [
        [tuple(c) for c in rounded[end - size : end].tolist()] for end, size in zip(ends, mesh.face_sizes, strict=True)
    ]


@cases("encoding", ENCODINGS)
@cases("faces", [QUADS, MIXED])
def test_each_corner_has_the_colour_of_its_face(read, encoding, faces):
    mesh = read(ply(encoding, bare_vertices(), faces_of(faces, FACE_BYTES)))
    assert mesh.rgb is None
    assert mesh.texture is None
    assert mesh.corner_rgb.dtype == np.float32
    assert polygons(mesh) == faces
    assert corner_bytes(mesh) == [[c] * len(f) for f, c in zip(faces, FACE_BYTES, strict=False)]
    assert mesh.notes == ()


@cases("encoding", ENCODINGS)
def test_alpha_other_properties_and_their_order(read, encoding):
    declarations = (
        "uchar alpha",
        "uchar blue",
        "list uchar int vertex_index",
        "float quality",
        "uchar red",
        "uchar green",
    )
    rows = [(7, c[2], f, 0.5, c[0], c[1]) for f, c in zip(MIXED, FACE_BYTES, strict=True)]
    mesh = read(ply(encoding, bare_vertices(), ("face", declarations, rows)))
    assert corner_bytes(mesh) == [[c] * len(f) for f, c in zip(MIXED, FACE_BYTES, strict=True)]


@cases("encoding", ENCODINGS)
@cases("kind", ["float", "double"])
def test_floats(read, encoding, kind):
    colours = [(0.0, 0.25, 1.0), (1.0, 0.5, 0.125)]
    mesh = read(ply(encoding, bare_vertices(), faces_of(QUADS, colours, tuple(f"{kind} {c}" for c in ("r", "g", "b")))))
    np.testing.assert_allclose(mesh.corner_rgb, np.repeat(colours, 4, axis=0), atol=1e-7)


def test_every_byte(read):
    colours = [(i, 255 - i, (i * 37) % 256) for i in range(256)]
    mesh = read(ply("binary_little_endian", bare_vertices(), faces_of([(0, 1, 2)] * 256, colours)))
    assert [corners[0] for corners in corner_bytes(mesh)] == colours


@cases("encoding", ENCODINGS)
def test_corners_and_faces_that_go_take_their_colours_along(read, encoding):
    faces = [(0, 1), (0, 1, 1, 2), (3, 3, 3), (2, 3, 4, 5), ()]
    mesh = read(ply(encoding, bare_vertices(), faces_of(faces, FACE_BYTES)))
    assert polygons(mesh) == [(0, 1, 2), (2, 3, 4, 5)]
    assert corner_bytes(mesh) == [[FACE_BYTES[1]] * 3, [FACE_BYTES[3]] * 4]


@cases("encoding", ENCODINGS)
def test_colours_of_vertices_come_first(read, encoding):
    mesh = read(ply(encoding, vertex(), faces_of(QUADS, FACE_BYTES)))
    assert as_bytes(mesh) == BYTES
    assert mesh.corner_rgb is None
    assert mesh.notes == ("the colours of its vertices are shown, and not those of its faces",)


def test_two_channels_are_no_colour(read):
    mesh = read(ply("ascii", bare_vertices(), faces_of(QUADS, [(1, 2), (3, 4)], RGB[:2])))
    assert mesh.corner_rgb is None
    assert mesh.notes == ("no colours: shown in neutral grey",)


def test_colours_of_corners_are_left_out_and_said(read):
    rows = [((0, 1, 2), (0.5,) * 9)]
    mesh = read(ply("ascii", bare_vertices(), ("face", (*INDICES, "list uchar float color"), rows)))
    assert "its faces' lists color, of colours of corners, are left out" in mesh.notes


@cases("encoding", ENCODINGS)
@cases("value", [float("nan"), float("inf")])
def test_not_finite(read, encoding, value):
    colours = [(0.5, 0.5, 0.5), (0.5, value, 0.5)]
    data = ply(encoding, bare_vertices(), faces_of(QUADS, colours, ("float red", "float green", "float blue")))
    refused(read, data, names=("face 1: ", "at 1 of 2 faces"))


def test_out_of_range(refuse):
    colours = [(0.5, 0.5, 0.5), (0.5, -3.0, 0.5)]
    data = ply("ascii", bare_vertices(), faces_of(QUADS, colours, ("float red", "float green", "float blue")))
    assert "colours lie between -3 and 0.5" in refuse(data)
