# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings of others put through a preset: cameras of their own, lenses, frames without poses."""

import json

import cv2
import numpy as np
import pytest
from refusals import refused
from analytic import box_depth
from probes import BOTH_PROBES, COLOUR, Probes
from recorded_layouts import HALF_M, WRITERS, WRITTEN, box_depth_m, image, poses
from runs import run

from noisy_world.layouts import LAYOUTS, SequenceFacts, find_sequence
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import Trajectory
from noisy_world.images.measured_depth import Registration
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.lens import DepthCamera, Distortion, Optics
from noisy_world.preset.keys import OutputSpec, read_preset
from noisy_world.evaluate.system_input import sequence_input
from noisy_world.perturb import frames
from noisy_world.dataset.plan import make_plan
from noisy_world.sources.renderers import Rectification

BOTH = [{"fog_depth": {"severity": 3}}, {"depth_gaussian_noise": {"severity": 2}}]


def preset_of(folder, source, *, layout="tum", scene=(), steps=BOTH, output=()):
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "preset.json"
    document = {
        "seed": 3,
        "scenes": [{"name": "box", "sequence": str(source), **dict(scene)}],
        "render": {"backend": "reference"},
        "settings": [{"name": "clean"}, {"name": "noisy", "perturb": steps}],
        "output": {"layout": layout, **dict(output)},
    }
    path.write_text(json.dumps(document))
    return path


