# SPDX-License-Identifier: GPL-3.0-or-later
"""Small sequences, and systems that are a few lines of Python each."""

import json
import sys

import cv2
import numpy as np
import yaml

from noisy_world.evaluate.systems import read_system

PRELUDE = """
import json, math, os, signal, subprocess, sys, time
index = json.load(open(sys.argv[1]))
frames = index["frames"]
def line(frame, x=0.0):
    return f"{frame['stamp_s']!r} {x} 0 0 0 0 0 1\\n"
def write(text, name="poses.txt"):
    open(name, "w").write(text)
"""


def write_recording(folder, frames=5, *, image="png", layout="tum", start_s=0.0, rate_hz=20.0):
    """Write a sequence of 8 x 6 pixels, which moves 1 cm along x with each frame."""
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    lists = {"rgb": [], "depth": [], "groundtruth": []}
    for k in range(frames):
        stamp = f"{start_s + k / rate_hz:.6f}"
        assert cv2.imwrite(str(folder / f"rgb/{k:06d}.{image}"), np.full((6, 8, 3), (10 + k, 20, 30), np.uint8))
        assert cv2.imwrite(str(folder / f"depth/{k:06d}.png"), np.full((6, 8), 5000 + k, np.uint16))
        lists["rgb"].append(f"{stamp} rgb/{k:06d}.{image}")
        lists["depth"].append(f"{stamp} depth/{k:06d}.png")
        lists["groundtruth"].append(f"{stamp} {k / 100} 0 0 0 0 0 1")
    for name, rows in lists.items():
        (folder / f"{name}.txt").write_text("".join(f"{row}\n" for row in rows))
    camera = {"w": 8, "h": 6, "fx": 10.0, "fy": 11.0, "cx": 3.5, "cy": 2.5, "scale": 5000.0}
    (folder / "cam_params.json").write_text(json.dumps({"camera": camera}))
    return folder


def script_system(folder, script, **keys):
    """Return a system that runs a script: `index`, `frames`, `line` and `write` are there for it."""
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / "program.py"
    program.write_text(PRELUDE + script)
    definition = {
        "name": "scripted",
        "command": [sys.executable, "-I", "-S", "-u", "{here}/program.py", "{frames}"],
        "writes": {"file": "poses.txt"},
        **keys,
    }
    path = folder / "scripted.yaml"
    path.write_text(yaml.safe_dump(definition))
    return read_system(path)
