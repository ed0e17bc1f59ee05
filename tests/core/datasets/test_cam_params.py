# SPDX-License-Identifier: GPL-3.0-or-later
"""cam_params.json of recordings: where it is looked for, what it says, and what it must not say."""

import json

import cv2
import numpy as np
import pytest
from refusals import refused
from cases import cases

from noisy_world.layouts import find_sequence
from noisy_world.core.geometry import Intrinsics

CAMERA = {"w": 8, "h": 6, "fx": 4.5, "fy": 4.25, "cx": -1.25, "cy": 2.0, "scale": 2000.0}


def write_tum(folder):
    for kind, pixels in (("rgb", np.zeros((6, 8, 3), np.uint8)), ("depth", np.full((6, 8), 1000, np.uint16))):
        (folder / kind).mkdir(parents=True)
        assert cv2.imwrite(str(folder / kind / "0.png"), pixels)
        (folder / f"{kind}.txt").write_text(f"0.0 {kind}/0.png\n")
    (folder / "groundtruth.txt").write_text("0.0 0 0 0 0 0 0 1\n")


def write_replica(folder):
    (folder / "results").mkdir(parents=True)
    assert cv2.imwrite(str(folder / "results/frame000000.png"), np.zeros((6, 8, 3), np.uint8))
    assert cv2.imwrite(str(folder / "results/depth000000.png"), np.full((6, 8), 1000, np.uint16))
    (folder / "traj.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n")


@pytest.mark.parametrize(("write", "own"), [(write_replica, 6553.5), (write_tum, 5000.0)])
def test_the_sequences_own_file_stands_over_that_of_the_folder_above(tmp_path, write, own):
    folder = tmp_path / "scene"
    write(folder)
    found = find_sequence(folder)
    assert (found.depth_scale_per_m, found.known_camera) == (own, None)
    (tmp_path / "cam_params.json").write_text(json.dumps({"camera": {**CAMERA, "scale": 4000}}))
    found = find_sequence(folder)
    assert found.depth_scale_per_m == 4000
    assert found.known_camera == Intrinsics(8, 6, 4.5, 4.25, -1.25, 2.0)
    (folder / "cam_params.json").write_text("\ufeff" + json.dumps({"camera": {**CAMERA, "fx": 9}}), encoding="utf-8")
    found = find_sequence(folder)
    assert (found.depth_scale_per_m, found.known_camera.fx_px) == (2000, 9)
    assert found.frame(0).depth_m[0, 0] == np.float32(0.5)


def test_the_scale_may_stand_alone(tmp_path):
    write_tum(tmp_path)
    (tmp_path / "cam_params.json").write_text('{"camera": {"scale": 2000}}')
    found = find_sequence(tmp_path)
    assert (found.depth_scale_per_m, found.known_camera) == (2000, None)


WRONG = [
    ({"w": True}, "camera.w: is no finite number"),
    ({"w": 8.5}, "camera.w: is 8.5, but a size is whole pixels"),
    ({"h": 0}, "camera.h: is 0, but has to be above 0"),
    ({"fx": -4}, "camera.fx: is -4, but has to be above 0"),
    ({"fy": "4"}, "camera.fy: is no finite number"),
    ({"cx": None}, "camera.cx: is no finite number"),
    ({"cy": 10**400}, "camera.cy: is no finite number"),
    ({"cx": [1]}, "camera.cx: is no finite number"),
    ({"scale": 0}, "camera.scale: is 0, but has to be a number above 0"),
    ({"scale": "6553.5"}, 'camera.scale: is "6553.5"'),
    ({"scale": -1}, "camera.scale: is -1, but has to be a number above 0"),
    ({"scale": 1e-300}, "camera.scale: is 1e-300 steps per metre"),
    ({"scale": 1e300}, "camera.scale: is 1e+300 steps per metre"),
    ({"scale": 0.0002}, "a step is 5e+03 m; it has to be 0.1 to 1e+07; write 5000 where 0.0002 m per step is meant"),
    ({"scale": True}, "camera.scale: is true"),
    ({"scale": [0] * 100}, "but has to be a number above 0"),
]


@cases(["change", "words"], WRONG)
def test_values_that_no_camera_has(tmp_path, change, words):
    folder = tmp_path / f"{abs(hash(str(change)))}"
    write_tum(folder)
    (folder / "cam_params.json").write_text(json.dumps({"camera": CAMERA | change}))
    refused(find_sequence, folder, names=("cam_params.json: ", words))


