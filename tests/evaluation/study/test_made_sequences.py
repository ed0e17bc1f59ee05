# SPDX-License-Identifier: GPL-3.0-or-later
"""Sequences that a study makes: the bytes that `generate` makes, each clean frame rendered once, and nothing left."""

import argparse
import hashlib
import json
import shutil
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest
from refusals import refused
from runs import run
from slam_systems import write_recording
from study_tools import FRAMES, small_world

from noisy_world.cli.study_workers import _fitting
from noisy_world.core.progress import PlainProgress
from noisy_world.core.schema import ConfigPath
from noisy_world.dataset.identity import RecordedSetting
from noisy_world.evaluate.cases import Case, Condition
from noisy_world.evaluate.study import Study, StudyOrder
from noisy_world.evaluate.study_results import ResultsFolder
from noisy_world.evaluate.study_sequences import PresetOrigin
from noisy_world.perturbations import registry
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.steps import Setting
from noisy_world.preset.keys import read_preset
from noisy_world.sources import read_scenes

pytest.importorskip("embreex", reason="embreex comes with an extra")

SHAKY = {"motion_deviation": {"rotation_deg": 3, "translation_m": 0.05}}
SETTINGS = [
    {"name": "clean"},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 3}}]},
    {"name": "bright", "perturb": [{"brightness": {"severity": 3}}]},
    {"name": "bright_dynamic", "perturb": [{"brightness": {"severity": 5, "mode": "dynamic"}}]},
    {"name": "holes", "perturb": [{"depth_random_missing": {"severity": 3}}]},
    {"name": "near", "perturb": [{"depth_range_clipping": {"severity": 3}}]},
    {"name": "late", "perturb": [{"desync": {"offset": 2}}]},
    {"name": "adrift", "perturb": [{"desync": {"offset": 2, "mode": "dynamic"}}]},
    {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]},
    {"name": "shaky", "perturb": [SHAKY]},
    {"name": "shaky_mixed", "perturb": [SHAKY, {"frost": {"severity": 2}}, {"desync": {"offset": 1}}]},
]
VARY = {"noise", "bright_dynamic", "holes", "adrift", "shaky", "shaky_mixed"}


def progress():
    return PlainProgress(sys.stderr)


def files_in(folder):
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def origin_of(preset, results, *seeds, **options):
    return PresetOrigin(read_preset(preset), seeds, ResultsFolder(results), **options)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    return small_world(tmp_path_factory.mktemp("world"), frames=12, settings=SETTINGS)


def test_the_bytes_are_those_of_generate_and_each_frame_is_rendered_once(world, tmp_path, monkeypatch):
    rendered = []
    frame = __import__("noisy_world.render.ray_session", fromlist=["RaySession"])
    session = next(item for item in vars(frame).values() if isinstance(item, type) and hasattr(item, "serves"))
    original = session.frame
    monkeypatch.setattr(
        session, "frame", lambda self, request: (rendered.append(request.index), original(self, request))[1]
    )
    origin = origin_of(world, tmp_path / "results", 3, 8)
    made = {}
    for case in origin.frames:
        with origin.sequence(case, progress()) as sequence:
            made[case] = files_in(sequence.folder)
    origin.finished("box")
    # 12 frames of the path; shaky and shaky_mixed move it, each for both seeds. The first frames are looked at, too.
    looked_at = len([index for index in rendered if index < 3])
    assert len([index for index in rendered if index >= 3]) == 9 * (1 + 2 * 2)
    assert looked_at <= 2 * 3 * (1 + 2 * 2)
    monkeypatch.undo()
    for seed in (3, 8):
        run(world, tmp_path / f"seed{seed}", overrides=[f"seed={seed}"])
        for case, files in made.items():
            if case.seed == seed:
                assert files == files_in(tmp_path / f"seed{seed}" / case.setting / case.scene), case
    assert not [path for path in tmp_path.glob("results/**/*") if path.is_file()]


def test_kept_frames_that_a_power_cut_has_damaged_are_made_again(world, tmp_path):
    made = []
    for damage in (None, lambda data: b"\0" * len(data), lambda data: data[:100]):
        origin = origin_of(world, tmp_path, 3)
        for path in tmp_path.glob(".noisy_world/clean/box/*/rgb/00000[1-4].npy") if damage else ():
            path.write_bytes(damage(path.read_bytes()))
        with origin.sequence(Case("box", "noise", 3), progress()) as sequence:
            made.append(files_in(sequence.folder))
            assert [frame.rgb.any() for frame in sequence.clean] == [True] * 12
    assert len(list(tmp_path.glob(".noisy_world/clean/box/*/rgb/*.npy"))) == 12
    assert made[0] == made[1] == made[2]


