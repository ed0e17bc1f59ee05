# SPDX-License-Identifier: GPL-3.0-or-later
"""A rolling shutter of some thirty lines, in a package of its own: the proof that frames are requests in time.

The camera turns and goes steadily, so the pose of each row is known in closed form, and so is the room's depth there.
"""

import json

import cv2
import installed_package
import numpy as np
import pytest
from refusals import refused
from analytic import box_depth
from cases import cases
from worlds import HIGH, LOW, write_replica, write_world
from runs import run
from written import stored

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")

import noisy_world.dataset.plan
from steady_camera import poses_at

from noisy_world.core.errors import StorageError
from noisy_world.core.geometry import Intrinsics
from noisy_world.perturbations.kinds import MotionPerturbation
from noisy_world.preset.keys import read_preset
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped.faster_motion import FasterMotion
from noisy_world.dataset.plan import make_plan

COUNT, RATE_HZ, SCALE = 6, 20.0, 6553.5
SIZE = (32, 24)
CAMERA = Intrinsics(*SIZE, 16.0, 16.0, 15.5, 11.5)

ROLLING = '''
"""Rows are seen one after another."""

from dataclasses import dataclass

import numpy as np

from noisy_world.extend import ExposurePerturbation, Shutter, key


@dataclass(frozen=True)
class RollingShutter:
    """How long the rows take."""

    readout_s: float = key("from the first row to the last", unit="s", default=0.03, minimum=0, maximum=1)


def shutter(parameters):
    return Shutter.centred(0.0, parameters.readout_s)


def apply(take, parameters):
    made = [None, None]
    height = next(image.shape[0] for image in (take(0.0).rgb, take(0.0).depth_m) if image is not None)
    for row, time_s in enumerate(shutter(parameters).line_times_s(height)):
        for number, image in enumerate((take(time_s).rgb, take(time_s).depth_m)):
            if image is not None:
                made[number] = np.empty_like(image) if row == 0 else made[number]
                made[number][row] = image[row]
    return tuple(made)


PERTURBATION = ExposurePerturbation(
    name="rolling", label="Rolling shutter", order=10, parameters=RollingShutter, source="none", apply=apply,
    shutter=shutter, severities={"readout_s": (0.01, 0.02, 0.03, 0.04, 0.05)},
)
'''


@pytest.fixture(scope="module", autouse=True)
def rolling(tmp_path_factory):
    modules = {"__init__.py": "", "rolling.py": ROLLING}
    site = installed_package.install(
        tmp_path_factory.mktemp("site"), "slow-sensors", "0.1", {"all": "slow_sensors.rolling:PERTURBATION"}, modules
    )
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(str(site))
        registry.cache_clear()
        yield
    registry.cache_clear()


def world(folder, settings, *, count=COUNT, **keys):
    preset = write_world(
        folder,
        size=SIZE,
        settings=settings,
        render={"engine": "embree", "backend": "reference"},
        output={"layout": "replica", "image": "png"},
        **keys,
    )
    write_replica(folder / "traj.txt", poses_at(np.arange(count) / RATE_HZ))
    return preset


def setting(name, readout_s, *more):
    return {"name": name, "perturb": [{"rolling": {"readout_s": readout_s}}, *more]}


def steps_of(out, name, frame):
    return cv2.imread(str(out / name / f"box/results/depth{frame:06d}.png"), cv2.IMREAD_UNCHANGED)


def rolled_m(frame, readout_s, *, factor=1):
    """Planar depth of a frame, each row from its own pose; NaN where a pixel is at an edge of the room."""
    height = CAMERA.height_px
    rows = []
    for row in range(height):
        time_s = frame / RATE_HZ + readout_s * ((row + 0.5) / height - 0.5)
        depth_m, sure = box_depth(CAMERA, poses_at(factor * time_s), LOW, HIGH)
        rows.append(np.where(sure, depth_m, np.nan)[row])
    return np.stack(rows)


