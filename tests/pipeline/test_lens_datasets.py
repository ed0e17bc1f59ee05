# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets seen through a lens that distorts: what is written, what is refused, and the way back to a pinhole."""

import json
import sys
import tarfile

import cv2
import numpy as np
import pytest
from refusals import refused
import yaml
from analytic import box_depth, look_at
from cases import cases
from packed import pack_to
from worlds import HIGH, LOW, write_replica, write_world
from runs import run

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")

import noisy_world
from noisy_world.layouts import find_sequence
from noisy_world.core.errors import StorageError
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.lens import Distortion, lens_rays
from noisy_world.core.camera_motion import travel_px
from noisy_world.core.progress import PlainProgress
from noisy_world.evaluate.run_maps import read_sequence
from noisy_world.evaluate.system_input import sequence_input
from noisy_world.dataset.recipe import recipe_of

SIZE = (64, 48)
CAMERA = Intrinsics(*SIZE, 32.0, 32.0, 31.5, 23.5)  # as write_world has it
COUNT, SCALE = 3, 6553.5
LENS = Distortion("radial-tangential", (-0.2, 0.03, 0.001, -0.002))
KEYS = {"k1": -0.2, "k2": 0.03, "p1": 0.001, "p2": -0.002}
POSES = np.stack([look_at([-0.4 + 0.1 * n, 0.1, 1.2], [1.0, 0.4, 1.0]) for n in range(COUNT)])


def world(folder, distortion=None, *, settings=({"name": "clean"},), engine="embree", layout="replica", **keys):
    preset = write_world(
        folder, size=SIZE, settings=list(settings), render={"engine": engine, "backend": "reference"},
        output={"layout": layout, "image": "png"}, **keys,
    )  # fmt: skip
    write_replica(folder / "traj.txt", POSES)
    if distortion is not None:
        document = yaml.safe_load(preset.read_text())
        document["camera"]["distortion"] = distortion
        preset.write_text(yaml.safe_dump(document))
    return preset


def images(out, frame, name="clean"):
    places = [str(out / name / f"box/results/{what}{frame:06d}.png") for what in ("frame", "depth")]
    return cv2.imread(places[0]), cv2.imread(places[1], cv2.IMREAD_UNCHANGED) / SCALE


def through(lens, c2w):
    """Planar depth of the room behind a lens, in closed form, through a hundred times as many pixels' neighbours."""
    rays = lens_rays(CAMERA, lens)
    local = np.stack([rays.right, rays.down, np.ones(rays.right.shape)], axis=-1) @ c2w[:3, :3].T
    with np.errstate(divide="ignore"):
        bounds = np.sort(np.where(local > 0, HIGH - c2w[:3, 3], LOW - c2w[:3, 3]) / local, axis=-1)
    return bounds[..., 0], bounds[..., 1] - bounds[..., 0] > 0.05


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    settings = [
        {"name": "clean"},
        {"name": "rolling", "perturb": [{"rolling_shutter": {"readout_ms": 1}}]},
        {"name": "moved", "perturb": [{"motion_deviation": {"rotation_deg": 3}}]},
        {"name": "blurred", "perturb": [{"camera_motion_blur": {"shutter_ms": 100}}]},
    ]
    preset = world(folder, KEYS, settings=settings)
    run(preset, folder / "out")
    return preset, folder / "out"


def test_depth_is_planar_behind_the_lens(made):
    for frame in range(COUNT):
        true_m, sure = through(LENS, POSES[frame])
        assert sure.mean() > 0.6
        assert np.abs(images(made[1], frame)[1] - true_m)[sure].max() < 0.5 / SCALE + 2e-5


@cases("name", ["clean", "rolling", "moved", "blurred"])
def test_each_sequence_says_its_lens(made, name):
    found = find_sequence(made[1] / name / "box")
    assert found.optics.distortion == LENS
    manifest = json.loads((made[1] / "manifest.json").read_text())
    assert manifest["camera"]["distortion"] == LENS.content()


