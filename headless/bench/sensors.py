# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras and depth sensors: processor time a frame beside each one's error against an oracle, in one run.

python headless/bench/sensors.py    prints two tables: moments of motion blur, and models of sensors

Times are the least of several turns, and turns of all that is compared follow one another, so a busy machine is so for
all of them.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import numpy as np
from numpy.typing import NDArray

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.srgb import decoded, encoded
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.rendering import open_render, render_options, source_paths
from noisy_world.perturb import apply
from noisy_world.preset.keys import read_preset

Float32 = NDArray[np.float32]

PRESET = ROOT / "presets" / "shutters.yaml"
FRAME, SHUTTER_MS = 12, 30.0
PER_PX = (0.25, 0.5, 0.8, 1.0, 2.0)  # moments a pixel of blur
ORACLE = {"moments_per_px": 16.0, "most_moments": 257}
TURNS = 5
SIZE, GREY = (680, 1200), 0.735357  # sRGB's code of half the light
PUBLISHED_MM = {  # of a plane 2 m away: docs/sensors.md says by whom
    "stereo": ({"least_contrast": 0.0}, 15.0),
    "structured_light": ({}, 1.5),
    "time_of_flight": ({}, 2.0),
    "redwood": ({}, 7.1),
    "axial_noise": ({}, 6.1),
}
CAMERA = Intrinsics(SIZE[1], SIZE[0], 600.0, 600.0, 599.5, 339.5)


def main(arguments: list[str]) -> int:
    """Measure, and print the tables."""
    argparse.ArgumentParser(prog="sensors.py", description="Time and error of sensors.").parse_args(arguments)
    print("| moments a pixel | moments | over a plain frame | PSNR against 257 moments |\n| --- | --- | --- | --- |")
    for row in blur_rows():
        print(row)
    print("\n| model | processor, a frame | over `depth_gaussian_noise` | error |\n| --- | --- | --- | --- |")
    for row in model_rows():
        print(row)
    return 0


def blur_rows() -> list[str]:
    """Return the rows of motion blur by embree, one ray a pixel."""
    blurs = {"plain": None, **{f"{each:g}": {"moments_per_px": each} for each in PER_PX}, "oracle": ORACLE}
    steps = {
        name: [] if given is None else [{"camera_motion_blur": {"shutter_ms": SHUTTER_MS, **given}}]
        for name, given in blurs.items()
    }
    settings = json.dumps([{"name": f"s{name}", "perturb": done} for name, done in steps.items()])
    plan = make_plan(read_preset(PRESET, [f"settings={settings}", "render.samples=1"]))
    light: dict[str, NDArray[np.float64]] = {}
    moments: dict[str, int] = {}
    took: dict[str, list[float]] = {}
    first = plan.renders[0]
    with first.scene.source.prepare(first.camera, lambda _: None) as prepared:
        for turn in range(TURNS):
            for render in plan.renders:
                (name,) = {sequence.setting.name[1:] for sequence in render.sequences}
                if turn and name == "oracle":
                    continue
                paths = source_paths(plan, render)
                opened = open_render(prepared, render, paths, render_options(plan, render), lambda _: None)
                begun = time.process_time()
                frame: Any = opened.frame(paths.request(FRAME))
                took.setdefault(name, []).append(time.process_time() - begun)
                light[name] = np.asarray(frame.rgb, np.float64)
                moments[name] = frame.exposure[0]["moments"] if getattr(frame, "exposure", ()) else 1
    plain_s = min(took["plain"])
    rows = []
    for name in map("{:g}".format, PER_PX):
        psnr_db = -10 * math.log10(np.square(light[name] - light["oracle"]).mean())
        rows.append(f"| {name} | {moments[name]} | {min(took[name]) / plain_s:.1f} | {psnr_db:.1f} dB |")
    return rows


