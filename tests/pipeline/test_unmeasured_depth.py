# SPDX-License-Identifier: GPL-3.0-or-later
"""Void of recordings: what was not measured is no sky to what acts on colour by depth, and is written as it is."""

import json

import cv2
import numpy as np
import pytest
from refusals import refused
import scipy.ndimage
from made_recordings import CAMERA, SIZE_PX, write_tum
from recipes_made import progress
from runs import run

import noisy_world
from noisy_world.images.measured_depth import completed_m
from noisy_world.perturb import apply, frames
from noisy_world.dataset.recipe import recipe_of

WIDE, HIGH = SIZE_PX
GREY = 120  # of the wall
WALL_M, SCALE = 2.5, 5000
VISIBILITY_M = 6.0
HOLES = (slice(20, 44), slice(30, 60)), (slice(None), slice(0, 8))  # in the middle, and at the border
FOG = {"fog_depth": {"visibility_m": VISIBILITY_M}}


def fogged(grey, distance_m, airlight=0.8):
    """The level of a grey surface in fog, by Koschmieder's law in linear light and IEC 61966-2-1."""
    linear = lambda value: value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4  # noqa: E731
    seen = np.exp(-np.log(20) * distance_m / VISIBILITY_M)
    light = linear(grey / 255) * seen + linear(airlight) * (1 - seen)
    return 255 * (1.055 * light ** (1 / 2.4) - 0.055)


def wall_steps(distance_m=WALL_M):
    steps = np.full((HIGH, WIDE), distance_m * SCALE, np.uint16)
    for hole in HOLES:
        steps[hole] = 0
    return steps


def recording(folder, depths):
    poses = [(0.01 * n, 0, 0, 0, 0, 0, 1) for n in range(len(depths))]
    return write_tum(folder, [np.full((HIGH, WIDE, 3), GREY, np.uint8)] * len(depths), depths, poses)


def preset(folder, *steps, backend="reference", **keys):
    document = {
        "scenes": [{"name": "wall", "sequence": "seq", **keys}],
        "camera": CAMERA,
        "render": {"backend": backend},
        "settings": [{"name": "bad", "perturb": list(steps)}],
        "output": {"layout": "tum", "overview": False},
    }
    path = folder / "preset.json"
    path.write_text(json.dumps(document))
    return path


def colour_of(out, frame=0):
    return cv2.imread(str(out / f"bad/wall/rgb/{frame:06d}.png"))


def depth_of(out, frame=0):
    return cv2.imread(str(out / f"bad/wall/depth/{frame:06d}.png"), cv2.IMREAD_UNCHANGED)


def records_of(out):
    return [json.loads(line) for line in (out / "bad/wall/frames.jsonl").read_text().splitlines()]


def test_a_hole_is_as_foggy_as_the_wall_that_it_is_in(tmp_path):
    recording(tmp_path / "seq", [wall_steps()])
    report = run(preset(tmp_path, FOG), tmp_path / "out")
    assert np.abs(colour_of(tmp_path / "out") - fogged(GREY, WALL_M)).max() < 1
    assert (depth_of(tmp_path / "out") == wall_steps()).all()  # what is written is what was measured
    share = (wall_steps() == 0).mean()
    assert records_of(tmp_path / "out")[0]["perturbed"]["depth_completed"] == {"share": pytest.approx(share, abs=1e-6)}
    assert any(f"{share:.1%}" in note and "void: sky" in note for note in report.notes)
    again = run(preset(tmp_path, FOG, void="sky"), tmp_path / "sky")
    hole = wall_steps() == 0
    assert np.abs(colour_of(tmp_path / "sky")[hole] - 0.8 * 255).max() < 1  # nothing but airlight
    assert np.abs(colour_of(tmp_path / "sky")[~hole] - fogged(GREY, WALL_M)).max() < 1
    assert "depth_completed" not in records_of(tmp_path / "sky")[0]["perturbed"]
    assert not any("void" in note for note in again.notes)


def test_what_does_not_look_at_depth_says_nothing_of_it(tmp_path):
    recording(tmp_path / "seq", [wall_steps()])
    run(preset(tmp_path, {"fog_depth": {"severity": 0}}, {"contrast": {"severity": 2}}), tmp_path / "out")
    assert "depth_completed" not in records_of(tmp_path / "out")[0]["perturbed"]


def test_a_hole_is_as_sharp_as_what_is_around_it(tmp_path):
    rgb = np.random.default_rng(3).integers(0, 256, (HIGH, WIDE, 3), np.uint8)
    focused = {"focus_m": WALL_M, "f_number": 2.0, "max_radius_px": 5.0}
    depth_m = wall_steps().astype(np.float32) / SCALE
    sharp = apply(rgb, "defocus_depth", depth_m=depth_m, **focused)
    assert np.abs(sharp.astype(int) - rgb).max() <= 1
    assert (apply(rgb, "defocus_depth", depth_m=depth_m, void="sky", **focused) != rgb)[HOLES[0]].mean() > 0.5


def farthest_neighbour(depth, v, u):
    """What is known next to a pixel in its row and its column, the farthest of it; 0 without any."""
    lines = depth[v, :u][::-1], depth[v, u + 1 :], depth[:v, u][::-1], depth[v + 1 :, u]
    return max((line[line > 0][0] for line in lines if (line > 0).any()), default=0)


