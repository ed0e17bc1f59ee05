"""ORB-SLAM3 and Open3D where `make slam-env` has been run; the plain tracker, and what needs neither, everywhere."""

import json
import shutil
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import box_room
import cv2
import numpy as np
import pytest
from refusals import refused

from noisy_world.core.errors import MissingDependencyError
from noisy_world.core.geometry import rotation_from_quat_wxyz
from noisy_world.evaluate.cases import Outcome, read_estimate_file
from noisy_world.evaluate.system_runs import PROGRAMS, check_system, run_system
from noisy_world.evaluate.systems import find_system
from noisy_world.trajectories.formats import read_trajectory

EXAMPLES = Path(__file__).resolve().parents[3] / "docs" / "examples"
FRAMES, STEP_M, DEPTH_M, FOCAL_PX = 40, 0.01, 2.0, 300.0


@pytest.fixture
def programs(monkeypatch):
    monkeypatch.syspath_prepend(str(PROGRAMS))
    monkeypatch.setitem(sys.modules, "orbslam3", ModuleType("orbslam3"))  # of another Python


def turned(random, count):
    return rotation_from_quat_wxyz(random.normal(size=(count, 4)))


def test_poses_are_written_as_they_are(programs, tmp_path):
    from frame_files import inverse, rigid, tum_text

    random = np.random.default_rng(0)
    rotations = np.concatenate([turned(random, 50), [np.diag(d) for d in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1])]])
    poses = {k: rigid(rotation, random.normal(size=3) * 1e5) for k, rotation in enumerate(rotations)}
    path = tmp_path / "poses.txt"
    path.write_text(tum_text(np.arange(len(rotations)) / 20 + 1e9, poses))
    read = read_trajectory(path, format="tum", stamp_unit="s")
    assert np.abs(read.c2w - np.array(list(poses.values()))).max() < 1e-10
    assert np.abs(inverse(poses[3]) @ poses[3] - np.eye(4)).max() < 1e-10
    assert np.array_equal(read.stamps_s, np.arange(len(rotations)) / 20 + 1e9)


def test_frames_without_a_final_pose_move_with_the_one_before(programs):
    import orb_slam3
    from frame_files import rigid

    random = np.random.default_rng(1)
    online = {k: rigid(rotation, random.normal(size=3)) for k, rotation in enumerate(turned(random, 4))}
    moved = rigid(turned(random, 1)[0], np.array([1.0, 2.0, 3.0]))
    found = orb_slam3.placed(online, {1: online[1] @ moved, 3: online[3]})
    assert sorted(found) == [1, 2, 3]  # nothing before frame 0 has a final pose
    assert np.abs(found[2] - online[2] @ moved).max() < 1e-12
    assert np.array_equal(found[3], online[3])


def test_misread_depth_is_what_a_colour_reader_leaves(programs, tmp_path):
    """Against OpenCV reading the file as colour, and a row of its bytes taken as if it had one channel."""
    from orb_slam3 import misread

    steps = np.random.default_rng(3).integers(0, 65536, (4, 11), dtype=np.uint16)
    steps[0, :4] = 0, 255, 256, 65535
    path = str(tmp_path / "depth.png")
    assert cv2.imwrite(path, steps)
    assert np.array_equal(misread(steps), cv2.imread(path).reshape(4, 33)[:, :11])