def model_rows() -> list[str]:
    """Return the rows of models of colour and of depth."""
    rng = np.random.default_rng(1)
    rgb = rng.random((*SIZE, 3), dtype=np.float32)
    depth_m = np.tile(np.linspace(1, 4, SIZE[1], dtype=np.float32), (SIZE[0], 1))
    beside: Mapping[str, Any] = {"seed": 3, "frame": 0, "intrinsics": CAMERA}
    errors = {
        "vignetting": ("of the law in float64", vignetting_error()),
        "bloom": ("of all light, that is lost", bloom_error()),
        "sensor_noise": ("of variance over mean", noise_error()),
        **{name: ("of a plane's deviation at 2 m", depth_error(name)) for name in PUBLISHED_MM},
    }
    jobs: dict[str, Callable[[], object]] = {
        "depth_gaussian_noise": lambda: apply(depth_m, "depth_gaussian_noise", seed=3)
    }
    for name in (
        "vignetting",
        "chromatic_aberration",
        "bloom",
        "flicker",
        "white_balance",
        "auto_exposure",
        "sensor_noise",
    ):
        jobs[name] = lambda name=name: apply(rgb, name, severity=3, **beside)
    for name in (*PUBLISHED_MM, "lidar"):
        jobs[name] = lambda name=name: apply(depth_m, name, rgb=rgb, **beside)
    took: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(TURNS):
        for name, job in jobs.items():
            begun = time.process_time()
            job()
            took[name].append(time.process_time() - begun)
    base_s = min(took.pop("depth_gaussian_noise"))
    rows = []
    for name, seconds in took.items():
        what, error = errors.get(name, ("", None))
        said = "none was measured here" if error is None else f"{100 * error:.2g} % {what}"
        rows.append(f"| `{name}` | {1000 * min(seconds):.0f} ms | {min(seconds) / base_s:.1f} | {said} |")
    return rows


def vignetting_error() -> float:
    """Return the largest relative error of light against the law."""
    made = decoded(apply(np.full((*SIZE, 3), GREY, np.float32), "vignetting", severity=3, intrinsics=CAMERA, seed=1))
    v, u = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float64)
    square = ((u - CAMERA.cx_px) ** 2 + (v - CAMERA.cy_px) ** 2) / (np.hypot(*SIZE) / 2) ** 2
    law = float(decoded(np.array([GREY], np.float32))[0]) * (1 - 0.5 * square)
    return float(np.abs(made[..., 0] / law - 1).max())


def bloom_error() -> float:
    """Return which share of the light of a lamp is lost or gained."""
    light = np.full((*SIZE, 3), 0.02, np.float32)
    light[330:350, 590:610] = 1.0
    made = decoded(apply(encoded(light), "bloom", severity=5, seed=1))
    return abs(float(made.sum(dtype=np.float64) / light.sum(dtype=np.float64)) - 1)


def noise_error() -> float:
    """Return by how much the slope of variance over mean is off, over flat fields of 5 to 70 % of white."""
    well, given = 10_000.0, {"gain_db": 0.0, "hot_percent": 0.0, "row_noise_electrons": 0.0, "bits": 12}
    given |= {"dark_electrons_per_s": 0.0}
    means, variances = [], []
    for share in (0.05, 0.2, 0.35, 0.5, 0.7):
        flat = encoded(np.full((400, 600, 3), share, np.float32))
        one, other = (decoded(apply(flat, "sensor_noise", seed=seed, **given)).astype(np.float64) for seed in (1, 2))
        means.append((one + other).mean() / 2)
        variances.append((one - other).var() / 2)
    slope = np.polyfit(means, variances, 1)[0]
    return abs(slope * well - 1)


def depth_error(name: str) -> float:
    """Return by how much the deviation of a plane at 2 m is off that which was published."""
    given, wanted_mm = PUBLISHED_MM[name]
    depth_m = np.full((200, 300), 2.0, np.float32)
    camera = Intrinsics(300, 200, 5000.0, 5000.0, 149.5, 99.5)
    grey = np.full((200, 300, 3), GREY, np.float32)
    found = apply(depth_m, name, seed=3, rgb=grey, intrinsics=camera, **given)
    return abs(1e3 * float(found[found > 0].std(dtype=np.float64)) / wanted_mm - 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
