# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances between surfaces, against closed forms."""

import numpy as np
import pytest
from refusals import refused

pytest.importorskip("scipy")

from seen_shapes import sphere_mesh, triangle_mesh, wall

from noisy_world.core.geometry import pose, rotation_from_euler_deg
from noisy_world.evaluate.map_metrics import MAP_METRICS, lay, score_map
from noisy_world.evaluate.true_maps import Culling, NoViews, TrueMap, corners_of, draw, squared_distances

SAMPLES = 4_000


def _score(mesh, truth, *, paper=False, **options):
    true_map = TrueMap(truth, NoViews(), "mesh", culling=Culling.NONE, samples=SAMPLES)
    return score_map(mesh, true_map, renders=False, paper=paper, **options).values


@pytest.mark.parametrize("far_m", [0.0, 1e5])
def test_a_sphere_scaled_by_a_hundredth(far_m):
    centre_m = np.array([far_m, -far_m, 0.3 * far_m])
    values = _score(sphere_mesh(2.02, centre_m=centre_m), sphere_mesh(2.0, centre_m=centre_m))
    assert values["accuracy_m"] == pytest.approx(0.02, rel=5e-3)  # of 64 circles: facets lie 0.1 % inside
    assert values["completion_m"] == pytest.approx(0.02, rel=5e-3)
    assert values["accuracy_median_m"] == pytest.approx(0.02, rel=5e-3)
    assert (values["completion_ratio_5cm"], values["accuracy_ratio_5cm"], values["f_score_5cm"]) == (1, 1, 1)
    assert (values["seen_share"], values["truth_seen_share"]) == (1, 1)


def test_a_plane_moved_by_a_centimetre():
    values = _score(wall(0.01), wall(0.0))
    assert values["accuracy_m"] == pytest.approx(0.01, rel=1e-3)
    assert values["completion_m"] == pytest.approx(0.01, rel=1e-3)
    fine = _score(wall(0.01, steps=70), wall(0.0, steps=90))  # smaller triangles than the samples lie apart
    assert fine["accuracy_m"] == pytest.approx(0.01, rel=1e-3)
    assert fine["completion_m"] == pytest.approx(0.01, rel=1e-3)


def test_equal_surfaces_have_no_distance_between_them_however_fine():
    for steps in (1, 7, 120):
        values = _score(wall(0.0, steps=steps), wall(0.0, steps=steps))
        assert values["accuracy_m"] < 1e-4


def test_half_a_map():
    half = wall(0.0)
    half.vertices_m[:, 1] = np.maximum(half.vertices_m[:, 1], 0)  # y of 0 to 1 alone
    values = _score(half, wall(0.0))
    assert values["accuracy_m"] == pytest.approx(0, abs=1e-9)
    assert values["completion_ratio_5cm"] == pytest.approx(0.525, abs=0.03)  # and 5 cm beyond
    assert values["completion_m"] == pytest.approx(0.25, rel=0.08)  # the mean of 0 to 1 m, and of 0


def test_the_paper_s_numbers_are_those_of_points():
    """Around a point of a plane the nearest of others, with density d, is 0.5 / sqrt(d) away; its square 1 / (pi d)."""
    values = _score(wall(0.0, width_m=4.0), wall(0.0, width_m=4.0), paper=True)
    density = SAMPLES / 16
    assert values["paper_accuracy_m"] == pytest.approx(0.5 / np.sqrt(density), rel=0.06)
    assert values["paper_completion_m2"] == pytest.approx(1 / (np.pi * density), rel=0.12)
    assert values["paper_icp_turn_deg"] < 0.5
    assert values["accuracy_m"] < 1e-4  # while the surfaces are the same
    far = _score(wall(0.2), wall(0.0), paper=True)  # too far for ICP
    assert far["paper_completion_ratio"] == 0
    assert far["paper_completion_ratio_squared"] == pytest.approx(1.0)  # 0.04 is less than 0.05
    assert far["paper_accuracy_m2"] == pytest.approx(0.04, rel=0.01)


