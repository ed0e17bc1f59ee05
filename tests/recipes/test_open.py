# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset and its recipe, opened: the same frames, those of the files, in any order and in other processes."""

import hashlib
import json
import pickle
import random
import shutil
import sys
import threading

import cv2
import numpy as np
import pytest
from cases import cases
from recipes_made import COUNT, SETTINGS, frames_from_arithmetic, make, progress
from refusals import refused
from worlds import ROOT
from written import RIG, stored

import noisy_world
from noisy_world.core.errors import NoisyWorldError
from noisy_world.preset.keys import read_preset
from noisy_world.perturb import frames as perturbed_frames
from noisy_world.dataset.run import Run
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.recipe import recipe_of


def records(out, name):
    return {item["frame"]: item for item in map(json.loads, (out / name / "frames.jsonl").read_text().splitlines())}


def check(frame, out, record):
    """Hold a frame against the files, by hashing them and by decoding them with OpenCV."""
    for kind, data in (("frame", frame.rgb_bytes()), ("depth", frame.depth_bytes())):
        (name,) = [name for name in record["sha256"] if name.rpartition("/")[2].startswith(kind)]
        path = out / frame.sequence / name
        assert hashlib.sha256(data).hexdigest() == record["sha256"][name]
        assert data == path.read_bytes()
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if kind == "frame":
            assert np.array_equal(frame.rgb, pixels[..., ::-1])
        else:
            assert np.array_equal(frame.depth_m, (pixels / 6553.5).astype(np.float32))
    assert frame.stamp_s == record["time_s"]
    assert frame.depth_stamp_s == record.get("depth_time_s", record["time_s"])
    assert frame.done == record.get("perturbed", {})


def test_random_frames_of_every_setting_are_those_of_the_files(made):
    opened = noisy_world.open(made.recipe, made.clean)
    assert len(opened.settings) == 30
    known = {name: records(made.out, name) for name in opened}
    poses = {name: np.loadtxt(made.out / name / "traj.txt").reshape(-1, 4, 4) for name in opened}
    rng = random.Random(4)
    drawn = [(name, rng.choice(sorted(known[name]))) for name in rng.choices(sorted(opened), k=200)]
    for name, index in drawn:
        frame = opened[name][index]
        check(frame, made.out, known[name][index])
        assert frame.c2w.dtype == np.float64
        assert np.abs(frame.c2w - poses[name][sorted(known[name]).index(index)]).max() < 1e-9


def test_a_dataset_is_opened_by_its_files(made):
    opened = noisy_world.open(made.out)
    assert list(opened) == sorted(f"{name}/box" for name in opened.settings)
    assert opened.scenes == ["box"]
    for name in ("clean/box", "early/box", "fast/box", "shaky_mixed/box"):
        known = records(made.out, name)
        assert list(opened[name].frames) == sorted(known)
        for frame in opened[name]:
            check(frame, made.out, known[frame.index])


@cases(
    ("output", "keys"),
    [
        ({"layout": "tum", "image": "png"}, {}),
        ({"layout": "tum", "image": "png", "depth_beyond": "farthest", "colour": "grey"}, {"rig": RIG}),
        ({"layout": "euroc", "image": "png"}, {}),
        ({"layout": "replica", "image": "jpg", "colour": "grey", "depth_scale_per_m": 1000}, {}),
    ],
)
@pytest.mark.usefixtures("no_blender")
def test_every_layout(tmp_path_factory, output, keys):
    wanted = ("clean", "early", "fast", "shaky_mixed") if "rig" in keys else ("clean", "adrift", "mixed", "shaky")
    settings = [item for item in SETTINGS if item.get("name") in wanted]
    made = make(tmp_path_factory.mktemp("layout"), output=output, settings=settings, frames=6, **keys)
    files, recipe = noisy_world.open(made.out), noisy_world.open(made.recipe, made.clean)
    assert list(files) == list(recipe)
    for name in files:
        assert files[name].frames == recipe[name].frames
        for one, other in zip(files[name], recipe[name], strict=True):
            assert one.rgb_bytes() == other.rgb_bytes()
            assert one.depth_bytes() == other.depth_bytes()
            assert np.array_equal(one.rgb, other.rgb)
            assert np.array_equal(one.depth_m, other.depth_m)
            assert np.abs(one.c2w - other.c2w).max() < 1e-6
            assert (one.stamp_s, one.depth_stamp_s, one.done) == (other.stamp_s, other.depth_stamp_s, other.done)


