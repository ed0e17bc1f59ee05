# SPDX-License-Identifier: GPL-3.0-or-later
"""A part of a recipe is made again and verified; clean frames are made, taken up again, and not those of another."""

import json
import os
import shutil
import threading

import fake_session
import numpy as np
import pytest
from cases import cases
from recipes_made import SETTINGS, make, progress
from refusals import refused
from recipes_made import noisy_world as command
from worlds import content

import noisy_world
from noisy_world.core.errors import InterruptedRunError, StorageError
from noisy_world.dataset.clean_store import make_store
from noisy_world.dataset.remaking import plan_of
from noisy_world.dataset.recipe import read_recipe

pytestmark = pytest.mark.usefixtures("no_blender")


@pytest.fixture(autouse=True)
def _blender_is_there(monkeypatch):
    """The commands look for bpy; here frames come from arithmetic."""
    monkeypatch.setattr("noisy_world.cli.generate.blender_problem", lambda entry: "")
    fake_session.Session.rendered.clear()


def test_a_part_is_made_again_and_verified(made, tmp_path, capfd):
    out = tmp_path / "out"
    words = ["remake", made.recipe, "--out", out, "--settings", "fo*,late", "--settings", "shaky"]
    assert command(*words, "--frames", "0:4") == 0
    said = capfd.readouterr().out.splitlines()
    assert said[-4:] == [
        "a part of the recipe: 26 of its 30 sequences were not made here",
        "a part of the recipe: 20 frames of these sequences were not made here",
        "32 images could not be compared, only checked against the dataset's own records: their blocks need frames "
        "0 to 8 whole",
        "4 sequences, 0 images as the recipe says",
    ]
    assert command(*words) == 0
    assert capfd.readouterr().out.splitlines()[-1] == "4 sequences, 72 images as the recipe says"
    whole = content(made.out)
    found = {name: digest for name, digest in content(out).items() if name != "manifest.json"}
    assert found == {name: whole[name] for name in found}
    assert len([name for name in found if name.endswith(".jpg")]) == 36


def test_an_input_that_differs_is_named(made, tmp_path, capfd):
    world = tmp_path / "world"
    shutil.copytree(made.recipe.parent, world)
    with (world / "mesh.ply").open("a") as file:
        file.write("\n")
    assert command("remake", world / "recipe.json", "--out", tmp_path / "out", "--settings", "fog_s3") == 1
    said = capfd.readouterr().err
    assert f"scenes: box: {world}/mesh.ply is not what the recipe was made from: its mesh_sha256 is" in said
    assert not (tmp_path / "out").exists()
    (world / "mesh.ply").unlink()
    assert command("remake", world / "recipe.json", "--out", tmp_path / "out") == 1
    assert "no such file" in capfd.readouterr().err
    words = ["--data", made.recipe.parent, "--settings", "fog_s3", "--frames", "0:2"]
    assert command("remake", world / "recipe.json", "--out", tmp_path / "out", *words) == 0


def test_a_setting_that_is_not_there_is_refused(made, tmp_path, capfd):
    assert command("remake", made.recipe, "--out", tmp_path, "--settings", "fgo*") == 1
    assert "'fgo*' matches none of 30 settings; near it: " in capfd.readouterr().err


# --- clean frames ---


def stored(folder):
    return {path.relative_to(folder).as_posix(): path.stat().st_mtime_ns for path in folder.rglob("*.npy")}


def test_clean_frames_are_those_of_the_renderer(made):
    for source in (0, 5):
        frame = fake_session.Session(None, "", None, camera(), options()).frame(moment(source))
        assert np.array_equal(np.load(made.clean / f"box/rgb/{source:06d}.npy"), frame.rgb)
        assert np.array_equal(np.load(made.clean / f"box/depth/{source:06d}.npy"), frame.depth_m)
    path = np.load(made.clean / "box/path.npy")
    poses = np.loadtxt(made.recipe.parent / "traj.txt")
    assert np.abs(path[:, 1:] - poses).max() < 1e-9
    assert np.array_equal(path[:, 0], np.arange(len(poses)) / 20)


def camera():
    from noisy_world.core.geometry import Intrinsics

    return Intrinsics(40, 32, 20.0, 20.0, 19.5, 15.5)


def options():
    from noisy_world.render.source import RenderOptions

    return RenderOptions(0.01, 1000, 1, 0)


def moment(index):
    from noisy_world.core.frame_request import FrameRequest

    return FrameRequest(index, 0.0, np.eye(4), np.eye(4))


