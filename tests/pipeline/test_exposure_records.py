# SPDX-License-Identifier: GPL-3.0-or-later
"""What frames.jsonl says of exposures where a frame's depth is another frame's: its colour's, however it was made."""

import json
import sys

import pytest
from test_rolling_shutter import poses_at
from worlds import write_replica, write_world
from written import run

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")

import noisy_world
from noisy_world.core.progress import PlainProgress
from noisy_world.recipes.of_dataset import recipe_of

BLUR = {"camera_motion_blur": {"shutter_ms": 40}}
LATE = {"desync": {"offset": 2}}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("late")
    preset = write_world(
        folder,
        size=(32, 24),
        settings=[{"name": "blurred", "perturb": [BLUR]}, {"name": "late", "perturb": [BLUR, LATE]}],
        render={"engine": "embree", "backend": "reference"},
        output={"layout": "replica", "image": "png"},
    )
    write_replica(folder / "traj.txt", poses_at([0.0, 0.05, 0.1, 0.4, 0.45, 0.9]))  # slow, then fast
    run(preset, folder / "out")
    return preset, folder / "out"


def lines_of(out, setting):
    return [json.loads(line) for line in (out / f"{setting}/box/frames.jsonl").read_text().splitlines()]


def test_the_record_is_of_the_colours_exposure(made):
    _, out = made
    blurred, late = (
        [line["perturbed"]["exposure"][0]["moments"] for line in lines_of(out, name)] for name in ("blurred", "late")
    )
    assert len(set(blurred)) > 2  # each frame goes another way
    assert late == blurred


@pytest.mark.parametrize("image", ["frame000001.png", "depth000001.png"])
def test_it_is_the_same_whichever_image_is_made_last(made, image):
    preset, out = made
    records = out / "late/box/frames.jsonl"
    before = records.read_bytes()
    (out / "late/box/results" / image).unlink()
    assert run(preset, out).frames_rendered == 1
    assert (out / "late/box/results" / image).exists()
    assert records.read_bytes() == before


def test_a_recipe_says_it_too(made):
    preset, out = made
    path = preset.parent / "late.recipe.json"
    path.write_text(recipe_of(out, PlainProgress(sys.stderr)).text())
    for name in ("blurred/box", "late/box"):
        there, again = (noisy_world.open(each)[name][1].done for each in (out, path))
        assert "exposure" in there
        assert again == there
