# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws docs/lens.jpg: the same view through a pinhole, a lens that distorts radially, and a fisheye.

python headless/tools/lens_picture.py docs/lens.jpg
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import numpy as np
from numpy.typing import NDArray

from noisy_world.core.datasets.images import rgb_bytes
from noisy_world.core.planning.exposed import render_options
from noisy_world.core.planning.source_paths import source_paths
from noisy_world.core.presets.preset import read_preset
from noisy_world.planning import make_plan
from tools.gallery import QUALITY, save, strip, whole

PRESET = ROOT / "presets" / "lens.yaml"
FRAME = 3  # chosen by eye: beams, bricks and boards, which are straight
SIZE = ["camera.width=1200", "camera.height=680", "camera.cx=599.5", "camera.cy=339.5"]
LENSES = (  # focal length in pixels, and lens
    (600, "null"),
    (600, "{k1: -0.28, k2: 0.07, p1: 0.0002, p2: 0.00002}"),
    (530, "{model: equidistant, k1: -0.02, k2: 0.01, k3: -0.004, k4: 0.001}"),
)


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="lens_picture.py", description="Draw a view through three lenses.")
    parser.add_argument("file", type=Path, help="the picture to write")
    file = parser.parse_args(arguments).file
    save(file, strip([whole(seen(*lens)) for lens in LENSES]), QUALITY)
    return 0


def seen(focal_px: int, lens: str) -> NDArray[np.uint8]:
    """Return a frame (H, W, 3) of the preset's walk through another lens, bytes."""
    size = [*SIZE, f"camera.fx={focal_px}", f"camera.fy={focal_px}", f"camera.distortion={lens}"]
    plan = make_plan(read_preset(PRESET, [*size, "settings=[{name: clean}]"]))
    (render,) = plan.renders
    paths = source_paths(plan, render)
    with render.scene.source.prepare(render.camera, print) as prepared:
        frame = prepared.open(paths, render_options(plan, render), print).frame(paths.request(FRAME))
    assert frame.rgb is not None, "the preset has colour"
    return rgb_bytes(np.asarray(frame.rgb, np.float32))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