def test_a_store_grows_and_mends_what_is_damaged(made, tmp_path, capfd):
    out = tmp_path / "clean"
    words = ["render-clean", made.recipe, "--out", out]
    assert command(*words, "--settings", "late", "--frames", "0:3") == 0
    assert sorted(fake_session.Session.rendered) == [0, 1, 2, 3, 4, 5], "late shows the depth of three frames later"
    opened = noisy_world.open(made.recipe, out)
    assert opened["late/box"][2].depth_bytes() == (made.out / "late/box/results/depth000002.png").read_bytes()
    before = stored(out)
    assert command(*words, "--settings", "fog_s3,shaky") == 0
    assert all(stored(out)[name] == mark for name, mark in before.items())
    assert len(fake_session.Session.rendered) == 6 + 3 + 9
    (out / "box/rgb/000001.npy").write_bytes((out / "box/rgb/000001.npy").read_bytes()[:-40])
    (out / "box/depth/000002.npy").unlink()
    flipped = bytearray((out / "box/rgb/000003.npy").read_bytes())
    flipped[len(flipped) // 2] ^= 1
    (out / "box/rgb/000003.npy").write_bytes(flipped)
    opened = noisy_world.open(made.recipe, out)
    refused(lambda: opened["late/box"][1].rgb, names=("000001.npy: ", "damaged", "'noisy-world render-clean'"))
    fake_session.Session.rendered.clear()
    assert command(*words, "--settings", "fog_s3") == 0
    assert fake_session.Session.rendered == [1, 2, 3]
    assert "3 frames rendered, 6 kept" in capfd.readouterr().out


def test_a_store_that_was_stopped_goes_on(made, tmp_path, monkeypatch):
    plan, stop = plan_of(read_recipe(made.recipe), settings=["clean"]), threading.Event()
    frame = fake_session.Session.frame

    def stopping(self, where):
        if where.index == 3:
            stop.set()
        return frame(self, where)

    monkeypatch.setattr(fake_session.Session, "frame", stopping)
    with pytest.raises(InterruptedRunError):
        make_store(plan, tmp_path / "clean", progress(), stop)
    assert len(list((tmp_path / "clean/box/rgb").iterdir())) == 4
    fake_session.Session.rendered.clear()
    assert make_store(plan, tmp_path / "clean", progress(), threading.Event()) == 5
    assert fake_session.Session.rendered == [4, 5, 6, 7, 8]


def test_another_recipes_clean_frames_are_refused(made, tmp_path):
    settings = [item for item in SETTINGS if item.get("name") in ("clean", "shaky")]
    shaky = {"name": "shaky", "perturb": [{"motion_deviation": {"rotation_deg": 4, "translation_m": 0.05}}]}
    other = make(tmp_path / "a", settings=[settings[0], shaky], output={"layout": "replica", "image": "jpg"})
    opened = noisy_world.open(made.recipe, other.clean)
    assert opened["clean/box"][3].rgb_bytes() == (made.out / "clean/box/results/frame000003.jpg").read_bytes()
    differs = "another recipe: settings.shaky.steps.0.parameters.rotation"
    refused(lambda: opened["shaky/box"], names=(str(other.clean), differs))
    far = make(tmp_path / "b", settings=settings, size=(20, 16), clean=True)
    opened = noisy_world.open(made.recipe, far.clean)
    refused(lambda: opened["clean/box"], names=(str(far.clean), "another recipe: scenes.box.camera"))
    plan, stop = plan_of(read_recipe(made.recipe)), threading.Event()
    for folder, named in ((far.clean, "scenes.box.camera"), (made.out, "no clean frames")):
        refused(make_store, plan, folder, progress(), stop, names=(str(folder), named), error=StorageError)


def test_a_recipe_with_clean_frames_needs_no_inputs(made, tmp_path):
    shutil.copy(made.recipe, tmp_path / "recipe.json")
    opened = noisy_world.open(tmp_path / "recipe.json", made.clean)
    assert opened["shaky/box"][5].rgb_bytes() == (made.out / "shaky/box/results/frame000005.jpg").read_bytes()
    refused(lambda: noisy_world.open(tmp_path / "recipe.json")["shaky/box"], names="no such file")


def test_no_space_for_clean_frames(made, tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    plan = plan_of(read_recipe(made.recipe), settings=["clean"])
    named = (str(tmp_path), "184 kB", "1.0 kB")
    refused(make_store, plan, tmp_path / "x", progress(), threading.Event(), names=named, error=StorageError)


# --- grown datasets ---


@cases("first", [["clean", "shaky"]])
def test_a_grown_dataset_keeps_what_its_last_preset_names(made, tmp_path_factory, first, capfd):
    folder = tmp_path_factory.mktemp("grown")
    make(folder, settings=[item for item in SETTINGS if item.get("name") in first], clean=False)
    grown = make(folder, settings=[item for item in SETTINGS if item.get("name") == "late"], clean=False)
    assert list(noisy_world.open(grown.recipe)) == ["clean/box", "late/box", "shaky/box"]
    capfd.readouterr()
    assert command("recipe", grown.out, "--out", os.devnull) == 0
    assert "does not name clean/box, shaky/box: the recipe verifies that, but cannot make it" in capfd.readouterr().err
    assert command("verify", grown.recipe, grown.out) == 0
    refused(lambda: noisy_world.open(grown.recipe)["shaky/box"], names="shaky")
    plan = plan_of(read_recipe(grown.recipe))
    assert [sequence.folder for sequence in plan.sequences] == ["late/box"]
    assert json.loads(grown.recipe.read_text())["sequences"].keys() == {"clean/box", "late/box", "shaky/box"}
