# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset takes new settings, scenes and frames: what is there stays, and the end is as if it were made at once."""

import json
from pathlib import Path

import fake_session
import numpy as np
import pytest
from refusals import refused
from cases import cases
from growing import CLEAN, FAST, FOG, NOISE, PATH, SHAKY, THREE, at_once, change, marks, world
from worlds import content, path_poses, write_box_ply, write_replica
from runs import run

from noisy_world.core.errors import StorageError

pytestmark = pytest.mark.usefixtures("no_blender")


def grown(tmp_path, values, *, first=None, **keys):
    """Make a dataset, change the preset, run again; check that what was there stayed and the end is as made at once."""
    preset, out = world(tmp_path / "world", **keys), tmp_path / "out"
    run(preset, out, **(first or {}))
    before = marks(out)
    fake_session.Session.rendered.clear()
    run(change(preset, values), out)
    rendered = list(fake_session.Session.rendered)
    assert content(out) == at_once(preset, tmp_path)
    after = marks(out)
    changed = {name for name, mark in before.items() if after[name] != mark}
    return changed, set(after) - set(before), rendered


def test_a_fourth_setting_makes_only_its_own_files(tmp_path):
    changed, new, rendered = grown(tmp_path, {"settings": [NOISE, *THREE]})
    assert not changed
    assert {name.split("/")[0] for name in new} == {"noise"}
    assert rendered == list(range(6))


def test_what_a_new_setting_leaves_alone_is_linked(tmp_path):
    grown(tmp_path, {"settings": [*THREE, {"name": "dim", "perturb": [{"brightness": None}]}]})
    depths = [tmp_path / f"out/{name}/box/results/depth000003.png" for name in ("clean", "fog", "dim")]
    assert depths[0].samefile(depths[1])
    assert depths[0].samefile(depths[2])


def test_a_setting_that_moves_the_path_is_rendered_alone(tmp_path):
    changed, new, rendered = grown(tmp_path, {"settings": [*THREE, SHAKY, FAST]})
    assert not changed
    assert {name.split("/")[0] for name in new} == {"shaky", "fast"}
    assert len(rendered) == 6 + 3, "faster motion needs every second frame of the path, the deviation six of its own"


def test_a_new_scene_makes_only_its_own_files(tmp_path):
    (tmp_path / "world").mkdir()
    write_box_ply(tmp_path / "world/hall.ply", shift_m=(1, 2, 3))
    scenes = [
        {"name": "hall", "mesh": "hall.ply", "trajectory": "traj.txt"},
        {"name": "box", "mesh": "mesh.ply", "trajectory": {"file": "traj.txt", "stop": 6}},
    ]
    changed, new, rendered = grown(tmp_path, {"scenes": scenes})
    assert not changed
    assert {name.split("/")[1] for name in new} == {"hall"}
    assert rendered == list(range(8))


def test_a_longer_part_of_the_path_adds_frames(tmp_path):
    settings = [CLEAN, FOG, {"name": "early", "perturb": [{"desync": {"offset": -1}}]}]
    changed, new, rendered = grown(tmp_path, {"scenes.0.trajectory.stop": 8}, settings=settings)
    assert {Path(name).name for name in changed} == {"traj.txt", "frames.jsonl"}
    assert {Path(name).name[5:] for name in new} == {"000006.png", "000007.png"}
    assert rendered[-2:] == [6, 7]
    assert set(rendered) <= {5, 6, 7}, "the depth of frame 5 is new to the frame after it"


def test_frames_of_a_longer_file_are_added(tmp_path):
    preset, out = world(tmp_path / "world", settings=[CLEAN, FOG, FAST]), tmp_path / "out"
    change(preset, {"scenes.0.trajectory": "traj.txt"})
    run(preset, out, frames=slice(1, 4))
    poses = path_poses(8)
    longer = np.concatenate([poses, poses[::-1]])
    write_replica(tmp_path / "world/traj.txt", longer)
    fake_session.Session.rendered.clear()
    run(preset, out)
    assert fake_session.Session.rendered[:2] == [0, 4]
    assert content(out) == at_once(preset, tmp_path)


FLAT = [
    {"name": name, "perturb": [{perturbation: {"severity": severity}}]}
    for name, perturbation, severity in (
        ("fog_s1", "fog", 1), ("contrast_s1", "contrast", 1), ("contrast_s2", "contrast", 2), ("fog_s2", "fog", 2),
    )
]  # fmt: skip
SWEPT = [{"sweep": {"perturb": ["fog", "contrast"], "severities": [1, 2]}}]