def assert_shows(steps, wanted_m):
    known = np.isfinite(wanted_m)
    assert known.mean() > 0.6  # the rest is at an edge of the room
    assert np.abs(steps[known] / SCALE - wanted_m[known]).max() < 0.5 / SCALE + 2e-5


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    settings = [
        {"name": "clean"},
        setting("rolling", 0.03),
        {"name": "cast", "perturb": [{"rolling_shutter": {"readout_ms": 30}}]},
        setting("rolling_dark", 0.03, {"brightness": {"severity": 2}}),
        setting("faster", 0.03, {"faster_motion": {"factor": 2}}),
        setting("twice", 0.03, {"faster_motion": {"factor": 2}}, {"gaussian_noise": {"severity": 1}}),
    ]
    preset = world(folder / "world", settings)
    return preset, folder / "out", run(preset, folder / "out")


def test_each_row_is_seen_from_its_own_pose(made):
    _, out, _ = made
    for frame in (0, 3, COUNT - 1):  # the first and the last look beyond the ends of the path
        assert_shows(steps_of(out, "rolling", frame), rolled_m(frame, 0.03))
        assert_shows(steps_of(out, "clean", frame), rolled_m(frame, 0.0))
    assert (steps_of(out, "rolling", 3) != steps_of(out, "clean", 3)).mean() > 0.5


def test_a_camera_twice_as_fast_is_skewed_twice_as_much(made):
    _, out, _ = made
    for frame in (0, 1, 2):
        assert_shows(steps_of(out, "faster", frame), rolled_m(frame, 0.03, factor=2))
    assert (steps_of(out, "faster", 1) != steps_of(out, "rolling", 2)).any()


def test_what_is_exposed_alike_is_rendered_once(made):
    _, out, report = made
    assert report.frames_rendered == 3 * COUNT + COUNT // 2
    for frame in range(COUNT):
        names = [out / name / f"box/results/depth{frame:06d}.png" for name in ("rolling", "rolling_dark")]
        assert names[0].samefile(names[1])


def test_renders_are_shared_by_poses_and_moments_not_by_their_number(tmp_path, monkeypatch):
    # Three of six poses each: 0, 2, 4 twice, and 1, 3, 5. Equal readouts are shared along equal poses alone.
    odd = MotionPerturbation(
        name="odd", label="Odd", order=20, parameters=FasterMotion, severities={}, source="here",
        choose=lambda count, parameters, context: np.arange(1, count, parameters.factor),
    )  # fmt: skip
    known = {**registry(), "odd": odd}
    monkeypatch.setattr(noisy_world.dataset.plan, "registry", lambda: known)
    settings = [
        setting("faster", 0.03, {"faster_motion": {"factor": 2}}),
        setting("odd", 0.03, {"odd": {"factor": 2}}),
        setting("same", 0.03, {"faster_motion": {"factor": 2}}, {"brightness": {"severity": 2}}),
        setting("quick", 0.01, {"faster_motion": {"factor": 2}}),
        setting("all", 0.03),
        {"name": "instants", "perturb": [{"odd": {"factor": 2}}]},
        {"name": "none", "perturb": [{"rolling": {"severity": 0}}, {"faster_motion": {"factor": 2}}]},
    ]
    plan = make_plan(read_preset(world(tmp_path, settings)))
    shared = [{sequence.setting.name for sequence in render.sequences} for render in plan.renders]
    assert sorted(map(sorted, shared)) == [["all"], ["faster", "same"], ["instants", "none"], ["odd"], ["quick"]]
    for render in plan.renders:
        # Exposed, the chosen poses are a path of their own; instants are frames of the scene's path.
        names = {sequence.setting.name for sequence in render.sequences}
        assert len(render.frames) == (6 if names & {"all", "instants"} else 3)


def test_records_say_when_the_rows_were_exposed(made):
    _, out, _ = made
    line = json.loads((out / "rolling_dark/box/frames.jsonl").read_text().splitlines()[2])
    (told,) = line["perturbed"]["exposure"]
    assert (told["name"], told["parameters"]) == ("rolling", {"readout_s": 0.03})
    assert told["shutter"] == {"opens_s": -0.015, "exposure_s": 0.0, "readout_s": 0.03, "direction": "down"}
    np.testing.assert_allclose(np.loadtxt(out / "rolling/box/traj.txt")[2].reshape(4, 4), poses_at(2 / RATE_HZ))


