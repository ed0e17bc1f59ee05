# SPDX-License-Identifier: GPL-3.0-or-later
"""How contexts say that a camera moves: along its own path, not from one camera to the next where the view cuts."""

import numpy as np

from noisy_world.core.geometry import pose, rotation_from_euler_deg
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.steps import Setting
from noisy_world.dataset.sequence import lay_out
from noisy_world.core.schema import ConfigPath
from noisy_world.core.trajectory import Trajectory
from noisy_world.perturbations import registry
from noisy_world.dataset.frame import Camera

RATE_HZ = 10.0


def told(perturb, shots):
    """What frames are told of six poses, half a metre a second along x; the fourth is of a camera 100 m away."""
    c2w = np.tile(np.eye(4), (6, 1, 1))
    c2w[:, 0, 3] = 0.05 * np.arange(6)
    c2w[3:] = pose(rotation_from_euler_deg(0.0, 90.0, 0.0), np.array([0.0, 100.0, 0.0])) @ c2w[3:]
    path = Trajectory(c2w, np.arange(6) / RATE_HZ, shots=None if shots is None else np.array(shots))
    sequence = lay_out(Setting("s", parse_steps(perturb, ConfigPath("x"), registry())), "room", 6, (1, "room", "s"))
    camera = Camera(None, path.stamps_s, path)
    return [camera.motion(sequence, frame) for frame in range(len(sequence.source_frames))]


def test_a_camera_is_at_rest_where_the_view_cuts_to_it():
    cut = told([], [0, 0, 0, 1, 1, 1])
    speeds = [np.linalg.norm(motion.velocity_m_s) for motion in cut]
    np.testing.assert_allclose(speeds, [0, 0.5, 0.5, 0, 0.5, 0.5], atol=1e-12)
    np.testing.assert_allclose([np.linalg.norm(motion.turning_rad_s) for motion in cut], np.zeros(6), atol=1e-12)
    one = told([], None)  # one camera that jumps: 100 m and a quarter turn in a tenth of a second
    assert np.linalg.norm(one[3].velocity_m_s) > 900
    np.testing.assert_allclose(np.linalg.norm(one[3].turning_rad_s), np.pi / 2 * RATE_HZ, rtol=1e-12)


def test_faster_motion_passes_a_cut_likewise():
    speeds = [
        np.linalg.norm(item.velocity_m_s) for item in told([{"faster_motion": {"factor": 2}}], [0, 0, 0, 1, 1, 1])
    ]
    np.testing.assert_allclose(speeds, [0, 1.0, 0], atol=1e-12)  # poses 0, 2 and 4
