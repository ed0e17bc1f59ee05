# SPDX-License-Identifier: GPL-3.0-or-later
"""Which frame shows which, against mappings worked out by hand and by brute force."""

from dataclasses import dataclass

import numpy as np
import pytest
from refusals import refused
from worlds import write_world

from noisy_world.dataset.plan import make_plan, plan_notes
from noisy_world.preset.keys import read_preset
from noisy_world.perturbations.kinds import MotionPerturbation
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.steps import Setting
from noisy_world.dataset.sequence import Shown, lay_out, written_paths
from noisy_world.core.schema import ConfigPath, key
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import Trajectory
from noisy_world.perturbations import registry

NAMES = (7, "room", "setting")


@dataclass(frozen=True)
class Order:
    """Which poses, given outright."""

    shift: int = key("nothing", default=0, minimum=0, maximum=9)


def choosing(name, order, indices):
    """A perturbation of motion that shows these poses."""
    return MotionPerturbation(
        name=name, label=name, parameters=Order, severities={}, source="here", order=order,
        choose=lambda count, parameters, context: np.array(indices),
    )  # fmt: skip


def moving(name, order):
    return MotionPerturbation(
        name=name, label=name, parameters=Order, severities={}, source="here", order=order,
        apply=lambda path, parameters, context: path,
    )  # fmt: skip


def sequence(perturb, count, chosen=None, more=()):
    known = dict(registry()) | {item.name: item for item in more}
    return lay_out(Setting("setting", parse_steps(perturb, ConfigPath("test"), known)), "room", count, NAMES, chosen)


def test_a_plain_sequence_shows_each_frame_once():
    plain = sequence([], 4)
    assert [plain.shown(k) for k in range(4)] == [Shown(k, k, k) for k in range(4)]
    assert (plain.skips, plain.paired, plain.frames) == (False, False, range(4))
    assert sequence([], 4, slice(1, 3)).frames == range(1, 3)
    assert sequence([], 4, slice(1, 3)).sources(["rgb", "depth"]) == range(1, 3)


def test_speed_and_desynchronisation_by_hand():
    # Every third of ten: 0 3 6 9. Depth of the frame after next goes with each; the last ones take the last.
    both = [{"desync": {"offset": 2}}, {"faster_motion": {"factor": 3}}]
    shown = sequence(both, 10)
    assert [shown.shown(k) for k in range(4)] == [Shown(0, 6, 2), Shown(3, 9, 3), Shown(6, 9, 3), Shown(9, 9, 3)]
    assert shown.showing("depth", 9) == [1, 2, 3]
    assert shown.showing("rgb", 9) == [3]
    assert shown.showing("depth", 3) == []
    assert shown.sources(["depth"]) == range(6, 10, 3)
    both[0]["desync"]["edge"] = "drop"
    dropped = sequence(both, 10)
    assert dropped.frames == range(2)
    assert dropped.leaves_out(2)
    refused(dropped.shown, 2, names="setting/room: frame 2 is left out", error=ValueError)
    assert dropped.sources(["rgb", "depth"]) == range(0, 10, 3)
    # Chosen frames keep their own pairs: depth of the frame before, so that the first one has none.
    early = [{"desync": {"offset": -1, "edge": "drop"}}]
    assert list(sequence(early, 6, slice(1, 4)).frames) == [1, 2, 3]
    assert list(sequence(early, 6, slice(0, 2)).frames) == [1]
    assert sequence(early, 6, slice(1, 4)).sources(["depth"]) == range(3)


def test_depth_of_another_frame_is_what_a_slow_sensor_had_by_then():
    """Frames 0 and 1 show one exposure, 2 to 4 the next: one frame later, frame 1 has that of 2, and 3 that of 4."""
    repeats, known = np.array([0, 0, 2, 2, 2, 5]), registry()

    def paired(**values):
        steps = parse_steps([{"desync": values}], ConfigPath("test"), known)
        shown = lay_out(Setting("setting", steps), "room", 6, NAMES, clocked=True, repeats=repeats)
        return [-1 if shown.leaves_out(frame) else shown.shown(frame).depth_frame for frame in range(6)]

    assert paired(offset=1) == [0, 2, 2, 2, 5, 5]
    assert paired(offset=1, edge="drop") == [0, 2, 2, 2, 5, -1]
    assert paired(offset=-1) == [0, 0, 0, 2, 2, 2]
    assert paired(offset=-2, edge="drop") == [-1, -1, 0, 0, 2, 2]


@pytest.mark.parametrize("indices", [[4, 4, 0, 2, 2], [1], [5, 4, 3, 2, 1, 0], [3, 1]])
def test_who_shows_what_is_the_inverse_of_what_is_shown(indices):
    shown = sequence([{"pick": {}}, {"desync": {"offset": -1}}], 6, more=[choosing("pick", 30, indices)])
    for source in range(6):
        for modality, name in (("rgb", "rgb_source"), ("depth", "depth_source")):
            expected = [k for k in range(len(indices)) if getattr(shown.shown(k), name) == source]
            assert shown.showing(modality, source) == expected
        before = [value for value in indices if value <= source]
        expected = indices.index(max(before)) if before else 0
        assert shown.frame_at(source) == expected


def test_a_choice_before_poses_move_shortens_the_path_that_is_rendered():
    steps = [{"halve": {}}, {"shake": {}}, {"last_two": {}}]
    more = [choosing("halve", 1, [0, 2, 4, 6]), moving("shake", 2), choosing("last_two", 3, [2, 3])]
    assert sequence(steps, 8, more=more).source_frames == range(2, 4)  # of the four that are rendered


def test_poses_and_stamps_of_the_frames():
    c2w = np.tile(np.eye(4), (7, 1, 1))
    c2w[:, 0, 3] = np.arange(7)
    stamps_s = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.7, 1.0])
    fast = sequence([{"faster_motion": {"factor": 3}}], 7)
    paths = written_paths(
        fast, SensorPaths(Trajectory(c2w, stamps_s), nominal=Trajectory(2 * c2w - np.eye(4), stamps_s))
    )
    assert paths.rgb.c2w[:, 0, 3].tolist() == [0, 3, 6]
    assert paths.rgb.stamps_s.tolist() == [0.0, 0.1, 0.25]  # the camera's rate stays
    assert list(paths.named()) == ["rgb", "nominal"]
    assert paths.nominal.c2w[:, 0, 3].tolist() == [0, 6, 12]


def test_a_pairing_that_reaches_beyond_all_frames_is_told(tmp_path):
    settings = [
        {"name": "late", "perturb": [{"desync": {"offset": -4}}]},
        {"name": "early", "perturb": [{"desync": {"offset": 4}}]},
        {"name": "near", "perturb": [{"desync": {"offset": -2}}]},
    ]
    plan = make_plan(read_preset(write_world(tmp_path, frames=4, settings=settings)))
    told = [text for text in plan_notes(plan) if "paired" in text]
    (scene,) = {sequence.scene for sequence in plan.sequences}
    said = f"late/{scene}: depth is paired from beyond its 4 frames, so all have the same"
    assert told == [f"{said}, like 1 more sequence"]
