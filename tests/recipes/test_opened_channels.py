# SPDX-License-Identifier: GPL-3.0-or-later
"""Every channel of a dataset, opened: the same arrays from its files, packed ones, a recipe, and kept clean frames."""

import json
import sys
import threading

import cv2
import numpy as np
import OpenEXR
import pytest
from refusals import refused

pytest.importorskip("embreex", reason="embreex comes with an extra")

from cases import cases
from packed import pack_to
from worlds import with_objects, write_world

import noisy_world
from noisy_world.core.errors import NoisyWorldError
from noisy_world.preset.keys import read_preset
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.run import Run
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.clean_store import make_store
from noisy_world.dataset.recipe import read_recipe, recipe_of
from noisy_world.dataset.remaking import verify

OTHERS = ("normal", "instance", "flow")
FORMATS = {"replica": {}, "euroc": {"normal": "exr", "instance": "npy", "flow": "npy"}}


def read(path):
    """An image's file in other hands."""
    if path.suffix == ".npy":
        return np.load(path)
    if path.suffix == ".exr":
        with OpenEXR.File(str(path), separate_channels=True) as file:
            planes = file.channels()
            names = ("dx", "dy", "hidden") if "hidden" in planes else "XYZ"
            return np.stack([planes[name].pixels for name in names], axis=-1)
    steps = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if steps.ndim == 2:
        return steps
    normal = steps[..., ::-1] / 65535 * 2 - 1
    return np.where(steps.any(axis=-1, keepdims=True), normal, 0)


@cases("layout", FORMATS)
def test_all_hands_give_the_same(layout, tmp_path):
    pytest.importorskip("pyarrow", reason="the extra 'cloud' is not installed: pyarrow")
    tmp_path /= layout
    preset = write_world(
        tmp_path / "world",
        frames=8,
        render={"engine": "embree", "backend": "reference"},
        settings=[{"name": "clean"}, {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]}],
        output={"layout": layout, "image": "png", "modalities": ["rgb", "depth", *OTHERS], "formats": FORMATS[layout]},
    )
    with_objects(tmp_path / "world", [300, 7, 7, 65535, -1, 12])
    plan, progress, stop = make_plan(read_preset(preset)), PlainProgress(sys.stderr), threading.Event()
    Run(plan, tmp_path / "out", progress=progress, stop=stop).make_dataset()
    pack_to(tmp_path / "out", f"file://{tmp_path}/packed")
    recipe = tmp_path / "world/out.recipe.json"
    recipe.write_text(recipe_of(tmp_path / "out", progress).text())
    make_store(plan, tmp_path / "clean", progress, stop)
    kinds = {name: FORMATS[layout].get(name, "exr" if name == "flow" else "png") for name in OTHERS}

    opened = [
        noisy_world.open(tmp_path / "out"),
        noisy_world.open(tmp_path / "packed"),
        noisy_world.open(recipe),
        noisy_world.open(recipe, clean=tmp_path / "clean"),
    ]
    for name in ("clean/box", "fast/box"):
        numbers = list(opened[0][name].frames)
        assert len(numbers) == (8 if name == "clean/box" else 4)
        for channel, kind in kinds.items():
            files = sorted((tmp_path / "out" / name).glob(f"**/*{channel}*/**/*.{kind}"))
            for index, file in zip(numbers, files, strict=True):
                truth = read(file)
                assert {hand[name][index].image_bytes(channel) for hand in opened} == {file.read_bytes()}
                for hand in opened:
                    image = hand[name][index].image(channel)
                    assert image.dtype == (np.uint16 if channel == "instance" else np.float32)
                    assert image.shape == truth.shape
                    assert np.abs(image - truth.astype(float)).max() < 1e-7
        assert np.array_equal(opened[2][name][1].image("rgb"), opened[0][name][1].rgb)
        assert np.array_equal(opened[2][name][1].image("depth"), opened[0][name][1].depth_m)
    for hand in opened:
        sample = hand.frames("fast", channels=["flow", "instance"])[1]
        assert np.array_equal(sample["flow"], hand["fast/box"][1].image("flow"))
        assert "normal" not in sample
    for dataset in (tmp_path / "out", tmp_path / "packed"):
        assert verify(read_recipe(recipe), dataset, progress, stop).lines() == []
    listed = json.loads((tmp_path / "packed/croissant.json").read_text())["distribution"]
    assert {item["encodingFormat"] for item in listed if item["@id"] == "flow-images"} == {
        {"exr": "image/x-exr", "npy": "application/x-npy"}[kinds["flow"]]
    }
    file.write_bytes(file.read_bytes()[:-9] + b"elsewhere")
    refused(
        lambda: noisy_world.open(tmp_path / "out")["fast/box"][numbers[-1]].image("flow"),
        names=f"{file.name}: is not as it was written",
    )


@cases("only", ["rgb", "depth"])
def test_a_folder_with_one_channel_is_opened_by_its_recipe(tmp_path, only):
    tmp_path /= only
    output = {"layout": "tum", "modalities": [only]}
    preset = write_world(
        tmp_path / "world", frames=2, render={"engine": "embree", "backend": "reference"}, output=output
    )
    Run(
        make_plan(read_preset(preset)), tmp_path / "out", progress=PlainProgress(sys.stderr), stop=threading.Event()
    ).make_dataset()
    lacking = {"rgb": "depth", "depth": "colour"}[only]
    refused(
        lambda: noisy_world.open(tmp_path / "out")["clean/box"], names=("clean/box: ", f"no {lacking}", "its recipe")
    )
    recipe = tmp_path / "world/recipe.json"
    recipe.write_text(recipe_of(tmp_path / "out", PlainProgress(sys.stderr)).text())
    frame = noisy_world.open(recipe)["clean/box"][1]
    name = {"rgb": "rgb/000001.png", "depth": "depth/000001.png"}[only]
    stored = cv2.imread(str(tmp_path / "out/clean/box" / name), cv2.IMREAD_UNCHANGED)
    if only == "rgb":
        np.testing.assert_array_equal(frame.rgb, stored[..., ::-1])
    else:
        np.testing.assert_allclose(frame.depth_m, stored / 5000, rtol=1e-6)


def test_what_is_not_there_is_said(tmp_path):
    preset = write_world(tmp_path / "world", frames=2, render={"engine": "embree", "backend": "reference"})
    Run(
        make_plan(read_preset(preset)), tmp_path / "out", progress=PlainProgress(sys.stderr), stop=threading.Event()
    ).make_dataset()
    frame = noisy_world.open(tmp_path / "out")["clean/box"][1]
    refused(frame.image, "flow", names=("frames.jsonl: frame 1: ", "flow"))
    refused(frame.image, "flows", names="there is no channel flows here", error=NoisyWorldError)