def recording(tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    return folder, WRITERS[name](folder)


@pytest.mark.parametrize(
    ("name", "layout"),
    [
        *(("bundlefusion", "replica"), ("nerfstudio", "tum"), ("open3d", "euroc"), ("bop", "replica")),
        *(("record3d", "tum"), ("polycam", "euroc"), ("openloris", "replica"), ("neural_rgbd", "tum")),
    ],
)
def test_what_is_written_is_what_was_recorded(name, layout, tmp_path):
    source, _ = recording(tmp_path, name)
    before = find_sequence(source)
    run(preset_of(tmp_path / "p", source, layout=layout), tmp_path / "out")
    after = find_sequence(tmp_path / "out/clean/box")
    off = np.abs(after.trajectory.c2w - before.trajectory.c2w)
    assert off[:, :3, 3].max() < 1e-9
    assert off.max() < 2e-9  # quaternions are rounded to 9 digits
    assert after.known_camera == before.known_camera
    if before.optics.depth is not None:
        assert after.optics.depth.intrinsics == before.optics.depth.intrinsics
    assert after.optics.distortion == before.optics.distortion
    for row in range(len(after.trajectory)):
        one, other = before.frame(row).depth_m, after.frame(row).depth_m
        assert one.shape == other.shape
        assert np.abs(one - other).max() <= 0.5001 / after.depth_scale_per_m
    noisy = find_sequence(tmp_path / "out/noisy/box").frame(0)
    assert noisy.rgb.shape == before.frame(0).rgb.shape
    assert noisy.depth_m.shape == before.frame(0).depth_m.shape
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert ("depth_camera" in manifest["camera"]) == (before.optics.depth is not None)
    if layout == "tum":
        same = list(frames(source, BOTH, seed=3, setting="noisy", scene="box"))
        assert np.array_equal(same[0].rgb, noisy.rgb)
    notes = json.loads((tmp_path / "out/run.json").read_text())["notes"]
    assert any("registered into colour" in note for note in notes) == (before.optics.depth is not None)


EXACT = {"tum", "euroc", "tum_vi", "vslamlab", "kitti"}  # their files hold nanoseconds


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_a_round_trip_loses_nothing_that_the_layout_holds(layout, tmp_path):
    written = WRITTEN["euroc"](tmp_path / "euroc")  # with stamps that float64 seconds cannot hold
    before = find_sequence(tmp_path / "euroc")
    run(preset_of(tmp_path / "p", tmp_path / "euroc", layout=layout, steps=[]), tmp_path / "out")
    after = find_sequence(tmp_path / "out/clean/box")
    if layout in EXACT:
        assert after.stamps.rgb.ns == before.stamps.rgb.ns
    assert np.array_equal(after.stamps.rgb.seconds, before.stamps.rgb.seconds)
    assert np.array_equal(after.stamps.depth.seconds, before.stamps.depth.seconds)
    assert np.abs(after.trajectory.c2w - written.c2w).max() < 1e-9
    assert after.known_camera == before.known_camera
    for row, steps in enumerate(written.steps):
        off_m = np.abs(after.frame(row).depth_m - steps / written.scale_per_m)
        assert off_m.max() < 0.5001 / after.depth_scale_per_m + 1e-6


@pytest.mark.parametrize("layout", ["nerfstudio", "colmap"])
@pytest.mark.parametrize(
    "lens",
    [
        Distortion("radial-tangential", (0.1, -0.05, 0.001, -0.002)),
        Distortion("radial-tangential", (0.1, -0.05, 0.001, -0.002, 0.01)),
        Distortion("equidistant", (0.1, -0.05, 0.01, -0.002)),
    ],
)
def test_a_lens_stands_in_the_files_that_others_read(layout, lens):
    camera, stamps = Intrinsics(64, 48, 61.0, 60.5, 31.25, 23.75), Trajectory(np.eye(4)[None], np.zeros(1))
    facts = SequenceFacts(OutputSpec(layout).format, camera, None, (0,), SensorPaths(stamps), optics=Optics(None, lens))
    texts = LAYOUTS[layout].sequence_texts(facts)
    names = ("k1", "k2", "k3", "k4") if lens.model == "equidistant" else ("k1", "k2", "p1", "p2", "k3")
    if layout == "nerfstudio":
        told = json.loads(texts["transforms.json"])
        assert tuple(told[key] for key in names[: len(lens.coefficients)]) == lens.coefficients
        assert told["camera_model"] == ("OPENCV_FISHEYE" if lens.model == "equidistant" else "OPENCV")
        return
    words = texts["sparse/0/cameras.txt"].splitlines()[-1].split()
    counts = {"OPENCV": 8, "FULL_OPENCV": 12, "OPENCV_FISHEYE": 8}
    assert len(words) == 4 + counts[words[1]]
    numbers = [*map(float, words[4:])]
    assert numbers[:4] == [61.0, 60.5, 31.75, 24.25]
    assert (*numbers[4:], 0.0)[: len(lens.coefficients)] == lens.coefficients


def test_a_layout_that_cannot_say_it_refuses(tmp_path):
    source, _ = recording(tmp_path, "nerfstudio")
    path = preset_of(tmp_path / "p", source, layout="vslamlab")
    refused(make_plan, read_preset(path), names=["scenes.0.sequence: ", "register: true"])
    (carried,) = make_plan(read_preset(path, ["scenes.0.register=true"])).renders
    assert carried.optics.distortion is not None
    run(path, tmp_path / "out", overrides=["scenes.0.register=true", "scenes.0.undistort=true"])
    found = find_sequence(tmp_path / "out/clean/box")
    assert found.optics.plain
    assert found.frame(0).depth_m.shape == found.frame(0).rgb.shape[:2]
    plain, _ = recording(tmp_path, "open3d")
    for key, told in (("undistort", "lens"), ("register", "camera")):
        preset = read_preset(preset_of(tmp_path / "q", plain, scene={key: True}))
        refused(make_plan, preset, names=[f"scenes.0.{key}: ", told])


# --- registration ---


@pytest.mark.parametrize("apart", [False, True])
def test_registered_depth_is_what_the_colour_camera_sees(apart):
    colour = Intrinsics(96, 72, 80.0, 81.0, 47.0, 36.0)
    seen = (64, 48, 50.0, 50.5, 31.0, 24.0)
    beside = np.eye(4)
    if apart:
        beside[:3, :3] = cv2.Rodrigues(np.array([0.01, -0.02, 0.015]))[0]
        beside[:3, 3] = 0.05, -0.002, 0.01
    c2w = poses(seed=9)[1]
    depth_m = box_depth_m(seen, c2w @ beside).astype(np.float32)
    depth_m[:, :4] = 0
    camera = DepthCamera(Intrinsics(*seen), tuple(map(tuple, beside.tolist())) if apart else None)
    found = Registration(colour, camera).depth_in_colour(depth_m)
    truth, sure = box_depth(colour, c2w, -HALF_M, HALF_M)
    # Where the colour camera's places are in the depth image: none of the first four columns has depth. Within a pixel
    # of the border of what has some, its edge decides.
    places = np.einsum("ij,hwj->hwi", np.linalg.inv(beside)[:3, :3], colour.ray_directions() * truth[..., None])
    places += np.linalg.inv(beside)[:3, 3]
    column, row = (places[..., k] / places[..., 2] * seen[2 + k] + seen[4 + k] for k in (0, 1))
    inside = np.minimum.reduce([column - 3.5, 63.5 - column, row + 0.5, 47.5 - row])
    assert (inside > 1).mean() > 0.8
    # Two turned squares leave a gap between the rectangles around their corners, of a few hundredths of a pixel.
    between = np.minimum(np.abs(column % 1 - 0.5), np.abs(row % 1 - 0.5)) < (0.03 if apart else 1e-6)
    assert (found[(inside > 1) & ~between] > 0).all()
    assert not found[inside < -1].any()
    # Off the box's edges depth is as wrong as half a depth pixel's slope, and a tenth where the cameras are apart.
    half_px = 0.5 * sum(
        np.abs(part) * ratio for part, ratio in zip(np.gradient(truth), (81 / 50.5, 80 / 50), strict=True)
    )
    assert (np.abs(found - truth) <= 1e-4 + 1.1 * half_px)[sure & (found > 0)].all()
    assert not Registration(colour, camera).depth_in_colour(np.zeros_like(depth_m)).any()


def test_the_nearest_of_several_counts_and_one_camera_changes_nothing():
    one = Intrinsics(8, 6, 7.0, 7.0, 3.5, 2.5)
    depth_m = np.full((6, 8), 2.0, np.float32)
    depth_m[2, 3] = 1.0
    depth_m[0, 0] = 0.0
    assert np.array_equal(Registration(one, DepthCamera(one)).depth_in_colour(depth_m), depth_m)
    far = DepthCamera(one, ((1.0, 0, 0, 2.0 / 7), (0, 1.0, 0, 0), (0, 0, 1.0, 0), (0, 0, 0, 1.0)))
    moved = Registration(one, far).depth_in_colour(depth_m)
    # At 2 m the shift is a pixel, at 1 m two: the near one covers what was beside it.
    assert moved[2, 5] == 1.0
    assert moved[3, 5] == 2.0
    assert not moved[:, 0].any()


@pytest.mark.parametrize(("fx_px", "fy_px"), [(10.0, 13.0), (13.0, 10.0)])
def test_a_depth_pixel_covers_its_own_rectangle_of_colour(fx_px, fy_px):
    # Pixels that are no squares; six by six of colour for each of depth, so that the edges of both fall together.
    small = Intrinsics(5, 4, fx_px, fy_px, 2.0, 1.5)
    large = Intrinsics(30, 24, 6 * fx_px, 6 * fy_px, 6 * 2.0 + 2.5, 6 * 1.5 + 2.5)
    depth_m = np.random.default_rng(2).permutation(np.linspace(1, 2, 20, dtype=np.float32)).reshape(4, 5)
    depth_m[1, 3] = 0
    found_m = Registration(large, DepthCamera(small)).depth_in_colour(depth_m)
    assert np.array_equal(found_m, depth_m.repeat(6, axis=0).repeat(6, axis=1))


# --- lenses ---


def test_undistorted_depth_is_that_of_the_nearest_pixel():
    camera, (k1, k2, p1, p2) = Intrinsics(40, 30, 30.0, 39.0, 19.0, 15.5), (-0.25, 0.06, 0.01, -0.02)
    lens = Distortion("radial-tangential", (k1, k2, p1, p2))
    depth_m = np.random.default_rng(3).choice(np.float32([0.0, 1.0, 2.5, 4.0]), (30, 40))
    found = Rectification(camera, Optics(distortion=lens), undistort=True).depth_m(depth_m)
    # Brown's model, as OpenCV's documentation prints it.
    v, u = np.mgrid[:30, :40]
    x, y = (u - 19.0) / 30.0, (v - 15.5) / 39.0
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2 * r2
    column = (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) * 30.0 + 19.0
    row = (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) * 39.0 + 15.5
    # OpenCV rounds places to 1/32 px, so halfway between two pixels either may count.
    clear = (abs(column % 1 - 0.5) > 1 / 32) & (abs(row % 1 - 0.5) > 1 / 32)
    nearest = np.rint(row).astype(int), np.rint(column).astype(int)
    inside = (nearest[0] >= 0) & (nearest[0] < 30) & (nearest[1] >= 0) & (nearest[1] < 40)
    wanted_m = np.where(inside, depth_m[np.clip(nearest[0], 0, 29), np.clip(nearest[1], 0, 39)], 0.0)
    assert clear.sum() > 1000
    assert np.array_equal(found[clear], wanted_m[clear])
    assert set(np.unique(found)) == {0.0, 1.0, 2.5, 4.0}


def test_a_lens_is_carried_or_taken_out(tmp_path):
    k = (64, 48, 40.0, 41.0, 31.0, 23.5)
    c2w = poses(count=1, seed=4)[0]
    lens = Distortion("radial-tangential", (-0.25, 0.06, 0.001, -0.002))
    camera = Intrinsics(*k)
    # A distorted picture: each pixel looks along the ray that the lens brings there, by OpenCV's own inverse.
    grid = np.stack(np.meshgrid(np.arange(64.0), np.arange(48.0)), axis=-1).reshape(-1, 1, 2)
    xy = cv2.undistortPoints(grid, camera.matrix, np.array(lens.coefficients)).reshape(48, 64, 2)
    rays = np.concatenate([xy, np.ones((48, 64, 1))], axis=-1) @ c2w[:3, :3].T
    depth_m = (np.where(rays > 0, HALF_M - c2w[:3, 3], -HALF_M - c2w[:3, 3]) / rays).min(axis=-1)
    source = tmp_path / "source"
    shade = np.clip(xy[..., :1] * 80 + 128, 0, 255).astype(np.uint8)
    image(source / "results/frame000000.png", np.repeat(shade, 3, axis=-1))
    image(source / "results/depth000000.png", np.rint(depth_m * 5000).astype(np.uint16))
    (source / "traj.txt").write_text(" ".join(map(repr, c2w.ravel().tolist())) + "\n")
    told = dict(zip(("w", "h", "fx", "fy", "cx", "cy"), k, strict=True))
    document = {"camera": {**told, "scale": 5000}, "distortion": lens.content()}
    (source / "cam_params.json").write_text(json.dumps(document))
    path = preset_of(tmp_path / "p", source, steps=[{"gaussian_noise": {"severity": 1}}])
    run(path, tmp_path / "carried")
    assert find_sequence(tmp_path / "carried/clean/box").optics.distortion == lens
    run(path, tmp_path / "pinhole", overrides=["scenes.0.undistort=true"])
    found = find_sequence(tmp_path / "pinhole/clean/box")
    assert found.optics.plain
    truth, sure = box_depth(camera, c2w, -HALF_M, HALF_M)
    made = found.frame(0).depth_m
    assert (made > 0)[5:-5, 5:-5].all()
    # The nearest pixel of the distorted image is half of one away; the lens makes its corners smaller by 1.8 at most,
    # by the derivative of its radius.
    half_px = 0.5 * sum(map(np.abs, np.gradient(truth)))
    assert (np.abs(made - truth) <= 0.0002 + 1.8 * half_px)[sure & (made > 0)].all()
    across = camera.ray_directions()[..., 0] * 80 + 128
    inner = np.s_[6:-6, 6:-6]
    assert np.abs(found.frame(0).rgb[..., 0].astype(float) - across)[inner].max() < 2.0


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ([], ["depth", "register: true", "undistort: true"]),
        (["scenes.0.register=true"], ["undistort: true"]),
    ],
)
def test_what_systems_cannot_read_is_one_line(keys, told, tmp_path):
    source, _ = recording(tmp_path, "nerfstudio")
    run(preset_of(tmp_path / "p", source, layout="euroc"), tmp_path / "out", overrides=keys)
    refused(sequence_input, tmp_path / "out/clean/box", names=[str(tmp_path / "out/clean/box"), *told])


