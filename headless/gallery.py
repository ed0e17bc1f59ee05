# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw every perturbation of colour at severities 1, 3 and 5 on a frame of the demo, as the compositor makes it.

python headless/gallery.py docs/gallery.jpg
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.core.images import rgb_bytes
from noisy_world.core.perturbation import Category
from showcase import demo_frame, perturbed, shown_perturbations

SEVERITIES = (1, 3, 5)
TILE_PX = (300, 170)
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
    blocks = [strip("Clean", "", [rgb_bytes(rgb)])]
    blocks += [
        strip(item.label, item.category, [made[item.name, severity] for severity in SEVERITIES])
        for item in shown_perturbations()
    ]
    blocks += [np.full_like(blocks[0], GROUND)] * (-len(blocks) % SHEETS_ACROSS)
    rows = [np.concatenate(blocks[k : k + SHEETS_ACROSS], axis=1) for k in range(0, len(blocks), SHEETS_ACROSS)]
    cv2.imwrite(str(options.out), np.concatenate(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    print(f"wrote {options.out}")
    return 0


def strip(label: str, category: Category | str, images: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return the images beside each other under their name, always as wide."""
    width = len(SEVERITIES) * (TILE_PX[0] + GAP_PX) + 2 * GAP_PX
    canvas = np.full((LABEL_PX + TILE_PX[1] + GAP_PX, width, 3), GROUND, dtype=np.uint8)
    text = f"{label}   {category}" if category else label
    cv2.putText(canvas, text, (GAP_PX, LABEL_PX - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    for place, image in enumerate(images):
        left = GAP_PX + place * (TILE_PX[0] + GAP_PX)
        tile = cv2.resize(image, TILE_PX, interpolation=cv2.INTER_AREA)
        canvas[LABEL_PX : LABEL_PX + TILE_PX[1], left : left + TILE_PX[0]] = tile
    return canvas


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
