# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded rooms: each is well formed, unlike the others, and walked through by a path that comes back."""

import sys

import numpy as np
import pytest

from noisy_world.scenes.polygon_mesh import EMBEDDED_ROOM, ROOMS, is_embedded, room_mesh, room_name, room_seeds
from noisy_world import rooms
from noisy_world.rooms import build_room, kept_room
from noisy_world.trajectories.handheld import handheld_path

FRAMES = 2000
# Of the living room before there were other rooms: sums of coordinates, mean colour, and a sum over the corners in
# their order. No hash: sines differ in the last digits between processors.
LIVING_ROOM_SUMS_M = [-130351.50981679952, 181412.03527659358, 921433.4435983131]
LIVING_ROOM_RGB = [0.48985472321510315, 0.44260507822036743, 0.3550059199333191]
LIVING_ROOM_CORNERS = 1566236656532
# Corners of each plan, clockwise as seen from above, in metres: as the table in docs/rooms.md has them.
PLANS = {
    1: [(-2.2, 2.0), (2.2, 2.0), (2.2, -2.0), (-2.2, -2.0)],
    2: [(-3.6, 3.1), (3.6, 3.1), (3.6, -0.2), (0.4, -0.2), (0.4, -3.1), (-3.6, -3.1)],
    3: [(-4.5, 0.95), (1.6, 0.95), (1.6, 2.85), (4.5, 2.85), (4.5, -0.95), (-4.5, -0.95)],
    4: [
        *((-4.3, 2.1), (-0.1, 2.1), (-0.1, 0.35), (0.1, 0.35), (0.1, 2.1), (3.9, 2.1)),
        *((3.9, -2.1), (0.1, -2.1), (0.1, -1.15), (-0.1, -1.15), (-0.1, -2.1), (-4.3, -2.1)),
    ],
    5: [(-4.5, 3.5), (4.5, 3.5), (4.5, -3.5), (-4.5, -3.5)],
    6: [(-2.2, 2.0), (2.2, 2.0), (2.2, -2.0), (-2.2, -2.0)],
    7: [(-3.2, 3.1), (3.2, 3.1), (3.2, -1.5), (2.6, -1.5), (2.6, -3.1), (-0.2, -3.1), (-0.2, -1.5), (-3.2, -1.5)],
}


@pytest.fixture(scope="module", params=sorted(PLANS))
def seed(request):
    return request.param


@pytest.fixture(scope="module")
def room(seed):
    return kept_room(seed)


@pytest.fixture(scope="module")
def path(room):
    return handheld_path(room, seed=1, frames=FRAMES)


def inside(plan, xy_m):
    """Whether points (N, 2) are inside of a polygon: an odd number of its edges lies to their right."""
    crossed = np.zeros(len(xy_m), int)
    for (x0, y0), (x1, y1) in zip(plan, [*plan[1:], plan[0]], strict=True):
        if x0 == x1:
            crossed += (xy_m[:, 0] < x0) & (xy_m[:, 1] >= min(y0, y1)) & (xy_m[:, 1] < max(y0, y1))
    return crossed % 2 == 1


def test_living_room_is_as_it_was():
    room = kept_room()
    assert room.vertices_m.shape == (873_341, 3)
    np.testing.assert_allclose(room.vertices_m.sum(axis=0), LIVING_ROOM_SUMS_M, rtol=0, atol=1e-6)
    np.testing.assert_allclose(room.rgb.mean(axis=0), LIVING_ROOM_RGB, rtol=0, atol=1e-5)
    corners = room.corner_vertices.astype(np.int64)
    assert (corners * np.arange(1, len(corners) + 1) % 1_000_003).sum() == LIVING_ROOM_CORNERS


