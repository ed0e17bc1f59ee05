# SPDX-License-Identifier: GPL-3.0-or-later
"""The street as a scene of the open file: houses, ground, what stands there, light, and a camera on a path."""

import math
import random
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from noisy_world.blender.camera import add_camera, key_trajectory, set_intrinsics
from noisy_world.blender.typed import cycles as cycles_of
from noisy_world.core.geometry import Intrinsics

from .furniture import (
    LANTERN_M,
    add_bench,
    add_board,
    add_bollard,
    add_bulbs,
    add_car,
    add_lamp,
    add_pot,
    add_table,
)
from .houses import Front, House, add_house
from .light import BULBS_W, middle_of, new_lamp, new_lantern_light, new_sky
from .solids import Solid
from .surfaces import street_materials
from .trees import new_tree_curve

ROAD_M, FRONT_M, FAR_M, NEAR_M = 3.5, 6.2, 66.0, -8.0  # half widths; where the street ends and begins
KERB_M = 0.15
SEED = 5  # of what is drawn: lit windows, goods, branches
FPS = 24
FRAMES = 72
FOCAL_WIDTHS = 0.86  # the focal length in image widths: a lens of 31 mm
CLIP_M = (0.05, 400.0)

LEFT = (
    House(8.2, 2, "cream", "white paint", 3),
    House(7.4, 3, "red brick", "stone", 3, "awning green"),
    House(9.0, 3, "ochre", "white paint", 4),
    House(6.6, 2, "stone", "white paint", 3, gable=True),
    House(8.8, 3, "rose", "white paint", 4, "awning red"),
    House(7.6, 4, "brown brick", "stone", 3),
    House(8.4, 3, "blue grey", "white paint", 4),
    House(9.5, 2, "cream", "stone", 4, gable=True),
    House(9.0, 3, "red brick", "stone", 4),
)
RIGHT = (
    House(9.2, 3, "stone", "white paint", 4),
    House(8.6, 3, "brown brick", "stone", 3, "awning red"),
    House(7.2, 2, "blue grey", "white paint", 3, gable=True),
    House(9.4, 3, "rose", "white paint", 4),
    House(7.8, 4, "cream", "stone", 3, "awning green"),
    House(8.0, 3, "red brick", "stone", 3),
    House(6.8, 2, "ochre", "white paint", 3, gable=True),
    House(9.6, 3, "stone", "white paint", 4),
    House(9.0, 4, "brown brick", "stone", 4),
)
END = (
    House(9.0, 3, "ochre", "white paint", 4),
    House(7.5, 4, "stone", "white paint", 3, gable=True),
    House(9.0, 3, "brown brick", "stone", 4),
)
LAMPS = ((-4.0, 8.5), (4.0, 14.5), (-4.0, 21.0), (4.0, 28.0), (-4.0, 36.0), (4.0, 44.0), (-4.0, 53.0))
TREES = ((-4.6, 15.0, 0.9), (4.7, 21.5, 1.0), (-4.6, 29.5, 1.05), (4.7, 37.0, 0.95), (-4.6, 45.5, 1.1))
CARS = ((-2.45, 6.6, "car red"), (-2.45, 12.2, "car silver"), (-2.4, 24.0, "car blue"), (2.45, 17.0, "car blue"))
MORE_CARS = ((2.45, 30.5, "car silver"), (-2.4, 33.0, "car red"), (2.4, 40.0, "car red"))
WIRES_M = (7.2, 13.2, 19.4, 26.0)


@dataclass(frozen=True)
class Street:
    """The scene, its camera, and the camera's path (N, 4, 4), camera-to-world with OpenCV axes, metres."""

    scene: bpy.types.Scene
    camera: bpy.types.Object
    c2w: NDArray[np.float64]


