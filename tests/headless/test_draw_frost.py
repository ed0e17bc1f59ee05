# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps of ice that the add-on carries are such as the script grows: from an edge, in branches that keep apart."""

import sys

import cv2
import numpy as np
import pytest
from worlds import ROOT

from noisy_world.perturbations.shipped import lens_frost

sys.path.insert(0, str(ROOT / "headless"))

from pictures import draw_frost

pytestmark = pytest.mark.long  # of the film set and of what is drawn once; rarely changed

WIDTH_PX = 384  # enough for plumes to fill it


@pytest.fixture(scope="module")
def tips():
    return draw_frost.grown(WIDTH_PX)


@pytest.fixture(scope="module")
def thick(tips):
    return draw_frost.ridges(tips, WIDTH_PX)


def test_all_ice_begins_at_the_edge_or_on_ice_that_is_there(tips):
    by_number = {tip.number: tip for tip in tips}
    for tip in tips:
        path = np.array(tip.path)
        assert (np.diff(path[:, 2]) > 0).all()
        if tip.parent == 0:
            assert path[0, 1] == 0
        else:
            parent = np.array(by_number[tip.parent].path)
            assert np.hypot(*(parent[:, :2] - path[0, :2]).T).min() < 1.1
            assert parent[0, 2] <= path[0, 2]


def test_branches_open_at_some_sixty_degrees(tips):
    by_number = {tip.number: tip for tip in tips}
    angles = []
    for tip in tips:
        if tip.parent and tip.kind == by_number[tip.parent].kind + 1:
            parent = np.array(by_number[tip.parent].path)[:, :2]
            at = int(np.hypot(*(parent - tip.path[0][:2]).T).argmin())
            if 0 < at < len(parent) - 1:
                along, own = parent[at + 1] - parent[at - 1], np.subtract(tip.path[1][:2], tip.path[0][:2])
                angles.append(np.degrees(np.arccos(along @ own / np.linalg.norm(along) / np.linalg.norm(own))))
    assert len(angles) > 500
    assert np.quantile(angles, [0.05, 0.95]) == pytest.approx([50, 64], abs=6)


def test_branches_keep_apart(tips):
    """Next to no pixel is crossed by a branch that is no relation of the one that was there."""
    owner, crossed = {}, 0
    for tip in tips:
        for x, y, _ in tip.path:
            other = owner.setdefault((int(x) % WIDTH_PX, int(y)), tip)
            related = tip.number in (other.number, other.parent) or tip.parent in (other.number, other.parent)
            crossed += not related
    assert crossed < 0.01 * len(owner)


def test_every_call_grows_the_same():
    first, again = (draw_frost.grown(64) for _ in range(2))
    assert [tip.path for tip in again] == [tip.path for tip in first]
    assert len(first) > 50


def test_a_strip_s_ends_join_and_its_ice_ends_before_its_depth(tips, thick):
    times = draw_frost.times(tips, WIDTH_PX)
    assert thick.shape == (lens_frost.HEIGHT_PX, WIDTH_PX)
    assert times.shape == (lens_frost.HEIGHT_PX // 4, WIDTH_PX // 4)
    apart = np.abs(np.diff(thick.astype(int), axis=1, append=thick[:, :1])).mean(axis=0)
    assert apart[-1] < apart.mean() * 1.5
    assert not thick[310:].any()
    middle = times.astype(float).mean(axis=1)
    assert middle[5] < 0.35 * middle[60]


def turns_of(tips):
    """How far branches of stems that grew long turn on 100 pixels of their way, degrees."""
    turned = []
    for tip in tips:
        if tip.kind == 1 and len(tip.path) > 20:
            steps = np.diff(np.array(tip.path)[:, :2], axis=0)
            ends = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))[[0, -1]]
            turned.append(abs(np.degrees(ends[1] - ends[0])) / len(steps) * 100)
    assert len(turned) > 100
    return turned


def test_barbs_of_feathers_bend_and_their_maps_are_carried(tips):
    feathers = draw_frost.grown(512, draw_frost.FEATHER)
    assert np.median(turns_of(feathers)) > 60 > np.median(turns_of(tips))
    carried, times = (
        cv2.imread(str(lens_frost.map_file(name, "feather")), cv2.IMREAD_UNCHANGED) for name in ("thickness", "time")
    )
    assert carried.shape == (lens_frost.HEIGHT_PX, lens_frost.WIDTH_PX)
    assert times.shape == (lens_frost.HEIGHT_PX // 4, lens_frost.WIDTH_PX // 4)
    grown = draw_frost.ridges(feathers, 512, draw_frost.FEATHER)
    assert carried[:60].mean() == pytest.approx(grown[:60].mean(), rel=0.3)
    assert not carried[316:].any()


def test_the_maps_that_are_carried_are_such_maps(thick):
    """Growing them takes half a minute, so they are compared with a part as a whole."""
    carried, times = (
        cv2.imread(str(lens_frost.map_file(name)), cv2.IMREAD_UNCHANGED) for name in ("thickness", "time")
    )
    assert carried.shape == (lens_frost.HEIGHT_PX, lens_frost.WIDTH_PX)
    assert times.shape == (lens_frost.HEIGHT_PX // 4, lens_frost.WIDTH_PX // 4)
    assert sum(lens_frost.map_file(name).stat().st_size for name in ("thickness", "time")) < 6e5
    assert set(np.unique(carried)) <= set(range(0, 256, 6))
    for rows in (slice(0, 60), slice(60, 180)):
        assert carried[rows].mean() == pytest.approx(thick[rows].mean(), rel=0.3)
    assert not carried[310:].any()
