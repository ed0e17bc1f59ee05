# SPDX-License-Identifier: GPL-3.0-or-later
"""Lit frames: environment and lens act on light before the view transform, in both executions and in the preview."""

import json

import bpy
import cv2
import numpy as np
import pytest

from group_tools import IDENTIFIERS, by_groups, step_of
from lit_scenes import LAMPS, lit_hall, make, write_preset
from own_scenes import new_scene, opened, save

from noisy_world.nodes.chain_scene import refresh_chain
from noisy_world.nodes.compositor import Compositor
from noisy_world.nodes.datablocks import muted_output
from noisy_world.render.scene_inspection import open_file
from noisy_world.dataset.identity import render_seed
from noisy_world.core.geometry import Intrinsics
from noisy_world.perturbations.execution import ColourWork
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.execution import on_light

CHAIN = ("fog_depth", "snow_depth", "frost", "lens_drops", "lens_dirt")


def written(folder, settings, backend):
    out = make(write_preset(folder, settings, backend=backend), folder / f"out-{backend}")
    return {path.parts[-4]: cv2.imread(str(path))[..., ::-1] for path in out.glob("*/hall/results/frame*.png")}


ALL = {name: {"severity": 3} for name in CHAIN}
SUN = (4.0, 20.0, 2e5)  # its disk in Blender's sky, at a strength of some tenths
FAINT = {"lens_dirt": {"severity": 3, "glare": 1e-3}}  # so that the sun's glare does not make all white


@pytest.mark.parametrize(("chain", "lamps"), [(ALL, LAMPS), (FAINT, SUN)], ids=["lamps", "sun"])
def test_what_the_viewports_compositor_shows_is_written(chain, lamps, tmp_path):
    lit_hall(tmp_path, lamps=lamps, lighting=lamps == LAMPS)
    storm = json.dumps({"name": "storm", "perturb": [{name: values} for name, values in chain.items()]})
    images = written(tmp_path, storm, "compositor")
    assert np.abs(images["storm"].astype(int) - images["clean"]).mean() > 5
    with opened(tmp_path / "lit.blend", rgb=False, depth=False) as (_, _, intrinsics):
        pass
    open_file(str(tmp_path / "lit.blend"))
    scene = bpy.context.scene
    scene.cycles.seed, scene.render.dither_intensity = render_seed(0), 0
    scene.render.compositor_device, scene.render.compositor_precision = "CPU", "FULL"
    steps = [step_of(name, **values) for name, values in chain.items()]
    refresh_chain(scene, steps, (0, "hall", "storm"), index_of=lambda _: 0, intrinsics=intrinsics, lit=True)
    scene.render.filepath = str(tmp_path / "shown.png")
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGB"
    with muted_output():
        bpy.ops.render.render(write_still=True)
    shown = cv2.imread(str(tmp_path / "shown.png"))[..., ::-1]
    difference = np.abs(shown.astype(int) - images["storm"])
    print("preview against written", difference.max(), difference.mean())
    assert difference.max() <= 1


def street_light(times=1):
    """Scene-linear light (H, W, 3) with small lamps, and depth (H, W) with a sky; so many times as large."""
    rng = np.random.default_rng(1)
    light = (0.3 * rng.random((48, 64, 3)) ** 2 + 0.02).astype(np.float32)
    for place, strength in enumerate(LAMPS):
        light[20 + 8 * place : 23 + 8 * place, 12 + 18 * place : 15 + 18 * place] = strength
    depth_m = np.tile(np.linspace(2, 60, 64, dtype=np.float32), (48, 1))
    depth_m[:12] = 0
    return (np.repeat(np.repeat(item, times, axis=0), times, axis=1) for item in (light, depth_m))


PATTERNS = {
    "rain": ("rain_depth", {"severity": 5}),
    "rain that drifts": ("rain_depth", {"severity": 3, "temporal": "drift", "coarse": True}),
    "snow by depth": ("snow_depth", {"severity": 5, "coarse": True}),
    "uneven fog": ("fog_depth", {"severity": 2, "unevenness": 0.6, "falloff_m": 4.0, "coarse": True}),
    "haze": ("haze", {"severity": 5}),
    "fog": ("fog", {"severity": 3}),
    "fog that flows": ("fog", {"severity": 5, "temporal": "drift"}),
    "snow": ("snow", {"severity": 3}),
    "quick snow": ("snow", {"severity": 4, "temporal": "drift", "coarse": True}),
    "water": ("spatter", {"severity": 2, "temporal": "drift"}),
    "mud": ("spatter", {"severity": 5}),
    "frost": ("lens_frost", {"severity": 3}),
    "drops": ("lens_drops", {"severity": 3}),
    "dirt": ("lens_dirt", {"severity": 5}),
}


def test_random_patterns_are_the_same_picture_in_both_executions():
    light, depth_m = street_light(2)
    height, width = depth_m.shape
    camera = Intrinsics(width, height, 64.0, 64.0, (width - 1) / 2, (height - 1) / 2)
    chains = {label: [step_of(name, **values)] for label, (name, values) in PATTERNS.items()}
    with Compositor((width, height), chains, width, camera, lit=True) as compositor:
        found, _ = compositor.evaluate(light, dict.fromkeys(chains, (5, IDENTIFIERS)), depth_m)
    where = FrameContext(5, IDENTIFIERS, intrinsics=camera, read_depth_m=lambda: depth_m)
    for label, steps in chains.items():
        wanted = on_light(ColourWork.of(steps, where), light)
        relative = np.abs(found[label] - wanted) / wanted
        print(label, relative.max())
        assert np.abs(wanted - light).mean() > 1e-3, label
        assert relative.max() < 1e-3, label


