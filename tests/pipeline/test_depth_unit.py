# SPDX-License-Identifier: GPL-3.0-or-later
"""A rig's depth sensor that is a device of its own: its camera, its clock, raw or registered into colour.

The room's depth from anywhere is known in closed form, and so is the path between its poses.
"""

import json

import cv2
import numpy as np
import pytest
from refusals import refused
import yaml
from analytic import box_depth, look_at
from cases import cases
from scipy.spatial.transform import Rotation
from lit_scenes import make
from shard_workers import workers_here
from worlds import HIGH, LOW, write_replica, write_world
from runs import run

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")
from steady_camera import poses_at

from noisy_world import open as open_dataset
from noisy_world.cli import command
from noisy_world.cli.entry import Entry
from noisy_world.layouts import EVERY
from noisy_world.core.errors import StorageError
from noisy_world.core.geometry import Intrinsics, pose
from noisy_world.dataset.plan import DepthClock
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan

COUNT, RATE_HZ, SCALE = 6, 20.0, 6553.5
SIZE = (64, 48)
COLOUR = Intrinsics(*SIZE, 32.0, 32.0, 31.5, 23.5)
DEPTH = Intrinsics(40, 26, 30.0, 28.0, 18.0, 13.25)
CAMERA = {"width": 40, "height": 26, "fx": 30.0, "fy": 28.0, "cx": 18.0, "cy": 13.25}
PLACE = {"translation_m": [0.11, -0.02, 0.03], "rotation_euler_deg": [1.0, -3.0, 2.0]}
NOISY = {"name": "noisy", "perturb": [{"gaussian_noise": {"severity": 3}}]}
FAST = {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]}


def rgb_from_depth():
    """Of PLACE, by scipy."""
    turned = Rotation.from_euler("xyz", PLACE["rotation_euler_deg"], degrees=True).as_matrix()
    return pose(turned, np.array(PLACE["translation_m"]))


def world(folder, depth, *, layout="replica", settings=({"name": "clean"},), count=COUNT, **keys):
    preset = write_world(
        folder,
        size=SIZE,
        settings=list(settings),
        **{
            "rig": None if depth is None else {"depth": depth},
            "render": {"engine": "embree", "backend": "reference"},
            "output": {"layout": layout},
            **keys,
        },
    )
    write_replica(folder / "traj.txt", poses_at(np.arange(count) / RATE_HZ))
    document = yaml.safe_load(preset.read_text())
    document["scenes"][0]["trajectory"] = {"file": "traj.txt", "rate_hz": RATE_HZ}
    preset.write_text(yaml.safe_dump(document))
    return preset


def steps_of(out, name, frame):
    return cv2.imread(str(out / name / f"box/results/depth{frame:06d}.png"), cv2.IMREAD_UNCHANGED)


def seen_m(camera, c2w):
    """Planar depth, NaN where a pixel is at an edge of the room."""
    depth_m, sure = box_depth(camera, c2w, LOW, HIGH)
    return np.where(sure, depth_m, np.nan)


def assert_shows(steps, wanted_m, least=0.6):
    assert steps.shape == wanted_m.shape
    known = np.isfinite(wanted_m) & (steps > 0)
    assert known.mean() > least
    assert np.abs(steps[known] / SCALE - wanted_m[known]).max() < 0.5 / SCALE + 2e-5


def content(folder):
    return {str(item.relative_to(folder)): item.read_bytes() for item in folder.rglob("*.png")}


# --- a camera of its own ---


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    folder = tmp_path_factory.mktemp("raw")
    depth = {**PLACE, **CAMERA, "delay_ms": 12.5}
    preset = world(folder / "world", depth, settings=[{"name": "clean"}, NOISY, FAST])
    run(preset, folder / "out")
    return preset, folder / "out"


def test_raw_depth_is_its_own_cameras_from_its_own_place_at_its_own_time(raw):
    _, out = raw
    for frame in range(COUNT):
        c2w = poses_at(frame / RATE_HZ + 0.0125) @ rgb_from_depth()
        assert_shows(steps_of(out, "clean", frame), seen_m(DEPTH, c2w))
    first, last = (out / name / "box/results/depth000003.png" for name in ("clean", "noisy"))
    assert first.samefile(last)  # nothing that is done to colour touches it


