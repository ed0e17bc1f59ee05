# SPDX-License-Identifier: GPL-3.0-or-later
"""Render frames of the street: scene-linear EXR files with depth, and the cameras beside them.

    python headless/pictures/street.py FOLDER [--size 640x360] [--frames 0 12 24] [--samples 8]

A file has RGB, scene-linear light of Rec. 709, and Z, planar depth in metres, 0 = void. cameras.json has the
intrinsics, and each frame's pose: camera-to-world, OpenCV axes, metres.
"""

import argparse
import json
import math
import random
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import bpy
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from noisy_world.core.geometry import Intrinsics
from noisy_world.nodes.datablocks import cycles as cycles_of
from noisy_world.nodes.datablocks import muted_output
from noisy_world.render.engines import RenderFile, without_void
from noisy_world.render.mesh_session import add_camera, key_trajectory, set_intrinsics
from noisy_world.render.own_scene import set_frame
from pictures.street_models import (
    LANTERN_M,
    Front,
    House,
    Point,
    Solid,
    add_bench,
    add_board,
    add_bollard,
    add_bulbs,
    add_car,
    add_house,
    add_lamp,
    add_pot,
    add_table,
    new_tree_curve,
)
from pictures.street_surfaces import Shader, Value, street_materials


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="street_frames.py", description="Render frames of the street.")
    parser.add_argument("folder", type=Path, help="the folder to write into")
    parser.add_argument("--size", type=size, default=(640, 360), help="width x height in pixels, such as 640x360")
    parser.add_argument("--frames", type=int, nargs="+", default=list(range(FRAMES)), help="of the path, 24 a second")
    parser.add_argument("--samples", type=int, default=8, help="of a pixel, before it is denoised")
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)
    with muted_output():
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    street = build_street(options.size, max(options.frames) + 1)
    write_cameras(options.folder / "cameras.json", options.size, options.frames, street.c2w.tolist())
    with StreetCamera(street, options.samples) as camera:
        for number in options.frames:
            path = options.folder / f"{number:04}.exr"
            write_frame(path, camera.frame(number))
            print(f"wrote {path}", flush=True)
    return 0


def size(text: str) -> tuple[int, int]:
    """Return the width and height that are written as 640x360."""
    wide, cross, high = text.partition("x")
    if not (cross and wide.isdecimal() and high.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r} is no size such as 640x360")
    return int(wide), int(high)


def write_cameras(path: Path, size_px: tuple[int, int], frames: list[int], c2w: list[list[list[float]]]) -> None:
    """Write the intrinsics and the frames' poses."""
    camera = intrinsics_of(size_px)
    content = {
        "fps": FPS,
        "width": camera.width_px,
        "height": camera.height_px,
        "fx": camera.fx_px,
        "fy": camera.fy_px,
        "cx": camera.cx_px,
        "cy": camera.cy_px,
        "c2w": {f"{number:04}.exr": c2w[number] for number in frames},
    }
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


# --- the street as a scene of the open file: houses, ground, what stands there, light, and a camera on a path ---


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
    set_look(scene)
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


def set_look(scene: bpy.types.Scene) -> None:
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


# --- the light of the street: a sky at dusk, and a light in each lantern ---


LAMP_W = 900.0
WARM = (1.0, 0.62, 0.3)
BULBS_W = 60.0  # of a wire's bulbs together
SKY_STRENGTH = 1.7


def new_sky() -> bpy.types.World:
    """Return a sky after sunset: warm low down where the street ends, blue above, with clouds."""
    world = bpy.data.worlds.new("Dusk")
    tree = world.node_tree
    assert tree is not None
    shader = Shader(tree)
    toward = shader.add("TexCoord", output="Generated")
    x, y, z = shader.parts(toward)
    height = shader.math("MAXIMUM", z, 0.0)
    glow = shader.between(shader.math("SUBTRACT", y, shader.math("MULTIPLY", height, 0.9)), -0.4, 1.0)
    low = shader.mix(glow, (0.16, 0.18, 0.27), (0.95, 0.42, 0.2))
    middle = shader.mix(glow, (0.12, 0.16, 0.3), (0.34, 0.3, 0.38))
    tone = shader.mix(shader.between(height, 0.0, 0.28), low, middle)
    tone = shader.mix(shader.between(height, 0.2, 0.9), tone, (0.07, 0.12, 0.27))
    # Clouds lie on a plane above, so they are flat and dense near the horizon.
    far = shader.math("ADD", height, 0.12)
    on_plane = shader.add("CombineXYZ", {0: shader.math("DIVIDE", x, far), 1: shader.math("DIVIDE", y, far)})
    cloud = shader.between(shader.noise(on_plane, 1.1, 7.0), 0.45, 0.72, 0.0, 0.75)
    lit: Value = shader.mix(glow, (0.1, 0.11, 0.17), (0.62, 0.28, 0.2))
    tone = shader.mix(shader.math("MULTIPLY", cloud, shader.between(height, 0.01, 0.12)), tone, lit)
    shader.end(shader.add("Background", {"Color": tone, "Strength": SKY_STRENGTH}), "OutputWorld")
    return world


