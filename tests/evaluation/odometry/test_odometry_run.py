"""rgbd_odometry on a room in closed form: where the camera was, and that it says when it does not know."""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import box_room
import numpy as np
import pytest

from noisy_world.core.errors import InputError
from noisy_world.evaluate.frame_tracking import State
from noisy_world.evaluate.odometry import Options, main, run
from noisy_world.evaluate.system_input import read_index
from noisy_world.scenes.ply import read_ply

ADDON = Path(__file__).parents[3] / "addon"
POSES = box_room.path(30, turn_deg=40.0)


def positions(result):
    return [frame.c2w[:3, 3] for frame in result.frames if frame.c2w is not None]


def states(result):
    return [frame.state for frame in result.frames]


def ran(folder, poses=POSES, options=None, **changes):
    return run(read_index(box_room.write(folder, poses, **changes)), options)


def blinded(first, last):
    """Void depth and black colour from frame first to last - 1."""
    return lambda number, colour, depth_m: (colour * 0, depth_m * 0) if first <= number < last else (colour, depth_m)


@pytest.fixture(scope="module")
def index_file(tmp_path_factory):
    return box_room.write(tmp_path_factory.mktemp("room"), POSES)


@pytest.fixture(scope="module")
def clean(index_file):
    return run(read_index(index_file))


def test_the_path_is_found_within_3_mm(clean):
    assert states(clean) == [State.TRACKED] * len(POSES)
    assert box_room.ate_rmse_m(positions(clean), POSES[:, :3, 3]) < 0.001
    assert len(clean.keyframes) > 2


def test_relative_poses_are_camera_to_world_in_opencv_axes(clean):
    found = clean.frames[-1].c2w  # the first pose is the identity
    true = np.linalg.inv(POSES[0]) @ POSES[-1]
    np.testing.assert_allclose(found, true, atol=0.01)