def test_twice_as_fast_goes_twice_as_far_before_depth_is_exposed(raw):
    _, out = raw
    for frame in range(COUNT // 2):
        c2w = poses_at(2 * (frame / RATE_HZ + 0.0125)) @ rgb_from_depth()
        assert_shows(steps_of(out, "fast", frame), seen_m(DEPTH, c2w))


def test_records_and_readers_know_its_camera_and_its_stamps(raw):
    _, out = raw
    records = [json.loads(line) for line in (out / "clean/box/frames.jsonl").read_text().splitlines()]
    assert [record["depth_time_s"] for record in records] == pytest.approx(np.arange(COUNT) / RATE_HZ + 0.0125)
    said = json.loads((out / "clean/cam_params.json").read_text())["depth_camera"]
    assert [said[name] for name in ("w", "h", "fx", "fy", "cx", "cy")] == list(CAMERA.values())
    np.testing.assert_allclose(said["rgb_from_depth"], rgb_from_depth(), atol=1e-12)
    opened = open_dataset(out)["clean/box"]
    frame = opened[2]
    assert frame.depth_m.shape == (26, 40)
    assert frame.rgb.shape == (48, 64, 3)


@cases("layout", ["replica", "tum", "euroc"])
def test_layouts_read_back_what_was_written(tmp_path, layout):
    tmp_path /= layout
    preset = world(tmp_path / "world", {**PLACE, **CAMERA, "delay_ms": 7, "clock_drift_ppm": 100}, layout=layout)
    run(preset, tmp_path / "out")
    found = EVERY[layout].read(tmp_path / "out/clean/box", RATE_HZ)
    assert found.optics.depth is not None
    assert found.optics.depth.intrinsics == DEPTH
    np.testing.assert_allclose(found.optics.depth.matrix, rgb_from_depth(), atol=1e-9)
    nominal_s = np.arange(COUNT) / RATE_HZ
    if layout != "replica":  # which has no stamps but in frames.jsonl
        np.testing.assert_allclose(found.stamps.depth.seconds, nominal_s / (1 + 1e-4) + 0.007, atol=1e-6)
    np.testing.assert_allclose(found.stamps.rgb.seconds, nominal_s, atol=1e-6)


def test_an_own_dataset_can_be_a_recording_that_registers(raw, tmp_path):
    _, out = raw
    document = {
        "scenes": [{"name": "box", "sequence": str(out / "clean/box"), "register": True}],
        "render": {"backend": "reference"},
    }
    (tmp_path / "again.json").write_text(json.dumps(document))
    run(tmp_path / "again.json", tmp_path / "out")
    assert cv2.imread(str(tmp_path / "out/clean/box/results/depth000000.png"), -1).shape == (48, 64)


# --- registered ---


def test_registered_depth_lies_on_colour_and_is_void_where_its_sensor_sees_nothing(tmp_path):
    fine = {"width": 640, "height": 480, "fx": 300.0, "fy": 300.0, "cx": 319.5, "cy": 239.5}
    preset = world(tmp_path / "world", {**PLACE, **fine, "registered": True})
    run(preset, tmp_path / "out")
    for frame in (0, 3):
        steps, wanted_m = steps_of(tmp_path / "out", "clean", frame), seen_m(COLOUR, poses_at(frame / RATE_HZ))
        known = np.isfinite(wanted_m) & (steps > 0)
        assert known.mean() > 0.6
        # A pixel takes a depth that was measured up to half a pixel of colour beside its centre.
        slope_m = np.nanmax(np.abs(np.diff(wanted_m, axis=1)))
        off_m = np.abs(steps[known] / SCALE - wanted_m[known])
        assert off_m.max() < slope_m
        assert np.median(off_m) < 0.003
    said = json.loads((tmp_path / "out/clean/cam_params.json").read_text())
    assert "depth_camera" not in said


def two_planes(folder, near_m, far_m, edge_m):
    """A wall, and left of `edge_m` a nearer one, seen along the world's y axis."""
    corners = []
    for y, x in ((far_m, (-9.0, 9.0)), (near_m, (-9.0, edge_m))):
        corners += [(x[0], y, -9.0), (x[1], y, -9.0), (x[1], y, 9.0), (x[0], y, 9.0)]
    lines = ["ply", "format ascii 1.0", f"element vertex {len(corners)}"]
    lines += [f"property double {axis}" for axis in "xyz"]
    lines += [f"property uchar {name}" for name in ("red", "green", "blue")]
    lines += ["element face 2", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, corner)) + " 90 120 150" for corner in corners]
    lines += [f"4 {4 * k} {4 * k + 1} {4 * k + 2} {4 * k + 3}" for k in range(2)]
    (folder / "mesh.ply").write_text("\n".join(lines) + "\n")


