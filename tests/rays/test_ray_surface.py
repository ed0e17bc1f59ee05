# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals and objects from rays against planes, boxes and spheres in closed form."""

import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
pytestmark = pytest.mark.usefixtures("way_of_casting")

from cases import cases
from surface_views import SURFACES, box, check_instances, plane, seen, worst_normal


@cases("made", SURFACES)
def test_normals(made):
    worst, frame = worst_normal("embree", made, channels={"rgb", "depth", "normal"})
    assert worst < 1e-4
    assert frame.image("normal").dtype == np.float32


def test_alone_and_of_nothing():
    mesh, view, camera, _, _ = plane()
    behind = view @ np.diag([-1.0, 1.0, -1.0, 1.0])  # looking the other way: half the plane's void
    normal = seen("embree", mesh, behind, camera, channels={"normal"}).image("normal")
    length = np.linalg.norm(normal, axis=-1)
    assert (length == 0).any()
    assert np.abs(length[length > 0] - 1).max(initial=0) < 1e-6


def test_colour_and_depth_are_the_same_beside_them():
    mesh, view, camera, _, _ = box()
    alone = seen("embree", mesh, view, camera)
    beside = seen("embree", mesh, view, camera, channels={"rgb", "depth", "normal"})
    assert np.array_equal(alone.rgb, beside.rgb)
    assert np.array_equal(alone.depth_m, beside.depth_m)
    assert alone.image("normal") is None


def test_every_pixel_off_edges_has_its_object():
    check_instances("embree")
