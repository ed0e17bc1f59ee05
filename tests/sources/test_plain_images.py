# SPDX-License-Identifier: GPL-3.0-or-later
"""A folder of plain images as a scene: colour alone, in the order of names, without depth or poses."""

import json
import shutil

import cv2
import numpy as np
import pytest
from refusals import refused

from noisy_world.cli.command import main
from noisy_world.preset.keys import read_preset
from noisy_world.core.schema import ConfigPath
from noisy_world.dataset.plan import make_plan
from noisy_world.sources.recording import read_images

NAMES = ("shot_2.png", "shot_10.png", "Shot_33.png")  # in the order of their numbers


def plates(folder, names=NAMES):
    """Write even greys, each its own."""
    folder.mkdir()
    for n, name in enumerate(names):
        cv2.imwrite(str(folder / name), np.full((12, 16, 3), 50 * n + 60, np.uint8))
    return folder


def preset_of(folder, **scene):
    document = {
        "seed": 3,
        "scenes": [{"sequence": "plates", "layout": "images", **scene}],
        "render": {"backend": "reference"},
        "settings": [
            {"name": "clean"},
            {"name": "lighter", "perturb": [{"brightness": {"offset": 0.1}}]},
            {"name": "noisy", "perturb": [{"gaussian_noise": {"severity": 2}}]},
        ],
        "output": {"modalities": ["rgb"], "layout": "tum"},
    }
    path = folder / "preset.json"
    path.write_text(json.dumps(document))
    return path


def test_plain_images_are_perturbed_in_the_order_of_their_names(tmp_path, capfd):
    plates(tmp_path / "plates")
    (tmp_path / "plates" / ".hidden.png").write_bytes(b"")
    assert main(["generate", str(preset_of(tmp_path, rate_hz=24.0)), "--out", str(tmp_path / "out")]) == 0, capfd
    made = tmp_path / "out"
    for setting, offset in (("clean", 0.0), ("lighter", 25.5)):
        seen = [cv2.imread(str(path)) for path in sorted((made / setting / "plates" / "rgb").iterdir())]
        assert [np.unique(image).tolist() for image in seen] == [[round(50 * n + 60 + offset)] for n in range(3)]
    assert sorted(item.name for item in (made / "noisy/plates").iterdir()) == ["frames.jsonl", "rgb", "rgb.txt"]
    stamps_s = [float(line.split()[0]) for line in (made / "noisy/plates/rgb.txt").read_text().splitlines()[-3:]]
    assert np.allclose(np.diff(stamps_s), 1 / 24, atol=1e-6)
    assert (made / "clean/plates/rgb/000001.png").read_bytes() == (tmp_path / "plates" / NAMES[1]).read_bytes()
    told = json.loads((made / "noisy/cam_params.json").read_text())["camera"]
    assert (told["fx"], told["cx"], told["cy"]) == (pytest.approx(19.2), 7.5, 5.5)
    assert any("nothing says its camera" in note for note in json.loads((made / "run.json").read_text())["notes"])


def test_what_needs_depth_or_poses_says_so_in_a_line(tmp_path):
    plates(tmp_path / "plates")
    path = preset_of(tmp_path)
    for change, words in (
        ("output.modalities=[rgb, depth]", ("plates has no depth", "output.modalities")),
        ("settings=[{name: a, perturb: [{haze: {severity: 1}}]}]", "a needs depth, and plates has none"),
        (
            "settings=[{name: a, perturb: [{camera_motion_blur: {}}]}]",
            "plain images have",
        ),
        ("settings=[{name: a, perturb: [{motion_deviation: {rotation_deg: 1}}]}]", "cannot be seen from elsewhere"),
        ("camera={width: 8, height: 6, fx: 4, fy: 4, cx: 3, cy: 2}", "its images are 16 x 12"),
        ("scenes.0.undistort=true", ("undistort: ", "leave it out")),
        ("scenes.0.register=true", ("register: ", "leave it out")),
        ("scenes.0.poses=require", ("poses: ", "leave it out")),
    ):
        refused(lambda change=change: make_plan(read_preset(path, [change])), names=words)


def test_a_folder_of_images_without_a_layout_is_told_how_it_is_read(tmp_path, capsys):
    plates(tmp_path / "plates")
    preset = preset_of(tmp_path, layout="auto")
    assert main(["generate", str(preset), "--out", str(tmp_path / "out"), "--dry-run"]) == 1
    said = capsys.readouterr().err
    assert "scenes.0.sequence: " in said
    assert (
        "plates has the files of no layout, but plain images; layout: images reads it, without depth and poses" in said
    )


def test_an_image_of_another_size_is_told_nothing_of_depth(tmp_path, capsys):
    plates(tmp_path / "plates")
    cv2.imwrite(str(tmp_path / "plates" / "shot_40.png"), np.zeros((10, 16, 3), np.uint8))
    assert main(["generate", str(preset_of(tmp_path)), "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert "shot_40.png: is 16 x 10 pixels, but the first colour image is 16 x 12; a sequence has one size\n" in said


def test_what_is_no_folder_of_images_is_one_line(tmp_path):
    place = ConfigPath("preset", "scenes.0")
    (tmp_path / "plates").mkdir()
    refused(read_images, tmp_path / "plates", place, names="plates: has no PNG or JPEG images")
    (tmp_path / "plates" / "a.EXR").write_bytes(b"v")
    refused(read_images, tmp_path / "plates", place, names=("plates: ", ".exr", "convert them"))
    shutil.rmtree(tmp_path / "plates")
    plates(tmp_path / "plates", ("a1.png", "a01.png"))
    refused(read_images, tmp_path / "plates", place, names=("a1.png", "a01.png", "keep one of"))
    (tmp_path / "plates" / "a01.png").unlink()
    cv2.imwrite(str(tmp_path / "plates" / "b.png"), np.zeros((8, 8, 3), np.uint8))
    refused(read_images(tmp_path / "plates", place).camera, None, names=("b.png: ", "8 x 8", "16 x 12"))
