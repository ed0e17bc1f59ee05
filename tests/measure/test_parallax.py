# SPDX-License-Identifier: GPL-3.0-or-later
"""Parallax tells depth of another scale and poses in another convention, and says nothing of sound recordings."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from made_recordings import write_tum
from scipy.spatial.transform import Rotation
from textured_room import look, textures
from worlds import generate_here
from runs import run

from noisy_world.layouts import find_sequence
from noisy_world.core.errors import InputError
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.lens import lens_rays
from noisy_world.core.lens import Distortion, Optics
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan
from noisy_world.measure.footage import footage_of
from noisy_world.measure.parallax import parallax
from noisy_world.core.schema import ConfigPath
from noisy_world.sources.recording import Recording

CAMERA = Intrinsics(160, 120, 120.0, 120.0, 79.5, 59.5)
KEYS = {"width": 160, "height": 120, "fx": 120.0, "fy": 120.0, "cx": 79.5, "cy": 59.5}
COUNT = 16
HALF_M = np.array([2.0, 1.5, 2.5])
SCALE = 5000.0
TIMES = np.linspace(0, 1, COUNT)
GL = np.diag([1.0, -1.0, -1.0, 1.0])
ROBOT = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # of a camera in a robot's axes
LENS = Distortion("radial-tangential", (-0.2, 0.05, 0.001, -0.002))


def poses(*, turn=1.0, go=1.0):
    """(COUNT, 4, 4) c2w of a hand that goes and turns. turn, go: times that."""
    made = np.tile(np.eye(4), (COUNT, 1, 1))
    angles = turn * np.stack([12 * np.sin(5 * TIMES), 25 * TIMES, 6 * np.cos(7 * TIMES)], axis=-1)
    made[:, :3, :3] = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    made[:, :3, 3] = go * np.stack([0.7 * TIMES, 0.2 * np.sin(6 * TIMES), 0.5 * TIMES**2 - 0.5], axis=-1)
    return made


def write(folder, c2w, *, contrast=1.0, lens=None):
    """Write what a camera at c2w sees."""
    v, u = np.mgrid[:120, :160]
    rays = np.stack([(u - 79.5) / 120, (v - 59.5) / 120, np.ones(u.shape)], axis=-1)
    if lens is not None:
        bent = lens_rays(CAMERA, lens)
        rays = np.stack([bent.right, bent.down, np.ones(u.shape)], axis=-1)
    walls = textures(contrast=contrast)
    frames = [look(pose, rays, walls, HALF_M) for pose in c2w]
    rows = np.concatenate([c2w[:, :3, 3], Rotation.from_matrix(c2w[:, :3, :3]).as_quat()], axis=1)
    steps = [(depth_m * SCALE).round() for _, depth_m in frames]
    return write_tum(folder / "seq", [np.repeat(grey[..., None], 3, axis=2) for grey, _ in frames], steps, rows)


def remark(folder, *, scale=SCALE, lens=None, said=np.asarray):
    """What is said where files say other things. said: the true poses (COUNT, 4, 4) -> those that a file has."""
    stored = replace(find_sequence(folder), depth_scale_per_m=scale, optics=Optics(distortion=lens))
    path = replace(stored.trajectory, c2w=said(stored.trajectory.c2w))
    recording = Recording(replace(stored, trajectory=path), ConfigPath("test"))
    with footage_of("seq", recording, CAMERA) as footage:
        return parallax(footage).remark


def scale_in(text):
    return float(re.search(r"depth_scale_per_m: ([0-9.e+]+)", text)[1])


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return write(tmp_path_factory.mktemp("sound"), poses())


def test_a_sound_recording_is_not_spoken_of(sound):
    assert remark(sound) == ""


@pytest.mark.parametrize("times", [0.1, 0.2, 0.7, 1.3107, 5.0])
def test_another_depth_scale_is_told_within_ten_percent(sound, times):
    assert scale_in(remark(sound, scale=SCALE * times)) == pytest.approx(SCALE, rel=0.1)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("world-to-camera",), np.linalg.inv),
        (("OpenGL",), lambda c2w: c2w @ GL),
        (("robot",), lambda c2w: c2w @ np.linalg.inv(ROBOT)),
        (("world-to-camera", "OpenGL"), lambda c2w: np.linalg.inv(c2w @ GL)),
    ],
)
def test_poses_in_another_convention_are_told(sound, words, said):
    found = remark(sound, said=said)
    assert "groundtruth.txt" in found
    assert [word in found for word in ("world-to-camera", "OpenGL", "robot")] == [
        word in words for word in ("world-to-camera", "OpenGL", "robot")
    ]
    assert "depth_scale_per_m" not in found
    both = remark(sound, said=said, scale=SCALE * 5)
    assert words[0] in both
    assert scale_in(both) == pytest.approx(SCALE, rel=0.1)


@pytest.mark.parametrize(
    ("motion", "contrast"),
    [({"go": 0.0}, 1.0), ({"go": 0.0, "turn": 0.0}, 1.0), ({}, 0.0), ({"go": 0.002}, 1.0)],
    ids=["turns only", "stands still", "no texture", "turns, and hardly moves"],
)
def test_what_does_not_tell_is_passed_over(tmp_path, motion, contrast):
    folder = write(tmp_path, poses(**motion), contrast=contrast)
    for scale in (SCALE, SCALE * 5):
        assert remark(folder, scale=scale) == ""


def test_poses_that_fit_in_no_way_are_passed_over(sound):
    assert remark(sound, said=lambda c2w: c2w[::-1]) == ""


def test_a_lens_is_taken_into_account(tmp_path):
    folder = write(tmp_path, poses(), lens=LENS)
    assert remark(folder, lens=LENS) == ""
    assert scale_in(remark(folder, lens=LENS, scale=SCALE * 5)) == pytest.approx(SCALE, rel=0.1)


def preset(folder, **scene):
    document = {
        "scenes": [{"name": "walk", "sequence": "seq", **scene}],
        "camera": KEYS,
        "render": {"backend": "reference"},
        "settings": [{"name": "clean"}],
        "output": {"layout": "tum", "overview": False},
    }
    path = folder / "preset.json"
    path.write_text(json.dumps(document))
    return path


def test_a_run_says_it_and_the_key_mends_it(sound):
    folder = sound.parent
    wrong = preset(folder, depth_scale_per_m=2500)
    notes = [note for note in run(wrong, folder / "out").notes if "parallax" in note]
    assert len(notes) == 1
    assert notes[0].startswith("walk: ")
    assert scale_in(notes[0]) == SCALE
    assert "depth_scale_per_m: 5000" in generate_here(wrong, "--dry-run", "--out", folder / "none").stdout
    assert not [note for note in run(wrong, folder / "out").notes if "parallax" in note]  # nothing is made
    assert make_plan(read_preset(wrong)).scenes[0].source.hashes()["depth_scale_per_m"] == 2500
    assert not [note for note in run(preset(folder), folder / "good").notes if "parallax" in note]
    before, after = (find_sequence(folder / name / "clean/walk").frame(0).depth_m for name in ("good", "out"))
    assert np.abs(after - 2 * before).max() < 1e-3


def test_plain_images_have_no_depth_scale(sound):
    with pytest.raises(InputError, match=r"scenes\.0\.depth_scale_per_m"):
        run(preset(sound.parent, sequence="seq/rgb", layout="images", depth_scale_per_m=1000), sound.parent / "no")
