# SPDX-License-Identifier: GPL-3.0-or-later
"""A rendered hall of 40 m, of which 16 bits hold a part: what the run says, against the depth in closed form."""

import json

import numpy as np
import pytest
import worlds
from analytic import box_depth
from worlds import generate_here, path_poses, write_world

from noisy_world.core.geometry import Intrinsics


LOW, HIGH = np.array([-20.0, -15.0, 0.0]), np.array([20.0, 15.0, 6.0])


def test_a_hall_of_40_m_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(worlds, "LOW", LOW)
    monkeypatch.setattr(worlds, "HIGH", HIGH)
    preset = write_world(tmp_path / "w", frames=2, size=(48, 36), output={"layout": "replica", "image": "jpg"})
    said = generate_here(preset, "--out", tmp_path / "out").stderr
    camera = Intrinsics(48, 36, 24.0, 24.0, 23.5, 17.5)
    depth_m = np.stack([box_depth(camera, pose, LOW, HIGH)[0] for pose in path_poses(2)])
    told = json.loads((tmp_path / "out/manifest.json").read_text())["depth_out_of_range"]["clean/box"]
    assert 0.3 < told["share"] < 0.7
    assert abs(told["share"] - (depth_m > 65535.5 / 6553.5).mean()) <= (np.abs(depth_m - 10) < 1e-3).mean()
    assert told["farthest_m"] == pytest.approx(depth_m.max(), rel=1e-4)
    assert f"box: {100 * told['share']:.3g} % of the pixels of clean (in 2 of 2 frames) lie beyond 10 m" in said
    assert "box: frame 0 of clean: " in said
    assert "output.depth_scale_per_m: " in said
