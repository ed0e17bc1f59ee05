# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings in presets: cameras, rates and globs; several cameras in one dataset."""

from recorded_presets import camera, preset_of, recorded
import errno
import json
import os
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from refusals import refused
import yaml
from made_recordings import write_tum
from worlds import generate_here
from runs import run
from written import names_in

from noisy_world.layouts import LAYOUTS, find_sequence
from noisy_world.core.errors import StorageError
from noisy_world.dataset.estimate import estimate
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan
from noisy_world.sources import read_scenes


pytestmark = pytest.mark.usefixtures("no_blender")


# --- intrinsics ---


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_without_a_camera_a_recordings_own_counts(tmp_path, layout):
    own = camera(fx=4.25, fy=4.75, cx=3.125, cy=-2.0625)
    source = recorded(tmp_path, layout, camera=own)
    preset = preset_of(tmp_path / "p", {"name": "box", "sequence": str(source)})
    run(preset, tmp_path / "again")
    told = json.loads((tmp_path / "again/clean/cam_params.json").read_text())["camera"]
    assert told == {"w": 8, "h": 6, "fx": 4.25, "fy": 4.75, "cx": 3.125, "cy": -2.0625, "scale": 6553.5}
    manifest = json.loads((tmp_path / "again/manifest.json").read_text())
    assert manifest["camera"]["cy_px"] == -2.0625
    assert manifest["identity"]["scenes"]["box"]["camera"]["fx"] == 4.25
    for other, names in (
        (camera(fx=4.5, cx=3.125, cy=-2.0625), ["scenes.0.sequence: ", "fx 4.25, fy 4.75", "fx 4.5, fy 4,"]),
        (camera(width=16), ["scenes.0.sequence: ", "8 x 6", "16 x 6", "leave it out"]),
    ):
        refused(run, preset, tmp_path / "no", overrides=["camera=" + json.dumps(other)], names=names)
    # What is nearer or farther than a camera sees is no contradiction, and neither is rounding.
    wide = json.dumps({**own, "fx": 4.2500001, "near_m": 0.5, "far_m": 3.0})
    run(preset, tmp_path / "near", overrides=[f"camera={wide}"])


@pytest.mark.parametrize("layout", ["replica", "tum"])
def test_no_camera_at_all_is_never_guessed(tmp_path, layout):
    source = recorded(tmp_path, layout)
    (source.parent / "cam_params.json").unlink()
    preset = preset_of(tmp_path / "p", {"sequence": str(source)})
    (whole,) = re.findall(r"camera: ({[^}]*})", refused(make_plan, read_preset(preset), names="scenes.0.sequence"))
    assert yaml.safe_load(whole) == {"width": 8, "height": 6, "fx": "FX", "fy": "FY", "cx": "CX", "cy": "CY"}
    for name, value in {"FX": 4.0, "FY": 4.0, "CX": 3.5, "CY": 2.5}.items():
        whole = whole.replace(name, str(value))
    run(preset, tmp_path / "given", overrides=[f"camera={whole}"])


@pytest.mark.parametrize(
    ("name", "camera"),
    [
        # TUM's table of intrinsics, https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
        ("freiburg1_desk", {"fx": 517.3, "fy": 516.5, "cx": 318.6, "cy": 255.3}),
        ("my_fr2-xyz", {"fx": 520.9, "fy": 521.0, "cx": 325.1, "cy": 249.7}),
        ("fr3/office", {"fx": 535.4, "fy": 539.2, "cx": 320.1, "cy": 247.6}),
        ("frame1", {"fx": "FX", "fy": "FY", "cx": "CX", "cy": "CY"}),
        ("fr12", {"fx": "FX", "fy": "FY", "cx": "CX", "cy": "CY"}),
    ],
)
def test_the_camera_to_give_is_printed_whole(tmp_path, name, camera):
    black = np.zeros((480, 640), np.uint8)
    write_tum(tmp_path / name, [np.stack([black] * 3, axis=-1)], [black], [(0, 0, 0, 0, 0, 0, 1)])
    preset = read_preset(preset_of(tmp_path / "p", {"name": "desk", "sequence": str(tmp_path / name)}))
    (whole,) = re.findall(r"camera: ({[^}]*})", refused(make_plan, preset, names="scenes.0.sequence"))
    assert yaml.safe_load(whole) == {"width": 640, "height": 480, **camera}


