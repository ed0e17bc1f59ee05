# SPDX-License-Identifier: GPL-3.0-or-later
"""The hand-held path in meshes that no scanner makes: it ends, with a path that keeps clear or with one line."""

import hashlib
import time
import warnings

import numpy as np
import pytest
from cases import cases
from odd_meshes import KINDS, odd_mesh
from refusals import refused

from noisy_world.core.errors import NoisyWorldError
from noisy_world.rooms import kept_room
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.trajectories.handheld import _route, _steps_from, handheld_path
from noisy_world.trajectories.room_map import Grid, faces_of, largest_part

# Of 500 that were tried: one of each kind; six of them did not end in half a minute before maps were bounded.
SEEDS = (7, 17, 18, 19, 29, 51, 58, 111, 113)
UNBOUNDED = np.array([[-np.inf] * 2, [np.inf] * 2])


def triangles(corners_m):
    corners_m = np.asarray(corners_m, dtype=np.float64)
    indices = np.arange(3 * len(corners_m), dtype=np.int32)
    return Mesh(corners_m.reshape(-1, 3), None, indices, indices[::3].copy())


@pytest.fixture(scope="module")
def embedded_room():
    return kept_room()


@pytest.mark.one_python
@pytest.mark.parametrize("seed", SEEDS)
def test_every_mesh_ends(seed):
    mesh = odd_mesh(seed)
    began_s = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        said, at_m = "", None
        try:
            at_m = handheld_path(mesh, seed=seed, frames=200).c2w[:, :3, 3]
        except NoisyWorldError as error:
            said = str(error)
    if at_m is None:
        assert said.startswith("no hand-held path: ")
        assert len(said.splitlines()) == 1
        assert len(said) < 300
    else:
        nearest_m = min(np.linalg.norm(mesh.vertices_m - here, axis=1).min() for here in at_m[::10])
        assert nearest_m >= 0.45 - 1e-3
    assert time.process_time() - began_s < 10.0


def test_the_meshes_are_of_every_kind():
    assert {seed % len(KINDS) for seed in SEEDS} == set(range(len(KINDS)))


@cases(
    ("seed", "frames", "rate_hz", "sha256"),
    [
        (5, 40, 4.0, "e913142f1d4185628d91db442d0034eaa8cd9b3705bd8a0d80d975cc1783e8dc"),
        (7, 40, 4.0, "56e796c746e4aa9c582f7cb8d9b9c001f254479cfbda5bf17d9d69ea0e23016e"),
    ],
)
def test_the_embedded_rooms_paths_stay(embedded_room, seed, frames, rate_hz, sha256):
    """As version 0.1.0 made them, to a nanometre: the presets' images rest on them."""
    c2w = handheld_path(embedded_room, seed=seed, frames=frames, rate_hz=rate_hz).c2w
    assert hashlib.sha256(np.round(c2w * 1e9).astype("<i8").tobytes()).hexdigest() == sha256


def flooded(mask, start):
    """The cells that are joined with one by their sides, cell by cell."""
    found, rest = {start}, [start]
    while rest:
        x, y = rest.pop()
        for cell in ((x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)):
            inside = min(cell) >= 0 and cell[0] < mask.shape[0] and cell[1] < mask.shape[1]
            if inside and mask[cell] and cell not in found:
                found.add(cell)
                rest.append(cell)
    return found


@cases("share", [0.0, 0.3, 0.55, 0.62, 0.8, 1.0])
@cases("shape", [(1, 1), (1, 30), (25, 1), (30, 40)])
def test_the_largest_part_against_a_flood(share, shape):
    mask = np.random.default_rng([int(share * 100), *shape]).random(shape) < share
    part = largest_part(mask)
    cells = set(zip(*map(np.ndarray.tolist, np.nonzero(part)), strict=True))
    rest, sizes = mask.copy(), [0]
    while rest.any():
        one = flooded(rest, tuple(int(i) for i in np.argwhere(rest)[0]))
        sizes.append(len(one))
        rest[tuple(np.array(sorted(one)).T)] = False
    assert len(cells) == max(sizes)
    assert not cells or flooded(mask, min(cells)) == cells