def test_mesh_is_well_formed(room):
    quads = room.corner_vertices.reshape(-1, 4)
    a, b, c, d = (room.vertices_m[quads[:, k]] for k in range(4))
    used = np.zeros(len(room.vertices_m), bool)
    used[quads] = True
    assert used.all()
    assert (room.face_sizes == 4).all()
    assert 0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1).min() > 1e-9
    np.testing.assert_array_equal(room.vertices_m, room.vertices_m.round(6))
    steps = room.rgb.astype(np.float64) * 255
    assert abs(steps - steps.round()).max() < 1e-4
    assert steps.min() >= 0
    assert steps.max() <= 255


def test_size_is_that_of_a_replica_scene(room):
    assert 500_000 <= len(room.vertices_m) <= 1_200_000


def test_walls_floor_and_ceiling_are_those_of_the_plan(room, seed):
    """A point every 30 cm of each wall, the floor and the ceiling has the surface, or a thing that hides it, near."""
    plan = PLANS[seed]
    low, high = np.min(plan, axis=0), np.max(plan, axis=0)
    x, y = np.meshgrid(np.arange(low[0] + 0.1, high[0], 0.3), np.arange(low[1] + 0.1, high[1], 0.3))
    xy = np.column_stack([x.ravel(), y.ravel()])
    xy = xy[inside(plan, xy)]
    height_m = {1: 2.5, 2: 2.8, 3: 2.9, 4: 2.7, 5: 3.0, 6: 2.75, 7: 2.9}[seed]
    for z in (0.0, height_m):
        level = room.vertices_m[abs(room.vertices_m[:, 2] - z) < 0.06, :2]
        cells = {tuple(cell) for cell in np.floor(level / 0.1).astype(int)}
        wanted = [tuple(cell) for cell in np.floor(xy / 0.1).astype(int)]
        covered = [
            cell in cells or (cell[0] + 1, cell[1]) in cells or (cell[0], cell[1] + 1) in cells for cell in wanted
        ]
        assert all(covered)


def test_path_stays_in_the_plan_and_away_from_everything(room, seed, path):
    plan, eye_m = PLANS[seed], path.c2w[:, :3, 3]
    assert inside(plan, eye_m[:, :2]).all()
    near = room.vertices_m[abs(room.vertices_m[:, 2] - eye_m[0, 2]) < 0.7]
    for position in eye_m[::50]:
        assert np.linalg.norm(near - position, axis=1).min() > 0.45


def test_path_comes_back_to_where_it_was(path):
    """At least a fifth of the frames after 20 s see again what a frame 20 s or more before saw."""
    eye_m, ahead = path.c2w[:, :3, 3], path.c2w[:, :3, 2]
    again = 0
    for k in range(400, FRAMES, 10):
        near = np.linalg.norm(eye_m[: k - 400] - eye_m[k], axis=1) < 0.4
        again += bool((near & (ahead[: k - 400] @ ahead[k] > np.cos(np.deg2rad(30)))).any())
    assert again > 0.2 * len(range(400, FRAMES, 10))


def test_path_reaches_every_part(seed, path):
    x, y, _ = path.c2w[:, :3, 3].T
    if seed == 2:  # both arms of the L
        assert ((x > 0.4) & (y > -0.2)).any()
        assert (y < -1.0).any()
    if seed == 3:  # the far end of the corridor, and the hall
        assert (x < -2.5).any()
        assert (y > 0.95).any()
    if seed == 4:  # through the doorway and back, more than once
        assert (np.diff(np.sign(x)) != 0).sum() >= 4
        assert x.min() < -1.5
        assert x.max() > 1.5
    if seed == 5:  # the aisle between the islands, to the windows
        assert (y > 1.4).any()
        assert (y < -1.6).any()
    assert np.linalg.norm(np.diff(path.c2w[:, :3, 3], axis=0), axis=1).sum() > 25.0


