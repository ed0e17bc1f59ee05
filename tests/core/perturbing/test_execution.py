# SPDX-License-Identifier: GPL-3.0-or-later
"""What an execution makes of steps of each kind, and what it refuses: expected values are written out by hand."""

from small_steps import BY_SEVERITY, SEQUENCE, WHERE, adding, colour, depth, motion, pairing, steps
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
from refusals import refused

from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.geometry import Intrinsics
from noisy_world.perturbations.execution import (
    ColourWork,
    chosen_poses,
    move,
    paired_depth,
    perturb_depth,
    perturb_rgb,
    split_motion,
    take_poses,
)
from noisy_world.perturbations.kinds import SequenceContext
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.steps import Setting
from noisy_world.core.schema import ConfigPath, key
from noisy_world.core.streams import stream
from noisy_world.core.camera_motion import CameraMotion
from noisy_world.core.trajectory import Trajectory, evenly_stamped

# --- colour ---


@pytest.mark.parametrize("kind", [np.float32, np.uint8])
def test_colour_is_clipped_between_two_steps(kind):
    # 0.6 + 0.7 is cut to 1 and comes back as 0.3; without the cut it would be 0.6 again. Below zero likewise.
    rgb = np.full((4, 5, 3), 0.6, np.float32) if kind is np.float32 else np.full((4, 5, 3), 153, np.uint8)
    up = steps(colour("a", adding), colour("b", adding), a={"amount": 0.7}, b={"amount": -0.7})
    made, _ = perturb_rgb(up, rgb, WHERE)
    assert np.array_equal(made, np.full((4, 5, 3), round(0.3 * 255)))
    down = steps(colour("a", adding), colour("b", adding), a={"amount": -0.7}, b={"amount": 0.7})
    made, _ = perturb_rgb(down, rgb, WHERE)
    assert np.array_equal(made, np.full((4, 5, 3), round(0.7 * 255)))


def test_colour_is_not_rounded_between_two_steps():
    # Two steps of a third of 1/255 are lost, or double, where bytes lie between.
    third = {"amount": 1 / 765}
    made, _ = perturb_rgb(
        steps(colour("a", adding), colour("b", adding), a=third, b=third), np.full((2, 2, 3), 100, np.uint8), WHERE
    )
    assert np.array_equal(made, np.full((2, 2, 3), 101))


def test_what_is_brighter_than_white_passes_between_steps_on_a_sensor_s_light_alone():
    """Of .8 + .7 the next step sees 1.5 where both act on light in the sensor, else 1."""
    seen = []

    def looking(rgb, parameters, _context):
        seen.append(float(rgb[0, 0, 0]))
        return rgb + np.float32(parameters.amount)

    for first, second, wanted in ((True, True, 1.5), (False, True, 1.0), (True, False, 1.0), (False, False, 1.0)):
        made = steps(
            colour("first", looking, order=1, on_light=first),
            colour("second", looking, order=2, on_light=second),
            first={"amount": 0.7},
            second={"amount": -0.9},
        )
        seen.clear()
        found, _ = perturb_rgb(made, np.full((1, 1, 3), 0.8, np.float32), WHERE)
        assert seen == pytest.approx([0.8, wanted])
        assert found is not None
        assert found.ravel() == pytest.approx([255 * (wanted - 0.9)] * 3, abs=0.51)


def test_float_colour_is_rounded_before_a_single_step_on_bytes():
    # 100.4 is rounded to 100 and doubled, to 200; unrounded it would be 200.8, rounded to 201. Of two steps the first
    # takes it unrounded: another 0.4 makes it 201.2.
    double = colour("a", lambda rgb, *_: rgb * 2, apply_bytes=lambda rgb, *_: rgb * 2)
    rgb = np.full((2, 2, 3), 100.4 / 255, np.float32)
    assert (perturb_rgb(steps(double), rgb, WHERE)[0] == 200).all()
    both = steps(double, colour("b", adding), b={"amount": 0.4 / 255})
    assert (perturb_rgb(both, rgb, WHERE)[0] == 201).all()


def test_equal_perturbations_act_in_the_order_given_and_others_in_theirs():
    def note(rgb, parameters, _context):
        acted.append(parameters.amount)
        return rgb.copy()

    first, second = colour("z_first", note, order=5), colour("a_second", note, order=7)
    known = {item.name: item for item in (second, first)}
    asked = [{"a_second": {"amount": 3}}, {"z_first": {"amount": 2}}, {"z_first": {"amount": 1}}]
    acted = []
    perturb_rgb(parse_steps(asked, ConfigPath("x"), known), np.zeros((2, 2, 3), np.uint8), WHERE)
    assert acted == [2, 1, 3]


