# SPDX-License-Identifier: GPL-3.0-or-later
"""Scores of trajectories whose errors are known in closed form, and of those that nobody wants to score."""

import math

import numpy as np
import pytest
from cases import cases
from refusals import refused
from trajectory_pairs import moved, path, rotation
from worlds import ROOT

from noisy_world.core.trajectory import Trajectory
from noisy_world.evaluate.estimates import Estimate, associate_poses
from noisy_world.evaluate.metrics import METRICS, PAPER_METRICS
from noisy_world.evaluate.pose_errors import PROTOCOLS, Alignment, pairs_apart
from noisy_world.evaluate.trajectory_scores import FAILURES, score_trajectory

ERRORS = [name for name in METRICS if name.startswith(("ate_", "rpe_"))]


def at(positions, stamps_s=None, rate_hz=10.0):
    """A truth whose camera never turns."""
    c2w = np.tile(np.eye(4), (len(positions), 1, 1))
    c2w[:, :3, 3] = positions
    return Trajectory(c2w, np.arange(len(positions)) / rate_hz if stamps_s is None else stamps_s)


def as_estimate(truth, rows=None, c2w=None):
    chosen = np.arange(len(truth)) if rows is None else np.asarray(rows, dtype=int)
    return Estimate(truth.stamps_s[chosen], (truth.c2w if c2w is None else c2w)[chosen])


def square(count=40, side_m=4.0):
    """The corners' and sides' points of a square, which comes back to where it began."""
    along = np.arange(count) * 4.0 / count
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]], dtype=float)
    whole = np.floor(along).astype(int)
    return side_m * (corners[whole] + (along - whole)[:, None] * (corners[whole + 1] - corners[whole]))


# --- closed forms ---


def test_an_estimate_in_another_world_is_perfect():
    rng = np.random.default_rng(3)
    truth = path(rng, 60)
    turn = rotation(rng, np.pi)
    score = score_trajectory(as_estimate(truth, c2w=moved(truth.c2w, turn, [5.0, -7.0, 9.0])), truth)
    assert score.failure == ""
    assert max(score.values[name] for name in ERRORS if name.endswith("_m")) < 1e-14
    assert score.values["ate_rotation_max_deg"] < 1e-12
    assert score.values["scale"] == pytest.approx(1.0, abs=1e-14)
    assert score.values["tracked_share"] == score.values["success_2cm"] == 1.0
    np.testing.assert_allclose(score.by.rotation, turn.T, atol=1e-14)
    np.testing.assert_allclose(score.frame_errors.position_m, truth.c2w[:, :3, 3], atol=1e-13)


@cases("scale", [1e-6, 0.2, 1.0, 3.0, 1e6])
def test_the_scale_of_a_monocular_estimate(scale):
    truth = at(square())
    estimate = as_estimate(truth, c2w=moved(truth.c2w, np.eye(3), [1.0, 2.0, 3.0], scale))
    fitted = score_trajectory(estimate, truth, monocular=True).values
    assert fitted["ate_rmse_m"] < 1e-9
    assert fitted["scale"] == pytest.approx(1.0 / scale, rel=1e-9)
    assert fitted["path_share"] == pytest.approx(1.0, rel=1e-9)
    values = score_trajectory(estimate, truth).values
    assert values["scale"] == pytest.approx(1.0 / scale, rel=1e-9)
    # Rigidly laid over its own enlargement, a shape is off by the difference of the scales times its own radius.
    radius_m = math.sqrt(np.mean(np.sum((square() - square().mean(axis=0)) ** 2, axis=1)))
    assert values["ate_rmse_m"] == pytest.approx(abs(scale - 1.0) * radius_m, rel=1e-9, abs=1e-12)
    assert values["path_share"] == pytest.approx(scale, rel=1e-9)


def test_errors_that_alignment_cannot_remove():
    # Up and down in turn, without a trend: the mean and every linear trend vanish, so the least squares stay at rest.
    positions = square(40)
    signs = np.tile([1.0, -1.0, -1.0, 1.0], 10)
    estimated = positions + 0.03 * signs[:, None] * np.array([0.0, 0.0, 1.0])
    truth = at(positions)
    values = score_trajectory(as_estimate(truth, c2w=at(estimated).c2w), truth).values
    assert values["ate_rmse_m"] == pytest.approx(0.03, rel=1e-3)
    assert values["ate_max_m"] == pytest.approx(0.03, rel=0.05)
    changes = np.abs(np.diff(signs)) * 0.03  # from frame to frame: 0.06 m every other time
    assert values["rpe_1frame_rmse_m"] == pytest.approx(math.sqrt(np.mean(changes**2)), rel=1e-9)
    assert values["rpe_1frame_rmse_deg"] == pytest.approx(0.0, abs=1e-12)
    assert values["success_2cm"] == 0.0
    assert values["success_5cm"] == 1.0
    assert values["success_auc"] == pytest.approx(1.0 - values["ate_rmse_m"])


