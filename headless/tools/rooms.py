# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the embedded rooms: two frames of each on its hand-held path, and its plan with the path.

python headless/tools/rooms.py docs/rooms.jpg
"""

import argparse
import sys
from pathlib import Path
from typing import TypeAlias

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.core.planning.exposed import render_options
from noisy_world.core.planning.source_paths import source_paths
from noisy_world.core.presets.preset import read_preset
from noisy_world.core.scenes.embedded import ROOMS, room_mesh
from noisy_world.core.scenes.mesh import Mesh
from noisy_world.pipeline.clean_frame import CleanFrame
from noisy_world.planning import make_plan
from noisy_world.rooms import build_room

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


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="rooms.py", description="Draw the embedded rooms.")
    parser.add_argument("out", type=Path, help="the picture to write, .jpg")
    parser.add_argument("--room", type=int, action="append", help="only this room; may be given several times")
    options = parser.parse_args(arguments)
    chosen = options.room or list(range(ROOMS))
    blocks = [block(seed) for seed in chosen]
    blocks += [np.full_like(blocks[0], GROUND)] * (-len(blocks) % ACROSS)
    rows = [np.concatenate(blocks[k : k + ACROSS], axis=1) for k in range(0, len(blocks), ACROSS)]
    options.out.write_bytes(small_jpeg(np.concatenate(rows)))
    print(f"wrote {options.out}")
    return 0


def block(seed: int) -> Image:
    """Return a room's two frames and its plan beside each other, under its name."""
    frames, path_m = rendered(seed, SHOWN[seed])
    mesh, length_m = build_room(seed), np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum()
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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