@cases(("near_m", "far_m", "side"), [(1.0, 2.0, -1), (1.5, 4.0, -1), (0.8, 3.0, -1), (1.0, 2.0, 1)])
def test_the_shadow_of_an_edge_is_as_wide_as_two_views_differ(tmp_path, near_m, far_m, side):
    """f b (1 / z_near - 1 / z_far), where the sensor sits on the far side of the edge's near surface, else nothing."""
    tmp_path /= f"{near_m} {far_m} {side}"
    focal_px, baseline_m = 300.0, 0.06
    camera = {"width": 320, "height": 24, "fx": focal_px, "fy": focal_px, "cx": 159.5, "cy": 11.5}
    depth = {"translation_m": [side * baseline_m, 0, 0], "registered": True}
    preset = world(tmp_path / "world", depth, count=1, camera=camera)
    two_planes(tmp_path / "world", near_m, far_m, 0.013)
    write_replica(tmp_path / "world/traj.txt", look_at([0, 0, 0], [0, 1, 0])[None])
    run(preset, tmp_path / "out")
    row = steps_of(tmp_path / "out", "clean", 0)[12] / SCALE
    edge = int(np.flatnonzero(np.diff(row < (near_m + far_m) / 2))[0])
    inner = row[60:-60]
    width_px = np.count_nonzero(inner == 0)
    expected = focal_px * baseline_m * (1 / near_m - 1 / far_m) if side < 0 else 0.0
    assert abs(width_px - expected) <= 0.5 + 1e-9, (edge, width_px)
    measured = inner[inner > 0]
    assert np.abs(measured - np.where(measured < (near_m + far_m) / 2, near_m, far_m)).max() < 1 / SCALE
    assert {round(near_m, 3), round(far_m, 3)} <= set(np.round(measured, 3))


def test_a_turned_sensors_depth_is_that_of_its_pixels_middles(tmp_path):
    """On a wall that colour faces, two metres away, however its depth is measured."""
    depth = {**CAMERA, "rotation_euler_deg": [2.0, -4.0, 3.0], "registered": True}
    preset = world(tmp_path / "world", depth, count=1)
    two_planes(tmp_path / "world", 1.0, 2.0, -8.9)
    write_replica(tmp_path / "world/traj.txt", look_at([0, 0, 0], [0, 1, 0])[None])
    run(preset, tmp_path / "out")
    steps = steps_of(tmp_path / "out", "clean", 0)
    assert np.mean(steps > 0) > 0.3
    assert np.abs(steps[steps > 0] / SCALE - 2.0).max() <= 1 / SCALE


def test_of_two_surfaces_on_one_pixel_the_nearer_counts(tmp_path):
    """Looking past an edge from the other side, both planes fall on the same pixels of colour."""
    camera = {"width": 320, "height": 24, "fx": 300.0, "fy": 300.0, "cx": 159.5, "cy": 11.5}
    preset = world(tmp_path / "world", {"translation_m": [0.06, 0, 0], "registered": True}, count=1, camera=camera)
    two_planes(tmp_path / "world", 1.0, 2.0, 0.013)
    write_replica(tmp_path / "world/traj.txt", look_at([0, 0, 0], [0, 1, 0])[None])
    run(preset, tmp_path / "out")
    row = steps_of(tmp_path / "out", "clean", 0)[12] / SCALE
    seen_from_colour = np.where((np.arange(320) - 159.5) / 300.0 < 0.013, 1.0, 2.0)
    inner = slice(60, -60)
    wrong = (np.abs(row - seen_from_colour)[inner] > 1e-3).sum()
    assert wrong <= 1  # the edge's own pixel


def test_registered_depth_is_said_to_be_where_colour_is(tmp_path):
    preset = world(tmp_path / "world", {**PLACE, **CAMERA, "registered": True}, layout="euroc", count=1)
    run(preset, tmp_path / "out")
    cameras = [tmp_path / f"out/clean/box/mav0/{name}/sensor.yaml" for name in ("cam0", "depth0")]
    colour, depth = (yaml.safe_load(path.read_text()) for path in cameras)
    for key in ("T_BS", "resolution", "intrinsics"):
        assert depth[key] == colour[key]


