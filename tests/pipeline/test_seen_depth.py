# SPDX-License-Identifier: GPL-3.0-or-later
"""The depth that weather gets: through panes, whose sky is not that of the air before them."""

import numpy as np

from noisy_world.render.source import RenderedFrame, SceneLight
from noisy_world.perturbations.shipped._air import air_light, sky_in
from noisy_world.dataset.frame import CleanFrame


def test_sky_that_a_window_shows_does_not_light_the_air_of_a_room():
    depth_m = np.full((4, 4), 3.0, np.float32)
    depth_m[0] = 0  # seen through an open door
    behind_m = depth_m.copy()
    behind_m[1, :2], behind_m[1, 2:] = 0, 40  # a pane: sky, and a house
    light = np.full((4, 4, 3), 0.1, np.float32)
    light[1] = 5.0
    scene_light = SceneLight(light, np.ones((4, 4, 1), np.float32), lambda rgba: rgba[..., :3])
    lit = CleanFrame(0, RenderedFrame(light, depth_m, light=scene_light, behind_glass_m=behind_m))
    seen_m = lit.read_seen_depth_m()
    assert np.abs(seen_m - [[0.0] * 4, [500.0, 500.0, 40.0, 40.0], [3.0] * 4, [3.0] * 4]).max() < 1e-3
    assert np.array_equal(sky_in(seen_m), sky_in(depth_m))
    assert np.allclose(air_light(light, seen_m).sky, 0.1)
    depth_m[0] = behind_m[0] = 3  # the door is shut
    room = CleanFrame(0, RenderedFrame(light, depth_m, light=scene_light, behind_glass_m=behind_m))
    assert np.abs(room.read_seen_depth_m()[1] - [3, 3, 40, 40]).max() < 1e-5
    unlit = CleanFrame(0, RenderedFrame(light, depth_m, behind_glass_m=behind_m))
    assert np.array_equal(unlit.read_seen_depth_m(), behind_m)
    assert np.array_equal(CleanFrame(0, RenderedFrame(light, depth_m)).read_seen_depth_m(), depth_m)
