# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals from Cycles against planes, boxes and spheres in closed form, and that they change nothing beside them."""

import numpy as np
import pytest

pytest.importorskip("bpy", reason="bpy is not installed")

from cases import cases
from surface_views import SURFACES, box, seen, worst_normal


@cases("made", SURFACES)
@cases("samples", [1, 4])
def test_normals(made, samples):
    worst, _ = worst_normal("cycles", made, samples=samples, channels={"rgb", "depth", "normal"})
    assert worst < 1e-4


def test_colour_and_depth_are_the_same_beside_them():
    mesh, view, camera, _, _ = box()
    alone = seen("cycles", mesh, view, camera)
    beside = seen("cycles", mesh, view, camera, channels={"rgb", "depth", "normal"})
    assert np.array_equal(alone.rgb, beside.rgb)
    assert np.array_equal(alone.depth_m, beside.depth_m)
    normal = seen("cycles", mesh, view, camera, channels={"normal"}).image("normal")
    assert np.array_equal(normal, beside.image("normal"))