def test_scenes_with_different_cameras(tmp_path, capfd):
    narrow = recorded(tmp_path / "a", camera=camera(fx=9.0))
    big = recorded(tmp_path / "b", "tum", camera=camera(width=12, height=10))
    scenes = [{"name": "narrow", "sequence": str(narrow)}, {"name": "big", "sequence": str(big)}]
    settings = [{"name": "clean"}, {"name": "hazy", "perturb": [{"fog_depth": {"severity": 3}}]}]
    for layout in LAYOUTS:
        preset = preset_of(tmp_path / layout, *scenes, settings=settings, output={"layout": layout, "overview": True})
        out = tmp_path / f"out_{layout}"
        run(preset, out)
        manifest = json.loads((out / "manifest.json").read_text())
        assert "camera" not in manifest
        assert {name: item["fx_px"] for name, item in manifest["cameras"].items()} == {"narrow": 9.0, "big": 4.0}
        for setting in ("clean", "hazy"):
            assert not (out / setting / "cam_params.json").exists()
            for name, size, fx in (("narrow", (8, 6), 9.0), ("big", (12, 10), 4.0)):
                found = find_sequence(out / setting / name)
                assert found.size_px == size
                assert found.known_camera.fx_px == fx
                if LAYOUTS[layout].setting_files:
                    assert manifest["files"][f"{setting}/{name}"]["cam_params.json"]
        (again,) = make_plan(read_preset(preset_of(tmp_path / f"q{layout}", {"sequence": f"{out}/clean/big"}))).renders
        assert again.camera.fx_px == 4.0
        before = names_in(out)
        assert any("overview.png" in name for name in before)
        alone = preset_of(tmp_path / f"alone_{layout}", scenes[0], output={"layout": layout})
        run(alone, out, overwrite=True)
        assert not {name for name in names_in(out) if "big" in name or "hazy" in name}
        assert (out / "clean/cam_params.json").exists() == bool(LAYOUTS[layout].setting_files)
        assert not (out / "clean/narrow/cam_params.json").exists()
    plan = make_plan(read_preset(preset))
    assert plan.camera is None
    alone_bytes = [
        estimate(make_plan(read_preset(preset_of(tmp_path / f"one{k}", scenes[k], settings=settings, output={"layout": "euroc"})))).bytes_written  # noqa: E501
        for k in range(2)
    ]  # fmt: skip
    assert abs(estimate(plan).bytes_written - sum(alone_bytes)) <= 1
    capfd.readouterr()
    shown = generate_here(preset, "--dry-run", "--out", tmp_path / "dry").stdout
    assert "camera     narrow: 8 x 6, fx 9, fy 4" in shown
    assert "camera     big: 12 x 10, fx 4, fy 4" in shown
    mixed = preset_of(tmp_path / "m", scenes[0], {"mesh": "embedded:room", "trajectory": {"handheld": {"frames": 2}}})
    assert {name: item.width_px for name, item in make_plan(read_preset(mixed)).cameras.items()} == {
        "narrow": 8,
        "room": 1200,
    }


