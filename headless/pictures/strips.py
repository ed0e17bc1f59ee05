# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw strips of eight frames of a place, at severities 1, 3 and 5 below one another, on which a look is judged.

    python headless/pictures/strips.py PLACES OUT [--only rain_depth ...] [--place harbour ...] [--severities 1 3 5]
        [--given '{caustic: 1}'] [--frames 8]

PLACES: a folder of `places.py`. OUT: gets PLACE_NAME.png. Arrays carry out the node groups, so what is seen is what the
compositor shows. A step is as it is newly added to the place, with the pattern that looks as in the world, and as wide
in the frame as in one of 1200 pixels. given: parameters in place of those, as YAML.
"""

import argparse
import json
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from noisy_world.core.camera_motion import motion_between
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry
from noisy_world.perturbations.execution import perturb_light
from noisy_world.perturbations.kinds import FrameContext, Perturbation
from noisy_world.perturbations.new_steps import new_step
from noisy_world.perturbations.parsing import parse_steps
from pictures.street import read_frame

SEED = 1
REFERENCE_PX = 1200  # the width for which sizes in pixels are meant
JUDGED = (
    *("rain_depth", "snow_depth", "fog_depth", "haze"),
    *("lens_drops", "lens_frost", "lens_dirt", "sensor_noise"),
)


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="strips.py", description="Draw strips of frames on which looks are judged.")
    parser.add_argument("places", type=Path, help="a folder of places.py")
    parser.add_argument("out", type=Path, help="the folder to write into")
    parser.add_argument("--only", nargs="+", default=list(JUDGED), help="perturbations")
    parser.add_argument("--place", nargs="+", help="places (default: all that are there)")
    parser.add_argument("--severities", type=float, nargs="+", default=[1, 3, 5], help="a row each")
    parser.add_argument("--frames", type=int, default=8, help="at most so many of a strip")
    parser.add_argument("--given", type=yaml.safe_load, default={}, help="parameters beside the severity, as YAML")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    for folder in sorted(path.parent for path in options.places.glob("*/cameras.json")):
        if options.place and folder.name not in options.place:
            continue
        for name in options.only:
            rows = [
                strip(folder, name, {"severity": each, **options.given}, options.frames) for each in options.severities
            ]
            path = options.out / f"{folder.name}_{name}.png"
            cv2.imwrite(str(path), np.vstack(rows)[..., ::-1])
            print(f"wrote {path}", flush=True)
    return 0


def strip(folder: Path, name: str, values: dict[str, Any], most: int) -> NDArray[np.uint8]:
    """Return frames of a place side by side, perturbed, as bytes. values: of the step, as a preset has them."""
    cameras = json.loads((folder / "cameras.json").read_text(encoding="utf-8"))
    lens = Intrinsics(*(cameras[key] for key in ("width", "height", "fx", "fy", "cx", "cy")))
    poses = {int(file[:4]): np.array(pose) for file, pose in cameras["c2w"].items()}
    numbers = sorted(poses)
    first = read_frame(folder / f"{numbers[0]:04}.exr")
    newly = new_values(registry()[name], first.depth_m, lens.width_px / REFERENCE_PX)
    (step,) = parse_steps([{name: newly | values}], ConfigPath("--given"), registry())
    shown = []
    for place, number in enumerate(numbers[:most]):
        frame = read_frame(folder / f"{number:04}.exr")
        before = numbers[max(place - 1, 0)]
        seconds = (number - before) / cameras["fps"]
        motion = motion_between(poses[numbers[0]], poses[before], poses[number], seconds)
        where = FrameContext(
            number,
            (SEED, "place", folder.name),
            stamp_s=number / cameras["fps"],
            intrinsics=lens,
            motion=motion,
            read_depth_m=lambda depth_m=frame.depth_m: depth_m,
        )
        lit = step.context(replace(where, lit=True))
        made = frame.rgb if step.severity == 0 else perturb_light(step, frame.rgb, step.severity, lit)
        shown.append(as_picture(made))
    return np.hstack(shown)


def new_values(perturbation: Perturbation, depth_m: NDArray[np.float32], scale: float) -> dict[str, Any]:
    """Return what a step has that is newly added to a scene of this depth, but for sizes in pixels: times a scale.

    What severity sets, and grain of a sensor's pixels, is not scaled.
    """
    values = new_step(perturbation, (), depth_m).values
    if perturbation.temporals:
        values["temporal"] = perturbation.natural
    if perturbation.stage == "lens":
        for item in fields(perturbation.parameters):
            if item.name.endswith("_px") and item.name not in perturbation.severities:
                own = getattr(perturbation.parameters(), item.name)
                values[item.name] = max(own * scale, item.metadata["key"].minimum or 0.0)
    return values


def as_picture(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return scene-linear light as bytes by sRGB's curve."""
    light = np.clip(linear, 0.0, 1.0)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(encoded * 255).astype(np.uint8)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
