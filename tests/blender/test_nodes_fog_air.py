# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups of haze and of fog that is no even layer, beside the execution on arrays."""

import numpy as np
import pytest

pytest.importorskip("bpy", reason="bpy is not installed")

from group_tools import by_nodes, by_reference, levels_apart, picture

SIZE = (41, 63)


def depths(*, void=True):
    depth_m = np.random.default_rng(1).uniform(0.2, 60, SIZE).astype(np.float32)
    if void:
        depth_m[:9, :20] = 0
        depth_m[9:12, :20] = np.nan
        depth_m[12:15, :20] = np.inf
    return depth_m


def test_haze_keeps_to_the_reference():
    for values in ({"severity": 1}, {"severity": 5}, {"angstrom": 4.0, "blueness": 1.0, "void_m": 80.0}):
        pair = [make("haze", picture(*SIZE), depth_m=depths(), **values)[0] for make in (by_nodes, by_reference)]
        assert levels_apart(*pair)[0] < 0.1
