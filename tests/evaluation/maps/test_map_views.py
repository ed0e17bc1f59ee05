# SPDX-License-Identifier: GPL-3.0-or-later
"""What true cameras see of maps: culling and renders, in closed forms."""

import math

import numpy as np
import pytest

pytest.importorskip("scipy")
pytest.importorskip("embreex")

from seen_shapes import CAMERA, View, around, looking, sphere_view, together, wall

from noisy_world.evaluate.map_metrics import MAP_METRICS, score_map
from noisy_world.evaluate.true_maps import Culling, RecordedViews, Seen, true_map_of_mesh, true_map_of_recording

AHEAD = looking((0, 0, 0), (1, 0, 0))
SAMPLES = 2000


def _truth(mesh, culling=Culling.FRUSTUM_OCCLUSION, poses=(AHEAD,)):
    return true_map_of_mesh(mesh, CAMERA, np.array(poses), culling=culling, samples=SAMPLES)


def test_a_wall_moved_by_a_centimetre_is_so_in_depth():
    with _truth(wall(2.0, width_m=8, rgb=(90, 90, 90))) as truth:
        values = score_map(wall(2.01, width_m=8, rgb=(100, 100, 100)), truth).values
    assert values["depth_l1_m"] == pytest.approx(0.01, abs=1e-6)
    assert values["depth_share"] == 1.0
    assert values["psnr_db"] == pytest.approx(20 * math.log10(25.5), abs=1e-6)
    assert values["ssim"] == pytest.approx((2 * 9000 + 6.5025) / (8100 + 10000 + 6.5025), abs=1e-4)  # no variance
    assert values["lpips"] is None
    assert list(values) == list(MAP_METRICS)
    assert values["accuracy_m"] == pytest.approx(0.01, abs=1e-9)


def test_what_the_map_lacks_is_said_and_depth_is_of_the_rest():
    half = wall(2.0, width_m=8)
    half.vertices_m[:, 1] = np.maximum(half.vertices_m[:, 1], 0)
    with _truth(wall(2.0, width_m=8)) as truth:
        values = score_map(half, truth).values
    assert values["depth_share"] == 0.5
    assert values["depth_l1_m"] == pytest.approx(0, abs=1e-6)
    assert values["psnr_db"] is None  # without colours


def test_what_a_wall_hides_is_culled():
    front, back = wall(2.0, width_m=8), wall(3.0, width_m=8)
    seen_area = (64 / 60 * 2) * (48 / 60 * 2)
    with _truth(together(front, back)) as truth:
        assert truth.part.share == pytest.approx(seen_area / 128, rel=0.3)
        assert (truth.points_m[:, 0] == 2.0).all()
    with _truth(together(front, back), Culling.FRUSTUM) as truth:
        assert (truth.points_m[:, 0] == 2.0).all()  # no deeper than the camera sees
    with _truth(together(front, back), Culling.NONE) as truth:
        assert truth.part.share == 1.0
        assert (truth.points_m[:, 0] == 3.0).mean() == pytest.approx(0.5, abs=0.05)


def test_the_frustum_alone_keeps_what_is_hidden():
    beside = together(wall(2.0, width_m=1), wall(3.0, width_m=8))  # the far wall is seen beside the near one
    shares = {}
    for culling in (Culling.FRUSTUM, Culling.FRUSTUM_OCCLUSION):
        with _truth(beside, culling) as truth:
            far = truth.points_m[truth.points_m[:, 0] == 3.0]
            shares[culling] = (np.abs(far[:, 1:]).max(axis=1) < 0.7).mean()  # in the shadow of 1.5 m
    assert shares[Culling.FRUSTUM] > 0.1
    assert shares[Culling.FRUSTUM_OCCLUSION] == 0


def test_a_floater_before_the_wall_counts_and_one_behind_it_does_not():
    true = wall(2.0, width_m=8)
    with _truth(true) as truth:
        before = score_map(together(true, wall(1.0, width_m=0.5)), truth, renders=False).values
        behind = score_map(together(true, wall(2.5, width_m=0.5)), truth, renders=False).values
    assert before["accuracy_m"] > 0.02
    assert behind["accuracy_m"] < 1e-9


def test_points_behind_the_camera_are_not_seen():
    with _truth(wall(2.0, width_m=8)) as truth:
        points_m = np.array([(1.0, 0, 0), (-1.0, 0, 0), (0.0, 0, 0), (2.05, 0, 0), (2.2, 0, 0), (1e30, 0, 0)])
        assert truth.seen.covers(points_m, 0.1).tolist() == [True, False, False, True, False, False]


def test_far_cameras_are_looked_at_first_and_none_is_left_out():
    poses = around(1.5)
    views = [sphere_view(c2w, 0.5) for c2w in poses]
    seen = Seen(RecordedViews(views, CAMERA), Culling.FRUSTUM_OCCLUSION)
    assert seen.view_count == 26
    directions = np.array([c2w[:3, 3] / 1.5 for c2w in poses])
    assert seen.covers(0.5 * directions, 0.02).all()
    assert not seen.covers(0.3 * directions, 0.02).any()


def test_a_recording_is_its_own_truth():
    poses = around(1.5)
    frames = [sphere_view(c2w, 0.5) for c2w in poses]
    with true_map_of_recording(frames, CAMERA, voxel_m=0.03, samples=SAMPLES) as truth:
        score = score_map(wall(0.0, width_m=0.01), truth)
    assert score.truth == "fused"
    assert score.values["depth_share"] == 0  # inside of the sphere: unseen
    radii = np.linalg.norm(truth.points_m, axis=1)
    assert abs(radii.mean() - 0.5) < 0.004


def test_a_recording_that_sees_nothing_has_no_truth():
    blind = View(np.zeros((48, 64, 3), np.uint8), np.zeros((48, 64), np.float32), AHEAD)
    with true_map_of_recording([blind], CAMERA, samples=SAMPLES) as truth:
        values = score_map(wall(1.0), truth).values
    assert values["accuracy_m"] is None
    assert values["depth_l1_m"] is None
    assert values["truth_seen_share"] is None
