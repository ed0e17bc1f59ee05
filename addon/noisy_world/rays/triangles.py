# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces as triangles, split as Blender splits them for rendering.

A flat face has one shape however it is split. But colours are interpolated within a triangle, and a face that is not
flat is another surface when it is split along another diagonal. So the rules are Blender's (bke::mesh::corner_tris), in
float32 as there: a quad along the diagonal from its first corner, unless that lies outside it; larger faces by cutting
off ears.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.scenes.mesh import Mesh
from .ear_clipping import clip_ears, turn

Points: TypeAlias = NDArray[np.float32]

AT_ONCE = 500_000  # triangles whose normals are calculated together; chosen: 100 MB

_IN_TWO = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
_ACROSS = np.array([[0, 1, 3], [1, 2, 3]], dtype=np.int32)  # where the diagonal from the first corner lies outside


def triangle_corners(mesh: Mesh, vertices_m: Points) -> NDArray[np.int32]:
    """Return the corners (T, 3) int32 of the mesh's triangles, as places in its corner_vertices, in the faces' order.

    vertices_m: (V, 3) float32, the vertices as they are rendered.
    """
    sizes = mesh.face_sizes
    starts = np.asarray(mesh.face_starts, dtype=np.int32)
    first_triangle = starts - 2 * np.arange(len(starts), dtype=np.int32)  # a face of n corners has n - 2 triangles
    corners = np.empty((len(mesh.corner_vertices) - 2 * len(starts), 3), dtype=np.int32)
    for size in np.unique(sizes).tolist():
        faces = np.flatnonzero(sizes == size)
        places = starts[faces, None] + np.arange(size, dtype=np.int32)
        local = _split(vertices_m, mesh.corner_vertices[places])
        rows = first_triangle[faces, None] + np.arange(size - 2, dtype=np.int32)
        corners[rows] = starts[faces, None, None] + local
    return corners


def triangle_faces(mesh: Mesh) -> NDArray[np.int32]:
    """Return the face (T,) int32 of each triangle."""
    return np.repeat(np.arange(len(mesh.face_starts), dtype=np.int32), mesh.face_sizes - 2)


def triangle_normals(mesh: Mesh, corners: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the normals (T, 3) float32 of triangles, of unit length; zero of those without an area.

    corners: (T, 3), as `triangle_corners` returns them. In float64, from the mesh's own vertices.
    """
    normals = np.zeros((len(corners), 3), dtype=np.float32)
    for start in range(0, len(corners), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        first, second, third = (mesh.vertices_m[mesh.corner_vertices[corners[part, corner]]] for corner in range(3))
        across = np.cross(second - first, third - first)
        length = np.linalg.norm(across, axis=1, keepdims=True)
        np.divide(across, length, out=normals[part], where=length > 0, casting="same_kind")
    return normals


def _split(vertices_m: Points, faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Split faces of the same size (F, n), given by their vertices; return triangles (F, n - 2, 3) of 0 to n - 1."""
    count, size = faces.shape
    if size == 3:
        return np.broadcast_to(np.arange(3, dtype=np.int32), (count, 1, 3))
    if size == 4:
        first, second, third, fourth = (vertices_m[faces[:, corner]] for corner in range(4))
        across = third - first
        one_side = np.cross(second - first, across), np.cross(fourth - first, across)
        outside = np.sum(one_side[0] * one_side[1], axis=1) > 0
        return np.where(outside[:, None, None], _ACROSS, _IN_TWO)
    points = _flattened(vertices_m[faces])
    before, at, after = ((part[..., 0], part[..., 1]) for part in (np.roll(points, turned, 1) for turned in (1, 0, -1)))
    convex = (turn(before, at, after) > 0).all(axis=1)
    split = np.empty((count, size - 2, 3), dtype=np.int32)
    if convex.any():
        split[convex] = clip_ears(_regular(size))  # the ears of convex faces depend on nothing but their number
    for face in np.flatnonzero(~convex).tolist():
        split[face] = clip_ears(points[face])
    return split


def _flattened(points_m: Points) -> Points:
    """Project faces (F, n, 3) along their normals; return (F, n, 2), seen from behind."""
    before = np.roll(points_m, 1, axis=1)
    difference, total = before - points_m, before + points_m
    normal = np.zeros_like(points_m[:, 0])
    for corner in range(points_m.shape[1]):  # Newell's, summed in Blender's order
        normal += difference[:, corner, [1, 2, 0]] * total[:, corner, [2, 0, 1]]
    length = np.sqrt(_dot(normal, normal))[:, None]
    x, y, z = np.where(length > 0, -normal / np.where(length > 0, length, 1), np.array([0, 0, -1], np.float32)).T
    slant = x * x + y * y
    upright, nothing = slant <= np.finfo(np.float32).eps, np.zeros_like(x)
    scale = 1 / np.sqrt(np.where(upright, 1, slant))
    right = np.stack([np.where(upright, np.where(z < 0, -1, 1), y * scale), np.where(upright, 0, -x * scale), nothing])
    up = np.where(upright, [[0], [1], [0]], [-z * right[1], z * right[0], x * right[1] - y * right[0]])
    axes = [axis.astype(np.float32).T[:, None] for axis in (right, up)]
    return np.stack([_dot(points_m, axis) for axis in axes], axis=-1)


def _dot(first: Points, second: Points) -> Points:
    """Return the products of vectors (..., 3), summed from the first component on."""
    product = first * second
    return np.add(product[..., 0] + product[..., 1], product[..., 2], dtype=np.float32)


def _regular(size: int) -> NDArray[np.float32]:
    """Return the corners (size, 2) of a regular face, in the order of `_flattened`."""
    angle = -np.linspace(0, 2 * np.pi, size, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1).astype(np.float32)
