# SPDX-License-Identifier: GPL-3.0-or-later
"""A file that is a parameter of a perturbation: what it holds decides bytes, and is in the identity and the records."""

import hashlib
import json
import os
import sys

import cv2
import numpy as np
import pytest
from refusals import refused
import yaml
from analytic import box_depth, look_at
from cases import cases
from shard_workers import workers_here
from worlds import HIGH, LOW, write_replica, write_world
from runs import run

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")

import noisy_world
from noisy_world.dataset.folder_state import read_dataset_state
from noisy_world.core.errors import StorageError
from noisy_world.core.geometry import Intrinsics
from noisy_world.preset.keys import read_preset
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.remaking import plan_of
from noisy_world.dataset.recipe import read_recipe, recipe_of

SIZE = (64, 48)
CAMERA = Intrinsics(*SIZE, 32.0, 32.0, 31.5, 23.5)
POSE = look_at([-0.4, 0.1, 1.2], [1.0, 0.4, 1.0])
STEP = {"redwood": {"warp": "tables/warp.txt", "noise": 0, "step_px": 0.001}}


def write_table(path, factor):
    path.parent.mkdir(exist_ok=True)
    cell = " ".join(["0"] * 3 + ["9000"] * 5 + ["0"] * 10 + [f"{factor}"] * 5)
    path.write_text("\n".join(["head"] * 5 + [cell] * 6400) + "\n")


def world(folder, step=STEP, factor=1.05, **keys):
    folder.mkdir(parents=True, exist_ok=True)
    settings = [{"name": "clean"}, {"name": "warped", "perturb": [step]}]
    preset = write_world(
        folder, size=SIZE, settings=settings, render={"engine": "embree", "backend": "reference"},
        output={"layout": "replica", "image": "png"}, **keys,
    )  # fmt: skip
    write_replica(folder / "traj.txt", np.repeat(POSE[None], 2, axis=0))
    write_table(folder / "tables/warp.txt", factor)
    return preset


def test_depth_is_warped_by_a_file_beside_the_preset_wherever_the_program_runs(tmp_path, monkeypatch):
    preset = world(tmp_path / "world")
    monkeypatch.chdir(tmp_path)
    run(preset, tmp_path / "out")
    made = cv2.imread(str(tmp_path / "out/warped/box/results/depth000000.png"), cv2.IMREAD_UNCHANGED) / 6553.5
    true_m, _ = box_depth(CAMERA, POSE, LOW, HIGH)
    np.testing.assert_allclose(made, (true_m / 1.05)[np.ix_(np.arange(48) & ~1, np.arange(64) & ~1)], atol=2e-3)
    wanted = {
        "name": "warp.txt",
        "sha256": hashlib.sha256((tmp_path / "world/tables/warp.txt").read_bytes()).hexdigest(),
    }
    (step,) = read_dataset_state(tmp_path / "out").identity["settings"]["warped"]["steps"]
    assert step["parameters"]["warp"] == {"sha256": wanted["sha256"]}
    line = json.loads((tmp_path / "out/warped/box/frames.jsonl").read_text().splitlines()[0])
    (note,) = line["perturbed"]["depth"]
    assert note["parameters"]["warp"] == wanted
    assert str(tmp_path) not in json.dumps(line)


def test_another_content_is_another_dataset_and_another_name_is_not(tmp_path):
    preset = world(tmp_path / "world")
    run(preset, tmp_path / "out")
    before = (tmp_path / "out/warped/box/results/depth000000.png").read_bytes()
    (tmp_path / "world/tables/warp.txt").rename(tmp_path / "world/tables/renamed.txt")
    preset.write_text(preset.read_text().replace("warp.txt", "renamed.txt"))
    run(preset, tmp_path / "out")
    write_table(tmp_path / "world/tables/renamed.txt", 1.2)
    refused(run, preset, tmp_path / "out", names="settings: warped (warp) was", error=StorageError)
    run(preset, tmp_path / "other")
    assert (tmp_path / "other/warped/box/results/depth000000.png").read_bytes() != before


def test_a_dataset_without_a_table_is_what_it_was(tmp_path):
    preset = world(tmp_path / "world", {"redwood": {"noise": 0}})
    run(preset, tmp_path / "out")
    line = json.loads((tmp_path / "out/warped/box/frames.jsonl").read_text().splitlines()[0])
    assert "warp" not in line["perturbed"]["depth"][0]["parameters"]
    assert "warp.txt" not in (tmp_path / "out/manifest.json").read_text()


