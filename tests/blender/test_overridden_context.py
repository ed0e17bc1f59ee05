# SPDX-License-Identifier: GPL-3.0-or-later
"""What renders does so whatever members of the context a script has overridden around it."""

import bpy
import numpy as np
import pytest

from group_tools import IDENTIFIERS, step_of
from own_scenes import new_scene, save

from noisy_world.nodes.compositor import Compositor
from noisy_world.render.own_stills import OwnStill, render_own_still
from noisy_world.render.own_view import camera_parameters
from noisy_world.render.scene_inspection import open_file
from noisy_world.render.own_stills import render_stills
from noisy_world.nodes.datablocks import override
from noisy_world.core.errors import InputError


def rendered(scene):
    """Images by each way of rendering in the open file: as meshes are, as scenes of one's own are, and composed."""
    seen = camera_parameters(scene, scene.camera).intrinsics
    own = OwnStill(
        frame=2.0, c2w=None, follows=True, intrinsics=seen, clip_m=None, engine=None, samples=None, seed=0,
        keep_compositor=False, depth_alpha=0.5,
    )  # fmt: skip
    (still,) = render_stills(scene, [2])
    with Compositor((48, 36), {"noisy": [step_of("gaussian_noise", severity=3)]}, 48) as compositor:
        made, _ = compositor.perturb(still.rgb, {"noisy": (0, IDENTIFIERS)})["noisy"]
    return [still.rgb, still.depth_m, render_own_still(scene, own).rgb, made]


OVERRIDDEN = [("view_layer",), ("scene",), ("scene", "view_layer")]


def overridden(members):
    """A context with these members of its own scene or, where the scene is among them, of another one."""
    scene = bpy.data.scenes.new("Other") if "scene" in members else bpy.context.scene
    given = {"scene": scene, "view_layer": scene.view_layers[0]}
    return override(**{name: given[name] for name in members})


def test_images_are_those_of_a_context_that_nothing_is_overridden_in():
    scene = new_scene()
    expected = rendered(scene)
    for members in OVERRIDDEN:
        with overridden(members):
            found = rendered(scene)
        for image, same in zip(found, expected, strict=True):
            assert np.array_equal(image, same)
            assert image.std() > 0


def test_a_blend_is_not_opened_where_blender_would_end(tmp_path):
    new_scene()
    path = save(tmp_path)
    for members in OVERRIDDEN:
        layers = len(bpy.context.scene.view_layers)
        with overridden(members), pytest.raises(InputError, match=r"hall\.blend: .*temp_override"):
            open_file(str(path))
        assert len(bpy.context.scene.view_layers) == layers
    with override(window=bpy.context.window):
        open_file(str(path))
    assert bpy.data.filepath == str(path)