@pytest.mark.parametrize("layout", ["replica", "euroc"])
def test_a_dataset_takes_in_a_scene_with_another_camera(tmp_path, layout):
    one = {"name": "one", "sequence": str(recorded(tmp_path / "a", camera=camera(fx=9.0)))}
    two = {"name": "two", "sequence": str(recorded(tmp_path / "b", camera=camera(fx=7.0)))}
    keys = {"settings": [{"name": "clean"}, {"name": "same"}], "output": {"layout": layout}}
    both = preset_of(tmp_path / "both", one, two, **keys)
    run(both, tmp_path / "at_once")
    for name, grown in (("with", both), ("beside", preset_of(tmp_path / "second", two, **keys))):
        out = tmp_path / name
        run(preset_of(tmp_path / "first", one, **keys), out)
        images = {path: path.stat().st_mtime_ns for path in out.rglob("*.*g")}
        assert (out / "clean/cam_params.json").exists() == (layout == "replica")
        run(grown, out)
        assert not (out / "clean/cam_params.json").exists()
        assert {path: path.stat().st_mtime_ns for path in images} == images
        assert names_in(out) == names_in(tmp_path / "at_once")
        for setting, scene, fx in (("clean", "one", 9.0), ("same", "one", 9.0), ("same", "two", 7.0)):
            assert find_sequence(out / setting / scene).known_camera.fx_px == fx
        told, wanted = (json.loads((place / "manifest.json").read_text()) for place in (out, tmp_path / "at_once"))
        for item in (told, wanted):
            for part in ("preset", "preset_sha256"):
                del item["identity"][part]
            for scene in item["identity"]["scenes"].values():
                scene["entry"] = None
        assert told == wanted
        assert run(grown, out).frames_rendered == 0


@pytest.mark.parametrize("value", [None, "8", -8, [8], {}, 10**400])
def test_a_manifest_whose_camera_is_none_is_one_line(tmp_path, value):
    out = recorded(tmp_path).parents[1]
    path = out / "manifest.json"
    content = json.loads(path.read_text())
    content["identity"]["scenes"]["box"]["camera"]["fx"] = value
    path.write_text(json.dumps(content))
    other = {"name": "other", "sequence": str(out / "clean/box")}
    preset = preset_of(tmp_path / "p", other, output={"image": "png"})
    refused(run, preset, out, names=["manifest.json", "identity"], error=StorageError)


def test_depth_of_another_camera_keeps_it(tmp_path):
    source = recorded(tmp_path, "euroc")
    path = source / "mav0/depth0/sensor.yaml"
    path.write_text(path.read_text().replace("intrinsics: [4.0", "intrinsics: [4.5"))
    found = find_sequence(source)
    assert (found.known_camera.fx_px, found.optics.depth.intrinsics.fx_px) == (4.0, 4.5)
    assert found.optics.depth.rgb_from_depth is None


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        ("resolution: [8, 6]", "resolution: [8.5, 6]", ["resolution: ", "8.5"]),
        ("resolution: [8, 6]", "resolution: [true, 6]", ["resolution: ", "finite"]),
        ("intrinsics: [4.0", "intrinsics: [-4.0", ["intrinsics: ", "-4"]),
        ("intrinsics: [4.0", "intrinsics: [.nan", ["intrinsics: ", "finite"]),
        ("intrinsics: [4.0", "intrinsics: [x", ["intrinsics: ", "finite"]),
        ("resolution: [8, 6]", "resolution: [6, 8]", ["6 x 8", "0000000000000000000.png has 8 x 6"]),
    ],
)
def test_a_sensor_yaml_that_no_camera_has(tmp_path, old, new, names):
    source = recorded(tmp_path, "euroc")
    for sensor in ("cam0", "depth0"):
        path = source / f"mav0/{sensor}/sensor.yaml"
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
    preset = read_preset(preset_of(tmp_path / "p", {"sequence": str(source)}))
    refused(make_plan, preset, names=["sensor.yaml: ", *names])


# --- rates and globs ---


