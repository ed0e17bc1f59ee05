# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies by physics: they arrive, the same again, and MuJoCo's own IMU feels what ours computes from their path."""

import numpy as np
import pytest
from worlds import write_world

pytest.importorskip("mujoco", reason="MuJoCo comes with the extra simulate")

from noisy_world.cli import command
from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.geometry import invert_pose, opencv_from_robot_c2w, pose
from noisy_world.core.curve import motion_of
from noisy_world.trajectories.formats import read_trajectory
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.trajectories import simulation
from noisy_world.trajectories.simulation import CELL_M, rough_floor
from noisy_world.trajectories.simulation import simulate


def bent_route(speed_m_s=0.35, seconds=8.0):
    at_s = np.arange(0.0, seconds, 0.1)
    xy_m = np.column_stack([speed_m_s * at_s, 0.4 * np.sin(1.2 * speed_m_s * at_s)])
    places = np.column_stack([xy_m, np.full(len(at_s), 1.0)])
    return evenly_stamped(opencv_from_robot_c2w(pose(np.broadcast_to(np.eye(3), (len(at_s), 3, 3)), places)), 10)


@pytest.mark.parametrize("kind", ["quadruped", "rover"])
@pytest.mark.parametrize("roughness_m", [0.0, 0.005])
def test_a_body_arrives_and_does_so_again(kind, roughness_m):
    route = bent_route()
    ways = [simulate(route, kind, floor_m=2.0, roughness_m=roughness_m, seed=3) for _ in range(2)]
    np.testing.assert_array_equal(ways[0].path.c2w, ways[1].path.c2w)
    place_m = ways[0].path.c2w[:, :3, 3]
    goal_m = route.c2w[:, :2, 3]
    off_m = [np.linalg.norm(goal_m - place[:2], axis=1).min() for place in place_m[::25]]
    assert max(off_m) < 0.25
    assert np.linalg.norm(place_m[-1, :2] - goal_m[-1]) < 0.4  # its camera is before its middle
    height_m = {"quadruped": 0.45, "rover": 0.4}[kind]
    assert place_m[:, 2].mean() - 2.0 == pytest.approx(height_m, abs=0.03)
    standing = ways[0].force_m_s2[75:120]  # before it goes it feels gravity alone
    assert np.linalg.norm(standing.mean(axis=0)) == pytest.approx(9.81, abs=0.2)  # contacts chatter


def straight_route(speed_m_s, metres):
    at_s = np.arange(0.0, metres / speed_m_s, 0.1)
    places = np.column_stack([speed_m_s * at_s, np.zeros(len(at_s)), np.ones(len(at_s))])
    return evenly_stamped(opencv_from_robot_c2w(pose(np.broadcast_to(np.eye(3), (len(at_s), 3, 3)), places)), 10)


@pytest.mark.parametrize("roughness_m", [0.0, 0.005, 0.01])
def test_the_quadruped_walks_at_eight_tenths_of_a_metre_a_second(roughness_m):
    way = simulate(straight_route(0.8, 8.0), "quadruped", floor_m=0.0, roughness_m=roughness_m, seed=1)
    assert not way.held_back
    place_m = way.path.c2w[int(2 * simulation.RATE_HZ) :, :3, 3]  # it has begun
    assert np.abs(place_m[:, 1]).max() < 0.15
    speed_m_s = (place_m[-1, 0] - place_m[0, 0]) / ((len(place_m) - 1) / simulation.RATE_HZ)
    assert speed_m_s == pytest.approx(0.8, rel=0.1 if roughness_m < 0.01 else 0.2)
    up = -way.path.c2w[:, 2, 1]  # of the camera's own up along the world's
    assert np.degrees(np.arccos(up.min())) < {0.0: 3.0, 0.005: 8.0, 0.01: 25.0}[roughness_m]  # it stumbles, and goes on