def test_a_sensor_measures_in_its_own_pixels_before_it_is_registered(tmp_path):
    depth = {**PLACE, **CAMERA, "registered": True}
    run(world(tmp_path / "exact", depth), tmp_path / "a")
    exact = steps_of(tmp_path / "a", "clean", 2)
    most_m = round(float(np.median(exact[exact > 0])) / SCALE, 2)
    sensor = {"depth_range_clipping": {"min_m": 0, "max_m": most_m}}
    late = [{"name": "clean", "perturb": [sensor]}]
    run(world(tmp_path / "late", depth, settings=late), tmp_path / "b")
    run(world(tmp_path / "early", {**depth, "sensor": sensor}), tmp_path / "c")
    after, before = (steps_of(tmp_path / name, "clean", 2) for name in "bc")
    far = exact > most_m * SCALE
    assert 0.1 < far.mean() < 0.8
    np.testing.assert_array_equal(after, np.where(far, 0, exact))
    # What its own planar depth calls far is another set of pixels than colour's.
    assert (before != after).any()
    assert (before != after).mean() < 0.1


def test_a_stereo_sensor_elsewhere_takes_the_colour_that_it_would_see(tmp_path):
    preset = world(tmp_path / "world", {**PLACE, **CAMERA, "registered": True, "sensor": "realsense_d435"})
    run(preset, tmp_path / "out")
    record = json.loads((tmp_path / "out/clean/box/frames.jsonl").read_text().splitlines()[0])
    assert record["perturbed"]["depth"][0]["name"] == "stereo"
    assert (steps_of(tmp_path / "out", "clean", 0) > 0).mean() > 0.1


# --- a clock of its own ---


def test_exposures_follow_the_rate_the_delay_and_the_drift():
    stamps_s = 100.0 + np.arange(8) / 30
    np.testing.assert_allclose(DepthClock(delay_s=0.004).exposures_s(stamps_s), stamps_s + 0.004, atol=1e-6)
    drifted = DepthClock(drift_ppm=1000).exposures_s(stamps_s)
    np.testing.assert_allclose(drifted - stamps_s, -(stamps_s - 100) * (1 - 1 / 1.001), atol=1e-6)
    slow = DepthClock(rate_hz=15).exposures_s(stamps_s)
    np.testing.assert_allclose(slow - 100, np.array([0, 0, 1, 1, 2, 2, 3, 3]) / 15, atol=1e-6)
    fast = DepthClock(rate_hz=90, delay_s=0.001).exposures_s(stamps_s)
    assert np.abs(fast - stamps_s).max() <= 0.5 / 90 + 1e-6  # the nearest, also before the frame
    np.testing.assert_allclose(fast, stamps_s + 0.001, atol=1e-6)


def test_a_slow_sensor_gives_one_exposure_to_several_frames(tmp_path):
    sensor = {"axial_noise": {}}
    preset = world(tmp_path / "world", {"rate_hz": 10, "sensor": sensor}, settings=[{"name": "clean"}, NOISY])
    report = run(preset, tmp_path / "out")
    assert report.frames_rendered == COUNT
    files = [tmp_path / f"out/clean/box/results/depth{frame:06d}.png" for frame in range(COUNT)]
    for even in (0, 2, 4):
        assert files[even].read_bytes() == files[even + 1].read_bytes()
    assert files[0].read_bytes() != files[2].read_bytes()
    records = [json.loads(line) for line in (tmp_path / "out/clean/box/frames.jsonl").read_text().splitlines()]
    times = [record.get("depth_time_s", record["time_s"]) for record in records]
    assert times == pytest.approx([0, 0, 0.1, 0.1, 0.2, 0.2])
    assert records[1]["perturbed"]["pairing"] == {"depth_of_frame": 0}


# --- the promises ---


def test_any_jobs_a_frame_alone_and_a_run_taken_up_again_give_the_same_bytes(tmp_path):
    depth = {**PLACE, **CAMERA, "registered": True, "delay_ms": 5, "rate_hz": 30, "sensor": "kinect_v1_near"}
    preset = world(tmp_path / "world", depth, settings=[{"name": "clean"}, NOISY, FAST])
    run(preset, tmp_path / "whole")
    whole = content(tmp_path / "whole")
    run(preset, tmp_path / "part", frames=slice(3, 4))
    part = content(tmp_path / "part")
    assert part
    assert {name: whole[name] for name in part} == part
    again = run(preset, tmp_path / "part")
    assert again.frames_kept > 0
    assert content(tmp_path / "part") == whole
    make(preset, tmp_path / "two", jobs=2, workers=workers_here(preset, tmp_path / "two"))
    assert content(tmp_path / "two") == whole