def colour_of(made):
    perturb_rgb(steps(colour("odd", lambda *_: made)), np.zeros((2, 2, 3), np.uint8), WHERE)


def depth_of(made):
    perturb_depth(steps(depth("odd", lambda *_: made)), np.ones((2, 2), np.float32), WHERE)


def motion_of(apply):
    move(steps(motion("odd", apply=apply)), straight(4), SEQUENCE)


def choice_of(made):
    chosen_poses(steps(motion("odd", choose=lambda *_: made)), 4, SEQUENCE)


def pairing_of(made):
    paired_depth(steps(pairing("odd", lambda *_: np.array(made))), 3, SEQUENCE)


IMAGES = (np.zeros((2, 2, 3)), np.zeros((2, 3, 3), np.float32), None)
INDICES = [np.array(chosen, np.int64) for chosen in ([0, 4], [-1, 0], [], [0, 1, 2, 3, 3], [[0, 1]])]
PAIRS = ([0, 1, 4], [0, -2, 1], [0, 1], [0.0, 1.0, 2.0])


@pytest.mark.parametrize(
    ("give", "wrong", "named"),
    [
        *((colour_of, made, ("apply", "float32", "shape (2, 2, 3)")) for made in IMAGES),
        *((depth_of, made, ("apply", "float32", "shape (2, 2)")) for made in IMAGES),
        (motion_of, lambda path, *_: evenly_stamped(path.c2w[:-1], 2.0), ("3 poses of 4", "time stamps")),
        (motion_of, lambda path, *_: Trajectory(path.c2w, path.stamps_s + 1), ("4 poses of 4", "time stamps")),
        *((choice_of, made, ("choose", "1 to 4 whole", "0 to 3")) for made in (*INDICES, np.array([0.0, 1.0]), "ab")),
        *((pairing_of, made, ("apply", "3 whole numbers", "from -1 to 2")) for made in PAIRS),
    ],
)
def test_what_a_perturbation_may_not_give_names_it(give, wrong, named):
    refused(give, wrong, names=("odd: ", *named), error=NoisyWorldError)


# --- what a step is told ---


def test_a_step_is_given_the_other_image_only_where_it_asks_for_it():
    told = []

    def look(image, _parameters, context):
        told.append(context)
        return image.copy()

    rgb, depth_m = np.full((2, 2, 3), 0.5, np.float32), np.full((2, 2), 2, np.float32)
    camera = Intrinsics(2, 2, 1.0, 1.0, 0.5, 0.5)
    where = replace(WHERE, stamp_s=1.5, intrinsics=camera, read_rgb=lambda: rgb, read_depth_m=lambda: depth_m)
    perturb_rgb(steps(colour("a", look), colour("b", look, needs_depth=True)), rgb, where)
    perturb_depth(steps(depth("c", look), depth("d", look, needs_rgb=True)), depth_m, where)
    alone, with_depth, plain, with_rgb = told
    assert np.array_equal(with_depth.depth_m, depth_m)
    assert np.array_equal(with_rgb.rgb, rgb)
    for context, name in ((alone, "depth_m"), (with_depth, "rgb"), (plain, "rgb"), (with_rgb, "depth_m")):
        refused(getattr, context, name, names=f"needs_{name.removesuffix('_m')}", error=TypeError)
    for context in told:
        assert (context.index, context.stamp_s, context.intrinsics) == (3, 1.5, camera)
    with pytest.raises(ValueError, match="read-only"):
        with_rgb.rgb[0] = 0
    assert alone.identifiers == (*SEQUENCE, "a", 0)
    assert with_rgb.stream("x").random() == stream(*SEQUENCE, "d", 0, "x", frame=3).random()


def test_what_a_step_needs_and_is_not_there_is_named():
    needing_depth, needing_rgb = colour("odd", adding, needs_depth=True), depth("odd", adding, needs_rgb=True)
    rgb, depth_m = np.zeros((2, 2, 3), np.uint8), np.ones((2, 2), np.float32)
    refused(perturb_rgb, steps(needing_depth), rgb, WHERE, names=("odd ", "depth"), error=TypeError)
    refused(perturb_depth, steps(needing_rgb), depth_m, WHERE, names=("odd ", "colour"), error=TypeError)


