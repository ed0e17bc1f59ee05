# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw weather and lenses on a frame of the street at severities 1, 3 and 5, beside the clean frame, for judging.

    python headless/tools/weather_pictures.py FOLDER --frame FRAME.exr [--only snow_depth haze] [--overview FILE.jpg]

FRAME.exr is what street_frames.py writes. FOLDER gets a sheet for each effect, in the frame's own size; the
overview has them all, small.
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.core.perturbing.kinds import ColourPerturbation
from noisy_world.core.perturbing.reading import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry
from tools.lit_compositor import ColourStep, perturbed, shown
from tools.street.frames import LitFrame, read_frame
from tools.street.scene import intrinsics_of

SEVERITIES = (1, 3, 5)
REFERENCE_PX = 1200
OVERVIEW_PX = 480  # the width of a picture there
QUALITY = 82
INDEX = 30  # of the film, so that what lands and dries has had time
GAP_PX, LABEL_PX = 6, 24
INK, GROUND = (30, 30, 30), 255


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="weather_pictures.py", description="Draw weather and lenses on the street.")
    parser.add_argument("folder", type=Path, help="the folder to write into")
    parser.add_argument("--frame", type=Path, required=True, help="a frame of the street, as an EXR")
    parser.add_argument("--only", nargs="+", default=list(effects()), choices=list(effects()), help="perturbations")
    parser.add_argument("--overview", type=Path, help="a JPEG of all of them, a line for each")
    options = parser.parse_args(arguments)
    frame = read_frame(options.frame)
    options.folder.mkdir(parents=True, exist_ok=True)
    lines = []
    for name in options.only:
        made = pictures(name, frame)
        save(options.folder / f"{name}.png", sheet({"clean": shown(frame.rgb)} | made))
        lines.append(line(made))
    if options.overview is not None:
        save(options.overview, np.concatenate(lines))
    return 0


def save(path: Path, picture: NDArray[np.uint8]) -> None:
    """Write a picture, and say so; quality of a JPEG: QUALITY. Raises OSError where it cannot be written."""
    _, data = cv2.imencode(path.suffix, picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    path.write_bytes(data.tobytes())
    print(f"wrote {path}")


def effects() -> dict[str, ColourPerturbation]:
    """Return the perturbations of air and lens that work in linear light, or by depth: weather, lenses."""
    colour = {name: item for name, item in registry().items() if isinstance(item, ColourPerturbation) and item.build}
    seen = {name: item for name, item in colour.items() if item.stage in ("environment", "lens")}
    return {name: item for name, item in seen.items() if item.needs_depth or item.linear}


def pictures(name: str, frame: LitFrame) -> dict[str, NDArray[np.uint8]]:
    """Return the effect at three severities, by what to write above each."""
    wide, high = frame.depth_m.shape[1], frame.depth_m.shape[0]
    steps = {f"{level}": severe(name, level) for level in SEVERITIES}
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


def severe(name: str, severity: float) -> ColourStep:
    """Return the step of a perturbation, drifting where it can, by the severities of streets where it has them."""
    values: dict[str, object] = {"severity": severity}
    if "drift" in effects()[name].temporals:
        values["temporal"] = "drift"
    if "outdoors" in effects()[name].other_severities:
        values["outdoors"] = True
    (step,) = parse_steps([{name: values}], ConfigPath("weather_pictures"), registry())
    return step


def labelled(label: str, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture under its name."""
    canvas = np.full((picture.shape[0] + LABEL_PX, picture.shape[1] + GAP_PX, 3), GROUND, dtype=np.uint8)
    canvas[LABEL_PX:, : picture.shape[1]] = picture
    cv2.putText(canvas, label, (GAP_PX, LABEL_PX - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    return canvas


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