@cases("changed", [{"delay_ms": 6}, {"rate_hz": 40}, {"registered": False}, {"width": 41}, {"clock_drift_ppm": 3}])
def test_another_device_is_another_dataset(tmp_path, changed):
    tmp_path /= next(iter(changed))
    depth = {**PLACE, **CAMERA, "registered": True, "delay_ms": 5}
    run(world(tmp_path / "world", depth), tmp_path / "out", frames=slice(0, 1))
    with pytest.raises(StorageError, match=r"rig\.depth|depth_camera|depth"):
        run(world(tmp_path / "other", {**depth, **changed}), tmp_path / "out")


@cases(
    ("depth", "keys", "names"),
    [
        ({"width": 40}, {}, ["rig.depth: ", "height"]),
        ({"width": 40, "height": 26}, {}, ["rig.depth: ", "fx"]),
        ({**CAMERA, "horizontal_fov_deg": 60}, {}, ["rig.depth: ", "fx", "horizontal_fov_deg"]),
        ({"rate_hz": 10}, {"layout": "tum"}, ["rig.depth.rate_hz: ", "frames 0 and 1"]),
        ({**CAMERA}, {"layout": "vslamlab"}, ["depth", "output.layout"]),
        ({"delay_ms": -5}, {"layout": "euroc"}, ["rig.depth: ", "depth of frame 0"]),
        ({**CAMERA}, {"output": {"modalities": ["rgb", "depth", "flow"]}}, ["flow", "rig.depth "]),
        (
            {"delay_ms": 5},
            {"settings": [{"name": "shaky", "perturb": [{"motion_deviation": {"rotation_deg": 1}}]}]},
            ["shaky: rig.depth ", "motion_deviation"],
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(tmp_path, depth, keys, names):
    preset = world(tmp_path, {**PLACE, **depth}, **keys)
    refused(lambda: make_plan(read_preset(preset)), names=names)


def test_a_longer_path_that_changes_what_is_between_frames_does_not_grow(tmp_path):
    preset = world(tmp_path / "world", {"delay_ms": 4})
    run(preset, tmp_path / "out")
    before = content(tmp_path / "out")
    longer = poses_at(np.arange(COUNT + 2) / RATE_HZ)
    longer[-1, 2, 3] += 0.2  # so that the curve through the poses is another one between the last that were there
    write_replica(tmp_path / "world/traj.txt", longer)
    refused(run, preset, tmp_path / "out", names=["box", "rig.depth"], error=StorageError)
    assert content(tmp_path / "out") == before


def test_a_recording_has_no_place_for_a_sensor(raw, tmp_path):
    _, out = raw
    document = {"scenes": [{"name": "box", "sequence": str(out / "clean/box")}], "rig": {"depth": {**CAMERA}}}
    (tmp_path / "preset.json").write_text(json.dumps(document))
    refused(make_plan, read_preset(tmp_path / "preset.json"), names=["scenes.0", "rig"])


def test_fog_thickens_with_the_depth_that_colour_sees(tmp_path):
    fog = [{"name": "fog", "perturb": [{"fog": {"severity": 3}}]}]
    run(world(tmp_path / "plain", None, settings=fog), tmp_path / "a")
    run(world(tmp_path / "unit", {**PLACE, **CAMERA, "registered": True}, settings=fog), tmp_path / "b")
    plain, unit = (cv2.imread(str(next((tmp_path / name / "fog/box/results").glob("frame000002.*")))) for name in "ab")
    np.testing.assert_array_equal(plain, unit)


def test_a_recipe_and_a_packed_copy_give_the_same_frames(raw, tmp_path):
    preset, out = raw
    recipe, entry = tmp_path / "recipe.json", Entry("noisy-world", ("noisy-world",))
    assert command.run("recipe", [str(out), "--out", str(recipe)], entry) == 0
    assert command.run("verify", [str(recipe), str(out)], entry) == 0
    assert command.run("publish", [str(out), str(tmp_path / "packed")], entry) == 0
    files = open_dataset(out)
    for other in (open_dataset(recipe, data=preset.parent), open_dataset(tmp_path / "packed")):
        for name in ("clean/box", "fast/box"):
            assert other[name].depth_camera == files[name].depth_camera
            assert other[name].depth_camera.intrinsics == DEPTH
            for frame in range(2):
                here, there = files[name][frame].depth_m * SCALE, other[name][frame].depth_m * SCALE
                np.testing.assert_array_equal(np.rint(here), np.rint(there))