@cases(
    "before, after",
    [
        ({"settings": SWEPT}, {"settings": FLAT}),
        ({"settings": [CLEAN, FOG]}, {"settings": [{**FOG, "backend": "reference"}, CLEAN]}),
        ({"settings": [FOG]}, {"settings": [{"name": "fog", "perturb": [{"fog": None}]}]}),
        ({}, {"output": {"layout": "replica", "image": "png", "depth_scale_per_m": 6553.5, "colour": "rgb"}}),
        ({}, {"rig": None, "seed": 3.0}),
        ({}, {"scenes.0.trajectory.every": 1, "scenes.0.trajectory.rate_hz": 20}),
    ],
)
def test_what_means_the_same_is_the_same(tmp_path, before, after):
    folder = tmp_path / str(abs(hash(repr((before, after)))))
    changed, new, rendered = grown(folder, after, **before)
    assert (changed, new, rendered) == (set(), set(), [])


def test_files_of_other_names_with_the_same_content_are_the_same(tmp_path):
    preset, out = world(tmp_path / "world"), tmp_path / "out"
    run(preset, out)
    before = marks(out)
    (tmp_path / "world/mesh.ply").rename(tmp_path / "world/room.ply")
    text = (tmp_path / "world/traj.txt").read_text()
    (tmp_path / "world/way.txt").write_text("# the same poses\n" + "".join(text.splitlines(keepends=True)[:6]))
    run(change(preset, {"scenes.0.mesh": "room.ply", "scenes.0.trajectory": "way.txt"}), out)
    assert marks(out) == before


def test_an_overview_is_drawn_or_left_out(tmp_path):
    changed, new, _ = grown(tmp_path, {"output.overview": True})
    assert (changed, new) == (set(), set())
    out = tmp_path / "out"
    assert (out / "overview.png").is_file()
    run(change(tmp_path / "world/preset.yaml", {"output.overview": False}), out)
    assert not (out / "overview.png").exists()


@cases(
    "perturb, same",
    [
        ([{"desync": {"offset": 1}}], False),  # the last frame of the shorter path had its own depth
        ([{"desync": {"offset": 1, "edge": "drop"}}], True),
        ([{"desync": {"offset": -2}}], True),
        ([{"faster_motion": {"factor": 2}}], True),
    ],
)
def test_frames_that_a_longer_path_would_change_are_not_kept(tmp_path, perturb, same):
    folder = tmp_path / str(len(list(tmp_path.iterdir())))
    settings, longer = [CLEAN, {"name": "it", "perturb": perturb}], {f"{PATH}.stop": 8}
    if same:
        grown(folder, longer, settings=settings)
        return
    preset, out = world(folder / "world", settings=settings), folder / "out"
    run(preset, out)
    refused(run, change(preset, longer), out, names=["settings: it (desync) "], error=StorageError)


@pytest.mark.parametrize(("shift_m", "step_m", "same"), [(0, 1, True), (5000, 0, True), (5000, 9, False)])
def test_far_away_a_longer_path_may_have_another_middle(tmp_path, shift_m, step_m, same):
    poses = path_poses(8)
    poses[:, 0, 3] += shift_m + step_m * np.arange(8)
    preset, out = world(tmp_path / "world"), tmp_path / "out"
    write_replica(tmp_path / "world/traj.txt", poses)
    run(preset, out)
    change(preset, {f"{PATH}.stop": 8, "settings": [CLEAN, FOG]})
    if same:
        run(preset, out)
        return
    refused(run, preset, out, names="scenes.0.trajectory: ", error=StorageError)


def test_what_the_preset_does_not_name_stays(tmp_path):
    preset, out = world(tmp_path / "world"), tmp_path / "out"
    run(preset, out)
    before = marks(out)
    report = run(change(preset, {"settings": [FOG, NOISE]}), out)
    assert [note for note in report.notes if note.endswith(": clean/box, late/box")]
    after = marks(out)
    assert {name: after[name] for name in before} == before
    manifest = json.loads((out / "manifest.json").read_text())
    assert set(manifest["frames"]) == {"clean/box", "fog/box", "late/box", "noise/box"}
    assert set(manifest["identity"]["settings"]) == {"clean", "fog", "late", "noise"}
    there = content(out)
    for name, digests in manifest["files"].items():
        for path, digest in digests.items() if isinstance(digests, dict) else [("", digests)]:
            assert there[f"{name}/{path}".rstrip("/")] == digest
    run(change(preset, {"settings": [NOISE, *THREE]}), out)
    assert content(out) == at_once(preset, tmp_path)
    run(change(preset, {"settings": [CLEAN]}), out, overwrite=True)
    assert {path.name for path in out.iterdir()} == {"clean", "manifest.json", "run.json"}