@cases("protocol, ate_m", [("strict", 0.05), ("paper", 0.05), ("paper_go_slam", 0.05), ("paper_mean", 0.04)])
def test_each_protocol_has_its_own_statistic(protocol, ate_m):
    # Four frames in each corner of a square, off its plane by 1 and 7 cm to both sides, which no rotation and no shift
    # makes smaller. The mean of 1 and 7 is 4, the root of the mean of 1 and 49 is 5.
    corners_m = np.repeat([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 4.0, 0.0]], 4, axis=0)
    off_m = np.zeros((16, 3))
    off_m[:, 2] = np.tile([0.01, -0.01, 0.07, -0.07], 4)
    values = score_trajectory(as_estimate(at(corners_m), c2w=at(corners_m + off_m).c2w), at(corners_m), protocol).values
    if protocol in ("paper", "paper_go_slam"):
        # The scale 8 / 8.0025, of the variances, leaves that share of the mean square.
        ate_m *= math.sqrt(8.0 / 8.0025)
    assert values["ate_rmse_m" if protocol == "strict" else "ate_m"] == pytest.approx(ate_m, rel=1e-9)


def test_a_success_tracks_four_fifths_of_the_frames_or_more():
    truth = at(square())
    for tracked, success in ((31, 0.0), (32, 1.0), (33, 1.0)):
        values = score_trajectory(as_estimate(truth, range(tracked)), truth).values
        assert values["tracked_share"] == tracked / 40
        assert (values["success_2cm"], values["success_auc"]) == (success, pytest.approx(success, abs=1e-12))


def test_a_camera_that_is_turned():
    truth = at(square())
    turned = np.array(truth.c2w)
    turned[:, :3, :3] = rotation(np.random.default_rng(1), np.deg2rad(7.0))
    values = score_trajectory(as_estimate(truth, c2w=turned), truth).values
    assert values["ate_rmse_m"] < 1e-14
    for kind in ("rmse", "mean", "median", "max"):
        assert values[f"ate_rotation_{kind}_deg"] == pytest.approx(7.0, abs=1e-9)
    # Its motions, in its own axes, differ from the true ones by 2 sin(3.5 degrees) of their part across the axis.
    assert 0.0 < values["rpe_1frame_rmse_m"] <= 2.0 * np.sin(np.deg2rad(3.5)) * 0.4 + 1e-12
    assert values["rpe_1frame_rmse_deg"] == pytest.approx(0.0, abs=1e-9)


def test_drift_in_a_line_is_the_relative_error():
    # 4 cm too far at each of 10 frames a second: 4 cm a frame, 40 cm a second; a metre is five frames here.
    positions = np.zeros((50, 3))
    positions[:, 0] = 0.2 * np.arange(50)
    truth = at(positions)
    drifted = at(positions * 1.2)
    values = score_trajectory(as_estimate(truth, c2w=drifted.c2w), truth).values
    assert values["rpe_1frame_rmse_m"] == pytest.approx(0.04)
    assert values["rpe_1s_rmse_m"] == pytest.approx(0.4)
    assert values["rpe_1m_rmse_m"] == pytest.approx(0.2)
    assert values["f1_auc"] == 0.0  # 40 cm a second is beyond its end
    assert values["f1_auc_rotation"] == pytest.approx(1.0)
    assert values["scale"] == pytest.approx(1.0 / 1.2)
    # Centred on the middle, the error grows to 24.5 frames times 4 cm at the ends.
    assert values["ate_max_m"] == pytest.approx(0.98)
    assert values["ate_rotation_rmse_deg"] < 1e-9  # a line does not say how it is turned about itself; the cameras do
    assert values["conditioning"] < 1e-9


