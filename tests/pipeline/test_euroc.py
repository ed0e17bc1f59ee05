# SPDX-License-Identifier: GPL-3.0-or-later
"""EuRoC ASL as it is written, checked by parsers of the tests' own."""

import json
import threading

import fake_session
import numpy as np
import pytest
from refusals import refused
import yaml
from worlds import content, path_poses
from runs import run
from written import (
    COUNT,
    RIG,
    SHAKY,
    extrinsics,
    fake_depth_m,
    fake_rgb,
    names_in,
    read,
    replica_poses,
    rows_of,
    states,
    world,
    write_tum_path,
)

from noisy_world.evaluate.system_input import sequence_input
from noisy_world.layouts import find_sequence
from noisy_world.core.errors import InterruptedRunError
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan


pytestmark = pytest.mark.usefixtures("no_blender")


def test_every_file_of_a_euroc_sequence(tmp_path):
    run(world(tmp_path / "w", "euroc"), tmp_path / "out")
    run(world(tmp_path / "r", "replica", output={"image": "png"}), tmp_path / "replica")
    folder, other = tmp_path / "out/clean/box", tmp_path / "replica/clean/box"
    stems = [f"{k * 50_000_000:019d}" for k in range(COUNT)]
    images = {f"mav0/{sensor}/data/{stem}.png" for sensor in ("cam0", "depth0") for stem in stems}
    described = {
        f"mav0/{place}/{name}"
        for place in ("cam0", "depth0", "state_groundtruth_estimate0")
        for name in ("data.csv", "sensor.yaml")
    }
    assert names_in(folder) == images | described | {"mav0/body.yaml", "mav0/cam0/timestamps.txt", "frames.jsonl"}
    assert [path.name for path in (tmp_path / "out/clean").iterdir()] == ["box"]  # no cam_params.json
    for sensor in ("cam0", "depth0"):
        listed = rows_of(folder / "mav0" / sensor / "data.csv")
        assert listed == [[stem, f"{stem}.png"] for stem in stems]
        assert sorted(name for _, name in listed) == [name for _, name in listed]
        about = yaml.safe_load((folder / "mav0" / sensor / "sensor.yaml").read_text())
        assert about["rate_hz"] == 20
        assert about["resolution"] == [8, 6]
        assert about["camera_model"] == "pinhole"
        assert about["intrinsics"] == [4.0, 4.0, 3.5, 2.5]
        assert about["distortion_coefficients"] == [0.0] * 4
        assert np.array_equal(extrinsics(folder / "mav0" / sensor / "sensor.yaml"), np.eye(4))
    assert yaml.safe_load((folder / "mav0/depth0/sensor.yaml").read_text())["depth_scale_per_m"] == 5000.0
    # ORB-SLAM3 takes a line of this file, with its end cut at LF alone, as an image's name.
    times = (folder / "mav0/cam0/timestamps.txt").read_bytes().decode().split("\n")
    assert times == [*stems, ""]
    assert isinstance(yaml.safe_load((folder / "mav0/body.yaml").read_text()), dict)
    stamps_ns, poses = states(folder)
    assert stamps_ns == [k * 50_000_000 for k in range(COUNT)]
    assert np.allclose(poses, replica_poses(other / "traj.txt"), atol=1e-12)
    assert np.allclose(poses, path_poses(COUNT), atol=1e-12)
    for k, stem in enumerate(stems):
        rgb = 255 * np.clip(fake_rgb(k), 0, 1).astype(float)
        grey = read(folder / f"mav0/cam0/data/{stem}.png")
        assert grey.shape == (6, 8)
        assert grey.dtype == np.uint8
        assert np.abs(grey - rgb @ [0.299, 0.587, 0.114]).max() <= 0.5 + 1e-4
        depth = read(folder / f"mav0/depth0/data/{stem}.png")
        assert depth.dtype == np.uint16
        assert np.abs(depth / 5000 - fake_depth_m(k)).max() <= 0.5 / 5000 + 1e-6


def test_euroc_in_colour(tmp_path):
    run(world(tmp_path / "w", "euroc", output={"colour": "rgb"}), tmp_path / "out")
    pixels = read(tmp_path / f"out/clean/box/mav0/cam0/data/{50_000_000:019d}.png")
    assert pixels.shape == (6, 8, 3)
    assert np.abs(pixels[..., ::-1] - 255 * fake_rgb(1)).max() <= 0.5 + 1e-4


