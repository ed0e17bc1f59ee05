# SPDX-License-Identifier: GPL-3.0-or-later
"""Real cameras: their tables against published fields of view, and presets that name them."""

import math
from pathlib import Path

import numpy as np
import pytest
from refusals import refused
from cases import cases

from noisy_world.preset.camera_devices import CAMERA_DEVICES
from noisy_world.core.lens import lens_problem, straightened
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.preset.keys import check_document
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry

PLACE = ConfigPath("preset.yaml")
# Degrees across and down. D435: FRAMOS's manual of the D435e; D455: Intel's data sheet; Azure Kinect: Microsoft's
# specification of 16:9; Kinect: second hand, as the 57 x 43 of the SDK are its depth's.
PUBLISHED = {
    "realsense_d435": (69.4, 42.5, 0.5),
    "realsense_d455": (90.0, 58.0, 3.0),
    "azure_kinect": (90.0, 59.0, 1.0),
    "kinect_v1": (62.0, 48.6, 3.0),
}


def read(camera, settings=({"name": "clean"},)):
    document = {"scenes": [{"name": "a", "mesh": "a.ply"}], "camera": camera, "settings": list(settings)}
    return check_document(document, Path("preset.yaml")).spec


def angle_between(first, second):
    """Return the angle between two rays in degrees."""
    first, second = (ray / np.linalg.norm(ray) for ray in (first, second))
    return math.degrees(math.acos(float(first @ second)))


def ray(camera, column, row):
    it = camera.intrinsics
    x, y = np.array([(column - it.cx_px) / it.fx_px]), np.array([(row - it.cy_px) / it.fy_px])
    if camera.distortion is not None:
        x, y = straightened(camera.distortion.lens, x, y)
    return np.array([x[0], y[0], 1.0])


@cases("name", list(PUBLISHED))
def test_a_cameras_field_of_view_is_the_published_one(name):
    """Outer edge to outer edge, through the lens."""
    camera = read({"device": name}).camera
    across, down, within = PUBLISHED[name]
    it = camera.intrinsics
    found = angle_between(ray(camera, -0.5, it.cy_px), ray(camera, it.width_px - 0.5, it.cy_px))
    assert found == pytest.approx(across, abs=within)
    found = angle_between(ray(camera, it.cx_px, -0.5), ray(camera, it.cx_px, it.height_px - 0.5))
    assert found == pytest.approx(down, abs=within)


@cases("name", list(CAMERA_DEVICES))
def test_each_camera_is_a_preset_with_a_sound_lens_and_sources(name):
    device = CAMERA_DEVICES[name]
    camera = read({"device": name}).camera
    assert camera.intrinsics == device.intrinsics
    if camera.distortion is not None:
        assert not lens_problem(camera.intrinsics, camera.distortion.lens)
    assert set(device.sources) == {"lens", *device.steps}
    steps = parse_steps([{"device": name}], PLACE, registry())
    assert {step.perturbation.name for step in steps} == set(device.steps)
    for step in steps:
        assert dict(step.given) == {
            key: pytest.approx(value) for key, value in device.steps[step.perturbation.name].items()
        }


def test_what_is_given_stays():
    camera = read({"device": "webcam", "fx": 800.0, "distortion": None, "near_m": 0.1}).camera
    assert (camera.fx, camera.fy, camera.distortion, camera.near_m) == (800.0, 822.317, None, 0.1)


@cases("size", [{"width": 320}, {"height": 240}, {"width": 320, "height": 240}])
def test_at_another_size_a_point_is_seen_at_the_same_share_of_the_image(size):
    whole, small = read({"device": "webcam"}).camera, read({"device": "webcam", **size}).camera
    assert (small.width, small.height) == (320, 240)
    point = np.array([0.13, -0.07])
    seen = [(point * (it.fx, it.fy) + (it.cx, it.cy) + 0.5) / (it.width, it.height) for it in (whole, small)]
    np.testing.assert_allclose(seen[0], seen[1], rtol=1e-12)
    assert small.distortion == whole.distortion


def test_written_out_it_stands_for_itself():
    """A recorded document makes the same camera, whatever the table becomes."""
    given = {"scenes": [{"name": "a", "mesh": "a.ply"}], "camera": {"device": "phone", "width": 640}}
    first = check_document(given, Path("preset.yaml"))
    again = check_document(first.document, Path("preset.yaml"))
    assert again.document == first.document
    assert again.spec == first.spec
    assert "fx" not in given["camera"]


def test_steps_may_be_changed_or_left_out():
    value = {"name": "webcam", "rolling_shutter": False, "sensor_noise": {"gain_db": 3.0}}
    steps = {step.perturbation.name: step.given for step in parse_steps([{"device": value}], PLACE, registry())}
    assert "rolling_shutter" not in steps
    assert steps["sensor_noise"]["gain_db"] == 3.0
    assert steps["sensor_noise"]["bits"] == 8


@cases(
    "camera, said",
    [
        ({"device": "webcm"}, ("camera.device: ", "'webcm'", "'webcam'")),
        ({"device": 3}, "camera.device: is the number 3"),
        ({"device": "webcam", "width": 320, "height": 320}, "camera: is 320 x 320, another shape"),
        ({"device": "webcam", "width": 0}, "camera.width: is 0 px, out of range"),
        ({"device": "webcam", "width": "wide"}, "camera.width: is the text 'wide'"),
    ],
)
def test_a_wrong_camera_is_said(camera, said):
    refused(read, camera, names=said)


@cases(
    "value, said",
    [
        ("fone", ("perturb.0.device", "'fone'", "'phone'")),
        ({"sensor_noise": False}, "perturb.0.device: names no device"),
        ({"name": "phone", "glare": {}}, "perturb.0.device.glare: unknown part of a Phone 'glare'"),
        ({"name": "realsense_d455", "rolling_shutter": {}}, "unknown part of a RealSense D455 'rolling_shutter'"),
        ({"name": "phone", "sensor_noise": 3}, "perturb.0.device.sensor_noise: is the number 3"),
        ({"name": "phone", "sensor_noise": {"gian_db": 3}}, ("'gian_db'", "'gain_db'")),
        (None, "perturb.0.device: is empty"),
    ],
)
def test_wrong_steps_are_said(value, said):
    refused(parse_steps, [{"device": value}], PLACE.at("perturb"), registry(), names=said)


def test_a_shutter_beside_a_cameras_own_is_refused():
    asked = [{"device": "phone"}, {"rolling_shutter": {"readout_ms": 3}}]
    refused(parse_steps, asked, PLACE, registry(), names="rolling_shutter is given twice")
