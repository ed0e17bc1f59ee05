# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces split into triangles: nothing is lost or covered twice, and the diagonal is the one inside."""

import numpy as np
from ray_tools import polygons

from noisy_world.render.triangles import triangle_corners, triangle_faces


def split(faces):
    mesh = polygons([np.column_stack([face, np.zeros(len(face))]) for face in faces])
    corners = triangle_corners(mesh, mesh.vertices_m.astype(np.float32))
    return mesh, corners, triangle_faces(mesh)


def area(points):
    """The area of an outline (n, 2), by the shoelace formula."""
    x, y = np.asarray(points, float).T
    return (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def test_quads_are_split_from_their_first_corner_unless_that_is_outside():
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    dart = [(0, 0), (2, 2), (0, 1), (-2, 2)]  # bends inwards at its third corner, seen from the first
    turned = dart[1:] + dart[:1]
    _, corners, _ = split([square, dart, turned])
    assert (corners - [[0], [0], [4], [4], [8], [8]]).tolist() == [
        [0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3],
    ]  # fmt: skip


def test_triangles_cover_each_face_once():
    rng = np.random.default_rng(1)
    faces = []
    for _ in range(300):
        count = int(rng.integers(3, 30))
        angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
        radius = 1.0 if rng.random() < 0.3 else rng.uniform(0.1, 1, count)  # every star has a view of its middle
        faces.append(np.column_stack([np.cos(angle), np.sin(angle)]) * np.reshape(radius, (-1, 1)))
    mesh, corners, owners = split(faces)
    assert len(corners) == sum(len(face) - 2 for face in faces)
    points = mesh.vertices_m[mesh.corner_vertices[corners], :2]
    areas = np.array([area(triangle) for triangle in points])
    assert (areas > -1e-6).all()  # none is turned over, so none covers another
    sums = np.bincount(owners, areas, minlength=len(faces))
    assert np.allclose(sums, [area(face) for face in faces], rtol=1e-5, atol=1e-6)


def test_a_comb_of_a_thousand_corners():
    teeth = [(k, 10.0 * (k % 2) + 1) for k in range(1000)]
    outline = [(999.0, 0.0), *((float(x), y) for x, y in reversed(teeth)), (0.0, 0.0)]
    mesh, corners, _ = split([outline])
    points = mesh.vertices_m[mesh.corner_vertices[corners], :2]
    areas = np.array([area(triangle) for triangle in points])
    assert (areas > -1e-6).all()
    assert np.isclose(areas.sum(), area(outline))
