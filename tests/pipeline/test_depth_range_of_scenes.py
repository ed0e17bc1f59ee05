# SPDX-License-Identifier: GPL-3.0-or-later
"""`depth_range: scene`: the depth scale by how far frames can see, against the box in closed form."""

import json
import sys

import cv2
import numpy as np
import pytest
import yaml
from refusals import refused
from runs import run
from worlds import HIGH, LOW, path_poses, write_replica, write_world

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")

from noisy_world.cli.plan_text import print_plan
from noisy_world.core.errors import StorageError
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.recipe import read_recipe, recipe_of
from noisy_world.dataset.remaking import plan_of
from noisy_world.preset.keys import read_preset

EMBREE = {"engine": "embree", "backend": "reference"}
SHAKEN = {"name": "shaken", "perturb": [{"motion_deviation": {"rotation_deg": 0, "translation_m": 0.5}}]}


def world(folder, **keys):
    output = {"layout": "replica", "image": "png", "depth_range": "scene"} | keys.pop("output", {})
    return write_world(folder, render=EMBREE, output=output, **keys)


def farthest_m(positions_m):
    """The distance of the box's farthest corner from any position (N, 3)."""
    corners = np.stack(np.meshgrid(*zip(LOW, HIGH, strict=True)), -1).reshape(-1, 3)
    return np.linalg.norm(corners[:, None] - positions_m, axis=-1).max()


def test_the_scale_is_the_finest_of_the_series_that_holds_the_farthest_corner(tmp_path, capsys):
    preset = world(tmp_path)
    far_m = farthest_m(path_poses(6)[:, :3, 3])
    series = [step * 10.0**decade for decade in range(6) for step in (1, 2, 5)]
    wanted = max(scale for scale in series if far_m * scale <= 65535)
    run(preset, tmp_path / "out")
    params = json.loads((tmp_path / "out/clean/cam_params.json").read_text())
    assert params["camera"]["scale"] == wanted != 6553.5
    depths = [
        cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in (tmp_path / "out").glob("clean/box/results/depth*")
    ]
    assert len(depths) == 6
    assert max(depth.max() for depth in depths) > 65535 / 2 / 2.5  # the next coarser step would hold it, too
    assert min(depth.min() for depth in depths) > 0  # the box is closed: nothing is void
    print_plan(make_plan(read_preset(preset)), tmp_path / "out")
    assert f"makes depth_scale_per_m {wanted:g}" in capsys.readouterr().out


def test_a_camera_that_deviates_and_a_near_far_plane_count(tmp_path):
    preset = world(tmp_path, settings=[{"name": "clean"}, SHAKEN])
    clean, shaken = (make_plan(read_preset(preset, settings=[name])).reach for name in ("clean", "shaken"))
    assert shaken.farthest_m > clean.farthest_m
    assert make_plan(read_preset(preset)).reach.farthest_m == shaken.farthest_m
    near = make_plan(read_preset(preset, ["camera.far_m=3"]))
    assert (near.reach.farthest_m, near.format.depth_scale_per_m) == (3, 20000)
    assert "far plane" in near.reach.note
    given = make_plan(read_preset(preset, ["output.depth_scale_per_m=100"]))
    assert (given.reach, given.format.depth_scale_per_m) == (None, 100)


def test_another_scene_is_refused_where_it_asks_for_another_scale(tmp_path):
    preset = world(tmp_path)
    run(preset, tmp_path / "out")
    two_scenes(preset)
    refused(run, preset, tmp_path / "out", names="depth_scale_per_m", error=StorageError)


def test_a_part_of_a_recipe_keeps_the_scale_of_the_whole(tmp_path):
    preset = two_scenes(world(tmp_path))
    alone, both = (make_plan(read_preset(preset, scenes=names)).format for names in (["box"], []))
    assert both.depth_scale_per_m < alone.depth_scale_per_m
    run(preset, tmp_path / "out", overrides=["output.depth_beyond=farthest"])
    recipe = tmp_path / "recipe.json"
    recipe.write_text(recipe_of(tmp_path / "out", PlainProgress(sys.stderr)).text())
    assert plan_of(read_recipe(recipe), scenes=["box"]).format.depth_scale_per_m == both.depth_scale_per_m


def two_scenes(preset):
    """The preset with a second scene, in which the camera is 60 m from the box."""
    far = np.repeat(path_poses(1), 2, axis=0)
    far[:, 0, 3] -= 60
    write_replica(preset.parent / "far.txt", far)
    text = yaml.safe_load(preset.read_text())
    text["scenes"].append({"name": "far", "mesh": "mesh.ply", "trajectory": "far.txt"})
    preset.write_text(yaml.safe_dump(text))
    return preset


def test_a_recording_has_no_range_before_it_is_read(tmp_path):
    preset = world(tmp_path)
    run(preset, tmp_path / "out", overrides=["output.depth_range=layout"])
    again = {"seed": 3, "scenes": [{"sequence": "out/clean/box"}], "settings": [{"name": "clean"}]}
    (tmp_path / "again.yaml").write_text(yaml.safe_dump(again | {"output": {"depth_range": "scene"}}))
    refused(
        make_plan, read_preset(tmp_path / "again.yaml"), names=["output.depth_range", "recording", "depth_scale_per_m"]
    )