def test_lost_frames():
    truth = at(square(100), rate_hz=10.0)
    rows = [*range(5, 40), *range(60, 90)]
    values = score_trajectory(as_estimate(truth, rows), truth).values
    assert values["tracked_share"] == 0.65
    assert values["initialisation_s"] == pytest.approx(0.5)
    assert values["losses"] == 2.0
    assert values["longest_loss_s"] == pytest.approx(2.1)  # from frame 39 to frame 60; the second from 89 to 99
    assert values["bad_pose_share"] == pytest.approx(0.35)
    assert values["ate_rmse_m"] < 1e-14
    assert values["success_100cm"] == values["success_auc"] == 0.0  # fewer than 80 % of the frames
    # Precision 1: all motions that are there are right. 25 + 20 pairs of a second of the truth's 90.
    assert values["f1_auc"] == pytest.approx(2 * 45 / (45 + 90), abs=1e-12)


def test_relative_errors_do_not_jump_over_lost_frames():
    truth = at(square(100))
    wrong = np.array(truth.c2w)
    wrong[50:, :3, 3] += [3.0, 0.0, 0.0]  # found again elsewhere after a loss
    rows = [*range(45), *range(55, 100)]
    score = score_trajectory(as_estimate(truth, rows, wrong), truth)
    assert score.values["rpe_1frame_rmse_m"] < 1e-12
    assert score.values["ate_rmse_m"] > 0.5
    assert np.isnan(score.frame_errors.error_m[45:55]).all()
    assert not score.frame_errors.tracked[45:55].any()


def test_the_area_under_the_f1_curve():
    # Against precision, recall and F1 calculated at 20,000 thresholds, one after another.
    rng = np.random.default_rng(5)
    truth = path(rng, 120)
    c2w = np.array(truth.c2w)
    c2w[:, :3, 3] += np.cumsum(rng.normal(size=(120, 3)) * 0.006, axis=0)
    rows = np.flatnonzero(rng.uniform(size=120) > 0.1)
    values = score_trajectory(as_estimate(truth, rows, c2w), truth).values
    kept = set(rows.tolist())
    errors = []
    for first in range(100):
        second = first + 20
        if first in kept and second in kept:
            motions = [np.linalg.inv(poses[first]) @ poses[second] for poses in (truth.c2w, c2w)]
            errors.append(np.linalg.norm((np.linalg.inv(motions[0]) @ motions[1])[:3, 3]))
    area, thresholds = 0.0, (np.arange(20_000) + 0.5) / 20_000 * 0.1
    for threshold in thresholds:
        good = sum(error < threshold for error in errors)
        precision, recall = good / len(errors), good / 100
        area += 0.0 if good == 0 else 2 * precision * recall / (precision + recall)
    assert 0.1 < values["f1_auc"] < 0.9
    assert values["f1_auc"] == pytest.approx(area / len(thresholds), abs=1e-4)


def test_the_success_curve_of_many_runs():
    # The mean of success_auc is the area under the share of runs below each threshold.
    rng = np.random.default_rng(8)
    truth = at(square())
    values = []
    for _ in range(50):
        positions = square() + rng.normal(size=(40, 3)) * rng.uniform(0.0, 1.0)
        values.append(score_trajectory(as_estimate(truth, c2w=at(positions).c2w), truth).values)
    ates = np.array([found["ate_rmse_m"] for found in values])
    curve = [(ates < threshold).mean() for threshold in (np.arange(10_000) + 0.5) / 10_000]
    assert np.mean([found["success_auc"] for found in values]) == pytest.approx(np.mean(curve), abs=1e-4)
    assert np.mean([found["success_50cm"] for found in values]) == (ates < 0.5).mean()


# --- failures ---


@cases("rows, word", [((), "no_poses"), ((4,), "too_few_poses"), ((4, 9), "too_few_poses"), ((4, 9, 14), "")])
def test_few_poses(rows, word):
    truth = at(square())
    score = score_trajectory(as_estimate(truth, list(rows)), truth)
    assert score.failure == word
    assert (score.poses, score.matched, score.frames) == (len(rows), len(rows), 40)
    assert score.values["tracked_share"] == len(rows) / 40
    assert (score.values["ate_rmse_m"] is None) == bool(word)
    assert score.values["success_auc"] == 0.0


