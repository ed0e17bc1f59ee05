# SPDX-License-Identifier: GPL-3.0-or-later
"""ATE and RPE are evo's to 1e-9, wherever evo gives a number."""

import functools

import numpy as np
import pytest
import trajectory_pairs

from noisy_world.evaluation.metrics import Alignment, score_trajectory
from noisy_world.evaluation.metrics.alignment import aligned_poses
from noisy_world.evaluation.metrics.association import associate_poses
from noisy_world.evaluation.metrics.errors import consecutive_pairs, pairs_apart, relative_errors, travelled_m

pytest.importorskip("evo", reason="evo is not installed")

from evo import EvoException
from evo.core import metrics, sync
from evo.core.trajectory import PoseTrajectory3D
from evo.core.units import Unit

SEEDS = range(200)
TOLERANCE = 1e-9
STATISTICS = [getattr(metrics.StatisticsType, name) for name in ("rmse", "mean", "median", "max", "std")]


random_pair = functools.cache(trajectory_pairs.random_pair)


@functools.cache
def of_evo(pair, *, with_scale):
    """The truth and the aligned estimate as evo pairs and aligns them; None where it refuses."""
    truth = PoseTrajectory3D(poses_se3=list(pair.truth.c2w), timestamps=pair.truth.stamps_s)
    estimate = PoseTrajectory3D(poses_se3=list(pair.estimate.c2w), timestamps=pair.estimate.stamps_s)
    try:
        truth, estimate = sync.associate_trajectories(truth, estimate, max_diff=0.01)
        estimate.align(truth, correct_scale=with_scale)
    except EvoException:
        return None
    return truth, estimate


def statistics(metric, data):
    metric.process_data(data)
    return {kind.value: float(metric.get_statistic(kind)) for kind in STATISTICS}


@pytest.mark.parametrize("how", [Alignment.SE3, Alignment.SIM3])
def test_absolute_errors(how):
    compared = 0
    for seed in SEEDS:
        pair = random_pair(seed)
        data = of_evo(pair, with_scale=how is Alignment.SIM3)
        score = score_trajectory(pair.estimate, pair.truth, alignment=how)
        if data is None:
            assert score.failure == "stands_still", (seed, pair.odd)
            continue
        assert score.failure == "", (seed, pair.odd)
        assert score.matched == data[0].num_poses
        for part, unit, relation in (
            ("ate", "m", metrics.PoseRelation.translation_part),
            ("ate_rotation", "deg", metrics.PoseRelation.rotation_angle_deg),
        ):
            for kind, expected in statistics(metrics.APE(relation), data).items():
                name = f"{part}_{kind}_{unit}"
                if name in score.values:
                    assert score.values[name] == pytest.approx(expected, rel=0, abs=TOLERANCE), (seed, pair.odd, name)
                    compared += 1
    assert compared > 1500


def relative(pair, data, pairs, with_scale):
    """Our relative errors of the same poses, paired and aligned by our code."""
    rows, frames = associate_poses(pair.estimate.stamps_s, pair.truth.stamps_s)
    score = score_trajectory(pair.estimate, pair.truth, alignment=Alignment.SIM3 if with_scale else Alignment.SE3)
    estimate, truth = aligned_poses(pair.estimate.c2w[rows], score.by), pair.truth.c2w[frames]
    return relative_errors(estimate, truth, pairs(truth))


RELATIVE = {
    "consecutive": ({"delta": 1, "delta_unit": Unit.frames}, lambda truth: consecutive_pairs(len(truth))),
    "0.3 m": (
        {"delta": 0.3, "delta_unit": Unit.meters, "all_pairs": True, "pairs_from_reference": True},
        lambda truth: pairs_apart(travelled_m(truth[:, :3, 3]), 0.3, 0.03),
    ),
    "7 frames": (
        {"delta": 7, "delta_unit": Unit.frames, "all_pairs": True},
        lambda truth: pairs_apart(np.arange(len(truth), dtype=float), 7.0, 0.5),
    ),
}


@pytest.mark.parametrize(
    ("kind", "with_scale"), [("consecutive", False), ("consecutive", True), ("0.3 m", True), ("7 frames", False)]
)
def test_relative_errors(kind, with_scale):
    how, pairs = RELATIVE[kind]
    compared = 0
    for seed in SEEDS:
        pair = random_pair(seed)
        data = of_evo(pair, with_scale=with_scale)
        if data is None:
            continue
        metres, degrees = relative(pair, data, pairs, with_scale)
        for errors, relation in (
            (metres, metrics.PoseRelation.translation_part),
            (degrees, metrics.PoseRelation.rotation_angle_deg),
        ):
            metric = metrics.RPE(relation, **how)
            try:
                metric.process_data(data)
            except EvoException:  # no pair is so far apart
                assert errors.size == 0
                continue
            np.testing.assert_allclose(errors, metric.error, rtol=0, atol=TOLERANCE, err_msg=f"{seed} {pair.odd}")
            compared += 1
    assert compared > 250


def test_the_scores_of_one_frame_are_those_of_evo_where_no_frame_is_missing():
    compared = 0
    for seed in SEEDS:
        pair = random_pair(seed)
        if pair.odd not in ("", "far", "plane", "mirrored", "noise"):
            continue
        data = of_evo(pair, with_scale=False)
        values = score_trajectory(pair.estimate, pair.truth).values
        for name, relation in (
            ("rpe_1frame_rmse_m", metrics.PoseRelation.translation_part),
            ("rpe_1frame_rmse_deg", metrics.PoseRelation.rotation_angle_deg),
        ):
            expected = statistics(metrics.RPE(relation, delta=1), data)["rmse"]
            assert values[name] == pytest.approx(expected, rel=0, abs=TOLERANCE)
        for name, relation in (
            ("rpe_1m_rmse_m", metrics.PoseRelation.translation_part),
            ("rpe_1m_rmse_deg", metrics.PoseRelation.rotation_angle_deg),
        ):
            metric = metrics.RPE(relation, 1.0, Unit.meters, 0.1, all_pairs=True, pairs_from_reference=True)
            assert values[name] == pytest.approx(statistics(metric, data)["rmse"], rel=0, abs=TOLERANCE)
        compared += 1
    assert compared == 100


def test_the_papers_numbers_are_those_of_its_notebook():
    # Its steps with evo: Sim(3) of the keyframes, RMSE; the aligned path over the whole true one; rotations in radians.
    compared = 0
    for seed in SEEDS:
        pair = random_pair(seed)
        score = score_trajectory(pair.estimate, pair.truth, "paper", keyframes=pair.estimate)
        data = of_evo(pair, with_scale=True)
        if data is None:
            assert score.values == {"ate_m": 1.0, "rpe_rad": 1.0, "sr": 0.0}
            continue
        whole = PoseTrajectory3D(poses_se3=list(pair.truth.c2w), timestamps=pair.truth.stamps_s)
        expected = {
            "ate_m": statistics(metrics.APE(metrics.PoseRelation.translation_part), data)["rmse"],
            "rpe_rad": statistics(metrics.RPE(metrics.PoseRelation.rotation_angle_rad, delta=1), data)["rmse"],
            "sr": data[1].path_length / whole.path_length,
        }
        assert score.values == pytest.approx(expected, rel=0, abs=TOLERANCE)
        compared += 1
    assert compared == 180
