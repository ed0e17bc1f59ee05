# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a pose for each frame."""

import json
import pathlib
import sys

frames = json.loads(pathlib.Path(sys.argv[1]).read_text())["frames"]
rows = [f"{frame['stamp_s']!r} {k / 1000} 0 0 0 0 0 1" for k, frame in enumerate(frames)]
pathlib.Path(sys.argv[2], "poses.txt").write_text("\n".join(rows) + "\n")
