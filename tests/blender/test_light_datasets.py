# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets of scene-linear light: the values are Blender's own, and every reader takes them or says why not."""

import json
import shutil
import sys
import threading

import bpy
import numpy as np
import OpenEXR
import pytest

from lit_scenes import LAMPS, lit_hall, make, write_preset
from packed import pack_to
from shard_workers import workers_here

import noisy_world
from noisy_world.nodes.datablocks import muted_output
from noisy_world.render.scene_inspection import open_file
from noisy_world.dataset.identity import render_seed
from noisy_world.core.errors import InputError, StorageError
from noisy_world.render.source import DRAWN, PERTURBED
from noisy_world.preset.keys import read_preset
from noisy_world.core.progress import PlainProgress
from noisy_world.evaluate.system_input import sequence_input
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.recipe import recipe_of
from noisy_world.dataset.recipe import read_recipe
from noisy_world.dataset.remaking import verify

CHAIN = "{fog_depth: {severity: 2}}, {haze: {severity: 3}}"
STORM = f"{{name: storm, perturb: [{CHAIN}]}}"
LIGHT = "image: exr, modalities: [rgb, depth], overview: true"


def light_of(path):
    """The light (H, W, 3) in an EXR, in OpenEXR's own hands."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        found = file.channels()
        return np.stack([found[name].pixels for name in "RGB"], axis=-1)


def rendered(blend, folder):
    """Light of the scene's first frame as Blender writes it."""
    open_file(str(blend))
    scene = bpy.context.scene
    scene.cycles.seed = render_seed(0)
    scene.render.filepath = str(folder / "own.exr")
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "OPEN_EXR", "RGB"
    scene.render.image_settings.color_depth, scene.render.image_settings.exr_codec = "32", "NONE"
    with muted_output():
        bpy.ops.render.render(write_still=True)
    return light_of(folder / "own.exr")


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    """A folder with the hall, its preset, and datasets of it by both executions."""
    folder = tmp_path_factory.mktemp("lit")
    lit_hall(folder, denoising=False)  # which enlarges what the last digit of a camera changes
    for backend in ("compositor", "reference"):
        make(write_preset(folder, STORM, backend=backend, output=LIGHT), folder / backend)
    return folder


def test_lamps_are_as_bright_as_in_blenders_own_render(hall, tmp_path):
    clean = light_of(hall / "reference/clean/hall/results/frame000000.exr")
    own = rendered(hall / "lit.blend", tmp_path)
    assert clean.dtype == np.float16
    assert clean.max() > 0.9 * LAMPS[-1]
    dark = own > 1e-3
    apart = (np.abs(clean - own)[dark] / own[dark]).ravel()
    print("half floats against Blender's own EXR", apart.max(), np.mean(apart > 2.0**-11))
    assert np.mean(apart > 2.0**-11) < 0.02  # at edges the camera's last digit shows


def test_both_executions_store_the_same_light(hall):
    found, wanted = (
        light_of(hall / f"{name}/storm/hall/results/frame000000.exr") for name in ("compositor", "reference")
    )
    assert wanted.max() > 5  # lamps stay lamps in the fog
    lit = wanted > 1e-3  # darker half floats have coarser steps
    apart = np.abs(found.astype(float) - wanted)[lit] / wanted[lit]
    print("nodes against arrays in the files", apart.max())
    assert apart.max() < 1e-3 + 2.0**-10  # and both are rounded


def test_a_dataset_again_resumed_in_shards_and_packed(hall, tmp_path):
    def files(out):
        return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*.exr"))}

    wanted = files(hall / "reference")
    assert len(wanted) == 2
    preset = write_preset(hall, STORM, output=LIGHT)
    out = make(preset, tmp_path / "shards", jobs=2, workers=workers_here(preset, tmp_path / "shards"))
    assert files(out) == wanted
    (out / "storm/hall/results/frame000000.exr").unlink()
    make(preset, out)
    assert files(out) == wanted
    assert (out / "overview.png").exists()


