# SPDX-License-Identifier: GPL-3.0-or-later
"""Render frames of the street: scene-linear EXR files with depth, and the cameras beside them.

    python headless/tools/street_frames.py FOLDER [--size 640x360] [--frames 0 12 24] [--samples 8]

A file has RGB, scene-linear light of Rec. 709, and Z, planar depth in metres, 0 = void. cameras.json has the
intrinsics, and each frame's pose: camera-to-world, OpenCV axes, metres.
"""

import argparse
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import bpy

from noisy_world.blender.scratch_images import muted_output
from tools.street.frames import StreetCamera, write_frame
from tools.street.scene import FPS, FRAMES, build_street, intrinsics_of


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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
