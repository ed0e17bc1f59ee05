# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures of ice that the add-on carries are what the script draws."""

import sys

import cv2
import numpy as np
import pytest
from worlds import ROOT

from noisy_world.perturbations.shipped import frost

sys.path.insert(0, str(ROOT / "headless"))

from pictures import draw_ice


@pytest.mark.long
@pytest.mark.parametrize("name", ["sheet", "needles", "rime", "ferns"])
def test_a_picture_is_what_its_seed_draws(name):
    drawn = draw_ice.draw(name).astype(int)
    carried = cv2.imread(str(frost.picture_file(name)), cv2.IMREAD_UNCHANGED)
    assert carried.shape == drawn.shape == (1024, 1536)  # grey: tinted where it is used
    apart = np.abs(carried - drawn)
    assert apart.mean() < 1.5
    assert np.quantile(apart, 0.999) < 8


def test_the_pictures_are_all_there_and_small():
    files = [frost.picture_file(item.name) for item in frost.PICTURES]
    assert sorted(path.stem for path in files) == sorted(draw_ice.PICTURES)
    assert sum(path.stat().st_size for path in files) < 2.5e6