def test_systems_read_a_treated_recording(tmp_path):
    source, _ = recording(tmp_path, "nerfstudio")
    keys = ["scenes.0.register=true", "scenes.0.undistort=true"]
    run(preset_of(tmp_path / "p", source, layout="euroc"), tmp_path / "out", overrides=keys)
    given = sequence_input(tmp_path / "out/noisy/box")
    assert given.camera == find_sequence(source).known_camera
    assert len(given.stored.trajectory) == 4


# --- poses ---


def test_frames_without_a_pose(tmp_path):
    source, written = recording(tmp_path, "scannet")
    (lost,) = written.lost
    path = preset_of(tmp_path / "p", source)
    run(path, tmp_path / "kept", overrides=["scenes.0.poses=keep"])
    assert len(list((tmp_path / "kept/clean/box/rgb").iterdir())) == 4
    truth = (tmp_path / "kept/clean/box/groundtruth.txt").read_text().splitlines()[3:]
    assert len(truth) == 3
    assert find_sequence(tmp_path / "kept/clean/box", poses="keep").trajectory.known.tolist() == [
        row != lost for row in range(4)
    ]
    for layout in LAYOUTS:
        keys = ["scenes.0.poses=keep", "scenes.0.register=true", f"output.layout={layout}"]
        if layout in ("replica", "nerfstudio", "kitti"):  # which have a pose for each frame
            refused(make_plan, read_preset(path, keys), names=["scenes.0.sequence: ", "1 of 4", "poses: drop"])
            continue
        run(path, tmp_path / f"in_{layout}", overrides=keys)
        known = find_sequence(tmp_path / f"in_{layout}/clean/box", poses="keep").trajectory.known
        assert known.tolist() == [row != lost for row in range(4)], layout
    mesh = ['scenes=[{"mesh": "room.ply", "trajectory": "a.txt", "poses": "keep"}]']
    refused(lambda: make_plan(read_preset(path, mesh)), names=["scenes.0.poses: ", "sequence"])


