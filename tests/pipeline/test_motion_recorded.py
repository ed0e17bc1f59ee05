# SPDX-License-Identifier: GPL-3.0-or-later
"""What frames.jsonl says of motion: which pose each frame shows, and the deviation that leads to the written pose."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from worlds import write_world
from written import RIG, states

import noisy_world.dataset.plan
from noisy_world.core.errors import NoisyWorldError
from noisy_world.perturbations.kinds import MotionPerturbation
from noisy_world.core.schema import key
from noisy_world.core.trajectory import Trajectory
from noisy_world.perturbations import registry
from runs import run

COUNT = 9


pytestmark = pytest.mark.usefixtures("no_blender")


def make(tmp_path, *perturb, frames=None, **keys):
    """Write a dataset of one setting; return what its frames' lines say of motion, and its folder."""
    keys = {"output": {"layout": "replica", "image": "jpg", "depth_scale_per_m": 1000}} | keys
    setting = {"name": "moved", "perturb": list(perturb)}
    preset = write_world(tmp_path / "w", frames=COUNT, size=(8, 6), settings=[{"name": "clean"}, setting], **keys)
    run(preset, tmp_path / "out", frames=frames)
    folder = tmp_path / "out/moved/box"
    lines = [json.loads(line) for line in (folder / "frames.jsonl").read_text().splitlines()]
    return [line.get("perturbed", {}).get("motion") for line in lines], folder


def poses(folder, name="traj.txt"):
    return np.loadtxt(folder / name, ndmin=2).reshape(-1, 4, 4)


def turned(angles_deg):
    """Rz Ry Rx by hand."""
    (a, b, c), (sa, sb, sc) = np.cos(np.radians(angles_deg)), np.sin(np.radians(angles_deg))
    x = np.array([[1, 0, 0], [0, a, -sa], [0, sa, a]])
    y = np.array([[b, 0, sb], [0, 1, 0], [-sb, 0, b]])
    z = np.array([[c, -sc, 0], [sc, c, 0], [0, 0, 1]])
    return z @ y @ x