def test_what_reads_it(hall, tmp_path):
    pytest.importorskip("pyarrow", reason="the extra 'cloud' is not installed: pyarrow")
    progress, stop = PlainProgress(sys.stderr), threading.Event()
    pack_to(hall / "reference", f"file://{tmp_path}/packed")
    recipe = hall / "light.recipe.json"
    recipe.write_text(recipe_of(hall / "reference", progress).text())
    wanted = light_of(hall / "reference/storm/hall/results/frame000000.exr")
    for place in (hall / "reference", tmp_path / "packed"):
        frame = noisy_world.open(place)["storm/hall"][0]
        assert frame.rgb.dtype == np.float32
        assert np.array_equal(frame.rgb, wanted)
        assert np.array_equal(frame.rgb_uncompressed, wanted)
        assert verify(read_recipe(recipe), place, progress, stop).lines() == []
    with pytest.raises(InputError, match=r"of storm/hall is light before the view .* 'noisy-world remake' makes"):
        _ = noisy_world.open(recipe)["storm/hall"][0].rgb
    with pytest.raises(InputError, match="its colour is EXR, scene-linear light, which systems do not read"):
        sequence_input(hall / "reference/storm/hall")
    again = tmp_path / "again.yaml"
    again.write_text(
        f"scenes: [{{name: again, sequence: {hall / 'reference/storm/hall'}}}]\nsettings: [{{name: clean}}]\n"
    )
    with pytest.raises(InputError, match=r"frame000000\.exr: is an EXR of scene-linear light, but colour has to be"):
        make(again, tmp_path / "again")


@pytest.mark.parametrize(
    ("settings", "output", "line"),
    [
        (
            "{name: n, perturb: [{gaussian_noise: {severity: 1}}]}",
            "image: exr",
            r"n: gaussian_noise \(sensor\) acts on",
        ),
        (
            "{name: n, perturb: [{jpeg_compression: {severity: 1}}]}",
            "image: exr",
            r"n: jpeg_compression \(post\) acts on",
        ),
        (STORM, "image: exr, colour: grey", r"output\.colour: is grey, but an EXR holds red, green and blue"),
        (STORM, "image: exr, layout: tum", r"output\.image: is exr, but the TUM layout's readers expect png"),
    ],
)
def test_what_has_no_light_is_refused(hall, settings, output, line):
    with pytest.raises(InputError, match=line):
        make_plan(read_preset(write_preset(hall, settings, output=output)))


def perturbed_after(inputs):
    assert inputs.pop(PERTURBED) == "before the view transform"


def drawn_otherwise(inputs):
    inputs[DRAWN] -= 1


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (perturbed_after, "act on its light before the view transform, but after it in the dataset, which an earlier"),
        (drawn_otherwise, "weather and dirt are drawn otherwise on its light"),
    ],
)
def test_a_dataset_made_in_an_earlier_way_does_not_grow(hall, tmp_path, change, line):
    out = tmp_path / "before"
    shutil.copytree(hall / "reference", out)
    manifest = json.loads((out / "manifest.json").read_text())
    change(manifest["identity"]["scenes"]["hall"]["inputs"])
    (out / "manifest.json").write_text(json.dumps(manifest))
    frame = out / "storm/hall/results/frame000000.exr"
    frame.unlink()
    with pytest.raises(StorageError, match=f"holds another dataset: .*{line}"):
        make(write_preset(hall, STORM, output=LIGHT), out)
    assert not frame.exists()


def test_a_recipe_of_lit_frames_says_who_knows_the_view_transform(hall, tmp_path):
    out = make(write_preset(hall, STORM), tmp_path / "shown")
    recipe = hall / "shown.recipe.json"
    recipe.write_text(recipe_of(out, PlainProgress(sys.stderr)).text())
    made = noisy_world.open(recipe)
    line = "of storm/hall is made before the view transform of hall, which Blender alone knows; 'noisy-world remake'"
    for asked in (lambda: made["storm/hall"][0].rgb, lambda: made["storm/hall"][0].image_bytes("rgb")):
        with pytest.raises(InputError, match=line):
            asked()
