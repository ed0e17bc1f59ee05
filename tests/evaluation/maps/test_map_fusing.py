# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps fused of depth images in closed form."""

import numpy as np
import pytest
from refusals import refused
from seen_shapes import CAMERA, around, looking, sphere_view

from noisy_world.evaluate.map_fusion import ColourVolume, fuse

RADIUS_M = 0.5


def _sphere(centre_m=(0.0, 0.0, 0.0), **options):
    poses = around(1.5, centre_m)
    return fuse([sphere_view(c2w, RADIUS_M, centre_m) for c2w in poses], poses, CAMERA, **options)


def test_a_sphere_is_closed_and_in_its_place():
    fused = _sphere(voxel_m=0.03)
    mesh = fused.mesh
    quads = mesh.corner_vertices.reshape(-1, 4)
    edges = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
    each, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    assert (count == 2).all()  # closed
    assert len(mesh.vertices_m) - len(each) + len(quads) == 2  # Euler: a sphere
    radii = np.linalg.norm(mesh.vertices_m, axis=1)
    assert abs(radii.mean() - RADIUS_M) < 0.003
    assert abs(radii - RADIUS_M).max() < 0.015  # half a voxel
    a, b, c, d = mesh.vertices_m[quads].transpose(1, 0, 2)
    assert (np.einsum("ni,ni->n", np.cross(c - a, d - b), a + b + c + d) > 0).all()  # they face outwards
    expected = (127.5 + 100 * mesh.vertices_m / radii[:, None]) / 255
    assert abs(mesh.rgb - expected).mean() < 0.02


def test_it_is_the_same_far_from_the_origin():
    far_m = np.array([1e5, -2e4, 300.0])
    near, far = _sphere(voxel_m=0.0625).mesh, _sphere(far_m, voxel_m=0.0625).mesh  # a power of two: the same voxels
    assert len(near.vertices_m) == len(far.vertices_m)
    assert np.abs(far.vertices_m - far_m - near.vertices_m).max() < 1e-4


def test_memory_is_bounded_and_voxels_double():
    fine, bounded = _sphere(voxel_m=0.02), _sphere(voxel_m=0.02, most_blocks=40)
    assert bounded.voxel_m in {0.04, 0.08}
    assert len(bounded.mesh.vertices_m) < len(fine.mesh.vertices_m) / 3
    radii = np.linalg.norm(bounded.mesh.vertices_m, axis=1)
    assert abs(radii.mean() - RADIUS_M) < bounded.voxel_m / 4


def test_even_one_frame_can_be_too_much():
    view = sphere_view(looking((0, 0, 0), (1, 0, 0)), 5.0)
    fused = fuse([view], [view.c2w], CAMERA, voxel_m=0.001, most_blocks=30)
    assert fused.voxel_m > 0.1
    assert fused.mesh is not None


def test_frames_without_a_pose_are_not_read():
    view = sphere_view(looking((2, 0, 0)), RADIUS_M)
    fused = fuse([view, object()], [view.c2w, None], CAMERA)
    assert fused.frames == 1
    assert fused.mesh is not None


def test_a_pose_that_is_kilometres_away_is_left_out():
    view = sphere_view(looking((2, 0, 0)), RADIUS_M)
    for wrong_m in (1e5, 1e30):
        wild = view.c2w.copy()
        wild[0, 3] += wrong_m
        fused = fuse([view, view], [view.c2w, wild], CAMERA)
        assert (fused.frames, fused.excluded) == (1, 1)
        assert np.abs(fused.mesh.vertices_m).max() < 1


def test_nothing_seen_is_no_mesh():
    view = sphere_view(looking((2, 0, 0), (4, 0, 0)), RADIUS_M)
    assert not view.depth_m.any()
    assert fuse([view], [view.c2w], CAMERA).mesh is None
    assert fuse([], [], CAMERA).mesh is None
    far = sphere_view(looking((2, 0, 0)), RADIUS_M)
    assert fuse([far], [far.c2w], CAMERA, far_m=1.0).mesh is None


def test_depth_that_is_no_number_is_void():
    view = sphere_view(looking((2, 0, 0)), RADIUS_M)
    odd = view.depth_m.copy()
    odd[view.depth_m == 0] = np.nan
    odd[0, 0] = np.inf
    volume = ColourVolume(CAMERA)
    volume.integrate(odd, view.c2w)
    points_m = volume.surface().vertices_m
    assert volume.surface().rgb is None
    assert np.isfinite(points_m).all()


def test_the_same_frames_give_the_same_bytes():
    one, other = _sphere(voxel_m=0.05).mesh, _sphere(voxel_m=0.05).mesh
    for name in ("vertices_m", "rgb", "corner_vertices", "face_starts"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


@pytest.mark.parametrize("voxel_m", [0.0, -1.0, np.nan])
def test_a_voxel_has_a_size(voxel_m):
    refused(ColourVolume, CAMERA, voxel_m, names="positive", error=ValueError)


def test_frames_have_the_size_of_the_camera():
    refused(ColourVolume(CAMERA).integrate, np.ones((4, 4), np.float32), np.eye(4), names="camera", error=ValueError)
