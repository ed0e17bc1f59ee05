# SPDX-License-Identifier: GPL-3.0-or-later
"""Sun lamps behind heavy air: how wide their penumbras are, what is left of their light, and what stays as it was."""

import json
import math
from dataclasses import replace

import bpy
import numpy as np
import pytest

from cases import cases
from own_scenes import key, opened, save
from refusals import refused
from runs import planned

from noisy_world.render.own_stills import OwnStill, StillRequest, render_own_still
from noisy_world.render.scene_inspection import inspect_scene
from noisy_world.scenes.sun_air import SunAir
from noisy_world.core.frame_request import FrameRequest
from noisy_world.core.geometry import Intrinsics

HEIGHT_M = 1.0  # of the box, whose edge stands above x = 0
OWN_RAD = math.radians(0.5)
AIR = SunAir(visibility_m=200.0, path_m=6.0)


def shadow_scene(samples=64):
    """A sun overhead, a black box that ends at x = 0, and a white floor of which a camera sees what is beside it."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 64, 16
    scene.cycles.samples, scene.cycles.use_adaptive_sampling = samples, False
    scene.cycles.max_bounces = 0
    scene.frame_start = scene.frame_end = 1
    bpy.ops.mesh.primitive_plane_add(size=400)
    chalk = bpy.data.materials.new("Chalk")  # which shines nowhere
    nodes, links = chalk.node_tree.nodes, chalk.node_tree.links
    links.new(nodes.new("ShaderNodeBsdfDiffuse").outputs[0], nodes["Material Output"].inputs["Surface"])
    bpy.context.object.data.materials.append(chalk)
    bpy.ops.mesh.primitive_cube_add(size=1)
    box = bpy.context.object
    box.scale, box.location = (100, 200, HEIGHT_M), (-50, 0, HEIGHT_M / 2)
    light = bpy.data.lights.new("Sun", "SUN")
    light.angle, light.energy = OWN_RAD, 1.0
    scene.collection.objects.link(bpy.data.objects.new("Sun", light))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.location = (1.5, 0, 20)
    camera.data.lens, camera.data.sensor_width = 100, 15  # 3 m of the floor
    return scene


def seen(path, air=None):
    """The floor's light by column (64,), and where each column's middle is, in metres from the box."""
    with opened(path, sun_air=air, depth=False) as (session, paths, _):
        light = session.frame(FrameRequest(0, 0.0, paths.rgb.c2w[0], paths.rgb.c2w[0])).light.rgb
    return light[..., 0].mean(axis=0), 1.5 + (np.arange(64) - 31.5) * 3 / 64


def lit_share(x_m, angle_rad):
    """What an even cone of light overhead gives a floor beside a box: directions not behind the box's edge.

    A direction (u, v, w) of the cone weighs du dv on the floor, in a disc of the radius sin(angle / 2); at x it is
    behind the edge where -u / w is above x / h.
    """
    radius = math.sin(angle_rad / 2)
    v = np.linspace(-radius, radius, 4001)
    half = np.sqrt(radius**2 - v**2)
    slope = np.asarray(x_m)[:, None] / HEIGHT_M
    edge = slope * np.sqrt((1 - v**2) / (1 + slope**2))
    width = half + np.minimum(edge, half)
    return np.trapezoid(width, v, axis=1) / (math.pi * radius**2)


@pytest.fixture(scope="module")
def shadow(tmp_path_factory):
    """The file of that scene."""
    shadow_scene()
    return save(tmp_path_factory.mktemp("shadow"), "shadow")


def test_a_penumbra_is_as_wide_as_the_disc_behind_the_air_makes_it(shadow):
    written = shadow.read_bytes()
    clear, x_m = seen(shadow)
    softened, _ = seen(shadow, AIR)
    # ln 20 x 6 / 200 times scattered; each time 2 (1 - 0.85) of a mean square, of which a disc's width is 8.
    depth = math.log(20) * 6 / 200
    angle_rad = math.hypot(OWN_RAD, math.sqrt(8 * depth * 2 * 0.15))
    assert math.degrees(angle_rad) == pytest.approx(26.6, abs=0.1)
    lit = clear[-8:].mean()
    assert np.abs(clear / lit - lit_share(x_m, OWN_RAD))[1:].max() < 0.02
    off = softened / lit - lit_share(x_m, angle_rad) * math.exp(-0.15 * depth)
    assert np.abs(off).max() < 0.04
    assert abs(off.mean()) < 0.005
    assert shadow.read_bytes() == written


def test_a_still_softens_lamps_while_it_is_rendered_and_gives_them_back():
    scene = shadow_scene(samples=4)
    lamp = bpy.data.lights["Sun"]
    lamp.exposure = 0.5
    before = lamp.angle, lamp.exposure
    still = OwnStill(1.0, None, True, Intrinsics(8, 6, 16, 16, 3.5, 2.5), None, None, None, 0, False, 0.5)
    lights = []
    for air in (None, SunAir(visibility_m=100.0, path_m=1000.0)):
        found = render_own_still(scene, replace(still, sun_air=air))
        lights.append(float(found.light.rgb.mean()))
        assert (lamp.angle, lamp.exposure) == before
    assert 0.001 < lights[1] / lights[0] < math.exp(-0.15 * 10 * math.log(20)) * 1.2
    assert StillRequest.of(StillRequest("Scene", {1: replace(still, sun_air=AIR)}).content()).stills[1].sun_air == AIR


def test_the_disc_is_at_most_half_a_turn():
    thick = SunAir(visibility_m=1e-3, path_m=1e5)
    assert thick.angle_rad(OWN_RAD) == math.pi
    assert SunAir(visibility_m=1e5, path_m=1e-6).angle_rad(OWN_RAD) == pytest.approx(OWN_RAD, rel=1e-3)


def strip(lamp):
    key(lamp, "angle", {1: 0.1, 9: 0.2})
    data = lamp.animation_data
    data.nla_tracks.new().strips.new("Dusk", 1, data.action)
    data.action = None


def without(lamp):
    bpy.data.lights.remove(lamp)


@cases(
    ("change", "says"),
    [
        (lambda lamp: None, ""),
        (lambda lamp: key(lamp, "energy", {1: 1.0, 9: 2.0}), ""),
        (lambda lamp: key(lamp, "angle", {1: 0.1, 9: 0.2}), "Sun angle"),
        (lambda lamp: lamp.driver_add("exposure"), "Sun exposure"),
        (strip, "Sun angle"),
        (without, "the scene Scene has no sun lamp"),
    ],
)
def test_what_cannot_be_softened_is_said_in_a_line(change, says):
    scene = shadow_scene()
    change(bpy.data.lights["Sun"])
    told = [item for item in inspect_scene(scene, None, None, softened=True).problems if item.key == "air"]
    assert [says in item.problem for item in told] == ([True] if says else [])
    assert not [item for item in inspect_scene(scene, None, None).problems if item.key == "air"]


def source_of(shadow, air, **render):
    path = shadow.with_name("preset.yaml")
    scene = {"name": "shadow", "blend": shadow.name, **({} if air is None else {"air": air})}
    path.write_text(json.dumps({"scenes": [scene], "render": render}))
    return planned(path).scenes[0].source


def test_air_is_in_the_identity_where_it_softens_alone(shadow):
    clear = source_of(shadow, None).hashes()
    assert source_of(shadow, {"visibility_m": 50}).hashes() == clear
    softened = source_of(shadow, {"soften_sun": True, "visibility_m": 150})
    added = {"sun_air": 1, "visibility_m": 150, "path_m": 100}
    assert softened.hashes() == {**clear, **added}
    assert softened.file.sun_air == SunAir(150, 100)
    refused(
        lambda: source_of(shadow, {"soften_sun": True}, engine="workbench"),
        names=("scenes.0.air.soften_sun: ", "workbench shows no lamps", "render.engine"),
    )