def test_the_same_bytes_by_two_jobs_and_of_a_rig_s_sensor(tmp_path):
    preset = world(tmp_path / "world")
    run(preset, tmp_path / "one")
    workers = workers_here(preset, tmp_path / "two", order=lambda shards: shards[::-1])
    run(preset, tmp_path / "two", jobs=2, workers=workers)
    name = "warped/box/results/depth000000.png"
    assert (tmp_path / "two" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()
    document = yaml.safe_load(preset.read_text())
    document["rig"], document["settings"] = {"depth": {"sensor": STEP}}, [{"name": "clean"}]
    sensor = tmp_path / "world/sensor.yaml"
    sensor.write_text(yaml.safe_dump(document))
    run(sensor, tmp_path / "rig")
    mine = (tmp_path / "rig/clean/box/results/depth000000.png").read_bytes()
    assert mine == (tmp_path / "one" / name).read_bytes()


def test_a_recipe_asks_for_the_same_file(tmp_path):
    preset = world(tmp_path / "world")
    run(preset, tmp_path / "out")
    recipe = tmp_path / "world/a.recipe"
    recipe.write_text(recipe_of(tmp_path / "out", PlainProgress(sys.stderr)).text())
    stored_m = cv2.imread(str(tmp_path / "out/warped/box/results/depth000001.png"), cv2.IMREAD_UNCHANGED) / 6553.5
    opened = noisy_world.open(recipe)["warped/box"][1]
    np.testing.assert_allclose(opened.depth_m, stored_m, atol=1e-6)
    moved = tmp_path / "elsewhere.recipe"
    moved.write_text(recipe.read_text())
    opened = noisy_world.open(moved, data=tmp_path / "world")["warped/box"][1]
    np.testing.assert_allclose(opened.depth_m, stored_m, atol=1e-6)
    write_table(tmp_path / "world/tables/warp.txt", 1.2)
    names = ["settings: warped: redwood.warp: ", "tables/warp.txt"]
    refused(lambda: noisy_world.open(recipe)["warped/box"][1].depth_m, names=names)
    refused(lambda: plan_of(read_recipe(recipe)), names=names)


@cases(
    ("name", "content", "said"),
    [
        ("gone.txt", None, "gone.txt"),
        ("short.txt", b"h\n" * 5 + b"1 2 3\n", "147200"),
        ("words.txt", b"h\n" * 5 + b"x " * 147200, "numbers"),
        ("nan.txt", b"h\n" * 5 + b"nan " * 147200, "finite"),
        ("bytes.txt", b"\xff\xfe\x00" * 9, "text"),
        ("~nobody_is_called_so/a.txt", None, "user"),
    ],
)
def test_what_is_no_table_is_refused_in_a_line_with_file_and_key(tmp_path, name, content, said):
    preset = world(tmp_path / "world", {"redwood": {"warp": name}})
    if content is not None:
        (tmp_path / "world" / name).write_bytes(content)
    file = name.split("/", maxsplit=1)[0].removeprefix("~")
    refused(lambda: make_plan(read_preset(preset)), names=["settings.1.perturb.0.redwood.warp: ", file, said])


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes here")
def test_a_pipe_is_not_waited_for(tmp_path):
    preset = world(tmp_path / "world", {"redwood": {"warp": "pipe"}})
    os.mkfifo(tmp_path / "world/pipe")
    refused(lambda: make_plan(read_preset(preset)), names=["settings.1.perturb.0.redwood.warp: ", "pipe"])


def test_another_mask_is_another_dataset_and_a_recipe_asks_for_the_same(tmp_path):
    step = {"contrast": {"severity": 3, "mask": "tables/mask.png"}}
    preset = world(tmp_path / "world", step)
    mask = tmp_path / "world/tables/mask.png"
    cv2.imwrite(str(mask), np.full((6, 8), 128, np.uint8))
    run(preset, tmp_path / "out")
    recipe = tmp_path / "world/recipe.json"
    recipe.write_text(recipe_of(tmp_path / "out", PlainProgress(sys.stderr)).text())
    assert plan_of(read_recipe(recipe)).settings[1].rgb[0].share.masks == (mask,)
    cv2.imwrite(str(mask), np.full((6, 8), 200, np.uint8))
    refused(run, preset, tmp_path / "out", names="settings: warped (mask) was", error=StorageError)
    refused(
        lambda: plan_of(read_recipe(recipe)), names=["mask.png is not what the recipe was made from", "contrast.mask"]
    )
