# SPDX-License-Identifier: GPL-3.0-or-later
"""What perturbations are told of a frame where settings combine motion, pairing, severities and uneven time.

The frames say by arithmetic which pose of the render they show; stamps and sources are tables made by hand, and motion
follows from the ground truth as it is written.
"""

import json
import sys
from dataclasses import dataclass

import fake_session
import numpy as np
import pytest
from probes import BOTH_PROBES, COLOUR, DEPTH, Probes
from scipy.spatial.transform import Rotation
from worlds import write_world
from runs import run
from written import replica_poses

from noisy_world.perturbations.kinds import MotionPerturbation
from noisy_world.dataset.rendering import source_paths
from noisy_world.preset.keys import read_preset
from noisy_world.core.schema import key
from noisy_world.core.streams import stream
from noisy_world.core.trajectory import Trajectory
from noisy_world.dataset.plan import make_plan

ROUNDED = 2e-8  # poses are rounded to a nanometre and 2e-9 rad, here at arms of some metres
STAMPS_S = [0.0, 0.1, 0.15, 0.35, 0.4, 0.7, 0.8, 1.1, 1.15]
KEYED = [{name: {"levels": [1, 4, 2, 5], "mode": "keyed"}} for name in (COLOUR, DEPTH)]
FASTER, THREE = ({"faster_motion": {"factor": factor}} for factor in (2, 3))
SHAKY = {"motion_deviation": {"rotation_deg": 20, "translation_m": 0.3}}
RIG = {"rgb": {"translation_m": [0.1, 0.0, 0.2], "rotation_euler_deg": [-90.0, 20.0, -90.0]}}
SETTINGS = {
    "fast": [FASTER, *BOTH_PROBES],
    "late": [{"desync": {"offset": 2, "edge": "drop"}}, FASTER, *BOTH_PROBES],
    "early": [{"desync": {"offset": -1, "edge": "drop"}}, *BOTH_PROBES],
    "shaky": [SHAKY, THREE, {"desync": {"offset": -1}}, *BOTH_PROBES],
    "keyed": [*KEYED, FASTER, {"desync": {"offset": 1}}],
    "swayed": [FASTER, {"sway": {"by_m": 1.0}}, *BOTH_PROBES],
}
# By hand, by setting: the frames that are made, the source frame of each frame of the sequence, and the frame whose
# depth each takes. The sway moves the poses that faster motion chose, so its render has these alone.
WANTED = {
    "fast": ([0, 1, 2, 3, 4], [0, 2, 4, 6, 8], [0, 1, 2, 3, 4]),
    "late": ([0, 1, 2], [0, 2, 4, 6, 8], [2, 3, 4]),
    "early": ([1, 2, 3, 4, 5, 6, 7, 8], range(9), [-1, 0, 1, 2, 3, 4, 5, 6, 7]),
    "shaky": ([0, 1, 2], [0, 3, 6], [0, 0, 1]),
    "keyed": ([0, 1, 2, 3, 4], [0, 2, 4, 6, 8], [1, 2, 3, 4, 4]),
    "swayed": ([0, 1, 2, 3, 4], range(5), [0, 1, 2, 3, 4]),
}


@dataclass(frozen=True)
class Sway:
    """How far."""

    by_m: float = key("to and fro", default=1.0, minimum=0, maximum=9)


def swayed(path, parameters, _context):
    c2w = path.c2w.copy()
    c2w[::2, 0, 3] += parameters.by_m
    return Trajectory(c2w, path.stamps_s)


