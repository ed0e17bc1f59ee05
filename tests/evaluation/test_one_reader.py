# SPDX-License-Identifier: GPL-3.0-or-later
"""A study and `score` say the same of an estimate, whatever its format, its stamps and its lost frames."""

import numpy as np
import pytest
from trajectory_pairs import moved, path, rotation

from noisy_world.core.trajectory import Trajectory
from noisy_world.evaluate.cases import ESTIMATE, Outcome, RunRecord, estimate_text
from noisy_world.evaluate.study_results import STRICT, score_run
from noisy_world.evaluate.system_runs import normalised
from noisy_world.evaluate.systems import Writes
from noisy_world.evaluate.trajectory_scores import read_poses_to_compare, score_trajectory
from noisy_world.trajectories.stamped_poses import tum_text

COUNT = 30
TRUTH = path(np.random.default_rng(4), COUNT, start_s=1_400_000_000.0)
C2W = moved(TRUTH.c2w, rotation(np.random.default_rng(5), 1.0), [1.0, 2.0, 3.0])
LOST = {3, 4, 17, COUNT - 1}
KEPT = [k for k in range(COUNT) if k not in LOST]


def tum(k):
    """Position and quaternion, x y z w, as trajectory files have them."""
    return tum_text(Trajectory(C2W[k : k + 1], [0.0])).strip().partition(" ")[2]


def block(pose):
    return "".join(" ".join(map(repr, row)) + "\n" for row in pose.tolist())


def matrices(text_of):
    nan = np.full((4, 4), np.nan)
    return "".join(text_of(nan if k in LOST else C2W[k]) for k in range(COUNT))


def stamped(shift_s=0.0, unit=1, rows=KEPT):
    return "".join(f"{(TRUTH.stamps_s[k] + shift_s) * unit:.6f} {tum(k)}\n" for k in rows)


KINDS = {
    "tum": ("tum", stamped()),
    "in nanoseconds": ("tum", stamped(unit=1e9)),
    "jitter within the tolerance": ("tum", stamped(0.009)),
    "late": ("tum", stamped(0.015)),
    "of another day": ("tum", stamped(86_400.0)),
    "twice": ("tum", stamped(rows=sorted([*KEPT, 5, 6]))),
    "header alone": ("tum", "timestamp tx ty tz qx qy qz qw\n"),
    "nothing": ("tum", ""),
    "blocks": ("matrices", matrices(block)),
    "lines": ("matrices", matrices(lambda pose: " ".join(map(repr, pose.ravel().tolist())) + "\n")),
    "replica": ("replica", matrices(lambda pose: " ".join(map(repr, pose.ravel().tolist())) + "\n")),
    "kitti": ("kitti", matrices(lambda pose: " ".join(map(repr, pose[:3].ravel().tolist())) + "\n")),
    "log": ("log", "".join(f"{k} {k} {k + 1}\n{block(C2W[k])}" for k in KEPT)),
    "all lost": ("matrices", "nan nan nan nan\n" * 4 * COUNT),
}


def numbers(values):
    return {name: -1.0 if value is None else value for name, value in values.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_a_study_and_score_agree(tmp_path, kind):
    format_name, text = KINDS[kind]
    run = tmp_path / "run"
    run.mkdir()
    (run / "poses.txt").write_text(text)
    (tmp_path / "groundtruth.txt").write_text(tum_text(TRUTH))
    listed = "".join(f"{stamp_s!r} rgb/{k}.png\n" for k, stamp_s in enumerate(TRUTH.stamps_s.tolist()))
    (tmp_path / "rgb.txt").write_text(listed)
    found = normalised(run, Writes("poses.txt", format=format_name), TRUTH.stamps_s.tolist())
    assert found.outcome is Outcome.FINISHED
    (run / ESTIMATE).write_text(estimate_text(found.estimate))
    record = RunRecord("mine", found.outcome, "", COUNT, 1.0)
    of_study = score_run(run, record, TRUTH, protocol=STRICT, monocular=False).content
    for name in ("auto", format_name):
        poses = read_poses_to_compare(run / "poses.txt", tmp_path / "groundtruth.txt", format=name)
        score = score_trajectory(poses.estimate, poses.truth, frames_s=poses.frames.stamps_s)
        assert score.failure == of_study["failure"]
        assert numbers(score.values) == pytest.approx(numbers(of_study[STRICT]), rel=1e-6, abs=1e-9)
    failed = {"late": "no_common_stamps", "of another day": "no_common_stamps"}
    expected = failed.get(kind, "no_poses" if kind in ("header alone", "nothing", "all lost") else "")
    assert of_study["failure"] == expected
    assert of_study[STRICT]["tracked_share"] == (0.0 if expected else len(KEPT) / COUNT)
