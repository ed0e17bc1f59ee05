# SPDX-License-Identifier: GPL-3.0-or-later
"""Render five small places, lit otherwise than the street, on which the looks of weather and glass are judged.

    python headless/pictures/places.py FOLDER [--only harbour ...] [--size 384x216] [--frames 0 3 6] [--samples 16]

A place's folder has what `street.py` writes: scene-linear EXR files with depth, and cameras.json.
"""

import argparse
import math
import random
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import itertools

import bpy
import numpy as np
from numpy.typing import NDArray

from noisy_world.nodes.datablocks import cycles as cycles_of
from noisy_world.nodes.datablocks import muted_output
from noisy_world.render.mesh_session import add_camera, key_trajectory, set_intrinsics
from pictures.street import (
    FPS,
    LitFrame,
    Street,
    StreetCamera,
    intrinsics_of,
    set_look,
    size,
    write_cameras,
    write_frame,
)
from pictures.street_models import Point, Solid, add_car, add_lamp
from pictures.street_surfaces import Colour, Shader, Value, brickwork, glowing, grained, new_shader, plain, wet

SEED = 11  # of what is drawn: crates, trees, boats
CLIP_M = (0.05, 400.0)
DUST = "Dust"
FRAMES = tuple(range(0, 24, 3))  # a strip of eight


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="places.py", description="Render five places on which looks are judged.")
    parser.add_argument("folder", type=Path, help="the folder to write into")
    parser.add_argument("--only", nargs="+", choices=list(PLACES), default=list(PLACES), help="places")
    parser.add_argument("--size", type=size, default=(384, 216), help="width x height in pixels, such as 384x216")
    parser.add_argument("--frames", type=int, nargs="+", default=list(FRAMES), help="of the path, 24 a second")
    parser.add_argument("--samples", type=int, default=16, help="of a pixel, before it is denoised")
    options = parser.parse_args(arguments)
    for name in options.only:
        folder = options.folder / name
        folder.mkdir(parents=True, exist_ok=True)
        with muted_output():
            bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        place = build_place(name, options.size, max(options.frames) + 1)
        write_cameras(folder / "cameras.json", options.size, options.frames, place.c2w.tolist())
        with StreetCamera(place, options.samples) as camera:
            for number in options.frames:
                write_frame(folder / f"{number:04}.exr", _frame(camera, place.scene, number, options.samples))
        print(f"wrote {folder}", flush=True)
    return 0


def _frame(camera: StreetCamera, scene: bpy.types.Scene, number: int, samples: int) -> LitFrame:
    """Render a frame. Where dust is in the air its depth is that of what is behind, rendered without the dust."""
    frame = camera.frame(number)
    dust = scene.objects.get(DUST)
    if dust is None:
        return frame
    dust.hide_render, cycles_of(scene).samples = True, 1
    clear = camera.frame(number)
    dust.hide_render, cycles_of(scene).samples = False, samples
    return replace(frame, depth_m=clear.depth_m)


# --- a place: what stands in it, its light, and a camera that walks ---


@dataclass(frozen=True)
class Place:
    """A place. fill: adds what stands in it. sky: makes its world. begin: where the camera begins, metres.

    heading_deg: where it looks and goes, from the y axis to the right. speed_m_s: how fast.
    """

    fill: Callable[[bpy.types.Scene], None]
    sky: Callable[[], bpy.types.World]
    begin: Point
    heading_deg: float = 0.0
    speed_m_s: float = 0.8


def build_place(name: str, size_px: tuple[int, int], frames: int) -> Street:
    """Add a place to the open file's scene, which should be empty; frames: of its path, from frame 0."""
    place = PLACES[name]
    scene = bpy.context.scene
    place.fill(scene)
    scene.world = place.sky()
    camera = add_camera(scene, "Camera")
    set_intrinsics(scene, camera, intrinsics_of(size_px), near_m=CLIP_M[0], far_m=CLIP_M[1])
    path = walk(place, frames)
    key_trajectory(scene, camera, path)
    scene.render.fps = FPS
    set_look(scene)
    return Street(scene, camera, path)


