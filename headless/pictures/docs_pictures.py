# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw pictures of the docs and the panel: rooms, what real cameras see, weather, three lenses, noise of depth.

python headless/pictures/docs_pictures.py rooms docs/rooms.jpg
python headless/pictures/docs_pictures.py cameras addon/noisy_world/panel/cameras docs/cameras.jpg
python headless/pictures/docs_pictures.py weather FOLDER --frame FRAME.exr
python headless/pictures/docs_pictures.py lens docs/lens.jpg
python headless/pictures/docs_pictures.py depth docs/depth_noise.jpg
python headless/pictures/docs_pictures.py depth docs/twin.jpg --device measured.yaml
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from noisy_world.core.schema import ConfigPath
from noisy_world.dataset.frame import CleanFrame
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.rendering import render_options, source_paths
from noisy_world.images.pixels import rgb_bytes
from noisy_world.perturb import apply
from noisy_world.perturbations import registry
from noisy_world.perturbations.kinds import ColourPerturbation
from noisy_world.perturbations.new_steps import new_step
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.preset.camera_devices import CAMERA_DEVICES
from noisy_world.preset.keys import read_preset
from noisy_world.rooms import kept_room
from noisy_world.scenes.polygon_mesh import ROOMS, Mesh, room_mesh
from pictures import gallery
from pictures.lit_chain import ColourStep, perturbed, shown
from pictures.street import LitFrame, intrinsics_of, read_frame

Image: TypeAlias = NDArray[np.uint8]

DEMO = ROOT / "presets" / "demo.yaml"
FRAMES = 2000
SHOWN = ((720, 1215), (555, 1875), (720, 1710), (60, 1560), (720, 390), (720, 1050), (555, 1050), (885, 225))  # by eye
TILE_PX = (300, 170)
PLAN_PX = (214, 170)
GAP_PX = 6
LABEL_PX = 22
ACROSS = 2  # rooms beside each other
ROOF_M, GROUND_M = 2.2, -0.1  # what is higher, and the gardens' ground, are left out of the plan
LARGEST_BYTES = 300_000
INK, GROUND, PATH = (30, 30, 30), 255, (255, 60, 200)
QUALITY = 82  # of JPEG


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="docs_pictures.py", description="Draw pictures of the docs and the panel.")
    kinds = parser.add_subparsers(required=True)
    rooms = kinds.add_parser("rooms", help="two frames of each embedded room, and its plan with the path")
    rooms.add_argument("out", type=Path, help="the picture to write, .jpg")
    rooms.add_argument("--room", type=int, action="append", help="only this room; may be given several times")
    rooms.set_defaults(draw=draw_rooms)
    cameras = kinds.add_parser("cameras", help="what each real camera sees of the embedded room from one place")
    cameras.add_argument("folder", type=Path, help="the folder for a picture of each camera")
    cameras.add_argument("strip", type=Path, help="the picture of all of them")
    cameras.set_defaults(draw=draw_cameras)
    weather = kinds.add_parser("weather", help="weather and lenses on a frame of the street at severities 1, 3 and 5")
    weather.add_argument("folder", type=Path, help="the folder to write into")
    weather.add_argument("--frame", type=Path, required=True, help="a frame of the street, as an EXR")
    weather.add_argument("--only", nargs="+", default=list(effects()), choices=list(effects()), help="perturbations")
    weather.add_argument("--overview", type=Path, help="a JPEG of all of them, a line for each")
    weather.set_defaults(draw=draw_weather)
    lens = kinds.add_parser("lens", help="one view through a pinhole, a lens that distorts radially, and a fisheye")
    lens.add_argument("file", type=Path, help="the picture to write")
    lens.set_defaults(draw=draw_lenses)
    depth = kinds.add_parser("depth", help="slopes of depth that is clean, noisy pixel by pixel, and noisy in patches")
    depth.add_argument("file", type=Path, help="the picture to write")
    depth.add_argument("--device", type=Path, help="a measured device's file, drawn in place of the last model")
    depth.set_defaults(draw=draw_depth)
    options = parser.parse_args(arguments)
    options.draw(options)
    return 0


# --- rooms ---


def draw_rooms(options: argparse.Namespace) -> None:
    """Draw the embedded rooms."""
    chosen = options.room or list(range(ROOMS))
    blocks = [block(seed) for seed in chosen]
    blocks += [np.full_like(blocks[0], GROUND)] * (-len(blocks) % ACROSS)
    rows = [np.concatenate(blocks[k : k + ACROSS], axis=1) for k in range(0, len(blocks), ACROSS)]
    options.out.write_bytes(small_jpeg(np.concatenate(rows)))
    print(f"wrote {options.out}")


