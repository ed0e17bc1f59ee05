# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh lit by its file's own light, against Lambert's law; what holds no light is refused."""

import numpy as np
import pytest

import rooms_in_formats as rooms
from analytic import look_at
from importing import import_here
from runs import opened_render

import srgb
from noisy_world.render.own_scene import OwnSceneFile, OwnSceneSession
from noisy_world.core.errors import InputError
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.lens import lens_rays
from noisy_world.core.lens import Distortion
from noisy_world.dataset.rendering import open_render, render_options
from noisy_world.render.source import RenderOptions
from noisy_world.dataset.rendering import source_paths
from noisy_world.preset.keys import check_document
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.dataset.plan import make_plan
from noisy_world.sources.blender_process import write_lit_file
from noisy_world.sources.lit_scene import file_of

SIDE = 24
CAMERA = Intrinsics(SIDE, SIDE, SIDE, SIDE, (SIDE - 1) / 2, (SIDE - 1) / 2)
CHANNELS = frozenset({"rgb", "depth", "normal", "instance"})
OPTIONS = RenderOptions(near_m=0.01, far_m=100.0, samples=4, seed=0, threads=1, channels=CHANNELS)
HEIGHT_M = 1.5
EYE = look_at([0.0, 0.0, 3.0], [0.0, 1e-6, 0.0])  # looks down at the floor, which fills the image
MATT = {
    "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0},
    "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}},
}


@pytest.fixture(autouse=True)
def _imports_here(monkeypatch, capfd):
    import_here(monkeypatch, capfd)


def write_floor(path, intensity):
    """A matt floor at z = 0 below a point light of `intensity`, candela, off the middle: as glTF has them, Y up."""
    corners = 5.0 * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    lights = [{"type": "point", "intensity": intensity, "color": [1.0, 1.0, 1.0]}] if intensity else []
    nodes = [{"mesh": 0}]
    if lights:
        punctual = {"KHR_lights_punctual": {"light": 0}}
        nodes.append({"extensions": punctual, "translation": [0.5, HEIGHT_M, 0.25]})
    used = ["KHR_lights_punctual", "KHR_materials_specular"]
    extensions = {"KHR_lights_punctual": {"lights": lights}} if lights else {}
    scenes = [{"nodes": list(range(len(nodes)))}]
    document = rooms.gltf(
        {"POSITION": corners}, MATT, nodes=nodes, scenes=scenes, extensions=extensions, extensionsUsed=used
    )
    path.write_bytes(rooms.glb(*document))
    return path


def seen(file, tmp_path, eye, up=None):
    """Linear light (H, W) and depth that a pose sees."""
    lit = tmp_path / "lit.blend"
    _, objects = write_lit_file(file, lit, up)
    assert [item.number for item in objects] == [1]
    paths = SensorPaths(evenly_stamped(eye[None]))
    with OwnSceneSession(file_of(lit, [0.0], OwnSceneFile), paths, CAMERA, OPTIONS) as session:
        frame = session.frame(paths.request(0))
    assert (frame.image("instance") == 1).all()
    assert np.abs(frame.image("normal") - [0, 0, -1]).max() < 1e-4
    return srgb.linear(frame.rgb[..., 1]), frame.depth_m


def test_a_floor_below_a_lamp_follows_lamberts_law(tmp_path):
    light, depth_m = seen(write_floor(tmp_path / "floor.glb", 2000.0), tmp_path, EYE)
    assert np.abs(depth_m - 3.0).max() < 1e-5
    pixels = (np.arange(SIDE) - CAMERA.cx_px) * 3.0 / CAMERA.fx_px
    across, down = np.meshgrid(pixels, pixels)
    points = EYE[:3, 0] * across[..., None] + EYE[:3, 1] * down[..., None]
    lamp = np.array([0.5, -0.25, HEIGHT_M])  # Z up
    away_m = np.linalg.norm(points * (1, 1, 0) - lamp, axis=-1)
    # Lambert: albedo / pi x intensity x cos / d^2, with 683 lumens to the watt
    law = 0.8 / np.pi * 2000.0 / 683.0 * HEIGHT_M / away_m**3
    assert law.max() > 2.5 * law.min()
    ratio = light / law
    assert abs(ratio.mean() - 1) < 0.01
    assert np.abs(ratio - 1).max() < 0.06  # four samples of a lamp of some size
    # The same file as it is stored, seen from where that is: the same picture.
    stored = np.eye(4)
    stored[:3, :3] = rooms.TO_Y_UP
    again, _ = seen(tmp_path / "floor.glb", tmp_path, stored @ EYE, up="z")
    assert abs(again.mean() / light.mean() - 1) < 0.01
    assert np.abs(again / law - 1).max() < 0.06


