# SPDX-License-Identifier: GPL-3.0-or-later
import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.rooms.living_room import INTERIOR_MAX_M, INTERIOR_MIN_M

ADDON = Path(__file__).resolve().parents[2] / "addon"
DIGEST_IN_ANOTHER_PROCESS = """
import sys
sys.path.insert(0, sys.argv[1])
sys.path.insert(0, sys.argv[2])
from test_room import digest
from noisy_world.rooms import build_room
print(digest(build_room()))
"""


def digest(mesh: Mesh) -> str:
    parts = (mesh.vertices_m, mesh.rgb, mesh.corner_vertices, mesh.face_starts)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


@pytest.fixture(scope="module")
def other_process():
    command = [sys.executable, "-c", DIGEST_IN_ANOTHER_PROCESS, str(ADDON), str(Path(__file__).parent)]
    with subprocess.Popen(
        command, env={**os.environ, "PYTHONHASHSEED": "4711"}, stdout=subprocess.PIPE, text=True
    ) as running:
        yield running
        running.kill()


@pytest.fixture(scope="module")
def quads(room):
    return room.corner_vertices.reshape(-1, 4)


@pytest.fixture(scope="module")
def areas_m2(room, quads):
    """Half the cross product of the diagonals: the area of a flat quad."""
    a, b, c, d = (room.vertices_m[quads[:, k]] for k in range(4))
    return 0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1)


def test_a_room_built_anew_is_the_kept_one_to_the_byte(other_process, room):
    out, _ = other_process.communicate(timeout=300)
    assert out.strip() == digest(room)


def test_arrays_have_the_types_that_the_mesh_promises(room):
    assert room.vertices_m.dtype == np.float64
    assert room.rgb.dtype == np.float32
    assert room.corner_vertices.dtype == np.int32
    assert room.face_starts.dtype == np.int32
    assert room.rgb.shape == room.vertices_m.shape


def test_all_faces_are_quads(room):
    assert (room.face_sizes == 4).all()


def test_size_is_that_of_a_replica_scene(room):
    assert 400_000 <= len(room.vertices_m) <= 900_000


def test_every_vertex_is_used_and_every_index_exists(room):
    used = np.zeros(len(room.vertices_m), bool)
    assert room.corner_vertices.min() >= 0
    used[room.corner_vertices] = True
    assert used.all()


def test_no_face_is_degenerate(room, quads, areas_m2):
    assert areas_m2.min() > 1e-8
    assert (np.diff(np.sort(quads, axis=1), axis=1) > 0).all()
    for k in range(4):
        edge = room.vertices_m[quads[:, k]] - room.vertices_m[quads[:, (k + 1) % 4]]
        assert (edge**2).sum(1).min() > 0


def test_vertices_are_finite_whole_micrometres(room):
    assert np.isfinite(room.vertices_m).all()
    np.testing.assert_array_equal(room.vertices_m, room.vertices_m.round(6))


def test_colours_are_whole_255ths_and_use_the_range(room):
    assert room.rgb.min() >= 0
    assert room.rgb.max() <= 1
    steps = room.rgb.astype(np.float64) * 255
    assert abs(steps - steps.round()).max() < 1e-4
    assert np.percentile(room.rgb, 5) < 0.3
    assert np.percentile(room.rgb, 95) > 0.7


def test_interior_is_the_room_that_was_built(room):
    low, high = np.array(INTERIOR_MIN_M), np.array(INTERIOR_MAX_M)
    assert (high - low > 2.5).all()
    assert (room.vertices_m.min(0) >= low - 1.6).all()
    assert (room.vertices_m.max(0) <= high + 1.6).all()
    # Each of its six sides carries a closed surface: many vertices within 5 mm of the plane.
    for axis in range(3):
        for plane in (low[axis], high[axis]):
            assert (abs(room.vertices_m[:, axis] - plane) < 0.005).sum() > 5_000


def test_a_far_wall_lies_beyond_four_metres(room):
    low, high = np.array(INTERIOR_MIN_M), np.array(INTERIOR_MAX_M)
    wall = room.vertices_m[abs(room.vertices_m[:, 0] - high[0]) < 0.005]
    assert (wall[:, 0] - low[0]).min() > 4.0
    assert np.ptp(wall[:, 1]) > 4.5
    assert np.ptp(wall[:, 2]) > 2.4


def test_the_middle_of_the_room_is_free_at_eye_height(room):
    eye = room.vertices_m - np.array([0.0, 0.0, 1.5])
    assert np.sqrt((eye**2).sum(1)).min() > 0.6


def test_thin_parts_stand_free(room):
    """The cord of the lamp over the table is a closed ring about 1 cm wide with nothing beside it."""
    x, y, z = room.vertices_m.T
    around = (abs(x - 1.75) < 0.15) & (abs(y - 0.35) < 0.15) & (z > 1.9) & (z < 2.5)
    assert around.any()
    assert np.ptp(x[around]) < 0.02
    assert np.ptp(y[around]) < 0.02


def test_neighbouring_colours_differ_enough_for_features(room, quads, areas_m2):
    grey = room.rgb @ np.array([0.299, 0.587, 0.114], np.float32) * 255
    contrast = np.ptp(grey[quads], axis=1)
    assert np.average(contrast > 15, weights=areas_m2) > 0.2