@cases("protocol", ["strict", "paper", "paper_go_slam", "paper_mean"])
def test_a_failed_run(protocol):
    truth = at(square())
    still = as_estimate(truth, c2w=np.tile(truth.c2w[7], (40, 1, 1)))
    score = score_trajectory(still, truth, protocol)
    assert (score.failure, score.by) == ("stands_still", None)
    if protocol == "strict":
        assert [score.values[name] for name in ERRORS] == [None] * len(ERRORS)
        assert score.values["tracked_share"] == 1.0
        assert score.values["path_share"] == score.values["success_auc"] == score.values["f1_auc"] == 0.0
        assert score.values["bad_pose_share"] == 1.0
    else:
        assert score.values == {"ate_m": 1.0, "rpe_rad": 1.0, "sr": 0.0}
    assert np.isnan(score.frame_errors.error_m).all()
    assert score.frame_errors.tracked.all()


def test_standing_still_is_found_in_spite_of_rounding():
    truth = at(square())
    c2w = np.tile(np.eye(4), (40, 1, 1))
    c2w[:, :3, 3] = [1e5, -3e5, 0.1]
    c2w[::2, 0, 3] = np.nextafter(1e5, 2e5)
    assert score_trajectory(as_estimate(truth, c2w=c2w), truth).failure == "stands_still"


def test_a_camera_that_stood_still():
    truth = at(np.ones((40, 3)))
    perfect = score_trajectory(as_estimate(truth), truth)
    assert perfect.failure == ""
    assert perfect.values["ate_rmse_m"] == 0.0
    assert perfect.values["path_share"] is perfect.values["scale"] is None
    assert perfect.values["ate_rotation_rmse_deg"] < 1e-9
    assert perfect.values["rpe_1m_rmse_m"] is None
    trembling = at(np.ones((40, 3)) + 0.01 * np.tile([[1.0, 0, 0], [-1.0, 0, 0]], (20, 1)))
    assert score_trajectory(as_estimate(truth, c2w=trembling.c2w), truth).values["ate_rmse_m"] == pytest.approx(0.01)
    without_scale = score_trajectory(as_estimate(truth, c2w=trembling.c2w), truth, monocular=True)
    assert without_scale.failure == "truth_stands_still"
    assert without_scale.values["success_auc"] is None


def test_stamps_of_another_time():
    truth = at(square())
    score = score_trajectory(Estimate(truth.stamps_s + 100.0, truth.c2w), truth)
    assert (score.failure, score.matched, score.poses) == ("no_common_stamps", 0, 40)
    # Before and after the truth: those outside count for nothing, and against nothing.
    longer = at(np.vstack([square(), square(), square()]), stamps_s=np.arange(120) / 10.0 - 4.0)
    score = score_trajectory(as_estimate(longer), truth)
    assert (score.matched, score.poses) == (40, 120)
    assert score.values["ate_rmse_m"] < 1e-14


@cases("size_m", [1e90, 1e150, 1e300])
def test_an_estimate_that_explodes(size_m):
    truth = at(square())
    c2w = np.array(truth.c2w)
    c2w[20:, :3, 3] *= size_m
    for monocular in (False, True):
        score = score_trajectory(as_estimate(truth, c2w=c2w), truth, monocular=monocular)
        assert score.failure == ("diverged" if size_m > 1e100 else "")
        assert all(value is None or math.isfinite(value) for value in score.values.values())
        assert score.values["success_100cm"] == 0.0


@cases("size_m", [1e-12, 1e-150])
def test_a_tiny_monocular_estimate(size_m):
    truth = at(square())
    estimate = as_estimate(truth, c2w=moved(truth.c2w, np.eye(3), [0.0, 0.0, 0.0], size_m))
    score = score_trajectory(estimate, truth, monocular=True)
    assert score.failure == ""
    assert score.values["ate_rmse_m"] < 1e-12


def test_far_from_the_origin():
    rng = np.random.default_rng(11)
    near = path(rng, 60)
    off = np.array(near.c2w)
    off[:, :3, 3] += rng.normal(size=(60, 3)) * 0.02
    expected = score_trajectory(as_estimate(near, c2w=off), near).values
    far = Trajectory(moved(near.c2w, np.eye(3), [1e5, -1e5, 1e5]), near.stamps_s)
    found = score_trajectory(as_estimate(far, c2w=moved(off, np.eye(3), [1e5, -1e5, 1e5])), far).values
    assert found == pytest.approx(expected, rel=0, abs=1e-9)


