# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws what each real camera sees of the embedded room from one place: pictures for the panel and for the docs.

python headless/tools/camera_pictures.py addon/noisy_world/ui/cameras docs/cameras.jpg
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.core.camera_devices import CAMERA_DEVICES
from tools.gallery import JPEG

PRESET = ROOT / "presets" / "real_camera.yaml"
FRAME = 12  # chosen by eye: a turn, so that rows slant
TILE_PX = (256, 144)
GAP_PX, QUALITY, GROUND = 6, 82, 255
ACROSS = 4  # tiles in a row of the docs' picture


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="camera_pictures.py", description="Draw what real cameras see.")
    parser.add_argument("folder", type=Path, help="the folder for a picture of each camera")
    parser.add_argument("strip", type=Path, help="the picture of all of them")
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)
    pictures = {name: small(seen(name)) for name in CAMERA_DEVICES}
    for name, picture in pictures.items():
        cv2.imwrite(str(options.folder / f"{name}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY, *JPEG])
    cv2.imwrite(
        str(options.strip),
        together([tile(picture) for picture in pictures.values()]),
        [cv2.IMWRITE_JPEG_QUALITY, QUALITY, *JPEG],
    )
    return 0


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
    scale = min(TILE_PX[0] / width, TILE_PX[1] / height)
    size = (round(width * scale), round(height * scale))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def tile(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a small picture in the middle of a tile (144, 256, 3)."""
    found = np.full((TILE_PX[1], TILE_PX[0], 3), GROUND, np.uint8)
    top, left = (TILE_PX[1] - picture.shape[0]) // 2, (TILE_PX[0] - picture.shape[1]) // 2
    found[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return found


def together(tiles: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return tiles in rows of four."""
    rows = -(-len(tiles) // ACROSS)
    wide, high = TILE_PX[0] + GAP_PX, TILE_PX[1] + GAP_PX
    found = np.full((rows * high - GAP_PX, ACROSS * wide - GAP_PX, 3), GROUND, np.uint8)
    for index, picture in enumerate(tiles):
        top, left = index // ACROSS * high, index % ACROSS * wide
        found[top : top + TILE_PX[1], left : left + TILE_PX[0]] = picture
    return found


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
