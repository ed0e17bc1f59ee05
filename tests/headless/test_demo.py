# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo preset: what a new user sees first."""

import json

import cv2
import numpy as np
import pytest
from worlds import ROOT, generate_here

pytest.importorskip("bpy", reason="bpy is not installed")

FRAMES = 3


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Three frames of the demo, at its beginning, middle and end, of all settings."""
    out = tmp_path_factory.mktemp("demo") / "out"
    result = generate_here(ROOT / "presets/demo.yaml", "--out", out, "--set", "scenes.0.trajectory.every=16")
    return out, result.stdout


def test_it_names_what_it_wrote(demo):
    out, text = demo
    for words in (f"wrote {out}/clean/room", f"wrote {out}/overview.png", "frames/s", "peak memory"):
        assert words in text
    late = "mixed/room: depth is paired from beyond its 3 frames, so all have the same"
    assert json.loads((out / "run.json").read_text())["notes"] == [late]


def test_every_frame_has_texture_for_features(demo):
    detector = cv2.ORB_create(nfeatures=1000)
    for k in range(FRAMES):
        grey = cv2.imread(str(demo[0] / f"clean/room/results/frame{k:06d}.jpg"), cv2.IMREAD_GRAYSCALE)
        assert grey.shape == (680, 1200)
        assert len(detector.detect(grey, None)) >= 500, f"frame {k}"


def test_the_room_is_closed_deep_and_has_occlusions(demo):
    farthest, edges = 0, []
    for k in range(FRAMES):
        steps = cv2.imread(str(demo[0] / f"clean/room/results/depth{k:06d}.png"), cv2.IMREAD_UNCHANGED)
        assert (steps > 0).all(), f"a hole in frame {k}"
        depth_m = steps / 6553.5
        farthest = max(farthest, np.median(np.sort(depth_m.ravel())[-5000:]))
        edges.append(np.mean(np.abs(np.diff(depth_m, axis=1)) > 0.1 * depth_m[:, 1:]))
    assert farthest > 4.0
    assert np.mean(edges) > 0.003


def test_the_overview_is_a_picture_of_it(demo):
    picture = cv2.imread(str(demo[0] / "overview.png"))
    assert picture.shape[1] > 1200
    frame = cv2.imread(str(demo[0] / "clean/room/results/frame000000.jpg"))
    small = cv2.resize(frame, (320, 181), interpolation=cv2.INTER_AREA)
    found = cv2.matchTemplate(picture, small, cv2.TM_CCOEFF_NORMED)
    assert found.max() > 0.99