def test_a_sequence_has_a_stream_for_each_frame_and_one_of_its_own():
    context = SequenceContext((*SEQUENCE, "a", 0))
    assert context.stream("x", frame=5).random() == stream(*SEQUENCE, "a", 0, "x", frame=5).random()
    assert context.stream("x").random() == stream(*SEQUENCE, "a", 0, "x", "sequence").random()


def test_contexts_are_equal_where_their_randomness_is():
    # A pattern that is kept for a sequence is found again by its context, whatever images the frame has.
    other = replace(WHERE, stamp_s=2.0, read_rgb=lambda: np.zeros(1, np.float32))
    assert other == WHERE
    assert hash(other) == hash(WHERE)
    assert replace(WHERE, temporal="fixed") != WHERE


# --- motion ---


def straight(count):
    c2w = np.tile(np.eye(4), (count, 1, 1))
    c2w[:, 0, 3] = np.arange(count)
    return Trajectory(c2w, 10.0 + 0.5 * np.arange(count))


def raising(trajectory, parameters, _context):
    c2w = trajectory.c2w.copy()
    c2w[:, 2, 3] += parameters.amount
    return Trajectory(c2w, trajectory.stamps_s)


LIFT = motion("lift", 20, apply=raising)
THIRDS = motion("thirds", 10, choose=lambda count, *_: np.arange(0, count, 3))
BACK = motion("back", 30, choose=lambda count, *_: np.arange(count)[::-1])


def test_motion_is_carried_out_in_order():
    done = steps(BACK, LIFT, THIRDS, lift={"amount": 5.0})
    assert [step.perturbation.name for step in done] == ["thirds", "lift", "back"]
    moving, choosing = split_motion(done)
    assert ([step.perturbation.name for step in moving], [step.perturbation.name for step in choosing]) == (
        ["thirds", "lift"], ["back"],
    )  # fmt: skip
    moved = move(moving, straight(8), SEQUENCE)
    assert moved.c2w[:, 0, 3].tolist() == [0, 3, 6]
    assert moved.c2w[:, 2, 3].tolist() == [5, 5, 5]
    assert moved.stamps_s.tolist() == [10, 10.5, 11]
    assert chosen_poses(moving, 8, SEQUENCE).tolist() == [0, 3, 6]
    assert chosen_poses(choosing, 3, SEQUENCE).tolist() == [2, 1, 0]
    assert chosen_poses(done, 8, SEQUENCE).tolist() == [6, 3, 0]
    whole = move(done, straight(8), SEQUENCE)
    assert whole.c2w[:, 0, 3].tolist() == [6, 3, 0]
    assert whole.stamps_s.tolist() == [10, 10.5, 11]


def test_a_choice_between_two_that_move_poses_is_rendered_with_them():
    again = motion("again", 25, apply=raising)
    moving, choosing = split_motion(steps(LIFT, motion("half", 22, choose=THIRDS.choose), again, BACK))
    assert [step.perturbation.name for step in moving] == ["lift", "half", "again"]
    assert [step.perturbation.name for step in choosing] == ["back"]


def test_motion_without_a_choice_shows_every_pose():
    assert chosen_poses(steps(LIFT), 5, SEQUENCE) is None
    assert take_poses(straight(5), None).c2w.shape == (5, 4, 4)
    assert split_motion(steps(BACK))[0] == ()


def test_severity_0_leaves_path_and_pairing_alone():
    lift, back = motion("lift", apply=raising, **BY_SEVERITY), motion("back", choose=BACK.choose, **BY_SEVERITY)
    late = pairing("late", lambda count, *_: np.zeros(count, np.int64), **BY_SEVERITY)
    nothing = steps(lift, back, late, lift={"severity": 0}, back={"severity": 0}, late={"severity": 0})
    setting = Setting("s", nothing)
    assert split_motion(setting.motion) == ((), ())
    assert np.array_equal(move(setting.motion, straight(4), SEQUENCE).c2w, straight(4).c2w)
    assert chosen_poses(setting.motion, 4, SEQUENCE) is None
    assert paired_depth(setting.pairing, 4, SEQUENCE) is None
    (step,) = steps(lift, lift={"severity": 4})
    assert move([step], straight(2), SEQUENCE).c2w[:, 2, 3].tolist() == [4, 4]


# --- pairing ---


