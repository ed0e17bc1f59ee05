# SPDX-License-Identifier: GPL-3.0-or-later
"""When depth has been seen through all that may let rays pass: after two looks that show nothing new."""

import numpy as np
from cases import cases

from noisy_world.render.own_scene import MOST_LOOKS, DepthScene


class Scripted(DepthScene):
    """A scene whose looks are given: depth at two pixels, one after another; the last one goes on."""

    def __init__(self, looks):
        self.looks, self.seeds = looks, []

    def _once(self, seed, band=None):
        self.seeds.append(seed)
        return {"Depth.Z": np.array(self.looks[min(seed, len(self.looks) - 1)], np.float32)}

    def close(self):
        pass


@cases(
    ("looks", "farthest_m", "count"),
    [
        ([(1, 1)], (1, 1), 3),
        # One look that shows nothing new is not enough: what half of the rays pass is met again half of the time.
        ([(1, 1), (1, 1), (1, 4), (1, 1), (3, 1), (1, 1), (1, 1)], (3, 4), 7),
        ([(1, 1), (2, 1), (1, 1), (1, 1)], (2, 1), 4),
        ([(k, 1) for k in range(1, 40)], (MOST_LOOKS, 1), MOST_LOOKS),
    ],
)
def test_the_farthest_of_several_looks_counts(looks, farthest_m, count):
    scene = Scripted(looks)
    np.testing.assert_array_equal(scene._through()["Depth.Z"], farthest_m)
    assert scene.seeds == list(range(count))
