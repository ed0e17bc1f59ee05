# SPDX-License-Identifier: GPL-3.0-or-later
"""A recording without depth is perturbed as it is, and what needs depth is refused by name."""

import numpy as np
from recorded_layouts import FRAMES, kitti
from recorded_presets import preset_of
from refusals import refused
from runs import run

from noisy_world.layouts import find_sequence
from noisy_world.perturb import frames

FOG = [{"fog_depth": {"severity": 3}}]
NOISE = [{"gaussian_noise": {"severity": 2}}]


def test_a_preset_writes_it_with_its_poses_and_times(tmp_path):
    (tmp_path / "drive").mkdir()
    written = kitti(tmp_path / "drive")
    scene = {"name": "drive", "sequence": str(tmp_path / "drive")}
    output = {"layout": "tum", "modalities": ["rgb"]}
    settings = [{"name": "clean"}, {"name": "noise", "perturb": NOISE}]
    run(preset_of(tmp_path / "p", scene, settings=settings, output=output), tmp_path / "out")
    found = find_sequence(tmp_path / "out/noise/drive")
    assert found.depth_files == ()
    np.testing.assert_allclose(found.trajectory.c2w, written.c2w, atol=1e-9)
    np.testing.assert_allclose(found.stamps.rgb.seconds, 0.1036 * np.arange(FRAMES), atol=1e-6)
    assert len(found.rgb_files) == FRAMES
    foggy = preset_of(tmp_path / "f", scene, settings=[{"name": "foggy", "perturb": FOG}], output=output)
    refused(run, foggy, tmp_path / "fog", names=("scenes.0.sequence", "foggy needs depth", "take that setting out"))
    scaled = preset_of(tmp_path / "s", {**scene, "depth_scale_per_m": 1000}, output=output)
    refused(run, scaled, tmp_path / "scaled", names=("depth_scale_per_m", "has no depth"))


def test_the_library_gives_its_colour(tmp_path):
    kitti(tmp_path)
    given = list(frames(tmp_path, NOISE))
    assert [(frame.rgb.shape, frame.depth_m) for frame in given] == [((48, 64, 3), None)] * FRAMES
    for needing in (FOG, [{"depth_gaussian_noise": {"severity": 1}}], [{"desync": {"offset": 1}}]):
        refused(frames, tmp_path, needing, names=("needs depth", str(tmp_path)))