def walk(place: Place, frames: int) -> NDArray[np.float64]:
    """Return a walker's path (N, 4, 4): straight ahead, with a sway; camera-to-world, OpenCV axes, metres."""
    seconds = np.arange(frames) / FPS
    poses = np.tile(np.eye(4), (frames, 1, 1))
    turn = np.radians(place.heading_deg + 2.0 * np.sin(0.8 * seconds))
    zero = np.zeros(frames)
    ahead = np.stack([np.sin(turn), np.cos(turn), zero], -1)
    right = np.stack([np.cos(turn), -np.sin(turn), zero], -1)
    poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2] = right, np.cross(ahead, right), ahead
    poses[:, :3, 3] = np.array(place.begin) + place.speed_m_s * seconds[:, None] * ahead[:1]
    poses[:, 2, 3] += 0.012 * np.sin(2 * np.pi * 1.8 * seconds)
    return poses


def grey(value: float) -> Colour:
    """Return a grey."""
    return (value, value, value)


def _link(scene: bpy.types.Scene, item: bpy.types.Object) -> None:
    scene.collection.objects.link(item)


def _add(scene: bpy.types.Scene, name: str, solid: Solid, *materials: bpy.types.Material) -> None:
    _link(scene, solid.to_object(name, {material.name: material for material in materials}))


def _sun(scene: bpy.types.Scene, power_w_m2: float, height_deg: float, from_deg: float, colour: Colour) -> None:
    """Add a sun. from_deg: where it stands, from the y axis to the right."""
    data = bpy.data.lights.new("Sun", "SUN")
    assert isinstance(data, bpy.types.SunLight)
    data.energy, data.angle, data.color = power_w_m2, math.radians(0.53), colour
    item = bpy.data.objects.new("Sun", data)
    item.rotation_euler = (math.radians(90 - height_deg), 0.0, math.radians(180 - from_deg))
    _link(scene, item)


def _lamp(scene: bpy.types.Scene, place: Point, power_w: float, colour: Colour) -> None:
    data = bpy.data.lights.new("Lamp", "POINT")
    assert isinstance(data, bpy.types.PointLight)
    data.energy, data.color, data.shadow_soft_size = power_w, colour, 0.12
    item = bpy.data.objects.new("Lamp", data)
    item.location, item.visible_camera = place, False
    _link(scene, item)


def _sky(name: str, low: Colour, high: Colour, strength: float, clouds: float = 0.0) -> bpy.types.World:
    """Return a sky from one colour at the horizon to another above. clouds: how white they are."""
    world = bpy.data.worlds.new(name)
    assert world.node_tree is not None
    shader = Shader(world.node_tree)
    x, y, z = shader.parts(shader.add("TexCoord", output="Generated"))
    height = shader.math("MAXIMUM", z, 0.0)
    tone: Value = shader.mix(shader.between(height, 0.0, 0.6), low, high)
    if clouds:
        far = shader.math("ADD", height, 0.12)
        where = shader.add("CombineXYZ", {0: shader.math("DIVIDE", x, far), 1: shader.math("DIVIDE", y, far)})
        tone = shader.mix(shader.between(shader.noise(where, 1.0, 6.0), 0.5, 0.75, 0.0, clouds), tone, (0.9, 0.9, 0.92))
    shader.end(shader.add("Background", {"Color": tone, "Strength": strength}), "OutputWorld")
    return world


# --- a workshop: brick walls, tall windows to the sun, benches and crates, dust in the light ---