def test_a_file_without_lights_is_refused(tmp_path):
    file = write_floor(tmp_path / "dark.glb", 0.0)
    with pytest.raises(InputError, match=r"dark\.glb: holds no lights and nothing that shines") as caught:
        write_lit_file(file, tmp_path / "lit.blend")
    assert "\n" not in str(caught.value)


LENS = {"model": "radial-tangential", "k1": -0.3, "k2": 0.05, "p1": 0.002, "p2": -0.001}
SEEN_BY = {"width": SIDE, "height": SIDE, "fx": SIDE * 0.7, "fy": SIDE * 0.7, "cx": SIDE / 2, "cy": SIDE / 2 - 1}


def lit_preset(tmp_path, distortion, *perturb, speed_m=0.0, samples=64):
    write_floor(tmp_path / "floor.glb", 2000.0)
    poses = np.repeat(EYE[None], 4, axis=0)
    poses[:, 2, 3] += speed_m * np.arange(4)
    (tmp_path / "path.txt").write_text("\n".join(" ".join(map(str, pose.ravel())) for pose in poses))
    scene = {"name": "floor", "mesh": "floor.glb", "light": "scene", "trajectory": "path.txt"}
    document = {
        "scenes": [scene],
        "camera": {**SEEN_BY, "distortion": distortion},
        "render": {"samples": samples},
        "settings": [{"name": "seen", "perturb": list(perturb)}],
        "output": {"layout": "tum", "modalities": ["rgb", "depth", *([] if perturb else ["normal", "instance"])]},
    }
    return check_document(document, tmp_path / "preset.yaml")


def test_through_a_lens_it_follows_lamberts_law_and_no_border_is_missing(tmp_path):
    plan = make_plan(lit_preset(tmp_path, LENS))
    with opened_render(plan) as (opened, sensors):
        frame = opened.frame(sensors.request(0))
        shown = frame.light.show(frame.light.rgb)
    assert np.abs(frame.depth_m - 3.0).max() < 1e-5
    assert (frame.image("instance") == 1).all()
    assert np.abs(frame.image("normal") - [0, 0, -1]).max() < 1e-4
    np.testing.assert_array_equal(shown, frame.rgb)
    rays = lens_rays(plan.renders[0].camera, Distortion("radial-tangential", (-0.3, 0.05, 0.002, -0.001)))
    points = 3.0 * (EYE[:3, 0] * rays.right[..., None] + EYE[:3, 1] * rays.down[..., None])
    away_m = np.linalg.norm(points * (1, 1, 0) - np.array([0.5, -0.25, HEIGHT_M]), axis=-1)
    ratio = frame.light.rgb[..., 1] / (0.8 / np.pi * 2000.0 / 683.0 * HEIGHT_M / away_m**3)
    assert abs(ratio.mean() - 1) < 0.01
    assert np.abs(ratio - 1).max() < 0.03


def test_its_lines_behind_a_lens_are_read_one_after_another(tmp_path):
    """The camera leaves the floor by 0.3 m a frame, looking down: each line is as far as it is by then."""
    plan = make_plan(lit_preset(tmp_path, LENS, {"rolling_shutter": {"readout_ms": 40}}, speed_m=0.3, samples=4))
    (render,) = plan.renders
    sensors = source_paths(plan, render)
    with render.scene.source.prepare(render.camera, print) as prepared:
        options = render_options(plan, render)
        opened = prepared.open(sensors, options, print)
        frame = open_render(prepared, render, sensors, options, print).frame(sensors.request(1))
        times_s = ((np.arange(SIDE) + 0.5) / SIDE - 0.5) * 0.04
        singles = [opened.frame(sensors.request(1).after(float(time_s))) for time_s in times_s]
    rate_hz = 1 / np.diff(sensors.rgb.stamps_s)[0]
    np.testing.assert_allclose(frame.depth_m, np.repeat((3.3 + 0.3 * rate_hz * times_s)[:, None], SIDE, 1), rtol=1e-5)
    rows = np.stack([single.light.rgb[row] for row, single in enumerate(singles)])
    assert -10 * np.log10(np.mean(np.square(frame.light.rgb - rows)) + 1e-12) > 65


def test_a_lit_mesh_is_not_undistorted(tmp_path):
    with pytest.raises(InputError, match=r"camera\.distortion\.undistort: is true, but light"):
        make_plan(lit_preset(tmp_path, {**LENS, "undistort": True}))
