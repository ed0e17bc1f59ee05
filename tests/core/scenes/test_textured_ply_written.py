# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh with textures is written so that it reads back: pictures, coordinates of corners, faces without a picture."""

import numpy as np
import pytest

from noisy_world.core.errors import StorageError
from noisy_world.scenes.polygon_mesh import Mesh, Texture
from noisy_world.scenes.ply import read_ply
from noisy_world.scenes.ply_writer import write_textured_ply


def textured(rng):
    """A quad with the first picture, a triangle with the second and one with colours alone."""
    pictures = tuple(rng.integers(0, 256, (4, 6, 3), dtype=np.uint8) for _ in range(2))
    uv = rng.random((10, 2)).astype(np.float32)
    texture = Texture(("a.png", "b.png"), pictures, uv, np.array([0, 1, -1], np.int32))
    return Mesh(
        vertices_m=rng.random((6, 3)).astype(np.float32).astype(np.float64),
        rgb=(rng.integers(0, 256, (6, 3)) / 255).astype(np.float32),
        corner_vertices=np.array([0, 1, 2, 3, 2, 3, 4, 3, 4, 5], np.int32),
        face_starts=np.array([0, 4, 7], np.int32),
        texture=texture,
    )


def test_it_reads_back(tmp_path):
    mesh = textured(np.random.default_rng(2))
    written = write_textured_ply(tmp_path / "room.ply", mesh, mesh.texture)
    assert [path.name for path in written] == ["room_0.png", "room_1.png"]
    found = read_ply(tmp_path / "room.ply")
    assert np.array_equal(found.vertices_m, mesh.vertices_m)
    assert np.array_equal(found.corner_vertices, mesh.corner_vertices)
    assert found.face_starts.tolist() == [0, 4, 7]
    assert found.texture.face_pictures.tolist() == [0, 1, -1]
    assert np.array_equal(found.texture.corner_uv[:7], mesh.texture.corner_uv[:7])
    assert all(np.array_equal(a, b) for a, b in zip(found.texture.pictures, mesh.texture.pictures, strict=True))


def test_polygons_become_triangles(tmp_path):
    mesh = textured(np.random.default_rng(3))
    write_textured_ply(tmp_path / "room.ply", mesh, mesh.texture, triangulate=True)
    found = read_ply(tmp_path / "room.ply")
    assert found.corner_vertices.reshape(-1, 3).tolist() == [[0, 1, 2], [0, 2, 3], [2, 3, 4], [3, 4, 5]]
    assert found.texture.face_pictures.tolist() == [0, 0, 1, -1]


def test_a_folder_that_is_not_there_is_one_line(tmp_path):
    mesh = textured(np.random.default_rng(4))
    with pytest.raises(StorageError):
        write_textured_ply(tmp_path / "nowhere" / "room.ply", mesh, mesh.texture)