def _workshop(scene: bpy.types.Scene) -> None:
    draw = random.Random(SEED)  # noqa: S311  where crates stand
    room, things = Solid(), Solid()
    wide, far, high = 4.2, 13.0, 4.4
    room.face([(-wide, -2, 0), (wide, -2, 0), (wide, far, 0), (-wide, far, 0)], "floor")
    room.face([(-wide, far, high), (wide, far, high), (wide, -2, high), (-wide, -2, high)], "whitewash")
    room.face([(-wide, far, 0), (wide, far, 0), (wide, far, high), (-wide, far, high)], "bricks")
    room.face([(wide, -2, 0), (-wide, -2, 0), (-wide, -2, high), (wide, -2, high)], "bricks")
    room.face([(-wide, -2, 0), (-wide, far, 0), (-wide, far, high), (-wide, -2, high)], "bricks")
    windows = (1.2, 4.2, 7.2, 10.2)
    edges = [-2.0, *(at + side for at in windows for side in (-0.7, 0.7)), far]
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        room.box((wide, begin, 0), (wide + 0.3, end, high), "bricks")
    for at in windows:
        room.box((wide, at - 0.7, 0), (wide + 0.3, at + 0.7, 1.1), "bricks")
        room.box((wide, at - 0.7, 3.7), (wide + 0.3, at + 0.7, high), "bricks")
        for k in range(1, 3):
            room.box(
                (wide + 0.1, at - 0.7 + k * 0.467 - 0.02, 1.1), (wide + 0.14, at - 0.7 + k * 0.467 + 0.02, 3.7), "iron"
            )
        for k in range(1, 4):
            room.box(
                (wide + 0.1, at - 0.7, 1.1 + k * 0.65 - 0.02), (wide + 0.14, at + 0.7, 1.1 + k * 0.65 + 0.02), "iron"
            )
    for k in range(6):
        things.box((-wide, 0.4 + 2.2 * k, high - 0.35), (wide, 0.6 + 2.2 * k, high), "wood")
    for y in (3.0, 6.5, 10.0):
        things.box((-3.6, y, 0.82), (-2.2, y + 2.2, 0.9), "wood")
        for x, at in ((-3.5, y + 0.1), (-2.3, y + 0.1), (-3.5, y + 2.1), (-2.3, y + 2.1)):
            things.box((x - 0.05, at - 0.05, 0), (x + 0.05, at + 0.05, 0.82), "wood")
        things.tube([(-3.0, y + 0.6, 0.9), (-3.0, y + 0.6, 1.3)], (0.12, 0.1), "iron")
        things.ball((-2.6, y + 1.5, 1.02), 0.12, "paint", sides=16)
    for _ in range(9):
        x, y, side = draw.uniform(1.6, 3.4), draw.uniform(2.0, 12.0), draw.uniform(0.35, 0.7)
        things.box((x, y, 0), (x + side, y + side, side), draw.choice(["wood", "paint", "iron"]))
    walls = brickwork("bricks", (0.2, 0.07, 0.045), (0.12, 0.045, 0.03))
    _add(
        scene,
        "Room",
        room,
        walls,
        plain("whitewash", (0.5, 0.48, 0.44), 0.9),
        plain("floor", (0.16, 0.15, 0.14), 0.5),
        plain("iron", (0.03, 0.03, 0.035), 0.4, 0.8),
    )
    _add(
        scene,
        "Things",
        things,
        grained("wood", (0.08, 0.04, 0.02), (0.22, 0.12, 0.055), (3.0, 40.0, 40.0)),
        bpy.data.materials["iron"],
        plain("paint", (0.03, 0.12, 0.22), 0.3, 0.0, 0.6),
    )
    _sun(scene, 32.0, 33.0, 62.0, (1.0, 0.84, 0.62))
    _dust(scene, (-wide + 0.01, -1.99, 0.01), (wide - 0.01, far - 0.01, high - 0.01), 0.03)


def _dust(scene: bpy.types.Scene, low: Point, high: Point, per_m: float) -> None:
    """Add even dust in the air, which makes beams of what light comes through windows."""
    solid = Solid()
    solid.box(low, high, "dust")
    material, shader = new_shader("dust")
    scatter = shader.add("VolumeScatter", {"Color": (1.0, 1.0, 1.0), "Density": per_m, "Anisotropy": 0.35})
    output = shader.tree.nodes.new("ShaderNodeOutputMaterial")
    shader.give(output.inputs["Volume"], scatter)
    _add(scene, DUST, solid, material)


# --- a harbour: water, boats, cranes, sheds of brick across the basin, a low sun ---


