# SPDX-License-Identifier: GPL-3.0-or-later
"""An entry that is added to the list begins by what is there, and by how far the scene's camera sees."""

import bpy
import numpy as np
import pytest
from cases import cases
from panel_tools import settings

from noisy_world.panel.document import perturb_of
from noisy_world.panel.new_entries import seen_depth_m
from noisy_world.perturbations import registry

pytestmark = pytest.mark.usefixtures("add_on")


def wall_before_a_camera(distance_m):
    """A wall in the plane y = distance, wider than what the camera at the origin sees, which looks along y."""
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.mesh.primitive_plane_add(size=20 * distance_m, location=(0, distance_m, 0), rotation=(np.pi / 2, 0, 0))
    bpy.ops.object.camera_add(location=(0, 0, 0), rotation=(np.pi / 2, 0, 0))
    bpy.context.scene.camera = bpy.context.object
    bpy.context.view_layer.update()


@cases("distance_m, outdoors", [(4.0, False), (60.0, True)])
def test_fog_begins_by_how_far_the_camera_sees(distance_m, outdoors):
    wall_before_a_camera(distance_m)
    depth_m = seen_depth_m(bpy.context.scene)
    assert np.allclose(depth_m, distance_m, rtol=1e-4)  # planar: the same at the corners
    assert bpy.ops.noisy_world.add_step(perturbation="fog_depth") == {"FINISHED"}
    ((_, values),) = perturb_of(settings())[-1].items()
    chosen = {"outdoors": outdoors, "reach": 1.5 if outdoors else 1.3, "air_around": not outdoors}
    chosen |= {} if outdoors else {"void_m": 4.0}
    assert values == {"severity": 3.0, **chosen, **registry()["fog_depth"].newly, "temporal": "drift"}


def test_without_a_camera_nothing_is_chosen_by_what_it_sees():
    bpy.context.scene.camera = None
    assert seen_depth_m(bpy.context.scene) is None
    bpy.ops.noisy_world.add_step(perturbation="fog_depth")
    ((_, values),) = perturb_of(settings())[-1].items()
    assert "outdoors" not in values


def test_an_overlay_on_another_begins_at_1_and_other_entries_stay():
    for name in ("fog", "contrast", "frost"):
        bpy.ops.noisy_world.add_step(perturbation=name)
    found = {name: values["severity"] for each in perturb_of(settings()) for name, values in each.items()}
    assert found == {"fog": 3.0, "frost": 1.0, "contrast": 3.0}