@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_euroc_with_one_modality_has_no_trace_of_the_other(tmp_path, modality):
    preset = world(tmp_path / "w", "euroc", output={"modalities": [modality], "overview": True})
    run(preset, tmp_path / "out")
    here, other = ("cam0", "depth0") if modality == "rgb" else ("depth0", "cam0")
    folder = tmp_path / "out/clean/box"
    assert len(rows_of(folder / "mav0" / here / "data.csv")) == COUNT
    assert not (folder / "mav0" / other).exists()
    assert (folder / "mav0/cam0/timestamps.txt").exists() == (modality == "rgb")
    assert (tmp_path / "out/overview.png").stat().st_size > 500
    if modality == "rgb":
        assert not find_sequence(folder).depth_files
    else:
        refused(find_sequence, folder, names=f"{other}/data.csv: ")


def test_a_robot_is_the_body(tmp_path):
    keys = {"rig": RIG, "settings": [{"name": "clean"}, SHAKY]}
    run(world(tmp_path / "w", "euroc", **keys), tmp_path / "out")
    run(world(tmp_path / "r", "replica", **keys), tmp_path / "replica")
    for setting in ("clean", "shaky"):
        folder, other = tmp_path / f"out/{setting}/box", tmp_path / f"replica/{setting}/box"
        _, body = states(folder)
        assert np.allclose(body, replica_poses(other / "traj_robot.txt"), atol=1e-12)
        for sensor, name in (("cam0", "traj.txt"), ("depth0", "traj_depth.txt")):
            in_body = extrinsics(folder / "mav0" / sensor / "sensor.yaml")
            assert np.allclose(body @ in_body, replica_poses(other / name), atol=1e-12)
        assert not np.allclose(extrinsics(folder / "mav0/cam0/sensor.yaml"), np.eye(4), atol=0.05)
    stamps_ns, nominal = states(tmp_path / "out/shaky/box", "state_nominal0")
    clean_ns, clean = states(tmp_path / "out/clean/box")
    assert stamps_ns == clean_ns
    assert np.allclose(nominal, clean, atol=1e-12)
    found = find_sequence(tmp_path / "out/clean/box")
    between = np.linalg.inv(extrinsics(folder / "mav0/cam0/sensor.yaml")) @ extrinsics(
        folder / "mav0/depth0/sensor.yaml"
    )
    assert np.allclose(found.optics.depth.matrix, between, atol=1e-12)
    refused(sequence_input, tmp_path / "out/clean/box", names=["clean/box", "depth has a camera of its own"])


def test_the_nominal_path_has_a_file_of_its_own(tmp_path):
    run(world(tmp_path / "w", "euroc", settings=[{"name": "clean"}, SHAKY]), tmp_path / "out")
    _, clean = states(tmp_path / "out/clean/box")
    _, true = states(tmp_path / "out/shaky/box")
    _, nominal = states(tmp_path / "out/shaky/box", "state_nominal0")
    assert np.allclose(nominal, clean, atol=1e-15)
    assert (np.abs(true - nominal).max(axis=(1, 2)) > 1e-4).all()
    assert not (tmp_path / "out/clean/box/mav0/state_nominal0").exists()


def test_stamps_of_a_real_clock_name_the_files(tmp_path):
    preset = world(tmp_path / "w", "euroc")
    override = write_tum_path(tmp_path / "w", ["1305031102.175304", "1305031102.211214", "1305031102.243211"])
    run(preset, tmp_path / "out", overrides=[override])
    folder = tmp_path / "out/clean/box"
    wanted = ["1305031102175304000", "1305031102211214000", "1305031102243211000"]
    assert sorted(path.stem for path in (folder / "mav0/cam0/data").iterdir()) == wanted
    assert [row[0] for row in rows_of(folder / "mav0/state_groundtruth_estimate0/data.csv")] == wanted
    records = [json.loads(line) for line in (folder / "frames.jsonl").read_text().splitlines()]
    assert [record["time_s"] for record in records] == [1305031102.175304, 1305031102.211214, 1305031102.243211]
    assert find_sequence(folder).trajectory.stamps_s.tolist() == [record["time_s"] for record in records]