def test_a_later_pairing_shifts_what_the_first_has_paired():
    late = pairing("late", lambda count, *_: np.array([1, 2, 3, -1]), order=10)
    back = pairing("back", lambda count, *_: np.arange(count)[::-1], order=20)
    assert paired_depth(steps(late), 4, SEQUENCE).tolist() == [1, 2, 3, -1]
    # Frame 0 now takes what frame 3 had, which was nothing; frame 3 was left out and stays so.
    assert paired_depth(steps(late, back), 4, SEQUENCE).tolist() == [-1, 3, 2, -1]
    dropping = pairing("dropping", lambda count, *_: np.array([3, -1, 1, 0]), order=20)
    assert paired_depth(steps(late, dropping), 4, SEQUENCE).tolist() == [-1, -1, 2, -1]
    assert paired_depth((), 4, SEQUENCE) is None


# --- what presets and authors may not say ---


def test_what_acts_on_a_sequence_acts_once_and_at_one_severity():
    known = {"lift": motion("lift", apply=raising, **BY_SEVERITY)}
    for given, named in (
        ([{"lift": None}, {"lift": None}], ("1: ", "lift", "twice")),
        ([{"lift": {"mode": "dynamic"}}], ("0.lift.mode: ", "dynamic", "whole sequence")),
    ):
        refused(parse_steps, given, ConfigPath("x"), known, names=named)


@dataclass(frozen=True)
class _Mode:
    mode: int = key("m", default=1)


@dataclass(frozen=True)
class _Listed:
    values: list = key("m", default=())


@dataclass(frozen=True)
class _Needed:
    amount: float = key("m")


@dataclass(frozen=True)
class _Undescribed:
    amount: float = 1.0


FIVE = (1, 2, 3, 4, 5)


@pytest.mark.parametrize(
    ("define", "wrong", "named"),
    [
        (partial(colour, "Fog", adding), {}, "'Fog'"),
        (partial(colour, "a.b", adding), {}, "'a.b'"),
        (partial(colour, "a", adding), {"parameters": int}, ("parameters", "dataclass")),
        (partial(colour, "a", adding), {"parameters": _Listed}, ("parameter values", "float")),
        (partial(colour, "a", adding), {"parameters": _Needed}, ("parameter amount", "key(...)", "default")),
        (partial(colour, "a", adding), {"parameters": _Undescribed}, ("parameter amount", "key(...)", "default")),
        (partial(colour, "a", adding), {"severities": {"amount": (1, 2)}}, "5 severities"),
        (partial(colour, "a", adding), {"severities": {"other": FIVE}}, "parameter"),
        (partial(colour, "a", adding), {"parameters": _Mode, "severities": {"mode": FIVE}}, "called mode"),
        (partial(colour, "a", adding), {"stage": "depth"}, ("'depth'", "environment, lens, sensor, post")),
        (partial(colour, "a", adding), {"stage": "nowhere"}, "'nowhere'"),
        (partial(motion, "a"), {}, ("apply", "choose")),
        (partial(motion, "a"), {"apply": raising, "choose": BACK.choose}, ("apply", "choose")),
        (partial(motion, "a"), {"apply": raising, "temporals": ("fresh",)}, "temporals"),
        (partial(pairing, "a", BACK.choose), {"temporals": ("fresh",)}, "temporals"),
    ],
)
def test_a_definition_that_cannot_be_is_refused(define, wrong, named):
    refused(define, **wrong, names=named, error=ValueError)


def test_work_is_shared_only_where_all_that_it_looks_at_is_equal():
    def moving(velocity_m_s):
        return CameraMotion(np.eye(4), np.eye(4), np.array([velocity_m_s, 0.0, 0.0]), np.zeros(3))

    def same(rgb, _parameters, _context):
        return rgb

    base = replace(WHERE, motion=moving(1.0))
    others = {
        "index": replace(base, index=4),
        "setting": replace(base, identifiers=(7, "room", "other")),
        "motion": replace(base, motion=moving(2.0)),
        "unknown motion": replace(base, motion=None),
    }
    wanted = {
        "looks": (colour("looks", same, uses_motion=True), set(others)),
        "draws": (colour("draws", same), {"index", "setting"}),
        "repeats": (colour("repeats", same, repeatable=True), set()),
    }
    for name, (perturbation, differ) in wanted.items():
        made = steps(perturbation)
        key_of = ColourWork.of(made, base).key
        assert ColourWork.of(made, replace(base, motion=moving(1.0))).key == key_of
        assert {what for what, where in others.items() if ColourWork.of(made, where).key != key_of} == differ, name
        assert ColourWork.of(steps(perturbation, **{name: {"amount": 2.0}}), base).key != key_of
    drifting = colour("drifting", same, temporals=("fresh", "fixed", "drift"))
    keys = {
        ColourWork.of(steps(drifting, drifting={"temporal": temporal}), base).key
        for temporal in ("fresh", "fixed", "drift")
    }
    assert len(keys) == 3