def test_settings_that_no_seed_changes_have_the_first_seed_only(world, tmp_path):
    cases = origin_of(world, tmp_path, 3, 8, 9).frames
    assert {case.setting for case in cases if case.seed == 3} == {item["name"] for item in SETTINGS}
    assert {case.setting for case in cases if case.seed == 8} == VARY
    assert {case.setting for case in cases if case.seed == 9} == VARY
    assert cases[Case("box", "fast", 3)] == 6
    assert cases[Case("box", "noise", 9)] == 12


def test_clean_counterparts(world, tmp_path):
    origin = origin_of(world, tmp_path, 3)
    with origin.sequence(Case("box", "clean", 3), progress()) as clean:
        assert clean.clean is None
        truth = clean.truth
        frames = [(frame.rgb, frame.depth_m) for frame in clean.opened]
    for setting in ("noise", "holes", "late"):
        with origin.sequence(Case("box", setting, 3), progress()) as noisy:
            assert noisy.clean is not None
            assert np.array_equal(noisy.truth.c2w, truth.c2w)
            for (rgb, depth_m), counterpart in zip(frames, noisy.clean, strict=True):
                assert np.array_equal(counterpart.rgb, rgb)
                assert np.array_equal(counterpart.depth_m, depth_m)
            refused(counterpart.rgb_bytes, names="rgb")
    with origin.sequence(Case("box", "shaky_mixed", 3), progress()) as mixed:
        assert mixed.clean is not None
        assert not np.array_equal(mixed.truth.c2w, truth.c2w)
        assert np.array_equal(mixed.clean[4].c2w, mixed.truth.c2w[4])
        assert not np.array_equal(mixed.clean[4].rgb, frames[4][0])
    with origin.sequence(Case("box", "shaky", 3), progress()) as moved:
        assert moved.clean is None  # its images are clean


REGISTERED = {"depth": {"width": 20, "height": 16, "horizontal_fov_deg": 80, "registered": True}}


@pytest.mark.parametrize("kind", ["recording", "registered"])
@pytest.mark.parametrize("keep_clean", [True, False])
def test_clean_counterparts_of_what_is_not_kept_or_has_another_camera(tmp_path, kind, keep_clean):
    """They are what a clean sequence's files hold."""
    if kind == "recording":
        recording = write_recording(tmp_path / "recorded", frames=3)
        scene = {"name": "box", "sequence": str(recording)}
        preset = tmp_path / "preset.json"
        keys = {"settings": SETTINGS[:2] + SETTINGS[4:5], "output": {"image": "png"}}
        preset.write_text(json.dumps({"seed": 3, "scenes": [scene], **keys}))
    else:
        preset = small_world(tmp_path, frames=3, settings=SETTINGS[:2] + SETTINGS[4:5], rig=REGISTERED)
    origin = origin_of(preset, tmp_path / "results", keep_clean=keep_clean)
    with origin.sequence(Case("box", "clean", 3), progress()) as clean:
        frames = [(frame.rgb, frame.depth_m) for frame in clean.opened]
    for setting in ("noise", "holes"):
        with origin.sequence(Case("box", setting, 3), progress()) as noisy:
            for (rgb, depth_m), counterpart in zip(frames, noisy.clean, strict=True):
                assert np.array_equal(counterpart.rgb, rgb)
                assert np.array_equal(counterpart.depth_m, depth_m)


def test_kept_sequences_stay_as_datasets(world, tmp_path):
    origin = origin_of(world, tmp_path, keep=True)
    with origin.sequence(Case("box", "noise", 3), progress()):
        pass
    assert (tmp_path / "kept/box/noise/seed-3/manifest.json").is_file()
    assert len(list((tmp_path / "kept/box/noise/seed-3/noise/box/results").glob("frame*"))) == 12


def test_without_kept_clean_frames_the_bytes_are_the_same(world, tmp_path):
    found = []
    for keep_clean in (True, False):
        origin = origin_of(world, tmp_path / str(keep_clean), keep_clean=keep_clean)
        with origin.sequence(Case("box", "noise", 3), progress()) as sequence:
            found.append(files_in(sequence.folder))
            assert (tmp_path / str(keep_clean) / ".noisy_world/clean").exists() == keep_clean
    assert found[0] == found[1]


