# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a short film of the street: four node groups come in behind the frames, one after another.

    python headless/pictures/street.py out/film/frames --size 640x360 --samples 5
    python headless/pictures/film.py docs/street --frames out/film/frames

writes docs/street.mp4 and its picture docs/street.jpg. Frames of the film that are missing there are left out.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import bpy
import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.nodes.datablocks import muted_output
from pictures.lit_chain import EVENING_FOG, OVERRIDE, Link, LitScene, add_groups, key_camera, shown
from pictures.street import FPS, LitFrame, intrinsics_of, read_frame

REFERENCE_PX = 1200
SKY_M = 500.0  # how far the sky is, for the fog: to where it would reach up
LARGEST_BYTES = 2_000_000
POSTER = 54  # the frame of the picture
QUALITIES = ("HIGH", "MEDIUM", "LOW", "VERYLOW", "LOWEST")  # of Blender's encoder, from the best
STRIP_PX, INK, SHADE = 26, (235, 235, 235), 0.45  # of the captions

# What comes in when, by eye: the effects come on as weather does, and stay.
FILM = (
    Link(
        "fog_depth",
        {OVERRIDE: True} | EVENING_FOG,
        {"Mask": ((4, 0.0), (9, 1.0)), "Visibility": ((5, 2000.0), (11, 400.0), (19, 80.0))},
    ),
    Link("snow_depth", {"Frame Rate": 24.0}, {"Severity": ((18, 0.0), (21, 1.0), (34, 4.0))}),
    Link(
        "lens_frost",
        {OVERRIDE: True, "Opacity": 1.5, "Growth": 0.0, "Feathers": True, "Halo": 0.3},
        {"Coverage": ((32, 0.0), (36, 0.08), (66, 0.6))},
    ),
    Link("gaussian_noise", {OVERRIDE: True}, {"Std": ((52, 0.0), (60, 0.045))}),
)
SHOWN_FROM = {5: "Fog by Depth", 18: "Snow by Depth", 34: "Lens Frost", 52: "Gaussian Noise"}


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="film.py", description="Make a film of the street.")
    parser.add_argument("out", type=Path, help="what to write, without .mp4 and .jpg")
    parser.add_argument("--frames", type=Path, required=True, help="the folder that street_frames.py wrote")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        pictures = []
        for number, picture in film(options.frames):
            path = Path(folder) / f"{number:04}.png"
            cv2.imwrite(str(path), picture[..., ::-1])
            pictures.append(path)
            if number == POSTER:
                cv2.imwrite(f"{options.out}.jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
        size = write_video(options.out.with_suffix(".mp4"), pictures, LARGEST_BYTES)
    print(f"wrote {options.out}.mp4: {len(pictures)} frames, {size / 1e6:.1f} MB")
    return 0


def film(folder: Path) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Yield the frames' numbers and pictures (H, W, 3)."""
    cameras = json.loads((folder / "cameras.json").read_text(encoding="utf-8"))
    names = sorted(name for name in cameras["c2w"] if (folder / name).exists())
    poses = np.array([cameras["c2w"][name] for name in names])
    size_px = cameras["width"], cameras["height"]
    with LitScene(size_px, 1, SKY_M) as scene:
        groups = add_groups(
            scene.tree, scene.rgb, scene.depth_m, FILM, camera=intrinsics_of(size_px), reference_width_px=REFERENCE_PX
        )
        key_camera(scene.tree, groups, poses, FPS)
        scene.write([groups[-1].outputs["Image"]])
        for number, name in enumerate(names):
            frame: LitFrame = read_frame(folder / name)
            (made,) = scene.run(frame, number)
            yield number, captioned(shown(made), number)


def captioned(picture: NDArray[np.uint8], number: int) -> NDArray[np.uint8]:
    """Write what has come in by this frame, low on the left."""
    text = "  +  ".join(name for first, name in SHOWN_FROM.items() if first <= number) or "Clean"
    drawn = picture.copy()
    drawn[-STRIP_PX:] = drawn[-STRIP_PX:] * SHADE
    place = (STRIP_PX // 2, picture.shape[0] - STRIP_PX // 3)
    cv2.putText(drawn, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    return drawn


def write_video(path: Path, pictures: list[Path], largest: int) -> int:
    """Write pictures as an H.264 film of the best quality that keeps it below `largest` bytes; return its size.

    Raises ValueError where even the lowest quality does not.
    """
    first = cv2.imread(str(pictures[0]))
    assert first is not None
    height, width = first.shape[:2]
    scene = bpy.data.scenes.new("Film")
    editor = scene.sequence_editor_create()
    strip = editor.strips.new_image("Film", str(pictures[0]), 1, 1)
    assert isinstance(strip, bpy.types.ImageStrip)
    for item in pictures[1:]:
        strip.elements.append(item.name)
    scene.frame_start, scene.frame_end = 1, len(pictures)
    render = scene.render
    render.resolution_x, render.resolution_y, render.fps = width, height, FPS
    render.filepath, render.use_file_extension = str(path.resolve()), False
    view = scene.view_settings
    assert view is not None
    view.view_transform = "Standard"  # pyright: ignore[reportAttributeAccessIssue]  the names come from OpenColorIO
    render.image_settings.media_type = "VIDEO"
    assert render.ffmpeg is not None
    render.ffmpeg.format, render.ffmpeg.codec, render.ffmpeg.ffmpeg_preset = "MPEG4", "H264", "BEST"
    try:
        for quality in QUALITIES:
            render.ffmpeg.constant_rate_factor = quality
            with muted_output():
                bpy.ops.render.render(animation=True, scene=scene.name)
            if path.stat().st_size <= largest:
                return path.stat().st_size
    finally:
        bpy.data.scenes.remove(scene)
    raise ValueError(f"{path}: {path.stat().st_size} bytes at the lowest quality; {largest} are allowed")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
