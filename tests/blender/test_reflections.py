# SPDX-License-Identifier: GPL-3.0-or-later
"""What surfaces of a scene of one's own mirror, seen through fog and haze: by Koschmieder's law along the whole way."""

import json
import math

import bpy
import numpy as np
import pytest

from cases import cases
from own_scenes import opened, save
from refusals import refused
from runs import planned

from noisy_world.core.frame_request import FrameRequest
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry
from noisy_world.perturbations.execution import ColourWork, on_light
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.render.own_stills import (
    OwnStill,
    StillRequest,
    _images_of,
    read_frames,
    render_own_still,
    write_request,
)
from noisy_world.sources.blend import reflections_problem

TO_MIRROR_M, BEHIND_M = 2.0, 5.0
GIVEN_BACK, SHONE = 0.6, 0.5  # by the mirror, and by the wall that it shows
SKY = 0.3
AIR = 0.25  # linear, that sRGB writes as 0.5371
ENCODED_AIR = 1.055 * AIR ** (1 / 2.4) - 0.055


def mirror_scene():
    """A camera before a mirror whose left half shows a shining wall behind it, and whose right half shows the sky."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 16, 8
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    scene.frame_start = scene.frame_end = 1
    world = scene.world = bpy.data.worlds.new("Sky")
    world.node_tree.nodes["Background"].inputs[0].default_value = (SKY, SKY, SKY, 1)
    for name, place, size, kind in (
        ("Mirror", (0, TO_MIRROR_M, 0), 4, "ShaderNodeBsdfGlossy"),
        ("Wall", (-50, TO_MIRROR_M - BEHIND_M, 0), 100, "ShaderNodeEmission"),
    ):
        bpy.ops.mesh.primitive_plane_add(size=size, location=place, rotation=(math.pi / 2, 0, 0))
        material = bpy.data.materials.new(name)
        tree = material.node_tree
        shader = tree.nodes.new(kind)
        shader.inputs["Color"].default_value = (*[GIVEN_BACK if name == "Mirror" else SHONE] * 3, 1)
        if name == "Mirror":
            shader.inputs["Roughness"].default_value = 0
        tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
        bpy.context.object.data.materials.append(material)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    lamp.location, lamp.data.energy = (0, 1, 3), 100
    scene.collection.objects.link(lamp)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.rotation_euler, camera.data.lens = (math.pi / 2, 0, 0), 200
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


@pytest.fixture(scope="module")
def mirror(tmp_path_factory):
    """The file of that scene."""
    mirror_scene()
    return save(tmp_path_factory.mktemp("mirror"), "mirror")


@pytest.fixture(scope="module")
def frames(mirror):
    """A frame without reflections, and two of the same pose with them."""
    found = []
    for mirrors in (False, True):
        with opened(mirror, through_glass=True, mirrors=mirrors) as (session, paths, _):
            request = FrameRequest(0, 0.0, paths.rgb.c2w[0], paths.rgb.c2w[0])
            found += [session.frame(request) for _ in range(2 if mirrors else 1)]
    return found


def test_colour_is_what_it_is_without_and_materials_are_given_back(frames):
    plain, first, second = frames
    assert plain.light.mirrored is None
    np.testing.assert_array_equal(first.light.rgb, plain.light.rgb)
    np.testing.assert_array_equal(second.light.rgb, plain.light.rgb)
    np.testing.assert_array_equal(first.light.mirrored.distance_m, second.light.mirrored.distance_m)


HALVES = {"wall": (slice(1, 7), SHONE), "sky": (slice(9, 15), SKY)}


def through(step, frame, mirrored):
    steps = parse_steps([step], ConfigPath("steps"), registry())
    work = ColourWork.of(steps, FrameContext(0, (1, "mirror"), lit=True, read_depth_m=lambda: frame.depth_m))
    return on_light(work, frame.light.rgb, mirrored)


@cases(
    ("step", "rates_per_m", "sky_seen"),
    [
        ({"fog_depth": {"visibility_m": 10}}, [math.log(20) / 10] * 3, 0.0),
        ({"fog_depth": {"visibility_m": 4, "leave_sky": True}}, [math.log(20) / 4] * 3, 1.0),
        (
            {"haze": {"visibility_m": 8, "angstrom": 1.0, "void_m": 1e5}},
            [math.log(20) / 8 * 550 / wave for wave in (611.4, 549.1, 464.2)],
            0.0,
        ),
    ],
)
def test_light_of_a_mirror_has_come_the_whole_way_through_the_air(frames, step, rates_per_m, sky_seen):
    ((name, given),) = step.items()
    air = {"air": "colour"} | dict.fromkeys(("air_red", "air_green", "air_blue"), ENCODED_AIR)
    frame = frames[1]
    made = through({name: given | air | {"lamps": 0}}, frame, frame.light.mirrored)
    rates = np.array(rates_per_m)
    before = np.exp(-rates * TO_MIRROR_M)
    for half, (columns, shone) in HALVES.items():
        behind = np.exp(-rates * BEHIND_M) if half == "wall" else sky_seen
        mirrored = GIVEN_BACK * (shone * behind + AIR * (1 - behind))
        expected = mirrored * before + AIR * (1 - before)
        np.testing.assert_allclose(made[:, columns].mean(axis=(0, 1)), expected, rtol=0.01)
    assert np.abs(through({name: given | air | {"lamps": 0}}, frame, None) - made).max() > 0.02


def test_a_mask_keeps_what_is_mirrored_as_it_is_where_it_says_so(frames):
    frame = frames[1]
    step = {"fog_depth": {"visibility_m": 5, "mix": 0}}
    np.testing.assert_allclose(through(step, frame, frame.light.mirrored), frame.light.rgb, atol=1e-6)


def test_a_still_has_what_its_process_wrote(tmp_path):
    still = OwnStill(
        1.0, None, True, Intrinsics(16, 8, 90, 90, 7.5, 3.5), None, None, None, 0, False, 0.5, mirrors=True
    )
    made = render_own_still(mirror_scene(), still)
    write_request(StillRequest("Scene", {3: still}), tmp_path)
    np.savez(tmp_path / "frames.npz", **_images_of(3, made))
    (read,) = read_frames(tmp_path).values()
    for name in ("share", "reflectance", "distance_m", "sky"):
        np.testing.assert_array_equal(getattr(read.light.mirrored, name), getattr(made.light.mirrored, name))
    assert np.median(made.light.mirrored.distance_m[:, :7]) == pytest.approx(BEHIND_M, rel=0.01)


def source_of(mirror, air, render=None):
    path = mirror.with_name("preset.yaml")
    entry = {"name": "mirror", "blend": mirror.name, "air": air}
    path.write_text(json.dumps({"scenes": [entry], "render": render or {}}))
    return planned(path).scenes[0].source


def test_reflections_are_in_the_identity_where_they_are_told(mirror):
    without, told = (source_of(mirror, {"reflections": on}) for on in (False, True))
    assert told.hashes() == {**without.hashes(), "reflections": 1}
    assert (without.file.mirrors, told.file.mirrors) == (False, True)
    assert "air.reflections" in told.capabilities.at_once


def test_what_cannot_tell_reflections_is_refused(mirror):
    names = ("scenes.0.air.reflections: is true", "not eevee", "render.engine: cycles")
    refused(lambda: source_of(mirror, {"reflections": True}, {"engine": "eevee"}), names=names)
    assert "compositor" in reflections_problem("cycles", composited=True)
    assert reflections_problem("cycles", composited=False) == ""