def test_clean_frames_that_would_fill_the_disk_are_not_kept(tmp_path, monkeypatch):
    mesh = {"mesh": "mesh.ply", "trajectory": "traj.txt"}
    preset = small_world(tmp_path, scenes=[{"name": "one", **mesh}, {"name": "two", **mesh}])
    order = StudyOrder(str(preset), read_preset(preset).document, str(tmp_path / "out"), ("rgbd_odometry",))
    usage = shutil.disk_usage(tmp_path)._replace(free=4 * 2 * FRAMES * 32 * 24 * 16 - 1)  # short of two scenes' fourth
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    for jobs, kept in ((1, True), (2, False)):
        options = argparse.Namespace(jobs=jobs, ray=None)
        study = _fitting(Study(order, stop=threading.Event()), options, progress(), threading.Event())
        assert study.order.keep_clean == kept


def test_paths_keep_the_presets_seed(tmp_path):
    walked = {"handheld": {"frames": FRAMES}}
    own = {"handheld": {"frames": FRAMES, "seed": 11}}
    scenes = [
        {"name": "one", "mesh": "embedded:room?seed=0", "trajectory": walked},
        {"name": "two", "mesh": "embedded:room?seed=0", "trajectory": own},
    ]
    origin = origin_of(small_world(tmp_path, scenes=scenes), tmp_path / "results", 21, 22)
    seeds = [scene.keys.trajectory.handheld.seed for scene in read_scenes(origin.preset)]
    assert seeds == [3, 11]
    assert origin.preset.spec.seed == 3


def test_a_preset_without_colour_is_refused(tmp_path):
    preset = small_world(tmp_path, output={"layout": "tum", "modalities": ["depth"]})
    refused(origin_of, preset, tmp_path / "results", names="colour")


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"rig": {"depth": {"width": 8, "height": 6, "horizontal_fov_deg": 60}}}, "rig.depth.registered: true"),
        (
            {"rig": {"depth": {"translation_m": [0.1, 0, 0]}}, "output": {"layout": "euroc"}},
            "rig.depth.registered: true",
        ),
        ({"output": {"layout": "replica", "image": "exr"}}, "output.image: "),
        (
            {
                "camera": {
                    "width": 32,
                    "height": 24,
                    "fx": 16,
                    "fy": 16,
                    "cx": 15.5,
                    "cy": 11.5,
                    "distortion": {"k1": 0.1},
                }
            },
            "undistort: true",
        ),
    ],
)
def test_what_systems_do_not_read_is_refused_before_anything_is_made(tmp_path, keys, named):
    origin = origin_of(small_world(tmp_path, **keys), tmp_path / "results")
    refused(lambda: origin.whole, names=named)


@pytest.mark.parametrize(
    ("perturb", "condition"),
    [
        ([], Condition("clean", "", "")),
        ([{"frost": {"severity": 3}}], Condition("frost", "static", "3")),
        ([{"frost": {"severity": 5, "mode": "dynamic"}}], Condition("frost", "dynamic", "5")),
        ([{"frost": {"mode": "keyed", "levels": [0, 5]}}], Condition("frost", "dynamic", "")),
        ([{"faster_motion": {"factor": 4}}], Condition("faster_motion", "", "")),
        ([{"desync": {"offset": 2}}], Condition("desync", "static", "")),
        ([{"desync": {"offset": 2, "mode": "dynamic"}}], Condition("desync", "dynamic", "")),
        ([{"frost": {"severity": 3}}, {"fog": {"severity": 3}}], Condition("fog+frost", "static", "3")),
        ([{"fog": {"mode": "dynamic", "levels": [1]}}], Condition("fog", "dynamic", "")),
        ([{"motion_deviation": {}}, {"fog": {"severity": 2.5}}], Condition("motion_deviation+fog", "static", "")),
    ],
)
def test_conditions_are_the_words_of_the_tables(perturb, condition):
    steps = parse_steps(perturb, ConfigPath("preset.yaml", "perturb"), registry())
    assert Condition.of(RecordedSetting.of(Setting("setting", steps)).content(), registry()) == condition


def test_condition_of_a_perturbation_that_is_not_known_here():
    step = {"name": "somebodys_own", "severity": 2.0, "levels": None, "parameters": {}}
    assert Condition.of({"steps": [step]}, registry()) == Condition("somebodys_own", "static", "2")


def test_names_of_cases():
    case = Case("room0", "frost_s5_static", 7)
    assert case.name == "room0/frost_s5_static/seed-7"
    assert Case.parse(case.name) == case
    assert sorted([replace(case, seed=10), case])[0] == case
    for name in ("room0", "room0/frost/seed-x", "a/b/c/seed-1", "room0//seed-1"):
        refused(Case.parse, name, names=name, error=ValueError)