def applied(nominal, deviation):
    """A planned pose with a deviation: on the right, in its own axes."""
    w, x, y, z = deviation["quat_wxyz"]
    assert abs(w * w + x * x + y * y + z * z - 1) < 1e-12
    change = np.eye(4)
    change[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    change[:3, 3] = deviation["translation_m"]
    return nominal @ change


SHAKY = {"motion_deviation": {"rotation_deg": 40, "translation_m": 0.5}}


def test_the_deviation_leads_from_the_planned_pose_to_the_true_one(tmp_path):
    told, folder = make(tmp_path, SHAKY)
    true, nominal = poses(folder), poses(folder, "traj_nominal.txt")
    assert len(told) == COUNT
    for frame, motion in enumerate(told):
        assert set(motion) == {"deviation", "drawn"}
        assert np.abs(applied(nominal[frame], motion["deviation"]) - true[frame]).max() < 1e-13
        drawn = motion["drawn"]["motion_deviation"]
        # As it is drawn: about the camera's axes, and along the world's.
        # Poses are rounded.
        assert np.abs(nominal[frame, :3, :3] @ turned(drawn["rotation_deg"]) - true[frame, :3, :3]).max() < 4e-9
        assert np.abs(nominal[frame, :3, 3] + drawn["translation_m"] - true[frame, :3, 3]).max() < 1e-9
    assert np.std([motion["drawn"]["motion_deviation"]["rotation_deg"] for motion in told]) == pytest.approx(
        40, rel=0.5
    )


def test_faster_motion_names_the_source_frame(tmp_path):
    told, folder = make(tmp_path, {"faster_motion": {"factor": 4}})
    assert told == [{"source_frame": 0}, {"source_frame": 4}, {"source_frame": 8}]
    assert np.array_equal(poses(folder), poses(folder.parents[1] / "clean/box")[::4])


def test_both_with_desynchronisation_and_selected_frames(tmp_path):
    perturb = ({"desync": {"offset": 1}}, SHAKY, {"faster_motion": {"factor": 2}})
    told, folder = make(tmp_path, *perturb, frames=slice(1, 4))
    true, nominal, clean = poses(folder), poses(folder, "traj_nominal.txt"), poses(folder.parents[1] / "clean/box")
    assert [motion["source_frame"] for motion in told] == [2, 4, 6]
    for place, motion in enumerate(told):
        assert np.abs(applied(nominal[place], motion["deviation"]) - true[place]).max() < 1e-13
        drawn = motion["drawn"]["motion_deviation"]
        assert np.abs(nominal[place, :3, 3] + drawn["translation_m"] - true[place, :3, 3]).max() < 1e-9
    lines = [json.loads(line) for line in (folder / "frames.jsonl").read_text().splitlines()]
    assert [line["perturbed"]["pairing"]["depth_of_frame"] for line in lines] == [2, 3, 4]
    assert len(clean) == 3


def test_nothing_is_said_where_nothing_moved(tmp_path):
    _, folder = make(tmp_path, {"gaussian_noise": {"severity": 1}})
    for setting in ("clean", "moved"):
        text = (folder.parents[1] / setting / "box/frames.jsonl").read_text()
        assert "motion" not in text
    told, _ = make(tmp_path / "still", {"motion_deviation": {"rotation_deg": 0, "translation_m": 0}})
    assert told[0]["deviation"]["translation_m"] == [0.0, 0.0, 0.0]
    assert np.abs(np.subtract(told[0]["deviation"]["quat_wxyz"], [1, 0, 0, 0])).max() < 1e-15
    told, _ = make(tmp_path / "slow", {"faster_motion": {"factor": 1}})
    assert told == [None] * COUNT


def test_on_a_rig_it_is_the_colour_cameras(tmp_path):
    told, folder = make(tmp_path, SHAKY, rig=RIG)
    true, nominal = poses(folder), poses(folder, "traj_nominal.txt")
    for frame, motion in enumerate(told):
        assert np.abs(applied(nominal[frame], motion["deviation"]) - true[frame]).max() < 1e-13


def test_taken_up_again_it_is_the_same(tmp_path):
    _, folder = make(tmp_path, SHAKY, {"faster_motion": {"factor": 2}})
    text = (folder / "frames.jsonl").read_text()
    (folder / "results/depth000002.png").unlink()
    make(tmp_path, SHAKY, {"faster_motion": {"factor": 2}})
    assert (folder / "frames.jsonl").read_text() == text


def test_euroc_has_it_too(tmp_path):
    told, folder = make(tmp_path, SHAKY, output={"layout": "euroc", "depth_scale_per_m": 1000})
    true, nominal = states(folder)[1], states(folder, "state_nominal0")[1]
    for frame, motion in enumerate(told):
        assert np.abs(applied(nominal[frame], motion["deviation"]) - true[frame]).max() < 1e-12


# --- perturbations of others ---


@dataclass(frozen=True)
class Tilt:
    """An angle."""

    angle_deg: float = key("about the world's z", default=10.0, minimum=0, maximum=90)


def tilted(path, parameters, _context):
    poses = path.c2w.copy()
    for k, pose in enumerate(poses):
        poses[k, :3, :3] = turned([0, 0, k * parameters.angle_deg]) @ pose[:3, :3]
        poses[k, :3, 3] = pose[:3, 3] + [k, -k, 0.1]
    return Trajectory(poses, path.stamps_s)


def installed(monkeypatch, *found):
    known = dict(registry()) | {item.name: item for item in found}
    monkeypatch.setattr(noisy_world.dataset.plan, "registry", lambda: known)


def tilt(order, **keys):
    return MotionPerturbation(
        name="tilt", label="Tilt", order=order, parameters=Tilt, severities={}, source="here", apply=tilted, **keys
    )


def test_a_perturbation_of_another_package_has_its_deviation(tmp_path, monkeypatch):
    # It moves the poses that faster motion chose, so the source frame is that of the scene's path all the same.
    installed(monkeypatch, tilt(25))
    told, folder = make(tmp_path, SHAKY, {"faster_motion": {"factor": 3}}, {"tilt": {"angle_deg": 15}})
    true, nominal = poses(folder), poses(folder, "traj_nominal.txt")
    assert np.array_equal(nominal, poses(folder.parents[1] / "clean/box")[::3])
    assert [motion["source_frame"] for motion in told] == [0, 3, 6]
    for frame, motion in enumerate(told):
        assert np.abs(applied(nominal[frame], motion["deviation"]) - true[frame]).max() < 1e-13
        drawn = motion["drawn"]["motion_deviation"]
        by_hand = nominal[frame, :3, 3] + drawn["translation_m"] + [frame, -frame, 0.1]
        assert np.abs(by_hand - true[frame, :3, 3]).max() < 1e-9
        assert set(motion["drawn"]) == {"motion_deviation"}


def test_what_it_says_it_drew_is_recorded(tmp_path, monkeypatch):
    installed(monkeypatch, tilt(5, drawn=lambda count, parameters, _: {"turned_deg": 15.0 * np.arange(count)}))
    told, _ = make(tmp_path, {"tilt": {"angle_deg": 15}}, {"faster_motion": {"factor": 4}})
    assert [motion["drawn"] for motion in told] == [{"tilt": {"turned_deg": value}} for value in (0.0, 60.0, 120.0)]


@pytest.mark.parametrize("made", [np.zeros(3), np.full(COUNT, np.nan)])
def test_what_breaks_the_contract_is_a_line(tmp_path, monkeypatch, made):
    installed(monkeypatch, tilt(5, drawn=lambda *_: {"turned_deg": made}))
    with pytest.raises(NoisyWorldError, match=r"tilt: drawn has to return finite numbers for each of 9 poses"):
        make(tmp_path, {"tilt": {"angle_deg": 15}})


def test_drawn_goes_with_apply():
    with pytest.raises(ValueError, match="drawn goes with apply"):
        MotionPerturbation(
            name="x", label="X", order=1, parameters=Tilt, severities={}, source="", choose=len, drawn=len
        )