def _harbour(scene: bpy.types.Scene) -> None:
    draw = random.Random(SEED)  # noqa: S311  boats
    solid = Solid()
    solid.face([(-80, -10, 0), (80, -10, 0), (80, 150, 0), (-80, 150, 0)], "water")
    solid.box((-3.5, -10, -2), (1.4, 26, 0.9), "stone")
    solid.box((-80, 62, -2), (80, 100, 1.0), "stone")
    for k, x in enumerate(range(-44, 44, 11)):
        tall = 6.0 + 1.5 * (k % 3)
        solid.box((x, 66, 1.0), (x + 9.5, 76, tall), "bricks")
        roof = [(x - 0.3, 65.7, tall), (x + 9.8, 65.7, tall), (x + 4.75, 66, tall + 3), (x + 4.75, 66, tall + 3)]
        solid.face(roof[:3], "slate")
        for j in range(3):
            solid.box((x + 1.2 + 2.8 * j, 65.9, 2.2), (x + 2.6 + 2.8 * j, 66.0, 4.2), "glass")
    for x in (-26.0, 6.0, 30.0):
        for dx, dy in ((-2, 0), (2, 0), (-2, 3), (2, 3)):
            solid.tube([(x + dx, 63 + dy, 1), (x + dx * 0.6, 63 + dy, 13)], (0.3, 0.25), "red")
        solid.box((x - 1.6, 62.5, 13), (x + 1.6, 66.5, 15), "red")
        solid.tube([(x, 64, 15), (x + 10, 58, 26)], (0.35, 0.2), "red")
        solid.tube([(x + 10, 58, 26), (x + 10, 58, 6)], (0.04, 0.04), "iron")
    for k in range(9):
        x, y = (3.6, -6.5)[k % 2] + draw.uniform(-0.4, 0.4) + (k // 6) * 7, 5 + 4.6 * k
        _boat(solid, x, y, draw.uniform(4.5, 7.0), draw.choice(["white", "blue", "red"]))
    for y in (3.0, 8.0, 13.0, 18.0):
        solid.tube([(1.1, y, 0.9), (1.1, y, 1.35)], (0.14, 0.17), "iron")
    for y in (6.0, 10.5):
        solid.box((-2.8, y, 0.9), (-1.6, y + 1.2, 1.8), "wood")
        solid.tube([(-0.4, y + 2, 0.9), (-0.4, y + 2, 1.7)], (0.3, 0.3), "blue", sides=14)
    water, shader = new_shader("water")
    waves = shader.noise(shader.add("Mapping", {"Vector": shader.position(), "Scale": (0.9, 2.2, 1.0)}), 1.0, 5.0)
    bump = shader.add("Bump", {"Strength": 0.3, "Distance": 0.12, "Height": waves})
    shader.surface({"Base Color": (0.012, 0.03, 0.03), "Roughness": 0.06, "IOR": 1.33, "Normal": bump})
    _add(
        scene,
        "Harbour",
        solid,
        water,
        brickwork("bricks", (0.2, 0.07, 0.045), (0.13, 0.05, 0.035)),
        plain("stone", (0.3, 0.28, 0.25), 0.8),
        plain("slate", (0.05, 0.055, 0.065), 0.6),
        plain("glass", (0.02, 0.025, 0.03), 0.05),
        plain("red", (0.35, 0.03, 0.02), 0.4),
        plain("iron", grey(0.02), 0.4),
        plain("white", (0.7, 0.7, 0.68), 0.35),
        plain("blue", (0.02, 0.08, 0.2), 0.35),
        grained("wood", (0.08, 0.04, 0.02), (0.24, 0.13, 0.06), (3.0, 40.0, 40.0)),
    )
    _sun(scene, 5.0, 14.0, -48.0, (1.0, 0.7, 0.42))


def _boat(solid: Solid, x_m: float, y_m: float, long_m: float, paint: str) -> None:
    """Add a sailing boat whose bow points along y."""
    rows = []
    for k in range(9):
        share = k / 8
        half = 0.9 * (1 - share**2.2) ** 0.8 + 0.02
        rows.append(
            [
                (x_m + half * side * wide, y_m + share * long_m, z)
                for side, wide, z in (
                    (-1, 1.0, 0.85 + 0.25 * share),
                    (-1, 0.7, 0.1),
                    (1, 0.7, 0.1),
                    (1, 1.0, 0.85 + 0.25 * share),
                )
            ]
        )
    solid.grid(rows, paint)
    solid.face([rows[0][3], rows[0][2], rows[0][1], rows[0][0]], paint)
    for first, second in itertools.pairwise(rows):
        solid.face([first[0], first[3], second[3], second[0]], "wood")
    solid.box((x_m - 0.5, y_m + 0.3 * long_m, 0.85), (x_m + 0.5, y_m + 0.55 * long_m, 1.35), "white")
    solid.tube([(x_m, y_m + 0.6 * long_m, 0.8), (x_m, y_m + 0.6 * long_m, 0.8 + 1.25 * long_m)], (0.06, 0.04), "white")
    solid.tube([(x_m, y_m + 0.6 * long_m, 1.7), (x_m, y_m + 0.1 * long_m, 1.75)], (0.06, 0.05), "white")


# --- a snowfield at noon: bright snow, a hut, spruces, a fence ---


def _snowfield(scene: bpy.types.Scene) -> None:
    draw = random.Random(SEED)  # noqa: S311  spruces
    ground, things = Solid(), Solid()
    side = np.concatenate([np.arange(-8, 8, 0.5), np.geomspace(8, 150, 26)])
    xs = np.unique(np.concatenate([-side, side]))
    ys = np.concatenate([np.arange(-6, 14, 0.5), np.geomspace(14, 220, 36)])
    ground.grid([[(float(x), float(y), _snow_m(float(x), float(y))) for x in xs] for y in ys], "snow")
    for _ in range(60):
        x, y = draw.uniform(-70, 70), draw.uniform(16, 130)
        if abs(x) > 4 + 0.08 * y:
            _spruce(things, x, y, _snow_m(x, y), draw.uniform(5, 11))
    for k in range(16):
        y, z = 3.0 + 2.2 * k, _snow_m(-3.2, 3.0 + 2.2 * k)
        things.box((-3.26, y - 0.06, z - 0.3), (-3.14, y + 0.06, z + 1.05), "wood")
        for up in (0.45, 0.85):
            things.box((-3.22, y, z + up), (-3.18, y + 2.2, z + up + 0.1), "wood")
    z = _snow_m(6.5, 20.0) - 0.3
    things.box((4.5, 18, z), (9.0, 22.5, z + 2.7), "wood")
    for x, sign in ((4.1, 1), (9.4, -1)):
        edge = [(x, 17.6, z + 2.5), (x, 22.9, z + 2.5), (6.75, 22.9, z + 4.6), (6.75, 17.6, z + 4.6)]
        things.face(edge if sign > 0 else edge[::-1], "snow")
        things.face([(6.75, 17.9, z + 4.4), (4.5, 17.9, z + 2.6), (9.0, 17.9, z + 2.6)], "wood")
    things.box((6.2, 17.95, z + 0.3), (7.2, 18.0, z + 2.2), "dark")
    things.box((7.8, 17.95, z + 1.1), (8.5, 18.0, z + 1.8), "glass")
    material, shader = new_shader("snow")
    bump = shader.add("Bump", {"Strength": 0.5, "Distance": 0.05, "Height": shader.noise(shader.position(), 3.0, 8.0)})
    shader.surface({"Base Color": (0.86, 0.88, 0.92), "Roughness": 0.6, "Normal": bump})
    _add(scene, "Ground", ground, material)
    _add(
        scene,
        "Things",
        things,
        material,
        plain("dark", (0.05, 0.025, 0.015), 0.7),
        plain("glass", grey(0.02), 0.05),
        grained("wood", (0.06, 0.035, 0.02), (0.17, 0.1, 0.055), (3.0, 40.0, 40.0)),
        grained("needles", (0.006, 0.02, 0.01), (0.02, 0.05, 0.025), (20.0, 20.0, 20.0)),
    )
    _sun(scene, 4.2, 38.0, 105.0, (1.0, 0.96, 0.9))


def _snow_m(x: float, y: float) -> float:
    far = max(y - 30.0, 0.0)
    hills = 0.0011 * far**1.6 * (1 + 0.6 * math.sin(0.03 * x + 1.0))
    return 0.25 * math.sin(0.21 * x + 0.5) * math.sin(0.17 * y) + 0.05 * math.sin(1.1 * x + 0.7 * y) + hills - 0.1


def _spruce(solid: Solid, x_m: float, y_m: float, z_m: float, tall_m: float) -> None:
    solid.tube([(x_m, y_m, z_m - 0.3), (x_m, y_m, z_m + 0.3 * tall_m)], (0.16, 0.12), "wood")
    for k in range(5):
        low, wide = 0.15 + 0.17 * k, 0.21 * tall_m * (1 - 0.17 * k)
        path = [(x_m, y_m, z_m + low * tall_m), (x_m, y_m, z_m + min(low + 0.3, 1.0) * tall_m)]
        solid.tube(path, (wide, 0.02), "needles", sides=11)
        path = [(x_m, y_m, z_m + (low + 0.13) * tall_m), (x_m, y_m, z_m + min(low + 0.31, 1.01) * tall_m)]
        solid.tube(path, (0.59 * wide, 0.02), "snow", sides=9)


# --- a car park at night: wet asphalt, cars, a few lamps, a lit entrance ---


def _car_park(scene: bpy.types.Scene) -> None:
    solid, parts = Solid(), Solid()
    solid.face([(-60, -10, 0), (60, -10, 0), (60, 90, 0), (-60, 90, 0)], "asphalt")
    for x in range(-18, 19, 3):
        for y in (7.0, 22.0):
            solid.box((x - 0.05, y, 0), (x + 0.05, y + 5, 0.004), "paint")
    paints = ("car red", "car silver", "car blue", "car dark")
    spots = ((-7.5, 9.5), (-1.5, 9.5), (4.5, 9.5), (10.5, 9.6), (-4.5, 24.5), (1.5, 24.6), (7.5, 24.5))
    bodies = [Solid() for _ in spots]
    for k, (x, y) in enumerate(spots):
        add_car(bodies[k], parts, x, y, paints[k % 4])
    for x, y in ((-9.0, 14.5), (3.0, 14.5), (15.0, 14.5), (-3.0, 32.0), (10.0, 32.0)):
        add_lamp(solid, x, y)
        _lamp(scene, (x, y, 3.6), 420.0, (1.0, 0.72, 0.42))
    solid.box((-24, 44, 0), (26, 58, 9), "wall")
    for k in range(12):
        for floor in (1, 2):
            lit = 4.0 if (k * 7 + floor * 3) % 4 == 0 else 0.0
            solid.box(
                (-22 + 4 * k, 43.95, 3.2 * floor),
                (-20 + 4 * k, 44, 3.2 * floor + 1.7),
                "shine" if lit else "glass",
                0.4 * lit,
            )
    solid.box((-4, 43.9, 0), (6, 44, 2.7), "shine", 2.5)
    solid.box((-4, 43.8, 3.0), (6, 44, 3.9), "sign", 5.0)
    _lamp(scene, (1.0, 41.0, 2.6), 200.0, (0.85, 0.95, 1.0))
    _material, shader = new_shader("asphalt")
    place = shader.position()
    wet(
        shader,
        shader.mix(shader.noise(place, 60.0, 2.0), grey(0.03), grey(0.07)),
        shader.noise(place, 80.0),
        (0.45, 0.6),
    )
    plain("paint", grey(0.5), 0.4)
    plain("wall", (0.2, 0.2, 0.21), 0.8)
    plain("glass", grey(0.01), 0.05)
    plain("iron", grey(0.02), 0.35, 0.8)
    plain("rubber", grey(0.012), 0.7)
    plain("chrome", grey(0.7), 0.12, 1.0)
    plain("porcelain", (0.75, 0.74, 0.7), 0.15, 0.0, 0.5)
    plain("white paint", (0.6, 0.58, 0.54), 0.5)
    plain("dark green", (0.015, 0.05, 0.035), 0.35, 0.0, 0.5)
    plain("car glass", grey(0.01), 0.02, 0.0, 1.0)
    for name, tone in CAR_PAINTS.items():
        plain(name, tone, 0.3, 0.3, 1.0)
    for name, tone in SHINING.items():
        glowing(name, tone)
    made = dict(bpy.data.materials.items())
    _link(scene, solid.to_object("Ground", made))
    _link(scene, parts.to_object("Car parts", made))
    for k, body in enumerate(bodies):
        item = body.to_object(f"Car {k}", made)
        rounded = item.modifiers.new("Rounded", "SUBSURF")
        assert isinstance(rounded, bpy.types.SubsurfModifier)
        rounded.levels = rounded.render_levels = 2
        _link(scene, item)


CAR_PAINTS: Mapping[str, Colour] = {
    "car red": (0.25, 0.012, 0.01),
    "car silver": (0.32, 0.33, 0.34),
    "car blue": (0.015, 0.04, 0.12),
    "car dark": (0.012, 0.012, 0.014),
}
SHINING: Mapping[str, Colour] = {
    "shine": (1.0, 0.82, 0.55),
    "sign": (0.15, 0.75, 1.0),
    "lantern": (1.0, 0.7, 0.36),
    "red light": (1.0, 0.02, 0.01),
}


# --- a forest: trunks, crowns and ferns, with the sun between them ---


def _forest(scene: bpy.types.Scene) -> None:
    draw = random.Random(SEED)  # noqa: S311  trees
    ground, trees = Solid(), Solid()
    xs, ys = np.linspace(-40, 40, 41), np.linspace(-8, 90, 50)
    ground.grid([[(float(x), float(y), 0.25 * math.sin(0.4 * x) * math.sin(0.33 * y)) for x in xs] for y in ys], "moss")
    leaves = Solid()
    for _ in range(150):
        x, y = draw.uniform(-32, 32), draw.uniform(3, 75)
        if abs(x) < 1.5:
            continue
        tall, thick = draw.uniform(10, 16), draw.uniform(0.12, 0.32)
        lean = draw.uniform(-0.6, 0.6)
        trees.tube(
            [(x, y, -0.4), (x + 0.3 * lean, y, 0.4 * tall), (x + lean, y, tall)],
            (thick * 1.3, thick, 0.05),
            "bark",
            sides=9,
        )
        for _ in range(70 if y < 40 else 30):
            up = draw.uniform(0.35, 1.0)
            out = 2.4 * (1.1 - up) ** 0.5
            cx, cy, cz = x + lean * up + draw.gauss(0, out), y + draw.gauss(0, out), up * tall + draw.gauss(0, 0.4)
            _leaf(leaves, (cx, cy, cz), draw, 0.34)
    for _ in range(900):
        x, y = draw.uniform(-14, 14), draw.uniform(0.5, 30)
        if abs(x) > 0.8:
            _leaf(leaves, (x, y, draw.uniform(0.05, 0.5)), draw, 0.22)
    _add(scene, "Ground", ground, grained("moss", (0.02, 0.016, 0.008), (0.05, 0.055, 0.018), (2.0, 2.0, 2.0)))
    _add(scene, "Trees", trees, grained("bark", (0.03, 0.022, 0.016), (0.1, 0.08, 0.06), (18.0, 18.0, 3.0)))
    material, shader = new_shader("leaf")
    tone = shader.mix(shader.noise(shader.position(), 0.8, 2.0), (0.03, 0.09, 0.012), (0.1, 0.17, 0.02))
    both = shader.add(
        "MixShader",
        {
            0: 0.4,
            1: shader.add("BsdfDiffuse", {"Color": tone}),
            2: shader.add("BsdfTranslucent", {"Color": shader.mix(0.4, tone, (0.3, 0.4, 0.03))}),
        },
    )
    shader.end(both)
    _add(scene, "Leaves", leaves, material)
    _sun(scene, 6.5, 32.0, 24.0, (1.0, 0.87, 0.65))


def _leaf(solid: Solid, at: Point, draw: random.Random, size_m: float) -> None:
    """Add a spray of leaves: a quad that is turned by chance."""
    first = np.array([draw.gauss(0, 1), draw.gauss(0, 1), draw.gauss(0, 0.5)])
    first *= size_m / max(float(np.linalg.norm(first)), 1e-6)
    second = np.cross(first, [draw.gauss(0, 1), draw.gauss(0, 1), draw.gauss(0, 1)])
    second *= 0.6 * size_m / max(float(np.linalg.norm(second)), 1e-6)
    corners = [np.array(at) + part for part in (-first, second, first, -second)]
    solid.face([(float(x), float(y), float(z)) for x, y, z in corners], "leaf")


PLACES: Mapping[str, Place] = {
    "workshop": Place(_workshop, lambda: _sky("Noon", (0.55, 0.65, 0.8), (0.2, 0.4, 0.8), 1.2), (-0.6, -1.2, 1.6), 2.0),
    "harbour": Place(
        _harbour, lambda: _sky("Late", (0.95, 0.6, 0.32), (0.2, 0.3, 0.52), 0.8, 0.6), (0.2, -3.0, 2.5), 4.0
    ),
    "snowfield": Place(
        _snowfield, lambda: _sky("Clear", (0.6, 0.75, 0.95), (0.12, 0.3, 0.75), 0.9), (0.0, -4.0, 1.6), 3.0
    ),
    "car_park": Place(
        _car_park, lambda: _sky("Night", (0.02, 0.02, 0.03), (0.004, 0.006, 0.014), 0.5), (0.5, 0.0, 1.6)
    ),
    "forest": Place(_forest, lambda: _sky("Morning", (0.8, 0.85, 0.8), (0.35, 0.5, 0.8), 1.0), (0.0, -2.0, 1.6), 5.0),
}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
