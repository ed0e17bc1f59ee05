# SPDX-License-Identifier: GPL-3.0-or-later
"""The places on which looks are judged: each is lit, has near and far, and its frames make strips."""

import sys

import bpy
import numpy as np
import pytest
from cases import cases
from worlds import ROOT

sys.path.insert(0, str(ROOT / "headless"))

from pictures import places, strips
from pictures.street import read_frame

pytestmark = pytest.mark.long  # of the film set and of what is drawn once; rarely changed

SIZE = "24x14"


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("places")
    given = ["--only", "workshop", "car_park", "--size", SIZE, "--frames", "0", "3", "--samples", "1"]
    assert places.main([str(folder), *given]) == 0
    return folder


def test_dust_makes_light_but_hides_no_depth(rendered):
    """The room's far wall is 13 m away along y, of which the camera has gone -1.2 m."""
    frame = read_frame(rendered / "workshop/0000.exr")
    assert np.abs(frame.depth_m[3:7, 8:16] - 14.2).max() < 0.4
    assert frame.rgb.mean() > 0.005


def test_a_night_has_lamps_and_a_sky_without_depth(rendered):
    frame = read_frame(rendered / "car_park/0000.exr")
    assert (frame.depth_m[0] == 0).mean() > 0.5
    assert 40 < frame.depth_m.max() < 100
    assert np.median(frame.rgb) < 0.2


@cases("name", list(places.PLACES))
def test_a_walk_is_of_rotations_and_goes_ahead(name):
    poses = places.walk(places.PLACES[name], 24)
    turned = poses[:, :3, :3]
    assert np.allclose(turned @ turned.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    ahead = np.einsum("ni,ni->n", np.diff(poses[:, :3, 3], axis=0), turned[:-1, :, 2])
    assert np.allclose(ahead, 0.8 / 24, atol=2e-3)


def test_a_strip_has_its_frames_side_by_side_and_severities_below_one_another(rendered, tmp_path):
    given = ["--only", "lens_dirt", "--severities", "0", "5", "--given", "{lens: 3}"]
    assert strips.main([str(rendered), str(tmp_path), *given]) == 0
    found = strips.cv2.imread(str(tmp_path / "car_park_lens_dirt.png"))
    assert found.shape == (2 * 14, 2 * 24, 3)
    clean = strips.as_picture(read_frame(rendered / "car_park/0003.exr").rgb)
    assert np.array_equal(found[:14, 24:, ::-1], clean)
    assert (found[14:] != found[:14]).any()
    assert bpy.context.scene.camera is not None
