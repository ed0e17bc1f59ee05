# SPDX-License-Identifier: GPL-3.0-or-later
"""Noisy-Rooms, whole but small: 125 settings of eight rooms, two frames each, made and loaded as SLAM systems do."""

import importlib.util
import json

import cv2
import numpy as np
import pytest
from foreign_loaders import slam_replica
from worlds import ROOT, generate_here

from noisy_world.scenes.polygon_mesh import ROOMS

# The rays alone cost less than half of what Blender does.
ENGINE = "embree" if importlib.util.find_spec("embreex") else "cycles"
if ENGINE == "cycles":
    pytest.importorskip("bpy", reason="neither embreex nor bpy is installed")

SETTINGS, FRAMES = 125, 2
SMALL = (
    "camera={width: 40, height: 24, fx: 20, fy: 20, cx: 19.5, cy: 11.5}",
    "scenes.0.trajectory.handheld.frames=40",
    f"render.engine={ENGINE}",
)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    out = tmp_path_factory.mktemp("noisy_rooms") / "out"
    generate_here(ROOT / "presets/noisy_rooms.yaml", "--out", out, "--frames", f"0:{FRAMES}", "--set", *SMALL)
    return out


def test_every_setting_of_every_room_is_there_and_loads(dataset):
    manifest = json.loads((dataset / "manifest.json").read_text())
    assert len(manifest["identity"]["settings"]) == SETTINGS
    assert len(manifest["frames"]) == SETTINGS * ROOMS == 1000
    assert set(manifest["frames"].values()) == {FRAMES}
    loaded = {folder: slam_replica(dataset / folder) for folder in manifest["frames"]}
    for folder, found in loaded.items():
        assert len(found.rgb) == len(found.depth) == len(found.c2w) == FRAMES, folder
        for rgb, depth in zip(found.rgb, found.depth, strict=True):
            assert cv2.imread(str(rgb)).shape == (24, 40, 3)
            assert cv2.imread(str(depth), cv2.IMREAD_UNCHANGED).dtype == np.uint16
    clean = loaded["clean/room3"]
    for folder, found in loaded.items():
        if folder.endswith("/room3"):
            setting = folder.partition("/")[0]
            moved = setting.startswith("deviation_")
            assert moved == (np.abs(found.c2w[0] - clean.c2w[0]).max() > 1e-9), setting


def test_the_rooms_differ_and_no_clean_frame_has_a_hole(dataset):
    firsts = [slam_replica(dataset / f"clean/room{k}") for k in range(ROOMS)]
    for found in firsts:
        assert all((cv2.imread(str(depth), cv2.IMREAD_UNCHANGED) > 0).all() for depth in found.depth)
    pictures = [cv2.imread(str(found.rgb[0])).astype(np.float64) for found in firsts]
    for k in range(ROOMS):
        for other in range(k):
            assert np.abs(pictures[k] - pictures[other]).mean() > 10
