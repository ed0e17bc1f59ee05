# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the small pictures of the panel from the gallery: one of each perturbation, and of each preset that is shipped.

A perturbation is shown at its greatest strength in the gallery; a preset by up to four of its perturbations.

python headless/pictures/thumbnails.py docs/gallery addon/noisy_world/panel/thumbnails
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon")]

import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.perturbations import registry
from noisy_world.perturbations.parsing import parse_settings
from noisy_world.preset.keys import read_preset

SIDE_PX = 120  # chosen: half as large again as the panel shows them at a scale of 1, and less than 300 kB in all
QUALITY, LEAST_QUALITY = 70, 30  # of JPEG
MOST_BYTES = 4500  # of a picture; chosen for 300 kB in all
TILES, GAP_PX = 3, 6  # of a picture of the gallery
MIDDLE = ("contrast", "fog", "fog_depth")  # at their greatest strength hardly anything of the room is left
FINE = (
    "snow_depth",
    "rain_depth",
    "lens_drops",
    "lens_dirt",
    "spatter",
    "snow",
    "rolling_shutter",
    "camera_motion_blur",
)
PART = 0.6  # of a tile, of which that is shown whose effect is fine
CLEAN = "clean"


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="thumbnails.py", description="Draw the small pictures of the panel.")
    parser.add_argument("gallery", type=Path, help="the folder of the gallery's pictures")
    parser.add_argument("folder", type=Path, help="the folder to write into; what else it holds is removed")
    options = parser.parse_args(arguments)
    lacking = [name for name in (CLEAN, *registry()) if not (options.gallery / f"{name}.jpg").is_file()]
    if lacking:
        parser.error(f"{options.gallery}: no picture of {', '.join(lacking)}; draw them with gallery.py")
    pictures = {f"perturbations/{name}.jpg": of_perturbation(options.gallery, name) for name in registry()}
    for path in sorted((ROOT / "presets").glob("*.yaml")):
        pictures[f"{path.stem}.jpg"] = of_preset(options.gallery, path)
    encoded = {name: jpeg(picture) for name, picture in pictures.items()}
    for old in options.folder.rglob("*.jpg"):
        old.unlink()
    for name, data in encoded.items():
        file = options.folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
    print(f"wrote {len(encoded)} pictures, {sum(map(len, encoded.values())) / 1000:.0f} kB, into {options.folder}")
    return 0


def of_perturbation(gallery: Path, name: str, side_px: int = SIDE_PX) -> NDArray[np.uint8]:
    """Return the middle of a tile of the gallery, or a part of it, as a square, BGR."""
    strip = np.asarray(cv2.imread(str(gallery / f"{name}.jpg")), np.uint8)
    width = (strip.shape[1] - (TILES - 1) * GAP_PX) // TILES
    place = 0 if name == CLEAN else 1 if name in MIDDLE else TILES - 1
    tile = strip[:, place * (width + GAP_PX) :][:, :width]
    side = round(tile.shape[0] * (PART if name in FINE else 1.0))
    left = (width - side) // 2
    square = tile[:side, left : left + side]
    kind = cv2.INTER_AREA if side > side_px else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(square, (side_px, side_px), interpolation=kind), np.uint8)


def of_preset(gallery: Path, path: Path) -> NDArray[np.uint8]:
    """Return a preset's perturbations as a square: one, or four beside each other; without any the clean room."""
    preset = read_preset(path)
    settings = parse_settings(preset.spec.settings, preset.setting_places, registry())
    names = list(dict.fromkeys(step.perturbation.name for setting in settings for step in setting.steps))
    if len(names) < 2:
        return of_perturbation(gallery, (names or [CLEAN])[0])
    chosen = [CLEAN, *names][:4] if len(names) < 4 else [names[k * (len(names) - 1) // 3] for k in range(4)]
    tiles = [of_perturbation(gallery, name, SIDE_PX // 2) for name in (*chosen, CLEAN)[:4]]
    rows = [np.concatenate(tiles[k : k + 2], axis=1) for k in (0, 2)]
    return np.concatenate(rows, axis=0)


def jpeg(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture as JPEG of at most MOST_BYTES, where LEAST_QUALITY allows that."""
    data = b""
    for quality in range(QUALITY, LEAST_QUALITY - 1, -10):
        options = (cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1)
        data = cv2.imencode(".jpg", picture, options)[1].tobytes()
        if len(data) <= MOST_BYTES:
            break
    return data


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