def block(seed: int) -> Image:
    """Return a room's two frames and its plan beside each other, under its name."""
    frames, path_m = rendered(seed, SHOWN[seed])
    mesh, length_m = kept_room(seed), np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum()
    print(f"room {seed}: {len(mesh.vertices_m):,} vertices, path of {length_m:.0f} m")
    tiles = [np.asarray(cv2.resize(frame, TILE_PX, interpolation=cv2.INTER_AREA), np.uint8) for frame in frames]
    tiles.append(plan(mesh, path_m))
    width = sum(tile.shape[1] + GAP_PX for tile in tiles) + GAP_PX
    canvas = np.full((LABEL_PX + TILE_PX[1] + GAP_PX, width, 3), GROUND, dtype=np.uint8)
    cv2.putText(canvas, room_mesh(seed), (GAP_PX, LABEL_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.48, INK, 1, cv2.LINE_AA)
    left = GAP_PX
    for tile in tiles:
        canvas[LABEL_PX : LABEL_PX + TILE_PX[1], left : left + tile.shape[1]] = tile
        left += tile.shape[1] + GAP_PX
    return canvas


def rendered(seed: int, shown: tuple[int, ...]) -> tuple[list[Image], NDArray[np.float64]]:
    """Return frames of a room's path as bytes, and the path's positions (N, 3). Empties the file."""
    overrides = [
        "settings=[{name: clean}]",
        f"scenes.0.mesh={room_mesh(seed)}",
        f"scenes.0.trajectory={{handheld: {{frames: {FRAMES}}}}}",
    ]
    plan_ = make_plan(read_preset(DEMO, overrides))
    render = plan_.renders[0]
    paths = source_paths(plan_, render)
    with render.scene.source.prepare(render.camera, print) as prepared:
        source = prepared.open(paths, render_options(plan_, render), print)
        requests = [paths.request(number) for number in shown]
        frames = [CleanFrame(request.frame, source.frame(request)).byte_rgb for request in requests]
    return frames, render.scene.source.trajectory().c2w[:, :3, 3]


def plan(mesh: Mesh, path_m: NDArray[np.float64]) -> Image:
    """Return a room as it is seen from above without its ceiling, north up, with the path through it."""
    assert mesh.rgb is not None
    below = (mesh.vertices_m[:, 2] < ROOF_M) & (mesh.vertices_m[:, 2] > GROUND_M)
    points_m, rgb = mesh.vertices_m[below], mesh.rgb[below]
    low_m, high_m = path_m.min(axis=0)[:2] - 2.6, path_m.max(axis=0)[:2] + 2.6
    low_m, high_m = np.maximum(low_m, points_m.min(axis=0)[:2]), np.minimum(high_m, points_m.max(axis=0)[:2])
    per_m = min(PLAN_PX[0] / (high_m - low_m)[0], PLAN_PX[1] / (high_m - low_m)[1])
    order = np.argsort(points_m[:, 2], kind="stable")  # what is higher is painted later
    column, row = ((points_m[order, :2] - low_m) * per_m).astype(np.int64).T
    inside = (column >= 0) & (column < PLAN_PX[0]) & (row >= 0) & (row < PLAN_PX[1])
    canvas = np.full((PLAN_PX[1], PLAN_PX[0], 3), GROUND, dtype=np.uint8)
    canvas[PLAN_PX[1] - 1 - row[inside], column[inside]] = np.rint(rgb[order][inside] * 255).astype(np.uint8)
    line = (path_m[:, :2] - low_m) * per_m
    line[:, 1] = PLAN_PX[1] - 1 - line[:, 1]
    return np.asarray(cv2.polylines(canvas, [np.rint(line).astype(np.int32)], False, PATH, 1, cv2.LINE_AA), np.uint8)


def small_jpeg(image: Image) -> bytes:
    """Return an image as a JPEG of the best quality that keeps it below LARGEST_BYTES."""
    for quality in range(90, 30, -4):
        data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        if len(data) <= LARGEST_BYTES:
            return data
    raise SystemExit(f"the picture does not fit {LARGEST_BYTES} bytes")


# --- real cameras ---


PRESET = ROOT / "presets" / "real_camera.yaml"
FRAME = 12  # chosen by eye: a turn, so that rows slant
CAMERA_TILE_PX = (256, 144)
CAMERAS_ACROSS = 4  # tiles in a row of the docs' picture


def draw_cameras(options: argparse.Namespace) -> None:
    """Draw what real cameras see."""
    options.folder.mkdir(parents=True, exist_ok=True)
    drawn = {name: small(seen(name)) for name in CAMERA_DEVICES}
    for name, picture in drawn.items():
        cv2.imwrite(str(options.folder / f"{name}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY, *gallery.JPEG])
    cv2.imwrite(
        str(options.strip),
        together([tile(picture) for picture in drawn.values()]),
        [cv2.IMWRITE_JPEG_QUALITY, QUALITY, *gallery.JPEG],
    )


def seen(device: str) -> NDArray[np.uint8]:
    """Return what a camera sees, (H, W, 3) BGR bytes at its own size."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        sets = [f"camera={{device: {device}}}", "output={image: png, modalities: [rgb]}"]
        sets.append(f"settings=[{{name: seen, perturb: [{{device: {device}}}]}}]")
        given = [part for text in sets for part in ("--set", text)]
        program = [sys.executable, str(ROOT / "headless" / "generate.py"), str(PRESET), "--out", str(out)]
        subprocess.run([*program, "--frames", f"{FRAME}:{FRAME + 1}", *given], check=True, stdout=subprocess.DEVNULL)
        (file,) = (out / "seen" / "room").rglob("*.png")
        return np.asarray(cv2.imread(str(file), cv2.IMREAD_COLOR), np.uint8)


def small(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture as large as it fits into a tile."""
    height, width = picture.shape[:2]
    scale = min(CAMERA_TILE_PX[0] / width, CAMERA_TILE_PX[1] / height)
    size = (round(width * scale), round(height * scale))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def tile(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a small picture in the middle of a tile (144, 256, 3)."""
    found = np.full((CAMERA_TILE_PX[1], CAMERA_TILE_PX[0], 3), GROUND, np.uint8)
    top, left = (CAMERA_TILE_PX[1] - picture.shape[0]) // 2, (CAMERA_TILE_PX[0] - picture.shape[1]) // 2
    found[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return found


def together(tiles: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return tiles in rows of four."""
    rows = -(-len(tiles) // CAMERAS_ACROSS)
    wide, high = CAMERA_TILE_PX[0] + GAP_PX, CAMERA_TILE_PX[1] + GAP_PX
    found = np.full((rows * high - GAP_PX, CAMERAS_ACROSS * wide - GAP_PX, 3), GROUND, np.uint8)
    for index, picture in enumerate(tiles):
        top, left = index // CAMERAS_ACROSS * high, index % CAMERAS_ACROSS * wide
        found[top : top + CAMERA_TILE_PX[1], left : left + CAMERA_TILE_PX[0]] = picture
    return found


# --- weather ---


SEVERITIES = (1, 3, 5)
REFERENCE_PX = 1200
OVERVIEW_PX = 480  # the width of a picture there
INDEX = 30  # of the film, so that what lands and dries has had time


def draw_weather(options: argparse.Namespace) -> None:
    """Draw weather and lenses on the street, beside the clean frame, for judging."""
    frame = read_frame(options.frame)
    options.folder.mkdir(parents=True, exist_ok=True)
    lines = []
    for name in options.only:
        made = pictures(name, frame)
        save(options.folder / f"{name}.png", sheet({"clean": shown(frame.rgb)} | made))
        lines.append(line(made))
    if options.overview is not None:
        save(options.overview, np.concatenate(lines))


def save(path: Path, picture: NDArray[np.uint8]) -> None:
    """Write a picture, and say so; quality of a JPEG: QUALITY. Raises OSError where it cannot be written."""
    _, data = cv2.imencode(path.suffix, picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    path.write_bytes(data.tobytes())
    print(f"wrote {path}")


def effects() -> dict[str, ColourPerturbation]:
    """Return the perturbations of air and lens that work in linear light, or by depth: weather, lenses."""
    colour = {name: item for name, item in registry().items() if isinstance(item, ColourPerturbation) and item.nodes}
    seen = {name: item for name, item in colour.items() if item.stage in ("environment", "lens")}
    return {
        name: item for name, item in seen.items() if item.needs_depth or (item.nodes is not None and item.nodes.linear)
    }


def pictures(name: str, frame: LitFrame) -> dict[str, NDArray[np.uint8]]:
    """Return the effect at three severities, by what to write above each."""
    wide, high = frame.depth_m.shape[1], frame.depth_m.shape[0]
    steps = {f"{level}": severe(name, level, frame.depth_m) for level in SEVERITIES}
    made = perturbed(frame, INDEX, steps, dict.fromkeys(steps, REFERENCE_PX), intrinsics_of((wide, high)))
    return {f"{name}, severity {level}": shown(rgb) for level, rgb in made.items()}


def sheet(made: Mapping[str, NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return four pictures, two by two, each under its name."""
    tiles = [labelled(label, picture) for label, picture in made.items()]
    return np.concatenate([np.concatenate(tiles[:2], axis=1), np.concatenate(tiles[2:], axis=1)])


def line(made: Mapping[str, NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return pictures beside one another, small, each under its name."""
    tiles = []
    for label, picture in made.items():
        high = round(picture.shape[0] * OVERVIEW_PX / picture.shape[1])
        small = cv2.resize(picture, (OVERVIEW_PX, high), interpolation=cv2.INTER_AREA)
        tiles.append(labelled(label, np.asarray(small, np.uint8)))
    return np.concatenate(tiles, axis=1)


def severe(name: str, severity: float, depth_m: NDArray[np.float32]) -> ColourStep:
    """Return the step of a perturbation as it is newly added to a scene of this depth, drifting where it can."""
    values = new_step(effects()[name], (), depth_m).values | {"severity": severity}
    if "drift" in effects()[name].temporals:
        values["temporal"] = "drift"
    (step,) = parse_steps([{name: values}], ConfigPath("docs_pictures"), registry())
    return step


def labelled(label: str, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture under its name."""
    canvas = np.full((picture.shape[0] + LABEL_PX, picture.shape[1] + GAP_PX, 3), GROUND, dtype=np.uint8)
    canvas[LABEL_PX:, : picture.shape[1]] = picture
    cv2.putText(canvas, label, (GAP_PX, LABEL_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    return canvas


# --- lenses ---


LENS_PRESET = ROOT / "presets" / "lens.yaml"
LENS_FRAME = 3  # chosen by eye: beams, bricks and boards, which are straight
SIZE = ["camera.width=1200", "camera.height=680", "camera.cx=599.5", "camera.cy=339.5"]
LENSES = (  # focal length in pixels, and lens
    (600, "null"),
    (600, "{k1: -0.28, k2: 0.07, p1: 0.0002, p2: 0.00002}"),
    (530, "{model: equidistant, k1: -0.02, k2: 0.01, k3: -0.004, k4: 0.001}"),
)


def draw_lenses(options: argparse.Namespace) -> None:
    """Draw a view through three lenses."""
    tiles = [gallery.whole(through(*lens)) for lens in LENSES]
    gallery.save(options.file, gallery.strip(tiles), gallery.QUALITY)


def through(focal_px: int, lens: str) -> NDArray[np.uint8]:
    """Return a frame (H, W, 3) of the preset's walk through another lens, bytes."""
    size = [*SIZE, f"camera.fx={focal_px}", f"camera.fy={focal_px}", f"camera.distortion={lens}"]
    plan = make_plan(read_preset(LENS_PRESET, [*size, "settings=[{name: clean}]"]))
    (render,) = plan.renders
    paths = source_paths(plan, render)
    with render.scene.source.prepare(render.camera, print) as prepared:
        frame = prepared.open(paths, render_options(plan, render), print).frame(paths.request(LENS_FRAME))
    assert frame.rgb is not None, "the preset has colour"
    return rgb_bytes(np.asarray(frame.rgb, np.float32))


# --- noise of depth ---


DEPTH_SIZE = ["camera.width=640", "camera.height=480", "camera.fx=585.5", "camera.fy=585.5"]
DEPTH_SIZE += ["camera.cx=319.5", "camera.cy=239.5"]
DEPTH_FRAME = 12  # by eye
KINECTS = ("kinect_v1", "kinect_v1_measured")
STEEP = 30.0  # shades of grey to an eighth of a pixel of disparity


def draw_depth(options: argparse.Namespace) -> None:
    """Draw the slopes of a frame's depth, clean and by two models of the first Kinect."""
    plan = make_plan(read_preset(DEMO, [*DEPTH_SIZE, "settings=[{name: clean}]"]))
    (render,) = plan.renders
    paths = source_paths(plan, render)
    with render.scene.source.prepare(render.camera, print) as prepared:
        frame = prepared.open(paths, render_options(plan, render), print).frame(paths.request(DEPTH_FRAME))
    clean_m = CleanFrame(DEPTH_FRAME, frame).depth_m
    models: list[dict[str, dict[str, Any]]] = [{"structured_light": {"device": each}} for each in KINECTS]
    if options.device is not None:
        models[-1] = yaml.safe_load(options.device.read_text())["depth"]
    depths = [
        apply(clean_m, name, seed=1, intrinsics=render.camera, **given)
        for model in models
        for name, given in model.items()
    ]
    gallery.save(options.file, np.hstack([sloping(each) for each in (clean_m, *depths)]), gallery.QUALITY)


def sloping(depth_m: NDArray[np.float32]) -> Image:
    """Return depth (H, W) as if lit from the upper left: the slope of the first Kinect's disparity; void is black."""
    known = depth_m > 0
    eighths = np.divide(351.3, depth_m, out=np.zeros_like(depth_m), where=known)
    slope = (cv2.Sobel(eighths, cv2.CV_32F, 1, 0) + cv2.Sobel(eighths, cv2.CV_32F, 0, 1)) / 8
    grey = np.where(known, np.clip(128 + STEEP * slope, 60, 235), 0).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
