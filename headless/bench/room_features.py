# SPDX-License-Identifier: GPL-3.0-or-later
"""Count ORB's keypoints in the clean frames of Noisy-Rooms, as they are rendered: the least of each room.

python headless/bench/room_features.py --every 1          # all 2,000 frames of eight rooms: an hour of a core
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2

from noisy_world.dataset.frame import CleanFrame
from noisy_world.dataset.plan import Plan, Render, make_plan
from noisy_world.dataset.rendering import render_options, source_paths
from noisy_world.preset.keys import read_preset

ENOUGH = 500
ASKED = 1000  # keypoints that ORB keeps at most: its counts depend on that


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status: 1 where a frame has too few."""
    parser = argparse.ArgumentParser(prog="room_features.py", description="Count ORB's keypoints in Noisy-Rooms.")
    parser.add_argument("--every", type=int, default=10, help="only each n-th frame")
    parser.add_argument("--scenes", action="append", default=[], help="names or globs of rooms")
    parser.add_argument("--engine", default="embree", help="the engine (default: embree, the fastest)")
    options = parser.parse_args(arguments)
    preset = ROOT / "presets/noisy_rooms.yaml"
    overrides = [f"render.engine={options.engine}"]
    plan = make_plan(read_preset(preset, overrides, scenes=options.scenes, settings=["clean"]))
    least = [(*fewest(plan, render, options.every), render.name) for render in plan.renders]
    for count, frame, name in least:
        print(f"{name}: at least {count} keypoints, in frame {frame}")
    return 1 if min(least)[0] < ENOUGH else 0


def fewest(plan: Plan, render: Render, every: int) -> tuple[int, int]:
    """Return the least number of keypoints in each n-th frame of a render, and the frame that has it."""
    detector = cv2.ORB.create(nfeatures=ASKED)
    paths = source_paths(plan, render)
    found: list[tuple[int, int]] = []
    with render.scene.source.prepare(render.camera, print) as prepared:
        source = prepared.open(paths, render_options(plan, render), print)
        for frame in render.frames[::every]:
            picture = CleanFrame(frame, source.frame(paths.request(frame))).byte_rgb
            grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
            found.append((len(detector.detect(grey)), frame))
    return min(found)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
