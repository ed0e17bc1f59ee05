# SPDX-License-Identifier: GPL-3.0-or-later
"""The compositor takes depth that was not measured for what the reference takes it for."""

import json

import cv2
import numpy as np
import pytest
from made_recordings import CAMERA, SIZE_PX, write_tum
from runs import run

pytest.importorskip("bpy", reason="Blender's package is not installed")


def test_both_backends_fog_a_hole_as_the_wall_around_it(tmp_path):
    wide, high = SIZE_PX
    steps = np.full((high, wide), 2.5 * 5000, np.uint16)
    steps[20:44, 30:60] = steps[:, :8] = 0
    write_tum(tmp_path / "seq", [np.full((high, wide, 3), 120, np.uint8)], [steps], [(0, 0, 0, 0, 0, 0, 1)])
    perturb = [{"fog_depth": {"visibility_m": 6.0}}]
    document = {
        "scenes": [{"name": "wall", "sequence": "seq"}],
        "camera": CAMERA,
        "settings": [{"name": name, "perturb": perturb, "backend": name} for name in ("reference", "compositor")],
        "output": {"layout": "tum", "overview": False},
    }
    (tmp_path / "preset.json").write_text(json.dumps(document))
    run(tmp_path / "preset.json", tmp_path / "out")
    reference, nodes = (
        cv2.imread(str(tmp_path / f"out/{name}/wall/rgb/000000.png")).astype(int)
        for name in ("reference", "compositor")
    )
    assert np.abs(nodes - reference).max() <= 1
    assert np.ptp(nodes.reshape(-1, 3), axis=0).max() <= 1
    assert nodes.mean() > 160  # fog it is
    for name in ("reference", "compositor"):
        record = json.loads((tmp_path / f"out/{name}/wall/frames.jsonl").read_text())
        assert record["perturbed"]["depth_completed"]["share"] == pytest.approx((steps == 0).mean(), abs=1e-6)