def test_ways_on_the_image_are_those_of_the_lens():
    """A wall before a camera that goes sideways and turns, every point projected by OpenCV."""
    rays = lens_rays(CAMERA, LENS)
    depth_m = np.full(rays.right.shape, 2.0, np.float32)
    c2w = np.tile(np.eye(4), (9, 1, 1))
    c2w[:, 0, 3] = np.linspace(-0.1, 0.1, 9)
    points = np.stack([rays.right, rays.down, np.ones_like(rays.right)], axis=-1).reshape(-1, 3) * 2.0
    places = []
    for pose in c2w:
        found, _ = cv2.projectPoints(
            points - pose[:3, 3], np.zeros(3), np.zeros(3), CAMERA.matrix, np.array(LENS.coefficients)
        )
        places.append(found.reshape(-1, 2))
    places = np.array(places)
    inside = ((places > -0.5) & (places < np.array(SIZE) - 0.5)).all(axis=-1)
    steps = np.where(inside[1:] & inside[:-1], np.linalg.norm(np.diff(places, axis=0), axis=-1), 0.0)
    true_px = steps.sum(axis=0).max()
    # A grid of pixels is looked at, and the widest ray through the image counts as within it.
    assert travel_px(depth_m, c2w[4], c2w, CAMERA, CAMERA, lens=LENS) == pytest.approx(true_px, rel=0.02)
    assert travel_px(depth_m, c2w[4], c2w, CAMERA, CAMERA) == pytest.approx(3.2, abs=1e-6)  # 32 px x .2 m / 2 m


def test_a_frame_alone_is_that_of_the_run(made, tmp_path):
    run(made[0], tmp_path / "alone", frames=slice(1, 2))
    for name in ("clean", "rolling", "moved", "blurred"):
        for kind in ("frame", "depth"):
            file = f"{name}/box/results/{kind}000001.png"
            assert (tmp_path / "alone" / file).read_bytes() == (made[1] / file).read_bytes()