def test_rays_that_are_cast_row_by_row_make_the_same_frames(made):
    _, out, _ = made
    for frame in (0, 3, COUNT - 1):
        assert_shows(steps_of(out, "cast", frame), rolled_m(frame, 0.03))
        assert np.abs(steps_of(out, "cast", frame).astype(int) - steps_of(out, "rolling", frame)).max() <= 1
    line = json.loads((out / "cast/box/frames.jsonl").read_text().splitlines()[2])
    (told,) = line["perturbed"]["exposure"]
    assert told["shutter"] == {"opens_s": -0.015, "exposure_s": 0.0, "readout_s": 0.03, "direction": "down"}
    half_s = 0.015 * (1 - 1 / SIZE[1])  # the rows' own moments are in the middle of their parts
    for name, after_s in (("first", -half_s), ("middle", 0.0), ("last", half_s)):
        assert told["lines"][name]["after_s"] == pytest.approx(after_s, abs=1e-12)
        np.testing.assert_allclose(told["lines"][name]["c2w"], poses_at(2 / RATE_HZ + after_s), atol=1e-9)


def test_an_engine_that_casts_no_rays_is_refused(tmp_path):
    preset = world(tmp_path, [{"name": "cast", "perturb": [{"rolling_shutter": {"readout_ms": 30}}]}])
    names = ["cast: rolling_shutter", "render.engine: embree"]
    refused(run, preset, tmp_path / "out", overrides=["render.engine=cycles"], names=names)


def test_another_readout_is_never_stale(made, tmp_path):
    preset, out, _ = made
    other = world(tmp_path, [setting("rolling", 0.01)])
    refused(run, other, out, names="rolling (readout_s) was 0.03, is 0.01", error=StorageError)
    again = run(preset, out)
    assert (again.frames_rendered, again.frames_kept) == (0, 3 * COUNT + COUNT // 2)


def test_a_path_that_goes_another_way_between_the_same_poses_is_told_apart(made, tmp_path):
    _, out, _ = made
    preset = world(tmp_path, [setting("rolling", 0.03)])
    bent = poses_at(np.repeat(np.arange(COUNT), 2) / RATE_HZ)
    bent[1::2, 2, 3] += 0.1
    write_replica(tmp_path / "traj.txt", bent)
    every = ["scenes.0.trajectory={file: traj.txt, every: 2, rate_hz: 40}"]
    refused(run, preset, out, overrides=every, names=["scenes.0: ", "another way"], error=StorageError)
    assert run(world(tmp_path / "clean", [{"name": "clean"}]), out).frames_rendered == 0
    # It is still known, though that run did not look.
    refused(run, preset, out, overrides=every, names=["scenes.0: ", "another way"], error=StorageError)


def test_a_longer_path_moves_what_is_between_its_poses(made, tmp_path):
    _, out, _ = made
    longer = world(tmp_path / "longer", [setting("rolling", 0.03)], count=COUNT + 2)
    refused(run, longer, out, names=["scenes.0.trajectory: ", "box"], error=StorageError)


@cases("motion", [{"motion_deviation": {"rotation_deg": 1}}])
def test_poses_that_are_drawn_apart_have_nothing_between_them(tmp_path, motion):
    shaky = world(tmp_path, [setting("shaky", 0.03, motion)])
    refused(run, shaky, tmp_path / "out", names=["settings: shaky: rolling ", "motion_deviation"])
    # An instant is no exposure.
    run(world(tmp_path, [{"name": "shaky", "perturb": [{"rolling": {"severity": 0}}, motion]}]), tmp_path / "out")


@cases("name", ["rolling", "rolling_shutter", "camera_motion_blur"])
def test_a_recording_has_instants_alone(made, tmp_path, name):
    _, out, _ = made
    preset = stored(tmp_path, out / "clean/box")
    document = json.loads(preset.read_text())
    document["settings"] = [{"name": "exposed", "perturb": [{name: {"severity": 3}}]}]
    del document["camera"]
    preset.write_text(json.dumps(document))
    refused(run, preset, tmp_path / "out", names=("scenes.0.sequence: exposed ", f"with {name},"))