# --- recordings ---


def recorded(folder, source, settings, **output):
    """Make a dataset of a recording, and its recipe; return both."""
    preset = stored(folder, source, **output)
    document = {**json.loads(preset.read_text()), "settings": settings}
    del document["camera"]
    preset.write_text(json.dumps(document))
    run_of(preset, folder / "out")
    (folder / "recipe.json").write_text(recipe_of(folder / "out", progress()).text())
    return folder / "out", folder / "recipe.json"


def run_of(preset, out):
    Run(make_plan(read_preset(preset)), out, progress=progress(), stop=threading.Event()).make_dataset()


@cases("image", ["jpg", "png"])
def test_a_recordings_frames_are_made_of_the_recording(made, tmp_path_factory, image):
    # A clean JPEG is the recording's own file, linked; as PNG it is encoded anew.
    settings = [item for item in SETTINGS if item.get("name") in ("clean", "late", "fast", "mixed", "fog_dynamic")]
    source = made.out / "fast/box"
    out, recipe = recorded(tmp_path_factory.mktemp("recorded"), source, settings, layout="replica", image=image)
    opened = noisy_world.open(recipe)
    for name in opened:
        known = records(out, name)
        for frame in opened[name]:
            for kind, data in (("frame", frame.rgb_bytes()), ("depth", frame.depth_bytes())):
                (digest,) = [value for file, value in known[frame.index]["sha256"].items() if kind in file]
                assert hashlib.sha256(data).hexdigest() == digest
            assert frame.done == known[frame.index].get("perturbed", {})
    frames = perturbed_frames(
        source, [{"fog": {"severity": 5, "mode": "dynamic"}}], seed=3, setting="fog_dynamic", scene="box"
    )
    for one, other in zip(frames, opened["fog_dynamic/box"], strict=True):
        assert np.array_equal(one.rgb, other.rgb_uncompressed)


def test_clean_frames_leave_recordings_out(made, tmp_path):
    world, out, clean = tmp_path / "world", tmp_path / "out", tmp_path / "clean"
    shutil.copytree(made.out / "fast", world / "fast")
    scenes = [{"name": "box", "mesh": "mesh.ply", "trajectory": "traj.txt"}, {"name": "walk", "sequence": "fast/box"}]
    with frames_from_arithmetic():
        settings = [item for item in SETTINGS if item.get("name") in ("clean", "mixed")]
        both = make(tmp_path, settings=settings, scenes=scenes, output={"layout": "replica", "image": "jpg"})
    assert (both.out, both.clean) == (out, clean)
    assert sorted(path.name for path in clean.iterdir() if path.name[0] != ".") == ["box", "clean.json"]
    opened = noisy_world.open(both.recipe, clean)
    for name in ("clean/box", "mixed/box", "clean/walk", "mixed/walk"):
        known = records(out, name)
        for frame in opened[name]:
            check(frame, out, known[frame.index])


def test_another_recording_is_refused(made, tmp_path):
    shutil.copytree(made.out / "fast", tmp_path / "fast")
    _, recipe = recorded(tmp_path, tmp_path / "fast/box", [{"name": "clean"}], layout="replica")
    with (tmp_path / "fast/box/traj.txt").open("a") as file:
        file.write("\n")
    opened = noisy_world.open(recipe)
    refused(lambda: opened["clean/box"], names=("scenes: box: traj.txt ", "trajectory_sha256"))