TEXTS = [
    ("{}", "holds no camera with a scale"),
    ("[]", "holds no camera with a scale"),
    ('{"camera": [1]}', "holds no camera with a scale"),
    ('{"camera": {"w": 8}}', "holds no camera with a scale"),
    ('{"camera": {"scale": 1, "fx": 4}}', "camera: holds no w, but other intrinsics; a camera has w, h, fx, fy"),
    ('{"camera": {"scale": NaN}}', "is not valid JSON"),
    ('{"camera": {"scale": Infinity}}', "is not valid JSON"),
    ('{"camera": {"scale": 1e999}}', "holds 1e999"),
    ('{"camera": {"scale": 1e-400}}', "camera.scale: is 0.0, but has to be a number above 0"),
    ('{"camera": {"scale": ' + "9" * 5000 + "}}", "is not valid JSON"),
    ("[" * 200_000, "nested too deeply"),
    ("scale: 3", "is not valid JSON"),
    ("", "is not valid JSON"),
]


@cases(["text", "words"], TEXTS)
def test_texts_that_are_no_such_file(tmp_path, text, words):
    folder = tmp_path / f"{abs(hash(text))}"
    write_tum(folder)
    (folder / "cam_params.json").write_text(text)
    refused(find_sequence, folder, names=("cam_params.json: ", words))


def test_a_folder_a_link_to_nowhere_and_bytes_are_no_missing_file(tmp_path):
    for name, make in (
        ("folder", lambda path: path.mkdir()),
        ("link", lambda path: path.symlink_to("nowhere")),
        ("loop", lambda path: path.symlink_to(path)),
        ("bytes", lambda path: path.write_bytes(b"\xff\xfe\x00")),
    ):
        write_tum(tmp_path / name)
        make(tmp_path / name / "cam_params.json")
        refused(find_sequence, tmp_path / name, names="cam_params.json: cannot be read")


def test_a_size_that_the_images_do_not_have(tmp_path):
    write_tum(tmp_path)
    (tmp_path / "cam_params.json").write_text(json.dumps({"camera": {**CAMERA, "w": 80}}))
    refused(lambda: find_sequence(tmp_path).known_camera, names=("cam_params.json: ", "80 x 6", "0.png", "8 x 6"))


def test_images_of_other_sizes_in_one_sequence(tmp_path):
    write_tum(tmp_path)
    assert cv2.imwrite(str(tmp_path / "depth/0.png"), np.ones((3, 4), np.uint16))
    found = find_sequence(tmp_path)
    for read in (found.check_images, lambda: found.frame(0).depth_m):
        refused(read, names=("0.png: ", "4 x 3", "8 x 6"))


DEPTH_CAMERA = {key: CAMERA[key] for key in ("w", "h", "fx", "fy", "cx", "cy")}
UNIT = np.eye(4).tolist()


@cases(
    ("beyond", "words"),
    [
        ({"distortion": [0.1]}, "distortion: has to be a model and coefficients"),
        ({"distortion": {"model": "equidistant", "coefficients": ["a"]}}, "distortion: has to be a list of finite"),
        ({"distortion": {"model": "fov", "coefficients": [0.9]}}, "distortion: is of the model fov"),
        ({"distortion": {"model": "fov", "coefficients": [0.9]}}, "undistort the images"),
        ({"distortion": {"model": "equidistant", "coefficients": [0.9]}}, "distortion: holds "),
        ({"depth_camera": {"w": 8}}, "depth_camera: has to have w, h, fx"),
        ({"depth_camera": {**DEPTH_CAMERA, "fy": 0}}, "depth_camera.fy: is 0"),
        ({"depth_camera": {**DEPTH_CAMERA, "shares_lens": 1}}, "depth_camera.shares_lens: is neither true nor false"),
        ({"depth_camera": {**DEPTH_CAMERA, "rgb_from_depth": UNIT[:3]}}, "rgb_from_depth: has to be four rows"),
        ({"depth_camera": {**DEPTH_CAMERA, "rgb_from_depth": [*UNIT[:3], UNIT[2]]}}, "is no rigid pose; write it row"),
        (
            {"depth_camera": {**DEPTH_CAMERA, "rgb_from_depth": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()}},
            "depth_camera.rgb_from_depth: is no rigid pose",
        ),
    ],
)
def test_what_no_camera_has_beyond_a_pinhole(tmp_path, beyond, words):
    folder = tmp_path / "scene"
    if not folder.exists():
        write_tum(folder)
    (folder / "cam_params.json").write_text(json.dumps({"camera": CAMERA, **beyond}))
    refused(find_sequence, folder, names=("cam_params.json: ", words))
