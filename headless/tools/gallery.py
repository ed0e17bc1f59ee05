# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw every perturbation of colour at severities 1, 3 and 5 on a frame of the demo, as the compositor makes it.

Those of the environment and of the front glass are shown on the whole frame, the others on a part, pixel for pixel.

python headless/tools/gallery.py docs/gallery.jpg
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.core.datasets.images import rgb_bytes
from noisy_world.core.perturbing.kinds import ColourPerturbation
from tools.showcase import demo_frame, perturbed, shown_perturbations

SEVERITIES = (1, 3, 5)  # as in the paper; the sizes below are chosen, for a picture 1,860 pixels wide
ON_THE_LENS = ("lens_drops", "lens_dirt")
TILE_PX = (300, 170)
DETAIL_PX = (200, 330)  # column and row of the part's upper left corner
GAP_PX = 6
LABEL_PX = 24
SHEETS_ACROSS = 2  # perturbations beside each other
INK, GROUND = (30, 30, 30), 255


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="gallery.py", description="Draw the perturbations of colour.")
    parser.add_argument("out", type=Path, help="the picture to write, .jpg or .png")
    options = parser.parse_args(arguments)
    rgb, depth_m = demo_frame()
    made = perturbed(rgb, depth_m, SEVERITIES)
    clean = rgb_bytes(rgb)
    blocks = [strip("Clean: whole frame, and detail", [whole(clean), detail(clean)])]
    blocks += [
        strip(f"{item.label}   {item.stage}", [view(item)(made[item.name, level]) for level in SEVERITIES])
        for item in shown_perturbations()
    ]
    blocks += [np.full_like(blocks[0], GROUND)] * (-len(blocks) % SHEETS_ACROSS)
    rows = [np.concatenate(blocks[k : k + SHEETS_ACROSS], axis=1) for k in range(0, len(blocks), SHEETS_ACROSS)]
    quality = [cv2.IMWRITE_JPEG_QUALITY, 84] if options.out.suffix == ".jpg" else []
    cv2.imwrite(str(options.out), np.concatenate(rows)[..., ::-1], quality)
    print(f"wrote {options.out}")
    return 0


def view(item: ColourPerturbation) -> Callable[[NDArray[np.uint8]], NDArray[np.uint8]]:
    """Return the function that gives the part of a frame to show: all of it for weather and what is on the lens."""
    return whole if item.stage == "environment" or item.name in ON_THE_LENS else detail


def whole(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the whole frame in the size of a tile."""
    return np.asarray(cv2.resize(image, TILE_PX, interpolation=cv2.INTER_AREA), np.uint8)


def detail(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a part of the frame that is as large as a tile."""
    left, top = DETAIL_PX
    return image[top : top + TILE_PX[1], left : left + TILE_PX[0]]


def strip(label: str, tiles: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return the tiles beside each other under their name; all strips are equally wide."""
    width = len(SEVERITIES) * (TILE_PX[0] + GAP_PX) + 2 * GAP_PX
    canvas = np.full((LABEL_PX + TILE_PX[1] + GAP_PX, width, 3), GROUND, dtype=np.uint8)
    cv2.putText(canvas, label, (GAP_PX, LABEL_PX - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    for column, tile in enumerate(tiles):
        left = GAP_PX + column * (TILE_PX[0] + GAP_PX)
        canvas[LABEL_PX : LABEL_PX + TILE_PX[1], left : left + TILE_PX[0]] = tile
    return canvas


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
