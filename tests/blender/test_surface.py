# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals and objects from Cycles against planes, boxes and spheres in closed form; they change nothing beside them."""

from dataclasses import replace

import numpy as np

from cases import cases
from surface_views import SURFACES, along, box, check_instances, worst_normal


@cases("made", SURFACES)
@cases("samples", [1, 4])
def test_normals(made, samples):
    worst, _ = worst_normal("cycles", made, samples=samples, channels={"rgb", "depth", "normal"})
    assert worst < 1e-4


@cases("samples", [1, 4])
def test_colour_and_depth_are_the_same_beside_them(samples):
    mesh, view, _, _, _ = box()
    mesh = replace(mesh, rgb=np.random.default_rng(1).random((24, 3)).astype(np.float32), object_ids=np.arange(1, 7))
    views = np.stack([view, view, view @ np.diag([-1.0, 1.0, -1.0, 1.0])])  # the camera stays, then turns
    alone = along("cycles", mesh, views, samples=samples)
    beside = along("cycles", mesh, views, samples=samples, channels={"rgb", "depth", "normal", "instance"})
    for before, after in zip(alone, beside, strict=True):
        assert np.array_equal(before.rgb, after.rgb)
        assert np.array_equal(before.depth_m, after.depth_m)
    others = along("cycles", mesh, views, samples=samples, channels={"normal", "instance"})
    for after, other in zip(beside, others, strict=True):
        for name in ("normal", "instance"):
            assert np.array_equal(after.image(name), other.image(name))
        assert other.rgb is None


def test_every_pixel_off_edges_has_its_object():
    check_instances("cycles")