def build_street(size_px: tuple[int, int], frames: int = FRAMES) -> Street:
    """Add the street to the open file's scene, which should be empty; frames: of the path, from frame 0."""
    scene = bpy.context.scene
    materials = street_materials()
    draw = random.Random(SEED)  # noqa: S311  which windows are lit
    _link(scene, _houses(draw).to_object("Houses", materials))
    _link(scene, _ground().to_object("Ground", materials))
    _link(scene, _cars(scene, materials).to_object("Car parts", materials))
    furniture, bulbs = _furniture()
    _link(scene, furniture.to_object("Furniture", materials))
    _trees(scene, materials["bark"])
    for k, (x_m, y_m) in enumerate(LAMPS):
        _link(scene, new_lantern_light(f"Lantern {k + 1}", (x_m, y_m, LANTERN_M - 0.42)))
    for k, place in enumerate(bulbs):
        _link(scene, new_lamp(f"Bulbs {k + 1}", place, BULBS_W, 1.0))
    scene.world = new_sky()
    camera = add_camera(scene, "Camera")
    set_intrinsics(scene, camera, intrinsics_of(size_px), near_m=CLIP_M[0], far_m=CLIP_M[1])
    path = path_c2w(frames)
    key_trajectory(scene, camera, path)
    scene.render.fps = FPS
    _set_look(scene)
    return Street(scene, camera, path)


def _link(scene: bpy.types.Scene, item: bpy.types.Object) -> None:
    scene.collection.objects.link(item)


def intrinsics_of(size_px: tuple[int, int]) -> Intrinsics:
    """Return the camera's intrinsics for an image size."""
    wide, high = size_px
    return Intrinsics(wide, high, FOCAL_WIDTHS * wide, FOCAL_WIDTHS * wide, (wide - 1) / 2, (high - 1) / 2)


def path_c2w(frames: int) -> NDArray[np.float64]:
    """Return the camera's path: a slow dolly along the pavement with a turn to the right and a walker's sway.

    (N, 4, 4), camera-to-world with OpenCV axes, metres; the speed does not depend on the number of frames.
    """
    seconds = np.arange(frames) / FPS
    poses = np.tile(np.eye(4), (frames, 1, 1))
    share = seconds / 3.0
    # The turn is from the street's axis to the right.
    turn = np.radians(-9.0 + 9.0 * share**2 * (3 - 2 * np.minimum(share, 1.0)))
    tilt = np.radians(1.0)
    level = math.cos(tilt)
    ahead = np.stack([np.sin(turn) * level, np.cos(turn) * level, np.full(frames, math.sin(tilt))], -1)
    right = np.stack([np.cos(turn), -np.sin(turn), np.zeros(frames)], -1)
    poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2] = right, np.cross(ahead, right), ahead
    poses[:, 0, 3] = 2.85 + 0.02 * np.sin(2 * np.pi * 0.9 * seconds)
    poses[:, 1, 3] = 0.75 * seconds
    poses[:, 2, 3] = 1.62 + 0.012 * np.sin(2 * np.pi * 1.8 * seconds)
    return poses


def _houses(draw: random.Random) -> Solid:
    solid = Solid()
    here = NEAR_M
    for house in LEFT:  # seen from the street, its left end is the far one
        add_house(solid, Front((-FRONT_M, here + house.width_m), (0.0, -1.0), (1.0, 0.0)), house, draw)
        here += house.width_m
    here = NEAR_M
    for house in RIGHT:
        add_house(solid, Front((FRONT_M, here), (0.0, 1.0), (-1.0, 0.0)), house, draw)
        here += house.width_m
    here = -13.0
    for house in END:
        add_house(solid, Front((here, FAR_M), (1.0, 0.0), (0.0, -1.0)), house, draw)
        here += house.width_m
    return solid