@pytest.mark.parametrize(("stamps", "words"), [(["-1.0", "0.0"], "frame 0"), (["1.0", "1.0000000001"], "frame 1")])
def test_stamps_that_cannot_be_names_are_refused_before_anything_is_made(tmp_path, stamps, words):
    preset = world(tmp_path / "w", "euroc")
    override = write_tum_path(tmp_path / "w", stamps)
    refused(run, preset, tmp_path / "out", overrides=[override], names=[words, "scenes.0", "output.layout"])
    assert not (tmp_path / "out").exists()
    run(preset, tmp_path / "out", overrides=[override, "output.layout=tum"])


@pytest.mark.parametrize(
    "trajectory",
    [
        "{handheld: {frames: 12, rate_hz: 30}}",
        "{handheld: {frames: 12}, start: 1, stop: 11, every: 3}",
        "{handheld: {frames: 12}, resample_hz: 7}",
        "{file: traj.txt, rate_hz: 12.5, start: 1}",
    ],
)
def test_stamps_are_known_before_the_path_is(tmp_path, trajectory):
    preset = world(tmp_path / "w", "euroc")
    plan = make_plan(read_preset(preset, [f"scenes.0.trajectory={trajectory}"]))
    scene = plan.renders[0].scene
    assert np.array_equal(scene.source.stamps_s, scene.source.trajectory().stamps_s)
    assert scene.frame_count == len(scene.source.stamps_s) == len(plan.sequences[0].frames)


def test_desynchronised_and_faster_sequences_keep_the_cameras_stamps(tmp_path):
    settings = [
        {"name": "clean"},
        {"name": "late", "perturb": [{"desync": {"offset": 1}}]},
        {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]},
    ]
    run(world(tmp_path / "w", "euroc", frames=5, settings=settings), tmp_path / "out")

    def path(setting, sensor, k):
        return tmp_path / f"out/{setting}/box/mav0/{sensor}/data/{k * 50_000_000:019d}.png"

    for k in range(5):
        assert path("late", "cam0", k).samefile(path("clean", "cam0", k))
        assert path("late", "depth0", k).samefile(path("clean", "depth0", min(k + 1, 4)))
    assert sorted(item.name for item in path("fast", "cam0", 0).parent.iterdir()) == [
        path("fast", "cam0", k).name for k in range(3)
    ]
    for k in range(3):
        for sensor in ("cam0", "depth0"):
            assert path("fast", sensor, k).samefile(path("clean", sensor, 2 * k))
    _, clean = states(tmp_path / "out/clean/box")
    stamps_ns, fast = states(tmp_path / "out/fast/box")
    assert stamps_ns == [0, 50_000_000, 100_000_000]
    assert np.allclose(fast, clean[::2], atol=1e-15)
    assert yaml.safe_load((tmp_path / "out/fast/box/mav0/cam0/sensor.yaml").read_text())["rate_hz"] == 20


def test_euroc_parts_make_the_whole_and_a_stopped_run_goes_on(tmp_path):
    preset = world(tmp_path / "w", "euroc", settings=[{"name": "clean"}, {"name": "same"}])
    run(preset, tmp_path / "whole")
    whole = content(tmp_path / "whole")
    run(preset, tmp_path / "parts", frames=slice(2, None))
    folder = tmp_path / "parts/clean/box"
    assert [int(row[0]) for row in rows_of(folder / "mav0/cam0/data.csv")] == [100_000_000, 150_000_000]
    assert states(folder)[0] == [100_000_000, 150_000_000]
    run(preset, tmp_path / "parts", frames=slice(0, 2))
    assert content(tmp_path / "parts") == whole

    stop = threading.Event()
    original = fake_session.Session.frame

    def stopping(self, request):
        if request.index == 1:
            stop.set()
        return original(self, request)

    fake_session.Session.frame = stopping
    try:
        with pytest.raises(InterruptedRunError):
            run(preset, tmp_path / "stopped", stop=stop)
    finally:
        fake_session.Session.frame = original
    fake_session.Session.rendered.clear()
    run(preset, tmp_path / "stopped")
    assert 0 < len(fake_session.Session.rendered) < COUNT
    assert content(tmp_path / "stopped") == whole
    lost = tmp_path / f"stopped/same/box/mav0/depth0/data/{50_000_000:019d}.png"
    lost.unlink()
    fake_session.Session.rendered.clear()
    run(preset, tmp_path / "stopped")
    assert fake_session.Session.rendered == [1]
    assert content(tmp_path / "stopped") == whole
