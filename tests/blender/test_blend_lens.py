# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene of a .blend through a lens that distorts: against OpenCV and rays in float64, and as a dataset."""

import json
from types import SimpleNamespace

import bpy
import cv2
import numpy as np
import pytest

from cases import cases
from own_scenes import cast, evaluated_triangles, new_scene, relative_errors, save
from runs import files_made, opened_render, planned
from shard_workers import workers_here

from noisy_world.core.lens import overscanned
from noisy_world.core.errors import InputError
from noisy_world.core.lens import lens_rays
from noisy_world.core.lens import Distortion

CAMERA = {"width": 48, "height": 36, "fx": 50.0, "fy": 50.0, "cx": 22.5, "cy": 18.0}
LENS = {"k1": -0.3, "k2": 0.05, "p1": 0.002, "p2": -0.001}
MODEL = Distortion("radial-tangential", (-0.3, 0.05, 0.002, -0.001))


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hall")
    new_scene(samples=1)
    save(folder)
    return folder


def preset(hall, name="lens", *, camera=CAMERA, distortion=LENS, settings=({"name": "clean"},), **scene):
    seen = camera if distortion is None else {**camera, "distortion": distortion}
    document = {
        "scenes": [{"name": "hall", "blend": "hall.blend", "frames": "1:3", **scene}],
        "camera": seen,
        "settings": list(settings),
        "render": {"backend": "reference"},
        "output": {"layout": "tum", "image": "png"},
    }
    path = hall / f"{name}.yaml"
    path.write_text(json.dumps(document))
    return path


def frame_of(path, index=1):
    plan = planned(path)
    with opened_render(plan) as (opened, sensors):
        frame = opened.frame(sensors.request(index))
        return frame, frame.light.show(frame.light.rgb), sensors.rgb.c2w[index], plan.renders[0].camera


def test_light_is_a_wider_pinholes_resampled_and_depth_that_of_the_lens_rays(hall):
    frame, shown, c2w, camera = frame_of(preset(hall))
    np.testing.assert_array_equal(shown, frame.rgb)
    wide = overscanned(camera, MODEL)
    names = ("width", "height", "fx", "fy", "cx", "cy")
    values = (wide.width_px, wide.height_px, wide.fx_px, wide.fy_px, wide.cx_px, wide.cy_px)
    pinhole = frame_of(preset(hall, "wide", camera=dict(zip(names, values, strict=True)), distortion=None))[0]
    # OpenCV's own way back from the lens, in light: where each pixel's ray is on the wider image.
    grid = np.stack(np.meshgrid(np.arange(48.0), np.arange(36.0)), axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-12)
    coefficients = np.array(MODEL.coefficients)
    found = cv2.undistortPoints(grid, camera.matrix, coefficients, None, np.eye(3), wide.matrix, criteria)
    at = found.reshape(36, 48, 2).astype(np.float32)
    true = cv2.remap(pinhole.light.rgb, at, None, cv2.INTER_LINEAR)
    # OpenCV rounds its weights to 1/32 px.
    assert np.abs(frame.light.rgb - true).max() < 0.04 * pinhole.light.rgb.max()
    assert np.abs(frame.light.rgb - true).mean() < 2e-3 * pinhole.light.rgb.max()
    bpy.ops.wm.open_mainfile(filepath=str(hall / "hall.blend"))
    rays = lens_rays(camera, MODEL)
    local = np.stack([rays.right, rays.down, np.ones_like(rays.right)], axis=-1)
    behind = SimpleNamespace(height_px=36, width_px=48, ray_directions=lambda: local)
    assert (frame.depth_m > 0).all()
    errors = relative_errors(frame.depth_m, cast(evaluated_triangles(2.0), c2w, behind))
    assert np.quantile(errors, 0.8) < 1e-6  # of the wall; the ball's edges have the depth of the nearest pixel
    assert errors.max() < 0.05


def test_what_is_out_of_focus_is_so_by_the_same_aperture(hall):
    """The lens's length in millimetres, which with the f-number is the aperture, is that without distortion."""
    found = []
    for distortion in (None, LENS):
        with opened_render(planned(preset(hall, distortion=distortion))) as (opened, sensors):
            opened.frame(sensors.request(0))
            found.append(bpy.data.scenes["Scene"].camera.data.lens)
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    assert found[0] == pytest.approx(50.0 * 36.0 / 48, rel=1e-6)


def test_a_dataset_of_it_is_the_same_in_any_order(hall, tmp_path):
    blur = {"camera_motion_blur": {"shutter_ms": 20, "most_moments": 3}}
    settings = [{"name": "clean"}, {"name": "blurred", "perturb": [blur]}]
    path = preset(hall, settings=settings)
    alone = files_made(path, tmp_path / "alone")
    assert json.loads(alone["manifest.json"])["camera"]["distortion"] == MODEL.content()
    workers = workers_here(path, tmp_path / "two", order=lambda shards: shards[::-1])
    assert files_made(path, tmp_path / "two", jobs=2, workers=workers) == alone


@cases(
    ("keys", "said"),
    [
        ({"distortion": {**LENS, "undistort": True}}, r"camera\.distortion\.undistort: is true, but light before"),
        ({"compositor": "keep"}, r"scenes\.0\.compositor: is keep, but a compositor works on the image"),
        ({"distortion": {"k1": -5.0}}, r"camera\.distortion: folds over"),
    ],
)
def test_what_cannot_be_done_is_one_line(hall, keys, said):
    with pytest.raises(InputError, match=said):
        planned(preset(hall, "wrong", **keys))