def test_a_way_leads_between_all_cells_of_a_part():
    """Where cells touched only by their corners, a way found from one end was not found from the other."""
    rng = np.random.default_rng(0)
    for _ in range(40):
        mask = np.pad(rng.random((20, 20)) < rng.uniform(0.5, 0.8), 2)
        part = largest_part(mask)
        cells = np.flatnonzero(part)
        start, goal = (int(cell) for cell in rng.choice(cells, 2))
        assert (_steps_from(part, start).ravel()[cells] >= 0).all()
        way = _route(Grid(np.zeros(2), part.shape, 0.05), part, start, goal)
        assert (way[0], way[-1]) == (start, goal)
        assert part.ravel()[way].all()


@cases("size_m", [0.05, 0.13, 0.25])
def test_points_cover_faces_as_finely_as_asked(size_m):
    rng = np.random.default_rng(1)
    soup = rng.uniform(-1.5, 1.5, (6, 3, 3))
    ends = rng.uniform(-100, 100, (2, 2, 3))
    needles = np.concatenate([ends, ends[:, :1] * 0.7 + ends[:, 1:] * 0.3 + 1e-4], axis=1)
    for corners_m in (soup, needles):
        faces = faces_of(triangles(corners_m), UNBOUNDED, 0.05)
        points_m = faces.points_m(size_m)
        assert len(points_m) < 2.5 * faces.pieces(size_m)
        weights = rng.dirichlet(np.ones(3), 12)
        for corner_m in corners_m:
            for on_face_m in weights @ corner_m:
                assert np.linalg.norm(points_m - on_face_m, axis=1).min() < 0.6 * size_m


@pytest.mark.one_python
def test_a_large_hall_gets_larger_cells():
    """60 m x 50 m with shelves: more than a map of 5 cm holds, and still kept clear of."""
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    boxes = [((0, 0, 0), (60, 50, 4)), *(((x, 5, 0), (x + 1, 45, 3)) for x in range(5, 55, 5))]
    corners = [[[x, y, z] for x in (a[0], b[0]) for y in (a[1], b[1]) for z in (a[2], b[2])] for a, b in boxes]
    faces = np.concatenate([quads + 8 * i for i in range(len(boxes))]).astype(np.int32)
    hall = Mesh(
        np.reshape(corners, (-1, 3)).astype(float), None, faces.ravel(), np.arange(len(faces), dtype=np.int32) * 4
    )
    at_m = handheld_path(hall, seed=0, frames=4000).c2w[:, :3, 3]
    for low, high in np.array(boxes[1:], dtype=float):
        outside_m = np.maximum(np.maximum(low - at_m, at_m - high), 0.0)
        assert np.linalg.norm(outside_m, axis=1).min() >= 0.45
    assert (np.minimum(at_m, np.array([60, 50, 4]) - at_m).min(axis=0) >= 0.45).all()
    assert np.ptp(at_m[:, :2], axis=0).max() > 10.0


def test_a_mesh_too_far_from_the_origin_is_refused(embedded_room):
    room = embedded_room
    far = Mesh(room.vertices_m + np.array([1e15, 0.0, 0.0]), None, room.corner_vertices, room.face_starts)
    refused(handheld_path, far, seed=0, frames=10, names="reaches 1e+15 m from the origin", error=NoisyWorldError)
    for wrong in (np.nan, np.inf, 1e300):
        vertices_m = room.vertices_m.copy()
        vertices_m[7, 1] = wrong
        odd = Mesh(vertices_m, None, room.corner_vertices, room.face_starts)
        refused(handheld_path, odd, seed=0, frames=10, names="from the origin", error=NoisyWorldError)


@pytest.mark.one_python
def test_a_tower_is_refused_at_once(embedded_room):
    """Faces of 1e7 m2: cut into pieces of 5 cm they would take hours."""
    room = embedded_room
    tower = Mesh(room.vertices_m * [1.0, 1.0, 1e6], None, room.corner_vertices, room.face_starts)
    refused(handheld_path, tower, seed=0, frames=10, names="check its metres", error=NoisyWorldError)
