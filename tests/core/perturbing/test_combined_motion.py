# SPDX-License-Identifier: GPL-3.0-or-later
"""Exposures, and what combinations of motion keep."""

from small_steps import COMMON, SEQUENCE, steps
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refused

from noisy_world.core.errors import NoisyWorldError
from noisy_world.perturbations.execution import chosen_poses, drawn_motion, move, paired_depth, take_poses
from noisy_world.perturbations.kinds import SceneAround
from noisy_world.perturbations.execution import expose
from noisy_world.perturbations.kinds import ExposurePerturbation, MotionPerturbation, PairingPerturbation
from noisy_world.core.frame_request import Shutter
from noisy_world.core.trajectory import Trajectory, evenly_stamped

# --- exposure ---


def exposing(name, order, apply):
    return ExposurePerturbation(
        **(COMMON | {"name": name, "order": order}), apply=apply, shutter=lambda parameters: Shutter()
    )


def test_exposures_act_one_inside_the_other():
    # The scene shows its own time. The first is a mean of the moments before and after, doubled; the second looks 0.5 s
    # later and adds 10. Around the frame's moment 3: the second takes 2 * (3.4 + 3.6) / 2 = 7.
    def doubled_mean(take, parameters):
        images = [take(seconds).rgb for seconds in (-parameters.amount, parameters.amount)]
        return images[0] + images[1], None

    def later(take, parameters):
        taken = take(parameters.amount)
        assert taken.depth_m is None
        return taken.rgb + np.float32(10), None

    asked = []

    def scene(seconds, _channels):
        asked.append(round(seconds, 9))
        return SimpleNamespace(rgb=np.full((1, 1, 3), 3 + seconds, np.float32), depth_m=None)

    both = exposing("inner", 1, doubled_mean), exposing("outer", 2, later)
    rgb, depth_m = expose(steps(*both, inner={"amount": 0.1}, outer={"amount": 0.5}), SceneAround(scene))
    assert rgb.ravel() == pytest.approx([17.0] * 3)
    assert depth_m is None
    assert asked == [0.4, 0.6]
    # The other way round: each of the two moments is looked at half a second later, and has 10 more.
    other = exposing("outer", 1, later), exposing("inner", 2, doubled_mean)
    rgb, _ = expose(steps(*other, inner={"amount": 0.1}, outer={"amount": 0.5}), SceneAround(scene))
    assert rgb.ravel() == pytest.approx([27.0] * 3)
    assert expose(steps(both[1], outer={"amount": 0.5}), SceneAround(scene))[0].ravel() == pytest.approx([13.5] * 3)


# --- what combinations of motion keep ---


def choosing(name, order, indices):
    return MotionPerturbation(
        **(COMMON | {"name": name, "order": order}), choose=lambda count, parameters, context: np.array(indices)
    )


def test_choices_and_what_was_drawn_follow_one_another():
    drawing = MotionPerturbation(
        **(COMMON | {"name": "drawing", "order": 1}),
        apply=lambda path, parameters, context: path,
        drawn=lambda count, parameters, context: {"number": np.arange(count) * 1.0},
    )
    # Of six: 5, 1, 3, 0. Of these four: the last, the first, the second.
    made = steps(drawing, choosing("first", 2, [5, 1, 3, 0]), choosing("second", 3, [3, 0, 1]))
    assert chosen_poses(made, 6, SEQUENCE).tolist() == [0, 5, 1]
    assert drawn_motion(made, 6, SEQUENCE)["drawing"]["number"].tolist() == [0.0, 5.0, 1.0]
    # What is drawn after a choice is drawn for the poses that are left.
    late = replace(drawing, order=9)
    made = steps(choosing("first", 2, [5, 1, 3, 0]), late)
    assert drawn_motion(made, 6, SEQUENCE)["drawing"]["number"].tolist() == [0.0, 1.0, 2.0, 3.0]
    pairs = [
        PairingPerturbation(
            **(COMMON | {"name": name, "order": order}), apply=lambda count, parameters, context, of=of: np.array(of)
        )
        for name, order, of in (("one", 1, [3, 2, -1, 0]), ("two", 2, [1, 2, 3, 0]))
    ]
    # Frame 0 takes the pair of frame 1, which is depth 2; frame 1 takes that of 2, which is out; 2 was out itself.
    assert paired_depth(steps(*pairs), 4, SEQUENCE).tolist() == [2, -1, -1, 3]


RAISED = np.zeros((4, 4))
RAISED[2, 3] = 1.0


def test_poses_that_are_moved_apart_have_nothing_between_them():
    path = evenly_stamped(np.tile(np.eye(4), (4, 1, 1)), 10.0)
    apart = MotionPerturbation(**(COMMON | {"name": "apart"}), apply=lambda path, parameters, context: path)
    smooth = replace(apart, name="smooth", continuous=True)
    moved = move(steps(apart), path.followed(np.array([0, 2])), SEQUENCE)
    assert moved.independent == "apart moves each pose by itself"
    refused(moved.pose_at, 0.05, names="between the frames: apart moves", error=NoisyWorldError)
    up = MotionPerturbation(
        **(COMMON | {"name": "up"}), apply=lambda path, parameters, context: replace(path, c2w=path.c2w + RAISED)
    )
    anew = replace(up, apply=lambda path, parameters, context: Trajectory(path.c2w, path.stamps_s))
    cut = move(steps(anew), replace(path, shots=np.array([0, 0, 1, 1])), SEQUENCE)
    assert [cut.cuts_between(k, k + 1) for k in range(3)] == [False, True, False]  # no camera flies between two
    raised = move(steps(up), path.followed(np.array([0, 2])), SEQUENCE)  # no curve is left of the path before
    np.testing.assert_array_equal(raised.continuous.pose_at(raised.stamps_s), raised.c2w)
    # What is shown of it afterwards has nothing between its poses either.
    shown = take_poses(move(steps(apart), path, SEQUENCE), np.array([0, 2]))
    refused(shown.pose_at, 0.05, names="between the frames: apart moves", error=NoisyWorldError)
    np.testing.assert_array_equal(move(steps(smooth), path, SEQUENCE).pose_at(0.05), np.eye(4))