def test_each_pixel_gets_the_farthest_of_what_was_measured_around_it():
    rng = np.random.default_rng(5)
    for share in (0.5, 0.01, 0.001):
        depth = np.where(rng.random((24, 32)) < share, rng.uniform(0.5, 5, (24, 32)), 0).astype(np.float32)
        depth[rng.integers(24), rng.integers(32)] = 2.0
        expected = depth
        while not expected.all():
            each = [farthest_neighbour(expected, v, u) for v, u in np.ndindex(depth.shape)]
            expected = np.where(expected > 0, expected, np.array(each, np.float32).reshape(depth.shape))
        expected = np.where(depth > 0, depth, scipy.ndimage.median_filter(expected, 5, mode="nearest"))
        assert (completed_m(depth) == expected).all()
    assert not completed_m(np.zeros((4, 6), np.float32)).any()


def test_a_shadow_beside_a_near_surface_counts_as_what_is_behind():
    """A bar at 1 m before a wall at 3 m: the projector's shadow lies on the wall, beside the bar."""
    depth_m = np.full((HIGH, WIDE), 3.0, np.float32)
    depth_m[20:, 40:50] = 1.0
    depth_m[20:, 32:40] = 0
    assert (completed_m(depth_m)[:, :40] == 3).all()


def test_a_frame_that_measured_nothing_counts_as_far_as_the_nearest_frame(tmp_path):
    nothing = np.zeros((HIGH, WIDE), np.uint16)
    depths = [wall_steps(4.0), nothing, nothing, nothing, wall_steps(1.5)]
    recording(tmp_path / "seq", depths)
    run(preset(tmp_path, FOG), tmp_path / "out")
    for frame, distance_m in enumerate((4.0, 4.0, 4.0, 1.5, 1.5)):  # the middle one: the earlier of two
        assert np.abs(colour_of(tmp_path / "out", frame) - fogged(GREY, distance_m)).max() < 1, frame
        assert (depth_of(tmp_path / "out", frame) == depths[frame]).all()
    assert records_of(tmp_path / "out")[2]["perturbed"]["depth_completed"] == {"share": 1.0, "depth_m": 4.0}


def test_a_recording_without_any_depth_is_refused_by_what_needs_it(tmp_path):
    recording(tmp_path / "seq", [np.zeros((HIGH, WIDE), np.uint16)] * 2)
    refused(run, preset(tmp_path, FOG), tmp_path / "out", names=["seq: ", "void: sky"])
    run(preset(tmp_path, {"contrast": {"severity": 2}}), tmp_path / "other")


def test_the_library_and_a_recipe_make_what_a_dataset_holds(tmp_path):
    recording(tmp_path / "seq", [wall_steps(), wall_steps(3.0)])
    path = preset(tmp_path, FOG)
    run(path, tmp_path / "out")
    with_library = list(frames(tmp_path / "seq", [FOG], setting="bad", scene="wall"))
    assert [item.rgb[0, 0, 0] for item in with_library] == [colour_of(tmp_path / "out", n)[0, 0, 0] for n in (0, 1)]
    for void in ("unmeasured", "sky"):
        (first, _) = frames(tmp_path / "seq", [FOG], setting="bad", scene="wall", void=void)
        alone = apply(
            np.full((HIGH, WIDE, 3), GREY, np.uint8), "fog_depth", depth_m=first.depth_m, void=void, **FOG["fog_depth"]
        )
        assert (first.rgb == alone).all()
    (tmp_path / "recipe.json").write_text(recipe_of(tmp_path / "out", progress()).text())
    remade = noisy_world.open(tmp_path / "recipe.json")["bad/wall"]
    for frame, record in zip(remade, records_of(tmp_path / "out"), strict=True):
        assert frame.done == record["perturbed"]
        assert (frame.rgb[..., ::-1] == colour_of(tmp_path / "out", frame.index)).all()


def test_the_library_is_told_the_depth_scale(tmp_path):
    recording(tmp_path / "seq", [wall_steps()])
    with pytest.warns(UserWarning, match="depth_scale_per_m"):
        (frame,) = frames(tmp_path / "seq", [], depth_scale_per_m=1000)
    assert frame.depth_m.max() == WALL_M * 5
    refused(frames, tmp_path / "seq", [], depth_scale_per_m=0, names="depth_scale_per_m", error=ValueError)


def test_the_library_takes_no_guess():
    rgb = np.full((4, 6, 3), GREY, np.uint8)
    nothing, known = np.zeros((4, 6), np.float32), np.ones((4, 6), np.float32)
    refused(apply, rgb, "fog_depth", 3, depth_m=nothing, names="void='sky'", error=ValueError)
    refused(apply, rgb, "fog_depth", 3, depth_m=known, void="far", names="'unmeasured' or 'sky'", error=ValueError)


@pytest.mark.parametrize("scene", [{"sequence": "seq/rgb", "layout": "images"}, {"video": "walk.avi"}])
def test_what_has_no_depth_has_no_void(tmp_path, scene):
    recording(tmp_path / "seq", [wall_steps()])
    path = preset(tmp_path)
    document = json.loads(path.read_text())
    document["scenes"] = [{**scene, "void": "sky"}]
    path.write_text(json.dumps(document))
    refused(run, path, tmp_path / "out", names="scenes.0.void")