@cases("changed", ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"])
def test_each_coefficient_is_in_the_identity(made, tmp_path, changed):
    key = f"camera.distortion.{changed}"
    refused(run, *made, overrides=[f"{key}={KEYS.get(changed, 0.0) + 0.001}"], names=key, error=StorageError)


def test_frames_that_are_undistorted_are_a_pinholes(made, tmp_path):
    run(made[0], tmp_path / "again", overrides=["camera.distortion.undistort=true"])
    run(world(tmp_path / "plain"), tmp_path / "pinhole")
    assert find_sequence(tmp_path / "again/clean/box").optics.plain
    matrix, values = CAMERA.matrix, np.array(LENS.coefficients)
    for frame in range(COUNT):
        rgb, depth_m = images(tmp_path / "again", frame)
        # OpenCV's own undistortion of the bent frame, within the rounding of its maps to 1/32 px.
        opencv = cv2.undistort(images(made[1], frame)[0], matrix, values)
        assert np.abs(rgb.astype(int) - opencv).max() <= 8
        seen = depth_m > 0
        true_m, sure = box_depth(CAMERA, POSES[frame], LOW, HIGH)
        assert np.abs(depth_m / true_m - 1)[sure & seen].max() < 0.05  # of the nearest pixel, half of one away
    key = "camera.distortion.undistort"
    refused(run, *made, overrides=[f"{key}=true"], names=key, error=StorageError)


@cases(("layout", "read"), [("euroc", "mav0/cam0/sensor.yaml"), ("tum", None), ("vslamlab", None)])
def test_layouts_that_know_lenses_write_them(tmp_path, layout, read):
    for model, keys, coefficients in (
        ("radial-tangential", KEYS, LENS.coefficients),
        ("radial-tangential", KEYS | {"k3": 0.01}, (*LENS.coefficients, 0.01)),
        ("equidistant", {"k1": -0.02, "k4": 0.001}, (-0.02, 0.0, 0.0, 0.001)),
    ):
        folder = tmp_path / f"{layout}{model}{len(coefficients)}"
        folder.mkdir()
        run(world(folder, {"model": model, **keys}, layout=layout), folder / "out")
        found = find_sequence(folder / "out/clean/box")
        assert found.optics.distortion == Distortion(model, coefficients)
        if read:
            text = (folder / "out/clean/box" / read).read_text()
            assert f"distortion_model: {model}" in text


@cases(
    ("keys", "named"),
    [
        (KEYS, {**KEYS, "colmap": "OPENCV", "kalibr": "radtan"}),
        ({"k1": -0.1, "k3": 0.01}, {"k1": -0.1, "k2": 0.0, "p1": 0.0, "p2": 0.0, "k3": 0.01, "colmap": "FULL_OPENCV"}),
        (
            {"model": "equidistant", "k1": -0.02},
            {"k1": -0.02, "k2": 0.0, "k3": 0.0, "k4": 0.0, "colmap": "OPENCV_FISHEYE", "kalibr": "equidistant"},
        ),
    ],
)
def test_cam_params_has_the_names_of_other_tools(tmp_path, keys, named):
    run(world(tmp_path, keys), tmp_path / "out", frames=slice(0, 1), overwrite=True)
    told = json.loads((tmp_path / "out/clean/cam_params.json").read_text())["distortion"]
    assert {name: value for name, value in told.items() if name not in ("model", "coefficients")} == named


def test_a_layout_that_cannot_say_it_is_refused(tmp_path):
    rational = {"k1": 0.1, "k6": 0.01}
    preset = world(tmp_path, rational, layout="vslamlab")
    refused(run, preset, tmp_path / "out", names=["scenes.0.mesh: ", "output.layout"])
    run(world(tmp_path / "pinhole", rational | {"undistort": True}, layout="vslamlab"), tmp_path / "out")


@cases(
    ("distortion", "names"),
    [
        ({"k1": -0.9}, ["camera.distortion: ", "64 x 48", "coefficients"]),
        ({"k1": 0.0}, ["camera.distortion: ", "coefficient"]),
        ({"model": "equidistant", "k1": 0.1, "p1": 0.1}, ["camera.distortion.p1: ", "radial-tangential"]),
        ({"model": "fisheye", "k1": 0.1}, ["camera.distortion.model: ", "radial-tangential"]),
        ({"k1": float("inf")}, "camera.distortion.k1: "),
    ],
)
def test_lenses_that_make_no_image_are_refused(tmp_path, distortion, names):
    refused(run, world(tmp_path, distortion), tmp_path / "out", names=names)
    assert not (tmp_path / "out").exists()


# --- bent from a pinhole's images ---


def stored_preset(folder, sequence, **keys):
    folder.mkdir(parents=True, exist_ok=True)
    document = {
        "seed": 3,
        "scenes": [{"name": "box", "sequence": str(sequence), **keys}],
        "render": {"backend": "reference"},
        "output": {"layout": "replica", "image": "png"},
    }
    path = folder / "stored.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def test_a_recording_is_bent_and_what_it_did_not_see_is_void(made, tmp_path):
    run(world(tmp_path / "world"), tmp_path / "pinhole")
    run(stored_preset(tmp_path / "bent", tmp_path / "pinhole/clean/box", distortion=KEYS), tmp_path / "out")
    assert find_sequence(tmp_path / "out/clean/box").optics.distortion == LENS
    rays = lens_rays(CAMERA, LENS)
    u, v = rays.right * 32 + 31.5, rays.down * 32 + 23.5
    inside = (u >= -0.5) & (u < 63.5) & (v >= -0.5) & (v < 47.5)
    assert 0.02 < (~inside).mean() < 0.5
    for frame in range(COUNT):
        rgb, depth_m = images(tmp_path / "out", frame)
        cast_rgb, cast_m = images(made[1], frame)
        true_m, sure = through(LENS, POSES[frame])
        assert not rgb[~inside].any()
        assert not depth_m[~inside].any()
        # Steps of 1 / 6553.5 m; beside the walls' edges a pixel has the nearest one's depth.
        error = np.abs(depth_m / true_m - 1)[sure & inside]
        assert np.quantile(error, 0.8) < 2e-4
        assert error.max() < 0.05
        assert np.abs(depth_m - cast_m)[sure & inside].mean() < 0.01
        assert np.median(np.abs(rgb.astype(int) - cast_rgb)[inside]) <= 2


@cases(
    ("keys", "names"),
    [
        ({"distortion": KEYS}, ["scenes.0.distortion: ", "undistort: true"]),
        ({"distortion": {"k1": 0.0}}, ["scenes.0.distortion: ", "coefficient"]),
        ({"distortion": {"k1": -0.9}, "undistort": True}, ["scenes.0.distortion: ", "folds"]),
        ({"distortion": KEYS | {"undistort": True}}, "scenes.0.distortion.undistort: "),
    ],
)
def test_recordings_that_cannot_be_bent_are_refused(made, tmp_path, keys, names):
    refused(run, stored_preset(tmp_path, made[1] / "clean/box", **keys), tmp_path / "out", names=names)


def test_another_lens_takes_the_place_of_a_recordings_own(made, tmp_path):
    keys = {"undistort": True, "distortion": {"model": "equidistant", "k1": 0.02}}
    run(stored_preset(tmp_path, made[1] / "clean/box", **keys), tmp_path / "out")
    assert find_sequence(tmp_path / "out/clean/box").optics.distortion == Distortion(
        "equidistant", (0.02, 0.0, 0.0, 0.0)
    )


def test_a_lens_of_the_camera_is_not_laid_over_a_recording(made, tmp_path):
    preset = stored_preset(tmp_path, made[1] / "clean/box", undistort=True)
    camera = "camera={width: 64, height: 48, fx: 32, fy: 32, cx: 31.5, cy: 23.5, distortion: {k1: -0.1}}"
    refused(run, preset, tmp_path / "out", overrides=[camera], names="camera.distortion: box")


def test_a_lens_that_needs_too_large_a_pinhole_is_refused_but_for_rays(tmp_path):
    wide = {"model": "equidistant", "k1": 0.05}
    out, focal = tmp_path / "out", ["camera.fx=25", "camera.fy=25"]
    names = ["camera.distortion: ", "render.engine: embree"]
    refused(run, world(tmp_path, wide, engine="cycles"), out, overrides=focal, names=names)
    run(world(tmp_path, wide), out, overrides=focal)


# --- readers ---


def test_those_who_open_it_are_told_the_lens(made, tmp_path):
    opened = noisy_world.open(made[1])
    assert opened["clean/box"].distortion == LENS
    recipe = made[0].parent / "a.recipe"
    recipe.write_text(recipe_of(made[1], PlainProgress(sys.stderr)).text())
    assert noisy_world.open(recipe)["clean/box"].distortion == LENS
    packed = f"file://{tmp_path}/packed"
    pack_to(made[1], packed)
    assert noisy_world.open(packed)["clean/box"].distortion == LENS
    with tarfile.open(next((tmp_path / "packed").rglob("*.tar"))) as tar:
        told = next(json.load(tar.extractfile(item)) for item in tar if item.name.endswith(".json"))
    assert told["camera"]["distortion"] == LENS.content()


def test_systems_and_maps_refuse_a_lens_that_they_would_ignore(made):
    folder = made[1] / "clean/box"
    refused(sequence_input, folder, names=[str(folder), "undistort: true"])
    refused(read_sequence, folder, names=[str(folder), "lens"])