def test_settings_follow_from_camera_and_rate(programs):
    import orb_settings
    import orb_slam3

    index = {
        "camera": {"width": 320, "height": 240, "fx": 300.0, "fy": 301.0, "cx": 159.5, "cy": 119.5},
        "frames": [{"stamp_s": 0.1}, {"stamp_s": 0.2}, {"stamp_s": 0.3}],
        "inverse_depth": {"median_per_m": 0.5, "noise_per_m": 0.001},
    }
    options = SimpleNamespace(mono=False, pixel_noise_px=0.9, slope=0.5, bf_px_m=None, near_m=3.1)
    lines = dict(line.split(": ") for line in orb_settings.settings_text(index, options).splitlines()[1:])
    assert lines["Camera.fps"] == "10"
    assert float(lines["Camera1.fy"]) == 301.0
    # A corner is .9 px off. Depth is .001 * 2 m * 2 m = 4 mm off, and .9 / 300 * 2 m * .5 = 3 mm where it is read: 5 mm
    # together, which at 2 m are .9 px of a bf of .9 * 2 * 2 / .005 = 720 px m.
    assert float(lines["Stereo.b"]) * 300.0 == pytest.approx(-720.0)
    assert float(lines["Stereo.b"]) * float(lines["Stereo.ThDepth"]) == pytest.approx(3.1)
    given = SimpleNamespace(mono=False, pixel_noise_px=None, slope=None, bf_px_m=80.0, near_m=3.1)
    assert f"Stereo.b: {80.0 / 300.0:.9f}" in orb_settings.settings_text(index, given)
    for wrong in ({"near_m": None}, {"bf_px_m": None}, {"pixel_noise_px": 0.9, "slope": 0.5}):
        options = SimpleNamespace(**{**vars(given), **wrong})
        refused(orb_settings.settings_text, index, options, names="--near-m", error=SystemExit)
    assert orb_settings.gap_of({"frames": [{"stamp_s": 5.0}]}) == 0.05
    states = {"TrackingState.OK": "tracked", "TrackingState.RECENTLY_LOST": "lost", "NO_IMAGES_YET": "not_initialised"}
    assert {orb_slam3.state_name(state) for state in states} == set(states.values())


@pytest.fixture(scope="module")
def wall(tmp_path_factory):
    """A textured wall, 2 m away, that a camera moves along by 1 cm a frame: 1.5 pixels."""
    folder = tmp_path_factory.mktemp("wall") / "wall"
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    random = np.random.default_rng(2)
    texture = random.integers(0, 255, (80, 160, 3), dtype=np.uint8)
    texture = cv2.GaussianBlur(cv2.resize(texture, (960, 480), interpolation=cv2.INTER_NEAREST), (0, 0), 0.8)
    lists = {"rgb": [], "depth": [], "groundtruth": []}
    for k in range(FRAMES):
        left_px = 100 + FOCAL_PX * STEP_M * k / DEPTH_M
        shift = np.array([[1.0, 0.0, -left_px], [0.0, 1.0, -100.0]])
        assert cv2.imwrite(str(folder / f"rgb/{k:06d}.png"), cv2.warpAffine(texture, shift, (320, 240)))
        assert cv2.imwrite(str(folder / f"depth/{k:06d}.png"), np.full((240, 320), DEPTH_M * 5000, np.uint16))
        for name in ("rgb", "depth"):
            lists[name].append(f"{k / 20:.6f} {name}/{k:06d}.png")
        lists["groundtruth"].append(f"{k / 20:.6f} {k * STEP_M} 0 0 0 0 0 1")
    for name, rows in lists.items():
        (folder / f"{name}.txt").write_text("".join(f"{row}\n" for row in rows))
    camera = {"w": 320, "h": 240, "fx": FOCAL_PX, "fy": FOCAL_PX, "cx": 159.5, "cy": 119.5, "scale": 5000.0}
    (folder / "cam_params.json").write_text(json.dumps({"camera": camera}))
    return folder


