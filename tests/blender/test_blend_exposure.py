# SPDX-License-Identifier: GPL-3.0-or-later
"""Exposure of a scene of a .blend whose camera and things move: against the mean light of many instants."""

import json
import math

import bpy
import numpy as np
import pytest

from cases import cases
from own_scenes import new_scene, save
from runs import files_made, opened_render, planned
from shard_workers import workers_here

from noisy_world.render.engines import bands_of
from noisy_world.core.errors import InputError
from noisy_world.core.frame_request import Shutter

BLUR = {"camera_motion_blur": {"shutter_ms": 40}}


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    """A folder with a .blend of a shaded wall and a ball that moves before a camera that moves."""
    return hall_in(tmp_path_factory.mktemp("hall"))


def hall_in(folder, *, still=False, denoised=False, focused=False):
    """Write it. still: the camera does not move. denoised, focused: it is set up so, the latter with depth of field."""
    scene = new_scene(samples=1)
    if still:
        bpy.data.objects["Rig"].animation_data_clear()
    scene.render.use_motion_blur = True
    scene.cycles.use_denoising = denoised
    dof = bpy.data.objects["Camera"].data.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_distance = focused, 0.5, 2.0
    glow = bpy.data.materials.new("glow")
    nodes, links = glow.node_tree.nodes, glow.node_tree.links
    place, emission = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeEmission")
    links.new(place.outputs["Generated"], emission.inputs["Color"])
    links.new(emission.outputs[0], nodes["Material Output"].inputs[0])
    for name in ("Wall", "Ball"):
        bpy.data.objects[name].data.materials.append(glow)
    save(folder)
    return folder


def plan_path(hall, *perturb, **keys):
    document = {
        "scenes": [{"name": "hall", "blend": "hall.blend", "frames": "1:4"}],
        "settings": [{"name": "exposed", "perturb": list(perturb)}] if perturb else [{"name": "clean"}],
        **keys,
    }
    path = hall / "preset.yaml"
    path.write_text(json.dumps(document))
    return path


def plan_of(hall, *perturb, **keys):
    return planned(plan_path(hall, *perturb, **keys))


def exposed(hall, *perturb, index=1, **keys):
    """A frame of a setting, and how it was said to be made."""
    notes = []
    with opened_render(plan_of(hall, *perturb, **keys), notes.append, exposing=True) as (opened, sensors):
        return opened.frame(sensors.request(index)), notes


def exposed_after(hall, seconds, *perturb, **keys):
    """What a setting's exposure is some seconds after the second frame."""
    with opened_render(plan_of(hall, *perturb, **keys), exposing=True) as (opened, sensors):
        return opened.frame(sensors.request(1).after(seconds))


def instants(hall, times_s, exposure=BLUR, *, index=1, **keys):
    """The frames some seconds after one of the path, each an instant, one by one; and the scene's frame of each.

    exposure: of a setting, whose samples these have.
    """
    with opened_render(plan_of(hall, exposure, **keys)) as (opened, sensors):
        for time_s in times_s:
            frame = opened.frame(sensors.request(index).after(float(time_s)))
            yield frame, bpy.data.scenes["Scene"].frame_current_final


def psnr(image, true):
    return -10 * math.log10(np.mean((image - true) ** 2))


def test_blur_of_camera_and_things_is_the_mean_light_of_128_instants(hall):
    frame, notes = exposed(hall, BLUR)
    assert "motion blur is set up in the .blend, and off where a setting exposes its frames itself" in notes
    times_s = ((np.arange(128) + 0.5) / 128 - 0.5) * 0.04
    mean, at = 0.0, []
    for made, scene_frame in instants(hall, times_s):
        mean = mean + made.light.rgb / 128.0
        at.append(scene_frame)
    (sharp, _), (before, _) = instants(hall, [0.0, -0.02])
    assert np.abs(np.array(at) - (2 + times_s * 25)).max() < 1e-5
    assert psnr(frame.rgb, sharp.rgb) < 40
    true = np.clip(mean, 0, None).astype(np.float32)
    assert psnr(frame.light.rgb, true) > 50
    np.testing.assert_array_equal(frame.depth_m, sharp.depth_m)
    assert np.abs(before.depth_m - sharp.depth_m).max() > 0.1
    assert 7 <= frame.exposure[0]["moments"] <= 15