def test_icp_finds_a_small_motion_far_from_the_origin():
    middle_m = np.array([1e5, 2e4, -3e3])
    truth = draw(corners_of(sphere_mesh(1.0)), 5000, 1).points_m * (1, 0.7, 0.4)
    moved = pose(rotation_from_euler_deg(1.0, -1.5, 2.0), (0.02, -0.01, 0.015))
    points = truth @ moved[:3, :3].T + moved[:3, 3]
    laid = lay(points + middle_m, truth + middle_m)
    back = (points + middle_m) @ laid.truth_from_map[:3, :3].T + laid.truth_from_map[:3, 3] - middle_m
    assert np.abs(back - truth).max() < 1e-3
    assert laid.share == 1.0


def test_icp_without_pairs_moves_nothing():
    points = np.eye(3)
    laid = lay(points, points + 10)
    assert np.array_equal(laid.truth_from_map, np.eye(4))
    assert laid.share == 0


def test_samples_are_even_by_area_and_the_same_again():
    mesh = triangle_mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 5), (3, 0, 5), (0, 3, 5)], [(0, 1, 2), (3, 4, 5)])
    corners_m = corners_of(mesh)
    samples = draw(corners_m, 100_000, "a")
    assert (samples.triangles == 1).mean() == pytest.approx(0.9, abs=0.004)
    first = samples.points_m[samples.triangles == 0]
    assert np.allclose(first.mean(axis=0), (1 / 3, 1 / 3, 0), atol=0.01)
    assert np.allclose(first[:, :2].std(axis=0), np.sqrt(1 / 18), atol=0.005)
    assert np.array_equal(samples.points_m, draw(corners_m, 100_000, "a").points_m)
    assert not np.array_equal(samples.points_m, draw(corners_m, 100_000, "b").points_m)


def test_distances_of_a_triangle_in_all_its_regions():
    corners = np.array([(0, 0, 0), (2, 0, 0), (0, 2, 0)], float)
    cases = {
        (0.5, 0.5, 3): 9,  # above
        (1, -2, 0): 4,  # beside an edge
        (2, 2, 1): 3,  # beside the long edge: sqrt(2) in the plane
        (-1, -1, 1): 3,  # a corner
        (4, 0, 0): 4,
        (0, 3, -2): 5,
        (0.3, 0.3, 0): 0,
    }
    points = np.array(list(cases), float)
    found = squared_distances(points, np.broadcast_to(corners, (len(points), 3, 3)))
    assert found == pytest.approx(list(cases.values()))
    line = np.array([(0, 0, 0), (1, 0, 0), (3, 0, 0)], float)  # without area
    assert squared_distances(np.array([(2.0, 1, 0)]), line[None]) == pytest.approx([1])
    dot = np.zeros((1, 3, 3))
    assert squared_distances(np.array([(2.0, 1, 0)]), dot) == pytest.approx([5])


def test_no_map_is_a_result():
    values = _score(None, wall(0.0), paper=True)
    assert values["completion_ratio_5cm"] == values["f_score_5cm"] == 0
    assert values["accuracy_m"] is None
    assert values["paper_accuracy_m"] is None
    flat = triangle_mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)])  # no area
    assert _score(flat, wall(0.0))["accuracy_m"] is None
    assert _score(wall(0.0), None)["accuracy_m"] is None


def test_a_map_is_moved_by_an_alignment_with_a_scale():
    by = pose(2.0 * rotation_from_euler_deg(0, 0, 90), (0.0, 0.0, 1.0))
    mesh, truth = (
        wall(0.5, width_m=1.0),
        triangle_mesh([(-1, 1, 0), (1, 1, 0), (1, 1, 2), (-1, 1, 2)], [(0, 1, 2), (0, 2, 3)]),
    )
    assert _score(mesh, truth, truth_from_map=by)["accuracy_m"] == pytest.approx(0, abs=1e-9)
    refused(_score, mesh, truth, truth_from_map=np.ones((4, 4)), names="last row", error=ValueError)


def test_each_number_has_a_name():
    assert set(_score(wall(0.0), wall(0.0), paper=True)) < set(MAP_METRICS)
    assert all(name == metric.name for name, metric in MAP_METRICS.items())