def test_the_plain_tracker_is_the_tutorial_s(wall, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    import odometry

    folder = tmp_path / "with a void frame"
    shutil.copytree(wall, folder)
    void = 20
    cv2.imwrite(str(folder / f"depth/{void:06d}.png"), np.zeros((240, 320), np.uint16))
    record = run_system(find_system("plain_odometry"), folder, tmp_path / "run")
    assert (record.outcome, record.detail) == (Outcome.FINISHED, "")
    assert set(record.versions) == {"numpy", "opencv", "python"}
    estimate = read_estimate_file(tmp_path / "run" / "estimate.txt")

    names = [
        [line.split()[1] for line in (folder / f"{name}.txt").read_text().splitlines()] for name in ("rgb", "depth")
    ]
    pairs = [f"{k / 20:.6f} {rgb} {k / 20:.6f} {depth}\n" for k, (rgb, depth) in enumerate(zip(*names, strict=True))]
    (folder / "associations.txt").write_text("".join(pairs))
    tracked_m, _, lost = odometry.track(folder, FOCAL_PX, FOCAL_PX, 159.5, 119.5)

    frames = np.delete(np.arange(FRAMES), [void, void + 1])  # it can be aligned with neither of its neighbours
    assert lost == 2
    assert np.allclose(estimate.stamps_s, frames / 20)
    assert np.allclose(estimate.c2w[:, :3, 3], tracked_m[frames], rtol=0, atol=1e-12)
    states = [line.split(",")[2] for line in (tmp_path / "run" / "frames.csv").read_text().splitlines()[1:]]
    assert [k for k, state in enumerate(states) if state == "lost"] == [void, void + 1]


def test_the_plain_tracker_follows_a_path_through_a_room(programs, tmp_path):
    import plain_odometry

    truth = box_room.path(20, turn_deg=25.0)
    poses = plain_odometry.track(json.loads(box_room.write(tmp_path, truth).read_text()))
    assert sorted(poses) == list(range(len(truth)))
    found_m, true_m = (np.array([pose[:3, 3] for pose in path]) for path in (poses.values(), truth))
    assert 0.0 < box_room.ate_rmse_m(found_m, true_m) < 0.01
    assert np.allclose(poses[19], np.linalg.inv(truth[0]) @ truth[19], atol=0.03)  # camera-to-world, OpenCV's axes


def run_here(name, sequence, out):
    system = find_system(name)
    try:
        check_system(system)
    except MissingDependencyError as error:
        pytest.skip(str(error))
    return run_system(system, sequence, out)


@pytest.mark.parametrize("name", ["orb_slam3", "orb_slam2", "orb_slam3_source"])
def test_orb_slam_moves_along_a_wall(wall, tmp_path, name):
    record = run_here(name, wall, tmp_path)
    assert (record.outcome, record.detail) == (Outcome.FINISHED, "")
    told = {"opencv", "orbslam3-python", "python"} if name == "orb_slam3" else {"source", "driver"}
    assert set(record.versions) == told | {"vocabulary"}
    estimate = read_estimate_file(tmp_path / "estimate.txt")
    assert len(estimate) == FRAMES
    truth_m = np.arange(FRAMES)[:, None] * [STEP_M, 0.0, 0.0]
    assert np.linalg.norm(estimate.c2w[:, :3, 3] - truth_m, axis=1).max() < 0.02
    assert (tmp_path / "frames.csv").read_text().count(",tracked,") == FRAMES
    assert 1 <= len(read_estimate_file(tmp_path / "keyframes.txt")) <= FRAMES


def test_kiss_icp_sees_depth_alone_and_says_the_same_twice(tmp_path):
    # In a box of bare walls it slides along them, by 4 to 11 cm: how well it follows a path is measured in rooms.
    truth = box_room.path(12, turn_deg=10.0)
    void = lambda number, colour, depth_m: (colour, depth_m * (number != 5))  # noqa: E731
    box_room.write_sequence(tmp_path / "box", truth, change=void)
    box_room.write_sequence(tmp_path / "dark", truth, change=lambda *seen: (seen[1] * 0, void(*seen)[1]))
    for name in ("box", "dark"):
        record = run_here("kiss_icp", tmp_path / name, tmp_path / f"run {name}")
        assert (record.outcome, record.detail) == (Outcome.FINISHED, "")
    estimates = [(tmp_path / f"run {name}/estimate.txt").read_bytes() for name in ("box", "dark")]
    assert estimates[0] == estimates[1]
    assert len(read_estimate_file(tmp_path / "run box/estimate.txt")) == len(truth) - 1


def test_colmap_places_frames_of_a_wall_or_loses_them(wall, tmp_path):
    record = run_here("colmap_mono", wall, tmp_path)
    assert record.outcome is Outcome.FINISHED
    states = [line.split(",")[2] for line in (tmp_path / "frames.csv").read_text().splitlines()[1:]]
    assert len(states) == FRAMES
    assert len(read_estimate_file(tmp_path / "estimate.txt")) == states.count("tracked")


def test_open3d_runs(wall, tmp_path):
    # Depth alone does not see a motion along a wall: the camera stands still, or is lost.
    record = run_here("open3d_slam", wall, tmp_path)
    assert record.outcome is Outcome.FINISHED
    states = [line.split(",")[2] for line in (tmp_path / "frames.csv").read_text().splitlines()[1:]]
    assert len(states) == FRAMES
    assert len(read_estimate_file(tmp_path / "estimate.txt")) == states.count("tracked")
    assert Path(tmp_path / "log.txt").exists()
