# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh as a source: its first frame is held against the mesh, seen from where the depth sensor is."""

from types import SimpleNamespace

import numpy as np
from analytic import box_depth, look_at

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.scenes.mesh import Mesh
from noisy_world.core.trajectories.sensor_paths import Moment
from noisy_world.sources.mesh import OpenMesh

CAMERA = Intrinsics(160, 120, 90.0, 80.0, 79.5, 59.5)
LOW, HIGH = np.array([-2.0, -1.5, 0.0]), np.array([2.5, 1.5, 2.5])
COLOUR_EYE = look_at([0.4, 0.2, 1.1], [2.0, 1.0, 0.7])
DEPTH_EYE = look_at([-0.9, -0.4, 1.5], [-2.0, -0.2, 1.2])


def dense_box():
    """A box's walls as scattered vertices; the check looks at nothing else."""
    rng = np.random.default_rng(0)
    points = rng.uniform(LOW, HIGH, (60_000, 3))
    axis = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), axis] = np.where(rng.integers(0, 2, len(points)), HIGH[axis], LOW[axis])
    corners = np.arange(len(points), dtype=np.int32)
    return Mesh(points, None, corners, corners[::3])


def notes_of_the_first_frame(depth_c2w):
    """What is noted of a frame whose depth was rendered from this pose."""
    depth_m, _ = box_depth(CAMERA, depth_c2w, LOW, HIGH)
    session = SimpleNamespace(frame=lambda moment: SimpleNamespace(rgb=None, depth_m=depth_m.astype(np.float32)))
    notes = []
    opened = OpenMesh(session, dense_box(), CAMERA, notes.append)
    opened.frame(Moment(3, 0.15, rgb_c2w=COLOUR_EYE, depth_c2w=DEPTH_EYE))
    return notes


def test_a_rigs_depth_is_checked_from_where_the_depth_sensor_is():
    assert notes_of_the_first_frame(DEPTH_EYE) == []
    (note,) = notes_of_the_first_frame(COLOUR_EYE)  # as if depth came from the colour sensor's place
    assert note.startswith("frame 3: ")
    assert "went wrong" in note