def new_lamp(name: str, place: Point, power_w: float, radius_m: float) -> bpy.types.Object:
    """Return a round light."""
    data = bpy.data.lights.new(name, "POINT")
    assert isinstance(data, bpy.types.PointLight)
    data.energy = power_w
    data.color = WARM
    data.shadow_soft_size = radius_m
    lamp = bpy.data.objects.new(name, data)
    lamp.location = place
    lamp.visible_camera = False
    lamp.visible_glossy = False  # the lantern itself is what is reflected
    return lamp


def new_lantern_light(name: str, place: Point) -> bpy.types.Object:
    """Return the light of a lantern, which its iron roof keeps from the sky."""
    data = bpy.data.lights.new(name, "SPOT")
    assert isinstance(data, bpy.types.SpotLight)
    data.energy = LAMP_W
    data.color = WARM
    data.shadow_soft_size = 0.12
    data.spot_size = math.radians(168)
    data.spot_blend = 0.6
    lamp = bpy.data.objects.new(name, data)
    lamp.location = place
    lamp.visible_camera = False
    lamp.visible_glossy = False
    return lamp


def middle_of(places: Sequence[Point]) -> Point:
    """Return the mean of some places."""
    x, y, z = (sum(values) / len(places) for values in zip(*places, strict=True))
    return (x, y, z)


# --- frames of the street: rendered, written and read, scene-linear colour with depth ---


BRIGHTEST = 60_000.0  # that a half float holds


@dataclass(frozen=True)
class LitFrame:
    """A frame. rgb: (H, W, 3) float32, scene-linear light, Rec. 709; depth_m: (H, W) float32, planar, 0 = void."""

    rgb: NDArray[np.float32]
    depth_m: NDArray[np.float32]


class StreetCamera:
    """Renders the street at frames of its path, without compositing."""

    def __init__(self, street: Street, samples: int) -> None:
        """Take over the street's scene. samples: a pixel, in Cycles, before its denoiser."""
        self._street = street
        scene = street.scene
        scene.render.use_compositing = False
        cycles_of(scene).samples = samples
        self._file = RenderFile(scene, (scene.render.resolution_x, scene.render.resolution_y))

    def frame(self, number: int) -> LitFrame:
        """Render a frame of the path."""
        scene = self._street.scene
        set_frame(scene, number)
        channels = self._file.render(scene.view_layers[0].name)
        rgb = np.stack([channels[f"Combined.{name}"] for name in "RGB"], axis=-1)
        return LitFrame(np.clip(rgb, 0.0, BRIGHTEST), without_void(channels["Depth.Z"], CLIP_M[1]))

    def close(self) -> None:
        """Remove the scratch file."""
        self._file.close()

    def __enter__(self) -> "StreetCamera":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def write_frame(path: Path, frame: LitFrame, *, exact_depth: bool = True) -> None:
    """Write a frame as an EXR: RGB as half floats, depth as float32 in the channel Z, or as half floats too."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    depth_m = frame.depth_m if exact_depth else frame.depth_m.astype(np.float16)
    channels = {"RGB": np.ascontiguousarray(frame.rgb.astype(np.float16)), "Z": np.ascontiguousarray(depth_m)}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def read_frame(path: Path) -> LitFrame:
    """Read what `write_frame` wrote."""
    with OpenEXR.File(str(path)) as file:
        channels = file.channels()
        return LitFrame(channels["RGB"].pixels.astype(np.float32), channels["Z"].pixels.astype(np.float32))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