def test_the_rate_of_a_sequence_without_stamps(tmp_path):
    source = recorded(tmp_path)
    (source / "frames.jsonl").unlink()
    scene = {"name": "box", "sequence": str(source)}
    run(preset_of(tmp_path / "p", scene, output={"layout": "tum"}), tmp_path / "twenty")
    run(preset_of(tmp_path / "q", {**scene, "rate_hz": 12.5}, output={"layout": "tum"}), tmp_path / "given")
    for name, gap_s in (("twenty", 0.05), ("given", 0.08)):
        stamps_s = np.loadtxt(tmp_path / name / "clean/box/groundtruth.txt")[:, 0]
        assert np.allclose(stamps_s, gap_s * np.arange(4), atol=1e-12)
    faster = preset_of(tmp_path / "q", {**scene, "rate_hz": 25}, output={"layout": "tum"})
    refused(run, faster, tmp_path / "given", names="scenes.0.rate_hz was 12.5, is 25", error=StorageError)
    own = {**scene, "sequence": str(tmp_path / "given/clean/box")}
    slower = preset_of(tmp_path / "r", {**own, "rate_hz": 20})
    refused(run, slower, tmp_path / "no", names=["scenes.0.rate_hz: ", "20 Hz", "rgb.txt", "12.5 Hz"])
    mesh = {"mesh": "embedded:room", "trajectory": {"handheld": {"frames": 2}}, "rate_hz": 20}
    refused(lambda: read_scenes(read_preset(preset_of(tmp_path / "s", mesh))), names=["scenes.0.rate_hz: ", "sequence"])


def test_a_glob_passes_over_files_beside_sequences(tmp_path):
    source = recorded(tmp_path)
    out = source.parents[1]
    assert (source.parent / "cam_params.json").is_file()
    preset = preset_of(out, {"sequence": "clean/*", "name": "s_*"})
    (scene,) = make_plan(read_preset(preset)).scenes
    assert scene.name == "s_box"
    (out / "clean/readme.txt").write_text("mine")
    (scene,) = make_plan(read_preset(preset_of(out, {"sequence": "clean/*", "name": "one"}))).scenes
    assert scene.name == "one"
    preset = preset_of(out, {"sequence": "clean/*"})
    (out / "clean/notes").mkdir()
    refused(make_plan, read_preset(preset), names="clean/notes: ")
    (out / "clean/notes").rmdir()
    (out / "clean/gone").symlink_to("nowhere")
    refused(make_plan, read_preset(preset), names="clean/gone: ")
    refused(make_plan, read_preset(preset_of(out, {"sequence": "clean/*.json"})), names="'clean/*.json'")


# --- images ---


def test_a_frame_that_cannot_be_used_is_named_before_anything_is_written(tmp_path):
    source = recorded(tmp_path, frames=4)
    preset = preset_of(tmp_path / "p", {"name": "box", "sequence": str(source)})
    images = source / "results"
    for name, pixels, names in (
        ("frame000002.png", np.zeros((5, 8, 3), np.uint8), ["8 x 5", "8 x 6"]),
        ("depth000003.png", np.zeros((6, 9), np.uint16), ["9 x 6", "8 x 6"]),
        ("depth000001.png", np.zeros((6, 8), np.uint8), ["8-bit grey"]),
    ):
        kept = (images / name).read_bytes()
        (images / name).write_bytes(encoded(pixels))
        refused(run, preset, tmp_path / "out", names=[f"{images / name}: ", *names])
        assert not (tmp_path / "out").exists()
        (images / name).write_bytes(kept)


def encoded(pixels):
    return cv2.imencode(".png", pixels)[1].tobytes()


def test_images_are_held_against_their_sha256_when_they_are_perturbed_and_when_they_are_linked(tmp_path):
    source = recorded(tmp_path, frames=3)
    image = source / "results/frame000001.png"
    image.write_bytes(encoded(cv2.imread(str(image)) ^ 1))
    noise = [{"name": "noise", "perturb": [{"brightness": {"severity": 1}}]}]
    for settings in ([{"name": "clean"}], noise):
        preset = preset_of(tmp_path / "p", {"name": "box", "sequence": str(source)}, settings=settings)
        out = tmp_path / f"out_{settings[0]['name']}"
        refused(run, preset, out, overrides=["output.image=png"], names=["frame000001.png: ", "frames.jsonl"])
    (source / "frames.jsonl").write_text('{"frame": 0, "time_s": 0.0, "sha256": {"results/frame000000.png": 3}}\n')
    refused(run, preset, tmp_path / "no", names="frames.jsonl")