SWAY = MotionPerturbation(
    name="sway", label="Sway", order=25, parameters=Sway, severities={}, source="here", apply=swayed
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The dataset of all settings, what the probes were told, and what they were told of some of its frames alone."""
    folder = tmp_path_factory.mktemp("told")
    settings = [{"name": name, "perturb": steps} for name, steps in SETTINGS.items()]
    noise = {"gaussian_noise": {"severity": 2}}
    settings += [{"name": name, "stream": "shared", "perturb": [SHAKY, noise]} for name in ("one", "other")]
    scenes = [{"name": "box", "mesh": "mesh.ply", "trajectory": {"file": "path.txt", "axes": "robot"}}]
    output = {"layout": "replica", "image": "png", "depth_scale_per_m": 1000}
    preset = write_world(folder, size=(8, 6), settings=settings, scenes=scenes, rig=RIG, output=output)
    turns = Rotation.from_rotvec(np.cumsum(np.random.default_rng(5).normal(scale=0.4, size=(9, 3)), axis=0))
    places_m = np.random.default_rng(6).normal(size=(9, 3))
    rows = np.column_stack([STAMPS_S, places_m, turns.as_quat()])
    (folder / "path.txt").write_text("\n".join(" ".join(map(repr, row)) for row in rows.tolist()) + "\n")
    whole, part = Probes(), Probes()
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(sys.modules, "bpy", None)
        patched.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
        whole.install(patched, SWAY)
        run(preset, folder / "out")
        part.install(patched, SWAY)
        run(preset, folder / "part", frames=slice(1, 3))
        plan = make_plan(read_preset(preset))
    return folder / "out", whole, part, plan


def source_of(image):
    """The frame of the render that an image of the stand-in for the renderer shows, colour or depth."""
    return round(float(image[0, 0, 2]) * 255) if image.ndim == 3 else round(float(image[0, 0])) - 1


def test_images_stamps_and_severities_are_of_the_frame_that_is_made(made):
    _, probes, _, _ = made
    for setting, (frames, sources, depth_frames) in WANTED.items():
        colour, depth = probes.of(COLOUR, setting), probes.of(DEPTH, setting)
        assert list(colour) == frames
        assert list(depth) == sorted({depth_frames[frame] for frame in frames})
        for frame, told in [*colour.items(), *depth.items()]:
            # The other image is of the same moment, whatever the frame is paired with.
            assert (source_of(told.own), source_of(told.other)) == (sources[frame], sources[frame]), (setting, frame)
            assert told.context.stamp_s == STAMPS_S[frame]
            assert told.amount == ([1, 4, 2, 5, 5][frame] if setting == "keyed" else 2)
            assert told.context.identifiers[:3] == (3, "box", setting)


def test_motion_is_that_of_the_written_poses_in_the_cameras_own_time(made):
    out, probes, _, _ = made
    for setting in SETTINGS:
        # Replica has a line for each frame that is made; before the first of `early` there is one that is left out.
        poses = replica_poses(out / setting / "box/traj.txt")
        frames = WANTED[setting][0]
        assert len(poses) == len(frames)
        for row, frame in enumerate(frames):
            told = probes.of(COLOUR, setting)[frame].context.motion
            np.testing.assert_allclose(told.c2w, poses[row], atol=1e-12)
            if frame == 0:
                assert not np.any([told.velocity_m_s, told.turning_rad_s])
            if row == 0:
                continue
            passed_s = STAMPS_S[frame] - STAMPS_S[frame - 1]
            moved_m = poses[row, :3, 3] - poses[row - 1, :3, 3]
            np.testing.assert_allclose(told.velocity_m_s, moved_m / passed_s, rtol=1e-9, atol=1e-9)
            turned = Rotation.from_matrix(poses[row - 1, :3, :3]).inv() * Rotation.from_matrix(poses[row, :3, :3])
            np.testing.assert_allclose(told.turning_rad_s, turned.as_rotvec() / passed_s, rtol=1e-7, atol=1e-9)
            if setting != "early":
                np.testing.assert_allclose(told.first_c2w, poses[0], atol=1e-12)


def test_frames_made_alone_are_told_the_same(made):
    _, whole, part, _ = made
    for setting, (frames, _, depth_frames) in WANTED.items():
        wanted = [frame for frame in frames if frame in (1, 2)]
        assert list(part.of(COLOUR, setting)) == wanted
        assert list(part.of(DEPTH, setting)) == sorted({depth_frames[frame] for frame in wanted})
    for place, told in part.received.items():
        other = whole.received[place]
        assert (told.context, told.context.stamp_s, told.amount) == (other.context, other.context.stamp_s, other.amount)
        assert (source_of(told.own), source_of(told.other)) == (source_of(other.own), source_of(other.other))
        assert place[0] == DEPTH or told.context.motion.key == other.context.motion.key


def test_a_render_is_asked_for_at_the_times_of_the_scene(made):
    # What moves in a scene is where it was when the path passed: a faster camera sees later moments of it.
    _, _, _, plan = made
    times_s = {
        render.name: [source_paths(plan, render).request(frame).time_s for frame in render.frames]
        for render in plan.renders
    }
    assert times_s == {
        "box": STAMPS_S,
        "box@shaky": [STAMPS_S[frame] for frame in (0, 3, 6)],
        "box@swayed": [STAMPS_S[frame] for frame in (0, 2, 4, 6, 8)],
        "box@one": STAMPS_S,
        "box@other": STAMPS_S,
    }


def test_a_deviation_moves_the_robot_and_the_camera_with_it(made):
    # The paper's deviation is the robot's: turning it swings a camera that sits off its centre.
    out, _, _, _ = made
    nominal, true = (replica_poses(out / "shaky/box" / name) for name in ("traj_nominal.txt", "traj.txt"))
    robot = replica_poses(out / "shaky/box/traj_robot.txt")
    mounted = np.linalg.inv(robot) @ true
    np.testing.assert_allclose(mounted, np.broadcast_to(mounted[0], mounted.shape), atol=ROUNDED)
    planned = nominal @ np.linalg.inv(mounted[0])
    clean = replica_poses(out / "fast/box/traj_robot.txt")
    np.testing.assert_allclose(planned[[0, 2]], clean[[0, 3]], atol=ROUNDED)
    assert np.abs(planned - robot).max() > 0.1


def test_settings_of_one_stream_are_moved_each_by_its_own_name(made):
    # `stream` is the name of random patterns of colour and depth. A path's are drawn by the setting's own.
    out, _, _, plan = made
    planned = plan.scenes[0].source.trajectory().c2w
    for setting in ("one", "other"):
        robot = replica_poses(out / setting / "box/traj_robot.txt")
        for frame in range(len(STAMPS_S)):
            normals = stream(3, "box", setting, "motion_deviation", 0, frame=frame).standard_normal(6)
            np.testing.assert_allclose(robot[frame, :3, 3] - planned[frame, :3, 3], 0.3 * normals[3:], atol=ROUNDED)
        lines = [json.loads(line) for line in (out / setting / "box/frames.jsonl").read_text().splitlines()]
        drawn_by = [line["perturbed"]["rgb"][0]["stream"] for line in lines]
        assert drawn_by == [[3, "box", "shared", "gaussian_noise", 0]] * len(STAMPS_S)
