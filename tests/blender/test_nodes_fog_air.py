# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups of haze and of fog that is no even layer, beside the execution on arrays."""

import numpy as np

import bpy
from cases import cases
from group_tools import by_nodes, by_reference, levels_apart, picture, step_of
from shown import evaluate_scene, image_of

from noisy_world.nodes.chain_scene import make_chain, show_chain
from noisy_world.nodes.compositor import Compositor
from noisy_world.core.geometry import Intrinsics, rotation_from_euler_deg
from noisy_world.nodes.chain import step_node
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.core.camera_motion import motion_between

SIZE = (41, 63)


def depths(*, void=True):
    depth_m = np.random.default_rng(1).uniform(0.2, 60, SIZE).astype(np.float32)
    if void:
        depth_m[:9, :20] = 0
        depth_m[9:12, :20] = np.nan
        depth_m[12:15, :20] = np.inf
    return depth_m


def test_haze_keeps_to_the_reference():
    for values in ({"severity": 1}, {"severity": 5}, {"angstrom": 4.0, "blueness": 1.0, "void_m": 80.0}):
        pair = [make("haze", picture(*SIZE), depth_m=depths(), **values)[0] for make in (by_nodes, by_reference)]
        assert levels_apart(*pair)[0] < 0.1


UNEVEN = {
    "thinner": {"falloff_m": 2.0, "camera_height_m": 1.0},
    "clumps": {"unevenness": 0.8, "clump_m": 5.0, "temporal": "drift", "wind_m_s": 2.0},
    "fresh": {"unevenness": 0.8, "visibility_m": 60.0},
    "glow": {"glow": 1.0, "airlight": 0.2},
    "all": {"falloff_m": 3.0, "unevenness": 0.5, "glow": 0.7, "airlight": 0.4, "temporal": "drift"},
}


@cases("name", UNEVEN)
def test_fog_that_is_no_even_layer_keeps_to_the_reference(name):
    values = {"severity": 2, "depth_m": depths(), **UNEVEN[name]}
    found, wanted = (make("fog_depth", picture(*SIZE), (7,), **values)[0] for make in (by_nodes, by_reference))
    assert levels_apart(found, wanted)[0] < 0.1
    (even,) = by_reference("fog_depth", picture(*SIZE), severity=2, depth_m=depths())
    assert levels_apart(even, wanted)[0] > 3


def test_fog_stays_in_the_world_in_the_compositor_too():
    """A camera that has gone on, turned and tilted since the first frame."""
    first, now = np.eye(4), np.eye(4)
    first[:3, :3], first[:3, 3] = rotation_from_euler_deg(-90.0, 0.0, 0.0), (1e5, 0.0, 3.0)
    now[:3, :3] = rotation_from_euler_deg(-80.0, 5.0, 30.0)
    now[:3, 3] = (1e5 + 2.0, 4.0, 3.5)
    motion = motion_between(first, first, now, 0.05)
    camera = Intrinsics(SIZE[1], SIZE[0], 40.0, 40.0, (SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2)
    step = step_of("fog_depth", severity=2, falloff_m=3.0, unevenness=0.8, temporal="drift")
    image, depth_m, where = picture(*SIZE), depths(void=False), (7, "room", "setting")
    with Compositor((SIZE[1], SIZE[0]), {"x": [step]}, SIZE[1], camera) as compositor:
        moved, still = (
            compositor.evaluate(image, {"x": (5, where)}, depth_m, motions)[0]["x"] for motions in ({"x": motion}, None)
        )
    context = step.context(FrameContext(5, where, intrinsics=camera, motion=motion, read_depth_m=lambda: depth_m))
    wanted = step.perturbation.apply(image, step.parameters(2), context)
    assert levels_apart(moved, wanted)[0] < 0.2
    assert levels_apart(still, wanted)[0] > 5


def test_an_artist_s_camera_drives_the_fog_and_the_panel_leaves_it_so(tmp_path):
    """A driver of the plainest kind, from an object's transform: no expression, so no script."""
    steps = [step_of("fog_depth", severity=3, visibility_m=1.0, falloff_m=0.5), step_of("rain_depth", severity=1)]
    rgb = np.full((4, 6, 3), 0.2, np.float32)
    scene = bpy.data.scenes.new("Street")
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 6, 4, 100
    scene.render.compositor_device, scene.render.compositor_precision = "CPU", "FULL"
    seen_from = bpy.data.objects.new("Seen from", None)
    scene.collection.objects.link(seen_from)
    chain = make_chain("Driven", steps, range(3), (1, "a", "b"))
    node = chain.nodes[step_node(steps[0])]
    curve = node.inputs["Camera Location"].driver_add("default_value", 2)
    curve.driver.type = "SUM"
    read = curve.driver.variables.new()
    read.type = "TRANSFORMS"
    target = read.targets[0]
    target.id, target.transform_type, target.transform_space = seen_from, "LOC_Z", "WORLD_SPACE"
    assert make_chain("Driven", steps, range(3), (1, "a", "b")) == chain
    assert len(chain.animation_data.drivers) == 1
    show_chain(scene, chain, image=image_of(rgb), encoded=True)
    means = []
    for height_m in (0.0, 3.0):
        seen_from.location.z = height_m
        means.append(evaluate_scene(scene, tmp_path).mean())
    assert means[0] > means[1] + 0.02
