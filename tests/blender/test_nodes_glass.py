# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups of what is on the lens beside the executions on arrays: the same drops, the same dirt."""

import bpy
import cv2
import numpy as np
import pytest
from cases import cases
from group_tools import by_nodes, by_reference, levels_apart, picture
from shown import evaluate_scene, image_of

from noisy_world.blender.nodes import ensure_group
from noisy_world.core.node_graphs.groups import build_group
from noisy_world.perturbations import registry

NAMES = ("lens_drops",)
SIZE = (90, 150)
DROPS = (
    {"severity": 1, "size_px": 8.0},
    {"severity": 5, "size_px": 12.0},
    {"severity": 3, "size_px": 30.0, "temporal": "fresh", "runs": 1.0, "contact_deg": 85.0},
    {"severity": 5, "size_px": 14.0, "focus_px": 0.0, "temporal": "fixed", "spread": 1.5, "view_deg": 40.0},
)


@cases("values", DROPS)
def test_drops_are_the_reference_s_drop_for_drop(values):
    image = picture(*SIZE)
    made = [make("lens_drops", image, (0, 977), **values) for make in (by_nodes, by_reference)]
    for found, wanted in zip(*made, strict=True):
        most, mean = levels_apart(found, wanted)
        assert mean < 0.02
        # Where a pixel lies on a drop's rim to within rounding, a sharp glass shows the drop or not.
        assert most < 0.5 or (values.get("focus_px") == 0 and np.mean(np.abs(found - wanted) > 2e-3) < 1e-3)
        assert np.abs(found - image).mean() > 1e-3


def test_without_drops_the_image_stays():
    image = picture(*SIZE)
    (found,) = by_nodes("lens_drops", image, severity=3, coverage=0.0, runs=0.0)
    assert levels_apart(found, image)[0] < 0.01


@cases("name", NAMES)
def test_a_preview_looks_like_the_frame(name):
    image = cv2.GaussianBlur(picture(180, 300), (0, 0), 2)
    small = np.asarray(cv2.resize(image, (150, 90), interpolation=cv2.INTER_AREA), np.float32)
    (frame,) = by_nodes(name, image, severity=5)
    (preview,) = by_nodes(name, small, severity=5, reference_width=300)
    wanted = cv2.resize(frame, (150, 90), interpolation=cv2.INTER_AREA)
    assert np.abs(preview - wanted).mean() < 0.15 * np.abs(wanted - small).mean()


@cases("name", NAMES)
def test_what_is_brighter_than_white_comes_through(name, tmp_path):
    """A group in an artist's compositor, in linear light, before lamps of 4, 20 and 100."""
    light = np.full((48, 72, 3), 0.2, np.float32)
    lamps = {4: slice(4, 12), 20: slice(20, 28), 100: slice(36, 44)}
    for value, rows in lamps.items():
        light[rows, 8:16] = value
    scene = bpy.data.scenes.new("Artist")
    scene.render.resolution_x, scene.render.resolution_y = 72, 48
    scene.render.compositor_precision, scene.render.compositor_device = "FULL", "CPU"
    tree = scene.compositing_node_group = bpy.data.node_groups.new("Own", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    shown, end = tree.nodes.new("CompositorNodeImage"), tree.nodes.new("NodeGroupOutput")
    shown.image = image_of(light)
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree = ensure_group(build_group(registry()[name]))
    node.inputs["Reference Width"].default_value = 600
    tree.links.new(shown.outputs["Image"], node.inputs["Image"])
    tree.links.new(node.outputs["Image"], end.inputs[0])
    found = evaluate_scene(scene, tmp_path)
    assert np.isfinite(found).all()
    for value, rows in lamps.items():
        assert found[rows, 8:16].max() == pytest.approx(value, rel=0.2)
    # Lamps are seen in drops, or lit dirt, where there are none.
    assert found[:, 30:].max() > 0.4
    node.inputs["Enabled"].default_value = False
    assert np.array_equal(evaluate_scene(scene, tmp_path)[..., :3], light)