def test_names_stand_for_rooms():
    assert room_seeds(EMBEDDED_ROOM) == room_seeds("embedded:room?seed=0") == [0]
    assert room_seeds("embedded:room?seed=3") == [3]
    assert room_seeds("embedded:room?seed=*") == list(range(ROOMS))
    assert room_seeds("embedded:room?seed=[1-3]") == [1, 2, 3]
    assert [room_mesh(k) for k in (0, 5)] == ["embedded:room", "embedded:room?seed=5"]
    assert [room_name("embedded:room", 0), room_name("embedded:room?seed=0", 0)] == ["room", "room0"]
    assert is_embedded("embedded:hall")
    assert not is_embedded("room.ply")
    assert not is_embedded(None)


@pytest.mark.parametrize(
    "mesh",
    ["embedded:hall", "embedded:room?seed=8", "embedded:room?seed=", "embedded:room?sed=1", "embedded:room?seed=-1"],
)
def test_a_room_that_is_not_there_is_an_error(mesh):
    with pytest.raises(ValueError, match="there is no 'embedded:"):
        room_seeds(mesh)


def test_another_seed_is_an_error():
    with pytest.raises(ValueError, match="0 to 7"):
        build_room(8)


@pytest.fixture
def drawn(tmp_path, monkeypatch):
    """How often a room was drawn, which here is one sheet, beside an empty folder of caches."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    count = []

    def draw(seed):
        count.append(seed)
        square = np.array([[0, 0, 0], [1_000_000, 0, 0], [0, 1, 0], [1, 1, 333_333]], np.int32)
        codes, shapes = np.arange(12, dtype=np.uint8).reshape(4, 3) * 20, np.array([[2, 2]], np.int32)
        return rooms._Drawn(square, codes, shapes, np.array([1], np.int32), np.array([2], np.int32))

    monkeypatch.setattr(rooms, "_draw", draw)
    return count


def kept_files(folder):
    return list((folder / "noisy-world").glob("*.npz"))


def test_a_room_is_drawn_once_and_read_as_it_was(drawn, tmp_path):
    meshes = [kept_room(3), kept_room(3), build_room(3)]
    assert drawn == [3, 3]
    for mesh in meshes:
        assert mesh.vertices_m.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1e-6, 0], [1e-6, 1e-6, 0.333333]]
        assert np.array_equal(mesh.rgb, (np.arange(12).reshape(4, 3) * 20 / 255).astype(np.float32))
        assert mesh.corner_vertices.tolist() == [0, 1, 3, 2]
        assert [part.dtype for part in (mesh.vertices_m, mesh.rgb, mesh.corner_vertices)] == ["f8", "f4", "i4"]


def test_a_room_whose_code_changed_is_drawn_anew_in_the_place_of_the_old_one(drawn, tmp_path, monkeypatch):
    for digest in ("a", "b"):
        monkeypatch.setattr(rooms, "_digest", lambda digest=digest: digest)
        kept_room(3)
    assert drawn == [3, 3]
    assert [file.name for file in kept_files(tmp_path)] == ["room3-b.npz"]


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "other"])
def test_a_damaged_file_is_drawn_anew(drawn, tmp_path, damage):
    kept_room(3)
    (file,) = kept_files(tmp_path)
    whole = file.read_bytes()
    at = whole.index(np.int32(333_333).tobytes())
    flipped = whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]
    file.write_bytes({"cut": whole[: len(whole) // 2], "flipped": flipped, "empty": b"", "other": b"no zip"}[damage])
    assert kept_room(3).vertices_m[3, 2] == 0.333333
    assert drawn == [3, 3]
    assert file.read_bytes() == whole


@pytest.mark.skipif(sys.platform == "win32", reason="folders are made so by its umask")
def test_a_folder_of_caches_that_others_could_write_into_is_not_used(drawn, tmp_path):
    (tmp_path / "noisy-world").mkdir(mode=0o700)
    (tmp_path / "noisy-world").chmod(0o777)
    kept_room(3)
    kept_room(3)
    assert drawn == [3, 3]
    assert not kept_files(tmp_path)
