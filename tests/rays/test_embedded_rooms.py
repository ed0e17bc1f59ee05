# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded rooms as they are rendered: no void in view, features in every frame."""

import cv2
import numpy as np
import pytest
import yaml
from runs import opened_render, planned


pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")

CAMERA = {"width": 1200, "height": 680, "fx": 600.0, "fy": 600.0, "cx": 599.5, "cy": 339.5}


def preset_of(folder, mesh):
    path = folder / "rooms.yaml"
    # The frames are half a minute apart: they show much of the room.
    trajectory = {"handheld": {"frames": 2000}, "every": 700}
    scenes = [{"mesh": mesh, "trajectory": trajectory}]
    content = {"scenes": scenes, "camera": CAMERA, "render": {"engine": "embree"}}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


# The corridor, which has the fewest features; the rooms joined by a doorway; the largest.
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_no_void_and_many_features_in_view(tmp_path, seed):
    orb = cv2.ORB_create(nfeatures=2000)
    with opened_render(planned(preset_of(tmp_path, f"embedded:room?seed={seed}"))) as (opened, sensors):
        for index in range(3):
            frame = opened.frame(sensors.request(index))
            assert (frame.depth_m > 0.2).all()
            assert frame.depth_m.max() < 12.0
            grey = cv2.cvtColor(np.rint(np.asarray(frame.rgb) * 255).astype(np.uint8), cv2.COLOR_RGB2GRAY)
            assert len(orb.detect(grey, None)) >= 500