def test_half_turns_and_mirror_images():
    truth = at(square())
    half_turn = np.diag([-1.0, -1.0, 1.0])
    score = score_trajectory(as_estimate(truth, c2w=moved(truth.c2w, half_turn, [0.0, 0.0, 0.0])), truth)
    assert score.values["ate_rmse_m"] < 1e-14
    assert score.values["ate_rotation_max_deg"] < 1e-6
    # A mirrored path cannot be laid over the true one, and a planar one only by turning it over.
    rng = np.random.default_rng(2)
    in_space = path(rng, 60)
    mirrored = np.array(in_space.c2w)
    mirrored[:, 2, 3] *= -1.0
    score = score_trajectory(as_estimate(in_space, c2w=mirrored), in_space)
    assert np.linalg.det(score.by.rotation) == pytest.approx(1.0)
    assert score.values["ate_rmse_m"] > 0.01


@cases("monocular", [False, True])
def test_alignments(monocular):
    truth = at(square())
    shift = np.array([0.3, 0.4, 0.0])
    estimate = as_estimate(truth, c2w=moved(truth.c2w, np.eye(3), shift))
    scores = {how: score_trajectory(estimate, truth, monocular=monocular, alignment=how) for how in Alignment}
    assert scores[Alignment.NONE].values["ate_rmse_m"] == pytest.approx(0.5)
    assert scores[Alignment.NONE].values["success_50cm"] == 0.0
    for how in (Alignment.FIRST_POSE, Alignment.SE3, Alignment.SIM3):
        assert scores[how].values["ate_rmse_m"] < 1e-14


def test_a_truth_of_one_frame():
    truth = at(square()[:1])
    score = score_trajectory(as_estimate(truth), truth)
    assert score.failure == "too_few_poses"
    assert score.values["f1_auc"] is None


# --- what is said ---


def test_every_metric_has_a_value_or_none():
    truth = at(square())
    every_other = as_estimate(truth, np.arange(0, 40, 2))
    for protocol, names in (("strict", METRICS), ("paper", PAPER_METRICS)):
        for estimate in (every_other, as_estimate(truth, [])):
            assert list(score_trajectory(estimate, truth, protocol).values) == list(names)
    assert all(metric.meaning.endswith(".") and metric.name == name for name, metric in METRICS.items())
    assert all(meaning for meaning in FAILURES.values())


def test_protocols_that_do_not_exist_are_refused():
    truth = at(square())
    refused(score_trajectory, as_estimate(truth), truth, "papre", names=["strict", "paper"], error=ValueError)


# --- association ---


@cases(
    "poses, frames, within, expected",
    [
        ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], 0.1, ([0, 1, 2], [0, 1, 2])),
        ([0.96, 1.04], [0.0, 1.0, 2.0], 0.1, ([0], [1])),  # of two that are equally near, the earlier
        ([0.9, 1.02], [0.0, 1.0, 2.0], 0.2, ([1], [1])),  # the nearer; the other is not given to a frame further off
        ([0.5], [0.0, 1.0], 0.5, ([0], [0])),
        ([0.1], [0.0, 1.0], 0.1, ([0], [0])),  # the limit belongs to it
        ([0.11], [0.0, 1.0], 0.1, ([], [])),
        ([], [0.0, 1.0], 0.1, ([], [])),
        ([1e9 + 1e-6, 1e9 + 0.05], [1e9, 1e9 + 0.05], 0.01, ([0, 1], [0, 1])),
        ([-5.0, 0.0, 9.0], [0.0], 100.0, ([1], [0])),
    ],
)
def test_association(poses, frames, within, expected):
    found = associate_poses(np.array(poses, dtype=float), np.array(frames, dtype=float), within)
    assert tuple(rows.tolist() for rows in found) == expected


def test_pairs_apart_are_those_of_a_search_through_all():
    rng = np.random.default_rng(4)
    for _ in range(100):
        along = np.cumsum(rng.choice([0.0, 0.25, 0.5], size=30))
        delta, tolerance = rng.choice([0.25, 0.6, 1.0, 3.0]), rng.choice([0.0, 0.1, 0.5])
        expected = []
        for first in range(29):
            off = [abs(along[second] - along[first] - delta) for second in range(first + 1, 30)]
            if min(off) <= tolerance:
                expected.append([first, first + 1 + off.index(min(off))])
        assert pairs_apart(along, delta, tolerance).tolist() == expected


def test_the_page_explains_every_metric_failure_and_fault():
    page = (ROOT / "docs/metrics.md").read_text()
    faults = [name for protocol in PROTOCOLS.values() for name, _ in protocol.faults]
    for name in (*METRICS, *PAPER_METRICS, *FAILURES, *PROTOCOLS, *faults):
        assert f"`{name}`" in page, name
