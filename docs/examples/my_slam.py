# SPDX-License-Identifier: GPL-3.0-or-later
"""The frame of a SLAM system: it is started with a JSON file that names the images, and writes a pose for each.

It says that the camera stands still. Put your tracker where `track` is.
"""

import json
import sys
from pathlib import Path
from typing import Any


def track(frame: dict[str, Any], index: dict[str, Any]) -> tuple[float, ...]:
    """Return where the camera is: x y z in metres, and qx qy qz qw; x is right, y down, z forward, camera to world.

    frame: its time, `stamp_s`, and the files of its images, `colour` and `depth`. index: the intrinsics, `camera`, and
    `depth_scale_per_m`, by which the numbers in depth's PNG are divided.
    """
    assert {"colour", "depth"} <= frame.keys()
    assert {"camera", "depth_scale_per_m"} <= index.keys()
    return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def main(file: str) -> None:
    """Track all frames, in their order."""
    index = json.loads(Path(file).read_text(encoding="utf-8"))
    with Path("poses.txt").open("w", encoding="utf-8") as poses:
        for frame in index["frames"]:
            print(frame["stamp_s"], *track(frame, index), file=poses, flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