def test_a_ball_that_moves_before_a_still_camera_is_blurred_too(tmp_path):
    hall = hall_in(tmp_path / "still", still=True)
    frame, _ = exposed(hall, BLUR)
    (sharp, _), *parts = instants(hall, [0.0, *(((np.arange(64) + 0.5) / 64 - 0.5) * 0.04)])
    true = sum(np.clip(made.light.rgb, 0, None) for made, _ in parts) / 64
    assert psnr(frame.light.rgb, true) > 50
    assert psnr(sharp.light.rgb, true) < 40
    # The ball goes .24 m in a frame of 1/25 s; the focal length is 50 mm of 36, of 48 pixels.
    goes_px = 48 * 50 / 36 * 0.24 / sharp.depth_m.min()
    assert frame.exposure[0]["moments"] == 2 * math.ceil(goes_px / 2) + 1, "an odd number, one a pixel or more"


def rolling(**values):
    return {"rolling_shutter": {"readout_ms": 40, **values}}


@cases("direction", ["down", "up", "right", "left"])
def test_lines_are_those_of_single_renders(hall, direction):
    """Down over all rows, which sees camera and ball go; else over a third of them."""
    frame, _ = exposed(hall, rolling(direction=direction), camera=SMALL)
    upright = direction in ("right", "left")
    image, depth_m = (np.swapaxes(part, 0, 1) if upright else part for part in (frame.light.rgb, frame.depth_m))
    count = len(image)
    lines = range(0, count, 1 if direction == "down" else 3)
    order = [count - 1 - line if direction in ("up", "left") else line for line in lines]
    times_s = [((place + 0.5) / count - 0.5) * 0.04 for place in order]
    errors, moved = [], []
    for line, (made, _) in zip(lines, instants(hall, times_s, rolling(), camera=SMALL), strict=True):
        single, single_m = (np.swapaxes(part, 0, 1) if upright else part for part in (made.light.rgb, made.depth_m))
        errors.append(np.square(image[line] - single[line]).mean())
        np.testing.assert_allclose(depth_m[line], single_m[line], rtol=1e-6)
        moved.append(single_m[line])
    assert -10 * math.log10(np.mean(errors) + 1e-12) > 65
    ((sharp, _),) = instants(hall, [0.0], rolling(), camera=SMALL)
    still = np.swapaxes(sharp.light.rgb, 0, 1) if upright else sharp.light.rgb
    assert psnr(image[list(lines)], still[list(lines)]) < 40


@cases("direction", ["down", "left"])
def test_lines_behind_a_lens_are_those_of_single_bent_renders(hall, direction):
    """Each line of the lens needs many of the wider pinhole, all of them at the line's own moment."""
    frame, _ = exposed(hall, rolling(direction=direction), camera=BENT)
    upright = direction == "left"
    image, depth_m = (np.swapaxes(part, 0, 1) if upright else part for part in (frame.light.rgb, frame.depth_m))
    count = len(image)
    lines = range(0, count, 2)
    order = [count - 1 - line if upright else line for line in lines]
    times_s = [((place + 0.5) / count - 0.5) * 0.04 for place in order]
    errors = []
    for line, (made, _) in zip(lines, instants(hall, times_s, rolling(), camera=BENT), strict=True):
        single, single_m = (np.swapaxes(part, 0, 1) if upright else part for part in (made.light.rgb, made.depth_m))
        errors.append(np.square(image[line] - single[line]).mean())
        np.testing.assert_allclose(depth_m[line], single_m[line], rtol=1e-6)
    assert -10 * math.log10(np.mean(errors) + 1e-12) > 65
    (sharp, _), (pinhole, _) = (
        next(instants(hall, [0.0], rolling(), camera=camera)) for camera in (BENT, {**BENT, "distortion": None})
    )
    assert psnr(frame.light.rgb, sharp.light.rgb) < 40
    assert psnr(sharp.light.rgb, pinhole.light.rgb) < 40


def test_depth_of_lines_behind_a_lens_is_right_where_it_is_rendered_apart(tmp_path):
    """As of a camera with depth of field, whose own render would falsify it."""
    hall = hall_in(tmp_path / "focused", focused=True)
    frame, _ = exposed(hall, rolling(), camera=BENT)
    times_s = ((np.arange(BENT["height"]) + 0.5) / BENT["height"] - 0.5) * 0.04
    for line, (made, _) in enumerate(instants(hall, times_s, rolling(), camera=BENT)):
        np.testing.assert_allclose(frame.depth_m[line], made.depth_m[line], rtol=1e-6)
    assert (frame.depth_m > 0).all()


def test_blur_lens_and_lines_are_right_together(hall):
    """The mean of read frames behind the lens, which are those of single lines; depth of the middle of the exposure."""
    both = [rolling(), {"camera_motion_blur": {"shutter_ms": 10, "most_moments": 3}}]
    frame, _ = exposed(hall, *both, camera=BENT)
    parts = [exposed_after(hall, seconds, rolling(), camera=BENT) for seconds in (-1 / 300, 0.0, 1 / 300)]
    true = sum(np.clip(part.light.rgb, 0, None) for part in parts) / 3
    assert psnr(frame.light.rgb, true) > 80
    np.testing.assert_array_equal(frame.depth_m, parts[1].depth_m)
    row, count = 5, BENT["height"]
    middle_s = ((row + 0.5) / count - 0.5) * 0.04
    times_s = middle_s + np.array([-1 / 300, 0.0, 1 / 300])
    singles = [made.light.rgb[row] for made, _ in instants(hall, times_s, rolling(), camera=BENT)]
    assert psnr(frame.light.rgb[row], np.mean(np.clip(singles, 0, None), axis=0)) > 65


