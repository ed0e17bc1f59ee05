# SPDX-License-Identifier: GPL-3.0-or-later
"""Which map a run has."""

from dataclasses import dataclass

import numpy as np
from seen_shapes import CAMERA, View, looking, sphere_view, wall

from noisy_world.evaluate.estimates import Estimate
from noisy_world.evaluate.pose_errors import IDENTITY, Similarity
from noisy_world.evaluate.run_maps import fuse_along, map_of_run
from noisy_world.scenes.ply_writer import write_ply


@dataclass(frozen=True)
class StampedView(View):
    """A frame with a time."""

    stamp_s: float


def _frames(poses):
    views = [sphere_view(c2w, 0.5) for c2w in poses]
    return [StampedView(view.rgb, view.depth_m, view.c2w, 0.1 * k) for k, view in enumerate(views)]


POSES = np.array([looking((2, 0, 0)), looking((0, 2, 0)), looking((0, 0, 2)), looking((-2, 0, 0))])
STAMPS_S = 0.1 * np.arange(4)


def test_only_frames_with_a_pose_are_fused_and_stamps_say_which():
    kept = np.array([0, 2])
    fused = fuse_along(Estimate(STAMPS_S[kept] + 0.004, POSES[kept]), _frames(POSES), CAMERA)
    assert fused.frames == 2
    assert fused.mesh is not None
    assert (fused.mesh.vertices_m[:, [0, 2]].max(axis=1) > -0.05).all()  # seen from +x and from +z alone
    assert np.abs(np.linalg.norm(fused.mesh.vertices_m, axis=1) - 0.5).max() < 0.03


def test_a_path_of_another_scale_is_fused_at_the_frames_own():
    by = Similarity(np.eye(3), np.zeros(3), 4.0)
    small = POSES.copy()
    small[:, :3, 3] /= 4
    fused = fuse_along(Estimate(STAMPS_S, small), _frames(POSES), CAMERA, by=by)
    assert fused.mesh is not None
    assert np.abs(np.linalg.norm(fused.mesh.vertices_m, axis=1) - 0.5).max() < 0.03


def test_a_run_s_map_is_its_own_or_fused_or_none(tmp_path):
    estimate, frames = Estimate(STAMPS_S, POSES), _frames(POSES)
    assert map_of_run(tmp_path, estimate, IDENTITY, frames, CAMERA).origin == "fused"
    failed = map_of_run(tmp_path, estimate, None, frames, CAMERA)
    assert (failed.mesh, failed.origin) == (None, "")
    assert failed.problem
    write_ply(tmp_path / "map.ply", wall(1.0))
    own = map_of_run(tmp_path, estimate, Similarity(np.eye(3), np.array([0, 0, 5.0]), 2.0), frames, CAMERA)
    assert own.origin == "system"
    assert own.mesh is not None
    assert own.mesh.vertices_m.min(axis=0).tolist() == [2, -2, 3]
    (tmp_path / "map.ply").write_bytes(b"ply\nnot one")
    broken = map_of_run(tmp_path, estimate, IDENTITY, frames, CAMERA)
    assert broken.mesh is None
    assert "map.ply" in broken.problem