def test_the_files_are_the_same_bytes_twice(index_file, tmp_path, capsys):
    for name in ("one", "two"):
        assert main([str(index_file), str(tmp_path / name)]) == 0
    for name in ("estimate.txt", "frames.csv", "keyframes.txt"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    assert "30 of 30 frames tracked" in capsys.readouterr().out


def test_files_say_state_and_pose_of_each_frame(index_file, clean, tmp_path):
    assert main([str(index_file), str(tmp_path)]) == 0
    rows = list(csv.DictReader((tmp_path / "frames.csv").open()))
    assert [(int(row["index"]), row["state"]) for row in rows] == [(n, "tracked") for n in range(30)]
    poses = np.loadtxt(tmp_path / "estimate.txt")
    np.testing.assert_allclose(poses[:, 0], np.arange(30) / box_room.RATE_HZ, atol=1e-9)
    np.testing.assert_array_equal(poses[:, 1:4], positions(clean))
    np.testing.assert_allclose(np.linalg.norm(poses[:, 4:], axis=1), 1.0, atol=1e-12)


def test_as_a_program(index_file, tmp_path):
    command = [sys.executable, "-m", "noisy_world.evaluate.odometry", str(index_file), str(tmp_path / "out")]
    environment = os.environ | {"PYTHONPATH": str(ADDON)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, "30 of 30" in done.stdout) == (0, True), done.stderr


def test_one_frame_is_tracked_at_the_origin(tmp_path):
    result = ran(tmp_path, POSES[:1])
    np.testing.assert_array_equal(result.frames[0].c2w, np.eye(4))


def test_void_depth_everywhere_is_never_initialised(tmp_path):
    result = ran(tmp_path, POSES[:4], change=lambda _, colour, depth_m: (colour, depth_m * 0))
    assert states(result) == [State.NOT_INITIALISED] * 4
    assert not positions(result)


def test_black_images_are_tracked_by_depth_or_lost_without_a_wrong_pose(tmp_path):
    result = ran(tmp_path, POSES[:12], change=lambda _, colour, depth_m: (colour * 0, depth_m))
    assert all(np.isfinite(place).all() for place in positions(result))
    known = [n for n, frame in enumerate(result.frames) if frame.c2w is not None]
    assert box_room.ate_rmse_m(positions(result), POSES[known, :3, 3]) < 0.05


def test_frames_without_sight_are_lost_and_those_after_are_found_again(tmp_path):
    result = ran(tmp_path, POSES[:16], change=blinded(6, 9))
    assert states(result)[6:9] == [State.LOST] * 3
    assert states(result)[9] is State.RELOCALISED
    assert set(states(result)[:6] + states(result)[10:]) == {State.TRACKED}
    seen = [*range(6), *range(9, 16)]
    assert box_room.ate_rmse_m(positions(result), POSES[seen, :3, 3]) < 0.005


def test_a_jump_to_what_was_never_seen_is_lost(tmp_path):
    away = box_room.path(5, sway_m=0.1)
    away[:, :3, :3] = np.diag([-1.0, -1.0, 1.0]) @ away[:, :3, :3]  # turned by half
    result = ran(tmp_path, np.concatenate([POSES[:5], away]))
    assert states(result) == [State.TRACKED] * 5 + [State.LOST] * 5


def test_a_first_frame_that_fits_nothing_is_given_up(tmp_path):
    noise = np.random.default_rng(1).uniform(0.5, 9.0, (120, 160))
    result = ran(tmp_path, POSES[:6], change=lambda n, colour, depth_m: (colour, noise if n == 0 else depth_m))
    assert states(result)[0] is State.NOT_INITIALISED
    assert states(result)[1:] == [State.TRACKED] * 5


def test_large_images_are_thinned_out_and_give_the_same_path(tmp_path):
    from noisy_world.core.geometry import Intrinsics

    camera = Intrinsics(241, 181, 120.0, 118.0, 118.0, 92.0)
    result = ran(tmp_path, POSES[:10], Options(widest_px=160), camera=camera)
    assert box_room.ate_rmse_m(positions(result), POSES[:10, :3, 3]) < 0.003


def test_stopping_keeps_what_is_there(index_file):
    count = iter(range(100))
    result = run(read_index(index_file), stopped=lambda: next(count) >= 7)
    assert result.stopped
    assert len(result.frames) == 7


def test_the_map_is_the_walls_of_the_room(index_file, tmp_path):
    pytest.importorskip("scipy")
    assert main([str(index_file), str(tmp_path), "--map"]) == 0
    mesh = read_ply(tmp_path / "map.ply")
    at = mesh.vertices_m @ POSES[0][:3, :3].T + POSES[0][:3, 3]
    nearest_m, second_m, _ = np.sort(np.minimum(np.abs(at - box_room.LOW), np.abs(at - box_room.HIGH)), axis=1).T
    assert len(at) > 1000
    assert nearest_m[second_m > 0.03].max() < 0.015
    assert nearest_m.max() < 0.03  # voxels cut the room's edges off


def test_without_gtsam_loops_stay_open_and_a_line_says_so(index_file, clean, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("noisy_world.evaluate.odometry.can_optimise", lambda: False)
    assert main([str(index_file), str(tmp_path)]) == 0
    assert "loops are not closed, as gtsam is missing" in capsys.readouterr().err
    assert len(np.loadtxt(tmp_path / "estimate.txt")) == len(clean.frames)


def test_another_size_than_the_camera_is_one_line(index_file, tmp_path, capsys):
    index = json.loads(index_file.read_text())
    index["camera"]["width"] = 161
    changed = tmp_path / "frames.json"
    changed.write_text(json.dumps(index))
    assert main([str(changed), str(tmp_path / "out")]) == 1
    assert "colour0000.png: has 160 x 120 pixels, but the camera 161 x 120" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda index: index["frames"].clear(), "frames: names no frame"),
        (lambda index: index["frames"][1].update(stamp_s=0.0), "frames.1.stamp_s: is 0.0, no later"),
        (lambda index: index.update(depth_scale_per_m=0), "depth_scale_per_m"),
        (lambda index: index["frames"][0].pop("colour"), "frames.0.colour: is missing"),
        (lambda index: index["frames"][0].update(colour="/nowhere.png"), "nowhere.png: cannot be read"),
    ],
)
def test_what_an_index_cannot_say_is_one_line(index_file, tmp_path, change, message):
    index = json.loads(index_file.read_text())
    change(index)
    changed = tmp_path / "frames.json"
    changed.write_text(json.dumps(index))
    with pytest.raises(InputError) as error:
        run(read_index(changed))
    assert message in str(error.value)
