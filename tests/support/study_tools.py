# SPDX-License-Identifier: GPL-3.0-or-later
"""Small studies for tests: a box room seen by rays, and systems that know the way."""

import csv
import json
import signal
import sys

import numpy as np
import pytest
import yaml
from worlds import path_poses, write_world

from noisy_world.cli import command

Rotation = pytest.importorskip("scipy.spatial.transform", reason="scipy comes with the extra evaluate").Rotation

FRAMES = 6
SIZE = (32, 24)
SETTINGS = [
    {"name": "clean"},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 3}}]},
    {"name": "bright", "perturb": [{"brightness": {"severity": 3}}]},
    {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]},
]

# Copies the pose of a frame's number from a file of positions and quaternions; each kind does something else beside.
PROGRAM = """
import json, os, signal, sys, time
kind, frames, out, path = sys.argv[1:5]
index = json.load(open(frames))["frames"]
rows = [list(map(float, line.split())) for line in open(path)]
if kind == "crash":
    print("out of memory")
    os.kill(os.getpid(), signal.SIGSEGV)
if kind == "hang":
    time.sleep(60)
if kind == "nothing":
    sys.exit(0)
if kind == "disc":
    with open(os.path.join(out, "map.ply"), "w") as file:
        file.write("ply\\nformat ascii 1.0\\nelement vertex 300\\n")
        file.writelines(f"property float {axis}\\n" for axis in "xyz")
        file.write("element face 1\\nproperty list int int vertex_indices\\nend_header\\n")
        file.writelines(f"{k % 7} {k % 5} {k % 3}\\n" for k in range(300))
        print(300, *range(300), file=file)
with open(os.path.join(out, "poses.txt"), "w") as file:
    for frame in index[:3] if kind == "three" else index[::2] if kind == "half" else index:
        pose = list(rows[frame["index"]])
        if kind == "nan":
            pose[0] = float("nan")
        if kind == "still":
            pose = rows[0]
        if kind == "long":
            pose[:3] = [1.05 * value for value in pose[:3]]
        file.write(" ".join(map(repr, [frame["stamp_s"], *pose])) + chr(10))
"""


def write_systems(folder, *kinds, repeatable=True, frames=FRAMES):
    """Write a definition for each kind of system; return what --systems takes."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "program.py").write_text(PROGRAM)
    path = folder / "way.txt"
    poses = path_poses(frames)
    quats_xyzw = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    rows = np.concatenate([poses[:, :3, 3], quats_xyzw], axis=1)
    path.write_text("".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()))
    found = []
    for kind in kinds:
        words = [sys.executable, "-I", "-S", "{here}/program.py", kind, "{frames}", "{out}", str(path)]
        definition = {
            "name": kind,
            "command": words,
            "writes": {"file": "poses.txt", "format": "tum"},
            "time_limit": {"start_s": 1.0 if kind == "hang" else 60.0, "frame_s": 0.0},
            "repeatable": repeatable,
        }
        (folder / f"{kind}.yaml").write_text(yaml.safe_dump(definition))
        found.append(str(folder / f"{kind}.yaml"))
    return ",".join(found)


def small_world(folder, **keys):
    """Write a world whose frames rays make; return its preset."""
    render = {"engine": "embree", "backend": "reference"}
    return write_world(folder, **{"frames": FRAMES, "size": SIZE, "render": render, "settings": SETTINGS, **keys})


def evaluate(*words, report=False):
    """Run the command in this process and return its status. report: whether it ends with one, which takes seconds."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        return command.main(["evaluate", *map(str, words), *([] if report else ["--no-report"])])
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def rows_of(results, name="runs"):
    with (results / "tables" / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


TIMES = ("seconds", "processor_s", "peak_memory_bytes")


def told(results):
    """Everything in a folder of results, by name, but for the times that runs took."""
    found = {}
    for path in sorted(results.rglob("*")):
        if path.is_file():
            name, content = path.relative_to(results).as_posix(), path.read_bytes()
            if path.name == "run.json":
                content = {key: value for key, value in json.loads(content).items() if key not in TIMES}
            if path.name == "runs.csv":
                content = [{key: value for key, value in row.items() if key not in TIMES} for row in rows_of(results)]
            found[name] = content
    return found
