# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera in a JSON file, in each of the forms that people have it, and what is none."""

import json

import pytest
from refusals import refused

from noisy_world.layouts.cam_params import read_camera_file
from noisy_world.core.geometry import Intrinsics

CAMERA = Intrinsics(640, 480, 525.0, 524.0, 319.5, 239.5)
PLAIN = {"width": 640, "height": 480, "fx": 525.0, "fy": 524.0, "cx": 319.5, "cy": 239.5}
OPEN3D = {"width": 640, "height": 480, "intrinsic_matrix": [525.0, 0, 0, 0, 524.0, 0, 319.5, 239.5, 1]}
NERFSTUDIO = {"w": 640, "h": 480, "fl_x": 525.0, "fl_y": 524.0, "cx": 320.0, "cy": 240.0}
REPLICA = {"camera": {"w": 640, "h": 480, "fx": 525.0, "fy": 524.0, "cx": 319.5, "cy": 239.5, "scale": 6553.5}}


MATRIX = {"width": 640, "height": 480, "K": [[525.0, 0, 319.5], [0, 524.0, 239.5], [0, 0, 1]]}


@pytest.mark.parametrize("document", [MATRIX, PLAIN, {"camera": PLAIN}, OPEN3D, NERFSTUDIO, REPLICA])
def test_forms_of_a_camera(tmp_path, document):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(document))
    assert read_camera_file(path) == CAMERA


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[1]", "no mapping"),
        ('{"fx": 1}', "no intrinsics"),
        (json.dumps({**MATRIX, "K": [5, 1, 2, 0, 5, 2, 0, 0, 1]}), "without skew"),
        ('{"camera": {"scale": 1000}}', "scale alone"),
        ('{"width": 4, "height": 4, "intrinsic_matrix": [1]}', "nine numbers"),
        (json.dumps({**PLAIN, "fx": -1}), "fx"),
        ("{", "camera.json"),
    ],
)
def test_what_is_no_camera_is_one_line(tmp_path, text, said):
    path = tmp_path / "camera.json"
    path.write_text(text)
    refused(read_camera_file, path, names=said)


def test_a_camera_of_images_of_another_size_is_refused(tmp_path):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(PLAIN))
    assert read_camera_file(path, (640, 480)) == CAMERA
    said = ("camera.json: ", "640 x 480, but these are 320 x 240", "say intrinsics")
    refused(read_camera_file, path, (320, 240), names=said)