def test_rays_are_cast_on_the_spot(tmp_path):
    pytest.importorskip("embreex", reason="embreex is not installed: the extra `embree`")
    settings = [item for item in SETTINGS if item.get("name") in ("clean", "late", "shaky_mixed", "drift")]
    render = {"engine": "embree", "samples": 1, "backend": "reference"}
    made = make(tmp_path, clean=False, settings=settings, frames=5, render=render)
    opened = noisy_world.open(made.recipe)
    order = [(name, frame) for frame in (3, 1) for name in ("clean/box", "shaky_mixed/box", "late/box", "drift/box")]
    for name, index in order[::-1]:
        if index in opened[name]:
            check(opened[name][index], made.out, records(made.out, name)[index])
    again = pickle.loads(pickle.dumps(opened))
    assert again["shaky_mixed/box"][1].rgb_bytes() == opened["shaky_mixed/box"][1].rgb_bytes()
    opened.close()


# --- access ---


def test_slices_and_counting_from_the_end(made):
    opened = noisy_world.open(made.recipe, made.clean)
    early = opened["early/box"]  # frames 2 to 8: the first two have no depth to go with them

    def numbers(found):
        return [frame.index for frame in found]

    assert early[-1].index == 8
    assert numbers(early[:]) == [2, 3, 4, 5, 6, 7, 8]
    assert numbers(early[:4]) == [2, 3]  # by the frames' own numbers, as --frames 0:4
    assert numbers(early[-2:]) == [7, 8]
    assert numbers(early[2:9:3]) == [2, 5, 8]
    assert numbers(early[::-1]) == [8, 7, 6, 5, 4, 3, 2]
    assert early[20:] == []


def test_what_a_user_gets_says_what_it_is(made):
    for opened in (noisy_world.open(made.recipe, made.clean), noisy_world.open(made.out)):
        assert repr(opened).startswith(f"<{opened.place}: {len(opened)} sequences, '")
        assert repr(opened["early/box"]) == "<sequence 'early/box': 7 frames, 2 to 8>"
        assert repr(opened["clean/box"][3]).startswith("<frame 3 of 'clean/box' at ")
        listed = opened.frames(["early", "fast"])
        assert repr(listed) == f"<10 frames of 2 sequences of {opened.place}>"


def test_what_is_not_there_is_said(made):
    opened = noisy_world.open(made.recipe, made.clean)
    refused(lambda: opened["fog_s4/box"], names=("'fog_s4/box'", "fog_s3/box"))
    for name, frame, named in (
        ("early/box", 0, "2 to 8"),
        ("fast/box", 3, "0 to 2"),
        ("early/box", -8, "2 to 8"),  # frame 1, which was left out
        ("clean/box", -99, "0 to 8"),
    ):
        refused(opened[name].__getitem__, frame, names=(name, f"frame {frame};", named), error=IndexError)
    refused(opened["clean/box"].__getitem__, 1.0, names="float", error=TypeError)
    refused(opened.frames, "fgo*", names=("settings: 'fgo*'", "none of 30 settings"))
    assert opened.get("fog_s4/box") is None
    assert "fog_s3/box" in opened
    assert "fog_s4/box" not in opened


def test_frames_that_nobody_rendered_are_missed_with_the_command(made, tmp_path):
    named = ("late/box needs clean frames of box", "'noisy-world render-clean", "--scenes box --settings late")
    refused(lambda: noisy_world.open(made.recipe)["late/box"][3].rgb, names=named)
    shutil.copytree(made.clean, tmp_path / "clean")
    for file in (tmp_path / "clean/box").glob("*/000004.npy"):
        file.unlink()
    opened = noisy_world.open(made.recipe, tmp_path / "clean")
    assert opened["clean/box"][3].rgb.any()
    refused(lambda: opened["clean/box"][4].rgb, names=f"{tmp_path}/clean lacks them")


def test_no_folder_and_no_recipe(tmp_path, made):
    for path, words in [
        (tmp_path / "none", "no such folder or recipe"),
        (tmp_path, "holds no sequence; name a recipe, a dataset"),
        (made.recipe.parent / "preset.yaml", "a recipe is what 'noisy-world recipe DATASET' writes"),
    ]:
        refused(noisy_world.open, path, names=(f"{path}: ", words))
    refused(noisy_world.open, made.recipe, tmp_path, names="is no folder of clean frames")
    refused(noisy_world.open, "nowhere://bucket/rooms", names="nowhere://bucket/rooms: ", error=NoisyWorldError)
    refused(noisy_world.open, made.out, made.clean, names="clean goes with a recipe")


