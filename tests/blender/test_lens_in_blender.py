# SPDX-License-Identifier: GPL-3.0-or-later
"""A lens that distorts with Blender's engines: more than the image is rendered, and bent; against walls and rays."""

import numpy as np
import pytest
from shutters import CAMERA, HIGH, LOW, coloured_room, moved, paths

from noisy_world.core.lens import lens_rays
from noisy_world.core.lens import Distortion
from noisy_world.render.source import RenderOptions
from noisy_world.sources.renderers import open_session

LENS = Distortion("radial-tangential", (-0.25, 0.06, 0.002, -0.001))


def rendered(engine):
    sensors = paths("rotation")
    options = RenderOptions(near_m=0.01, far_m=100.0, samples=1, seed=0, engine=engine)
    with open_session(coloured_room(smooth=True), "room", sensors, CAMERA, options, lens=LENS) as session:
        return session.frame(sensors.request(1))


def test_depth_and_colour_are_those_of_rays_through_the_lens():
    pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    frame, cast = rendered("cycles"), rendered("embree")
    rays = lens_rays(CAMERA, LENS)
    local = np.stack([rays.right, rays.down, np.ones_like(rays.right)], axis=-1)
    c2w = moved("rotation", 0.0)
    along = local @ c2w[:3, :3].T
    with np.errstate(divide="ignore"):
        bounds = np.sort(np.where(along > 0, HIGH - c2w[:3, 3], LOW - c2w[:3, 3]) / along, axis=-1)
    sure = bounds[..., 1] - bounds[..., 0] > 0.3  # not within some pixels of a seam of two walls
    assert frame.depth_m.all()  # no border is missing
    assert sure.mean() > 0.4
    assert np.quantile(np.abs(frame.depth_m / bounds[..., 0] - 1)[sure], 0.9) < 1e-6
    assert np.abs(frame.depth_m / bounds[..., 0] - 1)[sure].max() < 0.05  # beside a seam the nearest pixel's
    assert np.median(np.abs(frame.rgb - cast.rgb)) < 0.01
