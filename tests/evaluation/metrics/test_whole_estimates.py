# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of poses that were cut, and quaternions in another order than was read."""

import numpy as np
import pytest
import trajectory_pairs
from refusals import refused

from noisy_world.core.errors import InputError
from noisy_world.core.geometry import quat_wxyz_from_rotation
from noisy_world.core.trajectory import Trajectory
from noisy_world.evaluate.cases import Outcome, estimate_text, read_estimate_file
from noisy_world.evaluate.estimates import Estimate, check_whole
from noisy_world.evaluate.system_runs import normalised
from noisy_world.evaluate.systems import Writes
from noisy_world.evaluate.trajectory_scores import read_poses_to_compare, score_trajectory

PAIR = trajectory_pairs.random_pair(3)
FIXED = [f"{0.05 * k:.2f} {k:.1f} 2.0 3.0 0.000000 0.000000 0.600000 {0.8 + 1e-6 * k:.6f}" for k in range(4)]
NUMBERS = (0.8, 0.28, 0.96, 0.8, 0.70710681)
SHORTEST = [f"{0.05 * k:.2f} {k}.0 2.0 0.0 0.0 0.0 {(1 - w * w) ** 0.5!r} {w!r}" for k, w in enumerate(NUMBERS)]


@pytest.mark.parametrize("lines", [FIXED, SHORTEST], ids=["fixed", "shortest"])
def test_every_cut_inside_the_last_number_is_refused(tmp_path, lines):
    whole = "\n".join(lines) + "\n"
    check_whole(tmp_path / "e.txt", whole)
    for length in range(len(whole) - len(lines[-1].split()[-1]), len(whole) - 1):
        with pytest.raises(InputError, match=r"e.txt: line \d: the file .* end"):
            check_whole(tmp_path / "e.txt", whole[:length])


def test_a_whole_number_that_shows_that_it_is_needs_no_line_break(tmp_path):
    check_whole(tmp_path / "e.txt", "\n".join(FIXED))  # as many digits as before it
    check_whole(tmp_path / "e.txt", "1.0 0.0 0.0 2.5 0.0 1.0 0.0 3.25 0.0 0.0 1.0 4.125 0.0 0.0 0.0 1.0")
    check_whole(tmp_path / "e.txt", '{"frames": []}')
    names = ["e.txt: ", "'0.70710681'", "write it again"]  # nothing tells whether a digit follows
    refused(check_whole, tmp_path / "e.txt", "\n".join(SHORTEST), names=names)


@pytest.mark.parametrize("exponent", ["e-01", "e+00"])
def test_a_cut_exponent_is_none(tmp_path, exponent):
    text = "".join(f"{k} 1 2 3 0 0 0 1.000000e+00\n" for k in range(3)) + f"3 1 2 3 0 0 0 7.071068{exponent}"
    check_whole(tmp_path / "e.txt", text)
    refused(check_whole, tmp_path / "e.txt", text[:-1], names=["e.txt: ", "may be cut"])


def test_fewer_numbers_name_both_lines(tmp_path):
    text = "\n".join([FIXED[0], "0.05 1.5 2.0 3.0 0.0"])
    refused(check_whole, tmp_path / "e.txt", text, names=["e.txt: line 2: ", "5 numbers", "line 1 has 8"])


def test_commands_and_studies_refuse_a_cut_estimate(tmp_path):
    whole = estimate_text(PAIR.estimate)
    (tmp_path / "truth.txt").write_text(estimate_text(Estimate(PAIR.truth.stamps_s, PAIR.truth.c2w)))
    (tmp_path / "cut.txt").write_text(whole[:-4])
    line = f"line {len(PAIR.estimate)}"
    refused(read_poses_to_compare, tmp_path / "cut.txt", tmp_path / "truth.txt", names=f"cut.txt: {line}: ")
    refused(read_estimate_file, tmp_path / "cut.txt", names=[f"cut.txt: {line}: ", "remove the"])
    writes = Writes(file="cut.txt", format="tum")
    found = normalised(tmp_path, writes, PAIR.truth.stamps_s.tolist())
    assert found.outcome is Outcome.UNREADABLE
    assert f"cut.txt: {line}: the file does not end" in found.detail
    (tmp_path / "cut.txt").write_text(whole)
    assert len(read_estimate_file(tmp_path / "cut.txt")) == len(PAIR.estimate)


def turned(truth, change):
    """The truth with other rotations, its positions a millimetre off."""
    c2w = truth.c2w.copy()
    c2w[:, :3, 3] += 0.001 * np.random.default_rng(0).standard_normal((len(c2w), 3))
    c2w[:, :3, :3] = change(c2w[:, :3, :3])
    return Estimate(truth.stamps_s, c2w)


def shuffled(rotation):
    """What a reader of x y z w makes of w x y z: by scipy, whose quaternions are x y z w."""
    spatial = pytest.importorskip("scipy.spatial.transform")
    return spatial.Rotation.from_quat(quat_wxyz_from_rotation(rotation)).as_matrix()


def test_quaternions_w_first_are_warned_of():
    warned = 0
    for seed in range(40):
        pair = trajectory_pairs.random_pair(seed)
        estimate = turned(pair.truth, shuffled)
        score = score_trajectory(estimate, pair.truth)
        rotation_deg = score.values["ate_rotation_median_deg"]
        if score.failure or rotation_deg is None or rotation_deg < 30.0 or score.values["ate_rmse_m"] > 0.01:
            continue
        assert "written w first and read as x y z w" in score.notes[0], (seed, rotation_deg)
        warned += 1
    assert warned > 20


def test_other_axes_are_told_from_other_orders():
    score = score_trajectory(turned(PAIR.truth, lambda rotation: rotation @ np.diag([1.0, -1.0, -1.0])), PAIR.truth)
    assert "its cameras may have other axes (--axes)" in score.notes[0]
    assert score_trajectory(turned(PAIR.truth, lambda rotation: rotation), PAIR.truth).notes == ()


def nearly_straight(truth):
    """The same poses on a walk of metres that is straight to 6 mm."""
    c2w = truth.c2w.copy()
    c2w[:, :3, 3] = 0.006 * np.random.default_rng(1).standard_normal((len(c2w), 3))
    c2w[:, 0, 3] += 0.1 * np.arange(len(c2w))
    return Trajectory(c2w, truth.stamps_s)


@pytest.mark.parametrize("seed", range(5))
def test_a_walk_that_is_nearly_straight_accuses_only_those_whose_rotations_are_wrong(seed):
    truth = nearly_straight(PAIR.truth)
    c2w = turned(truth, lambda rotation: rotation).c2w.copy()
    c2w[:, :3, 3] += 0.004 * np.random.default_rng(seed).standard_normal((len(c2w), 3))
    right = Estimate(truth.stamps_s, c2w)
    score = score_trajectory(right, truth)
    assert score.conditioning.decided == "direction"
    assert score.notes == ()
    assert score.values["ate_rotation_rmse_deg"] < 1.0
    c2w[:, :3, :3] = shuffled(c2w[:, :3, :3])
    assert "written w first" in score_trajectory(Estimate(truth.stamps_s, c2w), truth).notes[0]