def test_feet_find_the_capture_point():
    """A foot that swings is put further ahead the faster the trunk goes, and further aside the faster it drifts."""
    level, place_m = np.eye(3), np.array([0.0, 0.0, simulation.STANCE_M + simulation.FOOT_M])
    time_s = (1.0 - 1e-6) / simulation.STRIDE_HZ  # the end of the swing of the legs that stood first

    def landing_m(speed_m_s):
        still = simulation.Trunk(place_m, np.zeros(3), np.zeros(3), level)
        legs = simulation.Trot.standing(still, 0.0)
        angles = legs.asked(simulation.Trunk(place_m, speed_m_s, np.zeros(3), level), legs.feet_m, time_s, 0.0, 0.0)
        roll, hip, knee = angles.reshape(4, 3)[0]
        # Forward kinematics by hand: thigh and shank in the leg's plane, which roll turns about x.
        ahead = -simulation.THIGH_M * np.sin(hip) - simulation.SHANK_M * np.sin(hip + knee)
        down = simulation.THIGH_M * np.cos(hip) + simulation.SHANK_M * np.cos(hip + knee)
        return np.array([ahead, down * np.sin(roll), -down * np.cos(roll)])

    stood_s = simulation.STANDS / simulation.STRIDE_HZ
    for speed_m_s in ([0.3, 0.0, 0.0], [0.0, 0.2, 0.0], [-0.2, 0.1, 0.0]):
        wanted_m = np.array(speed_m_s) * (stood_s / 2 + simulation.CAPTURE_S)
        np.testing.assert_allclose(landing_m(np.array(speed_m_s))[:2], wanted_m[:2], atol=2e-3)
        assert landing_m(np.array(speed_m_s))[2] == pytest.approx(-simulation.STANCE_M, abs=1e-3)


def test_a_rough_floor_is_as_rough_as_asked():
    floor = rough_floor(np.array([[0.0, 0.0], [20.0, 10.0]]), 0.0, 0.02, np.random.default_rng(0))
    assert floor.heights_m.std() == pytest.approx(0.02)
    slopes = np.diff(floor.heights_m, axis=1) / CELL_M
    # Of a field that a Gaussian of sigma smoothed, the slope's deviation is that of the heights / (sqrt(2) sigma).
    assert slopes.std() == pytest.approx(0.02 / (np.sqrt(2) * 0.15), rel=0.05)


def below_hz(values, hz, cut_hz):
    spectrum = np.fft.rfft(values, axis=0)
    spectrum[np.fft.rfftfreq(len(values), 1 / hz) > cut_hz] = 0
    return np.fft.irfft(spectrum, len(values), axis=0)


def as_it_moved(mujoco, felt):
    """Return mj_step as it is, which notes what MuJoCo's sensors give of the acceleration that the step brought about.

    Their own reading is of the acceleration before damping and drives are solved implicitly: off by the first order of
    the step.
    """
    plain, kept = mujoco.mj_step, []

    def step(model, data, nstep):
        assert nstep == 1
        if not kept:
            kept.append(mujoco.MjData(model))
        (before,) = kept
        before.qpos[:], before.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(model, before)
        plain(model, data)
        before.qacc[:] = (data.qvel - before.qvel) / model.opt.timestep
        mujoco.mj_rnePostConstraint(model, before)
        mujoco.mj_sensorAcc(model, before)
        felt.append(before.sensordata.copy())

    return step


@pytest.mark.parametrize("kind", ["quadruped", "rover"])
def test_our_imu_feels_what_mujocos_own_does(monkeypatch, kind):
    """An accelerometer and a gyroscope that know nothing of splines, over a rough floor; below 4 Hz."""
    mujoco = pytest.importorskip("mujoco")
    hz, felt = 2000.0, []
    monkeypatch.setattr(simulation, "STEP_S", 1 / hz)
    monkeypatch.setattr(simulation, "STEP_S", 1 / hz)
    monkeypatch.setattr(simulation, "RATE_HZ", hz)
    monkeypatch.setattr(mujoco, "mj_step", as_it_moved(mujoco, felt))
    way = simulate(bent_route(0.5, 4.0), kind, floor_m=0.0, roughness_m=0.005, seed=1)
    own = np.array(felt)[: len(way.path.stamps_s)]
    own[:-1, 3:] = (own[:-1, 3:] + own[1:, 3:]) / 2  # MuJoCo turns a body by a step's last rate: at a pose two meet
    camera_from_robot = invert_pose(opencv_from_robot_c2w(np.eye(4)))
    rate_rad_s, force_m_s2 = motion_of(way.path.continuous, way.path.stamps_s).carried(camera_from_robot).felt(9.81)
    going = slice(int(1.5 * hz), -int(0.5 * hz))
    inner = slice(int(0.7 * hz), -int(0.7 * hz))  # beside the ends, where cutting a spectrum rings
    for ours, theirs, bound in ((force_m_s2, own[:, :3], 0.001), (rate_rad_s, own[:, 3:], 1e-5)):
        off = below_hz((ours - theirs)[going], hz, 4.0)[inner]
        moved = below_hz((theirs - theirs.mean(axis=0))[going], hz, 4.0)[inner]
        assert np.sqrt(np.mean(off**2, axis=0)).max() < bound
        assert np.sqrt(np.mean(moved**2, axis=0)).max() > 10 * bound  # there is something to feel