def test_how_a_camera_moves_is_unknown_at_and_after_an_unknown_pose(tmp_path, monkeypatch):
    source, written = recording(tmp_path, "scannet")
    (lost,) = written.lost
    assert 0 < lost < 3
    probes = Probes()
    probes.install(monkeypatch)
    path = preset_of(tmp_path / "p", source, scene={"poses": "keep"}, steps=BOTH_PROBES)
    run(path, tmp_path / "out")
    told = probes.of(COLOUR, "noisy")
    assert [told[frame].context.motion is None for frame in range(4)] == [
        frame in (lost, lost + 1) for frame in range(4)
    ]


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_a_recording_without_ground_truth(layout, tmp_path):
    source, _ = recording(tmp_path, "open3d")
    (source / "scene/trajectory.log").unlink()
    steps = [*BOTH, {"faster_motion": {"factor": 2}}]
    path = preset_of(tmp_path / "p", source, layout=layout, scene={"poses": "none"}, steps=steps)
    run(path, tmp_path / "out")
    names = {item.name for item in (tmp_path / "out/noisy/box").rglob("*")}
    assert not names & {"traj.txt", "groundtruth.txt", "groundtruth.csv", "state_groundtruth_estimate0"}
    found = find_sequence(tmp_path / "out/noisy/box", poses="none")
    assert not found.trajectory.known.any()
    assert 1 <= len(found.rgb_files) < 4
    moving = ['settings=[{"name": "moved", "perturb": [{"motion_deviation": {"rotation_deg": 1}}]}]']
    refused(make_plan, read_preset(path, moving), names=["scenes.0.sequence: ", "moved"])