def _ground() -> Solid:
    solid = Solid()
    far, wide = FAR_M + 1.0, 60.0
    solid.face([(-ROAD_M, -20.0, 0.0), (ROAD_M, -20.0, 0.0), (ROAD_M, far, 0.0), (-ROAD_M, far, 0.0)], "asphalt")
    solid.face([(-wide, -20.0, -0.01), (wide, -20.0, -0.01), (wide, 120.0, -0.01), (-wide, 120.0, -0.01)], "asphalt")
    for side in (-1, 1):
        near, edge, out = (side * x for x in (ROAD_M, ROAD_M + 0.18, FRONT_M + 0.3))
        solid.box((min(near, edge), -20.0, 0.0), (max(near, edge), 60.0, KERB_M), "stone")
        solid.box((min(edge, out), -20.0, 0.0), (max(edge, out), 60.0, KERB_M - 0.01), "paving")
    for k in range(-2, 16):
        solid.box((-0.06, 4.0 * k, 0.0), (0.06, 4.0 * k + 1.8, 0.004), "road paint")
    return solid


def _cars(scene: bpy.types.Scene, materials: dict[str, bpy.types.Material]) -> Solid:
    parts = Solid()
    for k, (x_m, y_m, paint) in enumerate((*CARS, *MORE_CARS)):
        body = Solid()
        add_car(body, parts, x_m, y_m, paint)
        item = body.to_object(f"Car {k + 1}", materials)
        rounded = item.modifiers.new("Rounded", "SUBSURF")
        assert isinstance(rounded, bpy.types.SubsurfModifier)
        rounded.levels = rounded.render_levels = 2
        _link(scene, item)
    return parts


def _furniture() -> tuple[Solid, list[tuple[float, float, float]]]:
    solid = Solid()
    for x_m, y_m in LAMPS:
        add_lamp(solid, x_m, y_m)
    for x_m, y_m in ((-5.4, 11.0), (5.5, 15.5), (-5.4, 24.0)):
        add_bench(solid, x_m, y_m)
    add_table(solid, 4.05, 2.75)
    add_table(solid, 4.7, 5.4)
    add_board(solid, 4.0, 7.6)
    for y_m in (9.4, 11.0, 12.6):
        add_bollard(solid, 3.85, y_m)
    for y_m in (8.8, 10.6):
        add_pot(solid, 5.75, y_m)
    bulbs = []
    for k, y_m in enumerate(WIRES_M):
        places = add_bulbs(solid, (-FRONT_M, y_m, 5.9), (FRONT_M, y_m + 1.5 * (-1) ** k, 6.1), 0.75, 15)
        bulbs.append(middle_of(places))
    return solid, bulbs


def _trees(scene: bpy.types.Scene, bark: bpy.types.Material) -> None:
    shapes = [new_tree_curve(f"Tree {seed}", seed, bark) for seed in (1, 2)]
    for k, (x_m, y_m, size) in enumerate(TREES):
        item = bpy.data.objects.new(f"Tree {k + 1}", shapes[k % len(shapes)])
        item.location = (x_m, y_m, KERB_M - 0.02)
        item.rotation_euler = (0.0, 0.0, 2.4 * k)
        item.scale = (size, size, size)
        _link(scene, item)


def _set_look(scene: bpy.types.Scene) -> None:
    """Set how the scene is rendered: the view of a plain camera, Cycles with few samples and a denoiser."""
    view = scene.view_settings
    assert view is not None
    view.view_transform = "Standard"  # pyright: ignore[reportAttributeAccessIssue]  the names come from OpenColorIO
    render = scene.render
    render.engine = "CYCLES"  # pyright: ignore[reportAttributeAccessIssue]  the stubs know none but EEVEE
    cycles = cycles_of(scene)
    cycles.device = "CPU"
    cycles.samples = 8
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = True
    cycles.denoising_quality = "FAST"
    cycles.denoising_prefilter = "NONE"
    cycles.denoiser = "OPENIMAGEDENOISE"
    cycles.max_bounces = 4
    cycles.diffuse_bounces = 2
    cycles.glossy_bounces = 3
    cycles.sample_clamp_indirect = 4.0
    cycles.use_auto_tile = False
    scene.view_layers[0].use_pass_z = True
    render.use_persistent_data = True