def test_a_body_that_falls_or_cannot_arrive_is_said():
    with pytest.raises(NoisyWorldError, match=r"the quadruped (fell after|has not arrived)"):
        simulate(bent_route(), "quadruped", floor_m=0.0, roughness_m=0.1, seed=0)


@pytest.mark.parametrize("metres", [0.0, 0.1])
def test_a_route_of_no_length_is_said(metres):
    with pytest.raises(
        NoisyWorldError, match=r"m long, and a body has arrived 0\.15 m before its end; take a longer one"
    ):
        simulate(bent_route(metres / 8, seconds=8.0), "rover", floor_m=0.0, roughness_m=0.0, seed=0)
    with pytest.raises(NoisyWorldError, match="take a longer one"):
        simulate(bent_route(seconds=0.1), "rover", floor_m=0.0, roughness_m=0.0, seed=0)


def test_a_route_that_is_too_fast_is_said():
    quick, slow = (simulate(bent_route(speed), "rover", floor_m=0.0, roughness_m=0.0, seed=0) for speed in (2.0, 0.5))
    assert (quick.held_back, slow.held_back) == (True, False)


def test_the_command_writes_a_path_that_a_preset_takes(tmp_path, capfd):
    scene = {"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 60}, "body": "rover"}}
    preset = write_world(tmp_path, frames=2, size=(8, 6), scenes=[scene], render={"engine": "embree"})
    assert command.main(["simulate", str(preset), str(tmp_path / "rover.txt"), "--roughness", "0.002"]) == 0
    said = capfd.readouterr().out
    assert "use it as trajectory: {file: rover.txt, resample_hz: 30}" in said
    text = (tmp_path / "rover.txt").read_text()
    assert text.startswith("# rover of room, roughness 0.002 m, seed ")
    assert "; simulated by MuJoCo " in text
    path = read_trajectory(tmp_path / "rover.txt")
    assert path.stamps_s[1] == pytest.approx(1 / 250)
    assert command.main(["simulate", str(preset), str(tmp_path / "again.txt"), "--roughness", "0.002"]) == 0
    assert (tmp_path / "again.txt").read_bytes() == (tmp_path / "rover.txt").read_bytes()
    capfd.readouterr()
    walker = ["--set", "scenes.0.trajectory.body=walker"]
    assert command.main(["simulate", str(preset), str(tmp_path / "none.txt"), *walker]) == 1
    assert "trajectory.body: has to be a quadruped or a rover of a mesh" in capfd.readouterr().err
    assert not (tmp_path / "none.txt").exists()
    moved = ["--set", "scenes.0.trajectory.body={kind: rover, motion: 2}"]
    assert command.main(["simulate", str(preset), str(tmp_path / "none.txt"), *moved]) == 1
    said = capfd.readouterr().err
    assert "trajectory.body.motion: multiplies the formulas' motion, and a body by physics moves by its own" in said
    rough = ["--set", "scenes.0.trajectory.body=quadruped", "--roughness", "0.1"]
    assert command.main(["simulate", str(preset), str(tmp_path / "none.txt"), *rough]) == 1
    assert f"{preset}: scenes.0.trajectory.body: the quadruped " in capfd.readouterr().err
    assert not (tmp_path / "none.txt").exists()