def test_a_camera_replaces_the_datasets_own(tmp_path):
    source = tmp_path / "rgbd_dataset_freiburg2_xyz"
    for name, pixels in (("rgb", np.zeros((480, 640, 3), np.uint8)), ("depth", np.full((480, 640), 5000, np.uint16))):
        image(source / f"{name}/1.png", pixels)
        (source / f"{name}.txt").write_text(f"1.0 {name}/1.png\n")
    (source / "groundtruth.txt").write_text("1.0 0 0 0 0 0 0 1\n")
    path = preset_of(tmp_path / "p", source)
    (own,) = make_plan(read_preset(path)).renders
    assert (own.camera.fx_px, own.optics.distortion.coefficients[0]) == (520.9, 0.2312)
    ros = "camera={width: 640, height: 480, fx: 525, fy: 525, cx: 319.5, cy: 239.5}"
    (given,) = make_plan(read_preset(path, [ros])).renders
    assert (given.camera.fx_px, given.optics.plain) == (525.0, True)
    refused(make_plan, read_preset(path, [ros, "scenes.0.undistort=true"]), names="scenes.0.undistort: camera ")
    (pinhole,) = make_plan(read_preset(path, ["scenes.0.undistort=true"])).renders
    assert (pinhole.camera, pinhole.optics.plain) == (own.camera, True)