def test_depth_behind_a_lens_of_a_global_shutter_is_of_the_stamp(hall):
    frame, _ = exposed(hall, rolling(depth="global"), camera=BENT)
    ((sharp, _),) = instants(hall, [0.0], rolling(), camera=BENT)
    np.testing.assert_array_equal(frame.depth_m, sharp.depth_m)


SMALL = {"width": 23, "height": 17, "fx": 30.0, "fy": 30.0, "cx": 11.2, "cy": 8.1}
BENT = {**SMALL, "distortion": {"model": "radial-tangential", "k1": -0.3, "k2": 0.05, "p1": 0.01, "p2": -0.005}}


def test_lines_that_see_the_same_are_rendered_together():
    slow = bands_of(Shutter.centred(0.0, 0.01), (30, 24), 0.25)
    assert [band.rows for band in slow] == [slice(start, start + 3) for start in range(0, 24, 3)]
    assert [band.after_s for band in slow] == pytest.approx((np.arange(8) + 0.5) / 8 * 0.01 - 0.005)
    (still,) = bands_of(Shutter.centred(0.0, 0.01, "left"), (30, 24), 0.0)
    assert (still.rows, still.columns) == (slice(0, 24), slice(0, 30))
    assert still.after_s == pytest.approx(0.0)
    quick = bands_of(Shutter.centred(0.0, 0.01, "left"), (30, 24), 100.0)
    assert [band.columns.start for band in quick] == list(range(30))
    assert quick[0].after_s > quick[-1].after_s


def test_lines_are_not_denoised(tmp_path):
    hall = hall_in(tmp_path / "denoised", denoised=True)
    frame, notes = exposed(hall, rolling(), camera=SMALL)
    assert "denoising is off where lines are read one after another, as it needs whole frames" in notes
    ((plain, _),) = instants(hall, [-0.02 + 0.5 / 17 * 0.04], rolling(), camera=SMALL)
    np.testing.assert_allclose(frame.light.rgb[0], plain.light.rgb[0], atol=1e-4)


def test_depth_of_a_global_shutter_is_of_the_stamp_and_lines_are_in_the_record(hall):
    frame, _ = exposed(hall, rolling(depth="global"), camera=SMALL)
    ((sharp, _),) = instants(hall, [0.0], rolling(), camera=SMALL)
    np.testing.assert_array_equal(frame.depth_m, sharp.depth_m)
    assert psnr(frame.light.rgb, sharp.light.rgb) < 40
    lines = frame.exposure[0]["lines"]
    assert [round(lines[name]["after_s"] / 0.04 * 17) for name in ("first", "middle", "last")] == [-8, 0, 8]


def test_a_blur_whose_lines_are_read_is_the_mean_of_read_frames(hall):
    both = [rolling(), {"camera_motion_blur": {"shutter_ms": 10, "most_moments": 3}}]
    frame, _ = exposed(hall, *both, camera=SMALL)
    parts = [exposed_after(hall, seconds, rolling(), camera=SMALL) for seconds in (-1 / 300, 0.0, 1 / 300)]
    true = sum(np.clip(part.light.rgb, 0, None) for part in parts) / 3
    assert psnr(frame.light.rgb, true) > 80


def test_what_cannot_be_read_line_by_line_is_refused(hall):
    with pytest.raises(InputError, match="which Cycles alone can render"):
        plan_of(hall, rolling(), render={"engine": "eevee"})


def test_a_dataset_is_the_same_by_shards_in_any_order_and_of_a_frame_alone(hall, tmp_path):
    path = plan_path(hall, BLUR, output={"layout": "replica", "image": "png"})
    one = images_made(path, tmp_path / "one")
    backwards = workers_here(path, tmp_path / "two", order=lambda shards: shards[::-1])
    assert len(one) == 8
    assert images_made(path, tmp_path / "two", jobs=2, workers=backwards) == one
    alone = images_made(path, tmp_path / "alone", frames=slice(2, 3))
    assert {name: one[name.replace("000000", "000002")] for name in alone} == alone


def images_made(path, out, **several):
    """The bytes of the images of a dataset that is made, by name."""
    files = files_made(path, out, **several)
    return {name.rpartition("/")[2]: data for name, data in files.items() if "/results/" in name}