def test_a_cut_image_is_not_linked_into_a_clean_dataset(tmp_path):
    source = recorded(tmp_path, "tum", frames=3)
    (source / "frames.jsonl").unlink()
    image = source / "depth/000001.png"
    image.write_bytes(image.read_bytes()[:-20])
    preset = preset_of(tmp_path / "p", {"name": "box", "sequence": str(source)}, output={"layout": "tum"})
    refused(run, preset, tmp_path / "out", names=["000001.png: ", "copy it again"])


def test_an_image_from_another_disk_is_copied_once_and_then_linked(tmp_path, monkeypatch):
    source, link = recorded(tmp_path, "replica", frames=2), Path.hardlink_to

    def elsewhere(self, target):
        if source in Path(target).parents:
            raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))
        link(self, target)

    monkeypatch.setattr(Path, "hardlink_to", elsewhere)
    settings = [{"name": "clean"}, {"name": "late", "perturb": [{"desync": {"offset": 1}}]}]
    preset = preset_of(tmp_path / "p", {"name": "box", "sequence": str(source)}, settings=settings)
    run(preset, tmp_path / "out", overrides=["output.image=png"])
    images = sorted((tmp_path / "out").glob("*/box/results/frame000000.png"))
    assert len(images) == 2
    assert {path.stat().st_nlink for path in images} == {2}


def test_16_bit_colour_is_kept_until_it_is_written(tmp_path):
    source = recorded(tmp_path, frames=2)
    (source / "frames.jsonl").unlink()
    steps = np.random.default_rng(0).integers(0, 65536, (2, 6, 8, 3), dtype=np.uint16)
    for k in range(2):
        (source / f"results/frame{k:06d}.png").write_bytes(encoded(steps[k]))
    lighter = {"name": "light", "perturb": [{"brightness": {"severity": 2}}]}
    scene = {"name": "box", "sequence": str(source)}
    preset = preset_of(tmp_path / "p", scene, settings=[{"name": "clean"}, lighter], output={"image": "png"})
    report = run(preset, tmp_path / "out")
    told = "box: 2 of 2 colour images have 16 bits a channel: they are perturbed so, and written with 8"
    assert told in report.notes
    for k in range(2):
        clean = cv2.imread(str(tmp_path / f"out/clean/box/results/frame{k:06d}.png"), cv2.IMREAD_UNCHANGED)
        assert clean.dtype == np.uint8
        assert np.abs(clean.astype(float) - steps[k] / 257).max() <= 0.5 + 1e-4


def test_images_that_are_grey_are_told(tmp_path):
    source = recorded(tmp_path, "euroc", frames=2)
    preset = preset_of(tmp_path / "p", {"name": "box", "sequence": str(source)}, output={"layout": "euroc"})
    assert "box: 2 of 2 colour images are grey: perturbations get three equal channels" in run(preset, tmp_path / "out").notes  # noqa: E501  # fmt: skip


@pytest.mark.parametrize("key", ["settings", "scenes"])
def test_names_that_differ_in_case_only_are_refused(tmp_path, key):
    source = recorded(tmp_path, frames=2)
    scenes = [{"name": name, "sequence": str(source)} for name in (("box", "Box") if key == "scenes" else ("box",))]
    settings = [{"name": name} for name in (("clean", "Clean") if key == "settings" else ("clean",))]
    names = ["'Box'", "'box'", "case"] if key == "scenes" else ["'Clean'", "'clean'", "case"]
    both = preset_of(tmp_path / "p", *scenes, settings=settings)
    refused(lambda: make_plan(read_preset(both)), names=names)
    # A dataset that has one of them already.
    first = preset_of(tmp_path / "a", scenes[0], settings=settings[:1])
    run(first, tmp_path / "out")
    second = preset_of(tmp_path / "b", scenes[-1], settings=settings[-1:])
    refused(run, second, tmp_path / "out", names=names, error=StorageError)