QUICK = ("haze", "bloom", "defocus_blur", "glass_blur", "motion_blur", "zoom_blur", "elastic_transform")


def test_both_executions_give_the_same_light_of_any_brightness():
    light, depth_m = street_light()
    height, width = depth_m.shape
    camera = Intrinsics(width, height, 50.0, 50.0, (width - 1) / 2, (height - 1) / 2)
    air, lens = ("fog_depth", "haze", "frost"), ("lens_dirt", "lens_drops", "bloom", "defocus_blur", "defocus_depth")
    names = (*air, *lens, "gaussian_blur", "glass_blur", "motion_blur", "zoom_blur", "elastic_transform")
    chains = {name: [step_of(name, severity=3)] for name in names}
    chains |= {f"{name}, quickly": [step_of(name, severity=4, coarse=True)] for name in QUICK}
    with Compositor((width, height), chains, width, camera, lit=True) as compositor:
        found, _ = compositor.evaluate(light, dict.fromkeys(chains, (5, IDENTIFIERS)), depth_m)
    where = FrameContext(5, IDENTIFIERS, intrinsics=camera, read_depth_m=lambda: depth_m)
    for name, steps in chains.items():
        wanted = on_light(ColourWork.of(steps, where), light)
        relative = np.abs(found[name] - wanted) / wanted
        print(name, relative.max())
        assert relative.max() < 1e-3, name
        assert min(found[name].min(), wanted.min()) >= 0, name


def test_a_lens_spreads_light_itself_so_a_lamp_stays_a_lamp():
    light = np.full((21, 21, 3), 0.1, np.float32)
    light[10, 10] = 100
    (step,) = [step_of("defocus_blur", radius_px=4, alias_sigma_px=0)]
    made = on_light(ColourWork.of([step], FrameContext(0, IDENTIFIERS)), light)
    rows, columns = np.mgrid[-10:11, -10:11]
    disk = rows**2 + columns**2 <= 16
    assert np.abs(made[disk] - (0.1 + 99.9 / disk.sum())).max() < 1e-4  # as bright as the disk has pixels
    assert np.abs(made[~disk] - 0.1).max() < 1e-4


def test_sensors_act_on_what_the_view_transform_shows(tmp_path):
    lit_hall(tmp_path)
    noise, fog = "{speckle_noise: {severity: 2}}", "{fog_depth: {visibility_m: 1.0e5}}"
    settings = f"{{name: noise, stream: s, perturb: [{noise}]}}, {{name: both, stream: s, perturb: [{fog}, {noise}]}}"
    images = written(tmp_path, settings, "reference")
    both = images["both"].astype(int)
    assert np.abs(both - images["noise"]).max() <= 1  # fog that nobody sees: the same noise on the same display values
    assert np.abs(both - images["clean"]).mean() > 3


def test_a_group_outdoors_takes_the_other_table(tmp_path):
    light, depth_m = street_light()
    reach = {1: 1.0, 2: 0.4, 5: 3.0}
    table = {each: step_of("fog_depth", severity=each, outdoors=True, reach=far) for each, far in reach.items()}
    nodes = {f"s{each}": ("fog_depth", {"Severity": each, "Outdoors": True, "Reach": reach[each]}) for each in table}
    found = by_groups(nodes, light, tmp_path, depth_m=depth_m)
    for severity, step in table.items():
        wanted = on_light(ColourWork.of([step], FrameContext(0, IDENTIFIERS, read_depth_m=lambda: depth_m)), light)
        assert np.abs(found[f"s{severity}"] / wanted - 1).max() < 1e-3


@pytest.mark.parametrize("shader", ["glass", "principled"])
def test_weather_sees_through_glass_and_the_sensor_does_not(tmp_path, shader):
    scene = new_scene(samples=1)
    scene.frame_end = 1
    bpy.ops.mesh.primitive_plane_add(size=0.3, location=(0.2, 1.5, 0.1), rotation=(np.pi / 2, 0, 0))
    material = bpy.data.materials.new("Pane")
    bpy.context.object.data.materials.append(material)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    if shader == "glass":
        links.new(nodes.new("ShaderNodeBsdfGlass").outputs[0], nodes["Material Output"].inputs["Surface"])
    else:
        nodes["Principled BSDF"].inputs["Transmission Weight"].default_value = 1
    path = save(tmp_path, "pane")
    with opened(path, through_glass=True) as (session, paths, _):
        frame = session.frame(paths.request(0))
        again = session.frame(paths.request(0))
    bpy.data.objects.remove(bpy.data.objects["Plane"])
    with opened(save(tmp_path, "open")) as (session, paths, _):
        free_m = session.frame(paths.request(0)).depth_m
    pane = frame.depth_m < free_m - 0.1
    assert 0.05 < pane.mean() < 0.9
    apart, wall = np.abs(frame.behind_glass_m / free_m - 1), free_m > 3
    assert (pane & wall).any()
    assert apart[wall].max() < 1e-5
    assert apart.max() < 1e-3  # at the ball's edge, where a shift of a pixel's ten thousandth shows
    assert np.array_equal(frame.behind_glass_m, again.behind_glass_m)
    assert np.array_equal(frame.rgb, again.rgb)
    assert np.array_equal(frame.depth_m, again.depth_m)