def test_sequences_in_a_plain_layout_are_opened(made, tmp_path):
    shutil.copytree(made.out / "late/box", tmp_path / "plain/kitchen")
    (tmp_path / "plain/kitchen/frames.jsonl").unlink()
    for path, name in ((tmp_path / "plain", "kitchen"), (tmp_path / "plain/kitchen", "kitchen")):
        opened = noisy_world.open(path)
        assert list(opened) == [name]
        frame = opened[name][5]
        assert frame.rgb_bytes() == (made.out / "late/box/results/frame000005.jpg").read_bytes()
        assert (frame.stamp_s, frame.done, len(opened[name])) == (5 / 20, {}, COUNT)


def test_sequences_copied_out_of_a_dataset_say_enough(made, tmp_path):
    shutil.copytree(made.out / "early", tmp_path / "some/early")
    frame = noisy_world.open(tmp_path / "some")["early/box"][5]
    check(frame, made.out, records(made.out, "early/box")[5])


@pytest.mark.parametrize("perturbed", ["motion", 0.1, ["rgb"], None])
def test_a_record_whose_perturbations_are_no_object_is_damaged(made, tmp_path, perturbed):
    shutil.copytree(made.out / "late/box", tmp_path / "some/late/box")
    path = tmp_path / "some/late/box/frames.jsonl"
    lines = [json.loads(line) | {"perturbed": perturbed} for line in path.read_text().splitlines()]
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    opened = noisy_world.open(tmp_path / "some")
    refused(lambda: opened["late/box"][5], names="frames.jsonl: frame 5: ")


def test_the_compositors_colour_is_not_made_here(made, tmp_path):
    text = made.recipe.read_text().replace('"backend":"reference"', '"backend":"compositor"')
    (tmp_path / "recipe.json").write_text(text)
    opened = noisy_world.open(tmp_path / "recipe.json", made.clean)
    refused(lambda: opened["fog_s3/box"][3].rgb, names=("compositor", "'noisy-world remake'"))
    assert opened["fog_s3/box"][3].depth_bytes() == (made.out / "fog_s3/box/results/depth000003.png").read_bytes()
    assert opened["late/box"][3].rgb_bytes() == (made.out / "late/box/results/frame000003.jpg").read_bytes()


def test_another_processor_is_said(made, tmp_path):
    content = json.loads(made.recipe.read_text())
    content["identity"]["processor"]["features"].append("AVX1024")
    content["identity"]["versions"]["numpy"] = "1.0"
    (tmp_path / "recipe.json").write_text(json.dumps(content))
    with pytest.warns(UserWarning, match="numpy was 1.0, is .*; a processor without AVX1024: pixels may"):
        noisy_world.open(tmp_path / "recipe.json", made.clean)


def test_what_is_opened_can_be_pickled(made):
    for opened in (noisy_world.open(made.recipe, made.clean), noisy_world.open(made.out)):
        frame = opened["mixed/box"][2]
        for again in (
            pickle.loads(pickle.dumps(opened))["mixed/box"][2],
            pickle.loads(pickle.dumps(opened["mixed/box"]))[2],
            pickle.loads(pickle.dumps(frame)),
        ):
            assert again.rgb_bytes() == frame.rgb_bytes()
            assert again.done == frame.done


def test_the_pages_example(made):
    sys.path.append(str(ROOT / "docs/examples"))
    import from_a_recipe

    found = from_a_recipe.brightness(made.recipe, made.clean, "clean")
    files = sorted((made.out / "clean/box/results").glob("frame*.jpg"))
    (value,) = found.values()
    assert abs(value - np.mean([cv2.imread(str(file)).mean() for file in files])) < 0.5, "up to JPEG's loss"
