# SPDX-License-Identifier: GPL-3.0-or-later
"""On a still scene, weather that drifts shows its own motion and nothing else: Farneback's optical flow."""

import cv2
import numpy as np
import pytest

from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.shipped import snow_depth
from noisy_world.perturbations.shipped._particles import in_sight
from noisy_world.perturbations.shipped._weather import Lens, optical_depth, streaks_of
from noisy_world.perturbations.shipped._weather import view_of
from noisy_world.perturbations.shipped.fog_depth import PERTURBATION as FOG

SIZE, RATE_HZ = (180, 240), 100.0


def context_at(index, temporal="drift", depth_m=2.0):
    depth = np.full(SIZE, depth_m, np.float32)
    return FrameContext(index, (3,), temporal, read_depth_m=lambda: depth)


def grey(image):
    return (np.clip(image.mean(axis=-1), 0, 1) * 255).astype(np.uint8)


def test_only_flakes_move_and_as_their_velocities_say():
    texture = np.random.default_rng(0).random((18, 24)).astype(np.float32) * 0.2 + 0.1
    rgb = cv2.merge([cv2.resize(texture, SIZE[::-1], interpolation=cv2.INTER_CUBIC)] * 3)
    values = {"least_mrad": 8.0, "gusts_m_s": 0.0, "wind_m_s": 0.6, "aperture_mm": 0.0, "brightness": 6.0}
    parameters = snow_depth.PERTURBATION.at_severity(5, frame_rate_hz=RATE_HZ, **values)
    air = snow_depth.KIND.air(parameters)
    speeds, flows, still = [], [], []
    for index in range(0, 240, 40):
        one, other = (snow_depth.apply(rgb, parameters, context_at(k)) for k in (index, index + 1))
        flow = cv2.calcOpticalFlowFarneback(grey(one), grey(other), None, 0.5, 2, 11, 5, 7, 1.5, 0)
        context = context_at(index)
        view = view_of(context.depth_m, parameters, context)
        key = int(context.pattern_stream().integers(2**64, dtype=np.uint64))
        parts = [in_sight(air, view, key, k / RATE_HZ) for k in (index, index + 1)]
        drawn = [optical_depth(streaks_of(part, view, Lens(0.0, 5.0)), context.depth_m) for part in parts]
        bare = (drawn[0] == 0) & (drawn[1] == 0)
        assert np.array_equal(one[bare], other[bare])
        far = cv2.erode(bare.astype(np.uint8), np.ones((25, 25))) > 0
        still.append(np.abs(flow[far]).ravel())
        z_m = parts[0].position_m[:, 2]
        seen = parts[0].position_m[:, :2] / z_m[:, None] * view.focal_px + np.array(view.middle_px)
        inside = (seen >= 8).all(axis=1) & (seen < np.array(SIZE[::-1]) - 8).all(axis=1)
        inside &= parts[0].diameter_m * view.focal_px[0] / z_m > 3  # pixels
        column, row = np.rint(seen[inside]).astype(int).T
        flows.append(flow[row, column])
        speeds.append((parts[0].velocity_m_s / z_m[:, None])[inside, :2] * view.focal_px / RATE_HZ)
    flows, speeds = np.concatenate(flows), np.concatenate(speeds)
    assert len(flows) > 12
    assert np.median(np.concatenate(still)) < 0.02
    assert np.median(flows, axis=0) == pytest.approx(np.median(speeds, axis=0), rel=0.3)


def test_clumps_of_fog_go_with_the_wind():
    rgb = np.full((*SIZE, 3), 0.05, np.float32)
    values = {"unevenness": 1.0, "clump_m": 1.5, "wind_m_s": 3.0, "visibility_m": 6.0, "frame_rate_hz": 60.0}
    parameters = FOG.at_severity(3, **values)
    one, other = (FOG.apply(rgb, parameters, context_at(k)) for k in (10, 11))
    stretched = [np.clip((image - one.min()) / np.ptp(one), 0, 1) for image in (one, other)]
    flow = cv2.calcOpticalFlowFarneback(*map(grey, stretched), None, 0.5, 3, 25, 5, 7, 1.5, 0)
    # Clumps are between the camera and 2 m: the wind takes them 5 cm to the right, 3 to 12 px, of which the flow of a
    # picture without edges shows a part.
    right, down = np.median(flow.reshape(-1, 2), axis=0)
    assert 1 < right < 12
    assert abs(down) < 0.3 * right
