# SPDX-License-Identifier: GPL-3.0-or-later
"""Small worlds for tests: a coloured box room, a short path through it and a preset, written to a folder."""

import contextlib
import hashlib
import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml
from analytic import box_mesh, look_at

ROOT = Path(__file__).resolve().parents[2]
GENERATE = ROOT / "headless" / "generate.py"
BLENDER_IS_HERE = importlib.util.find_spec("bpy") is not None  # asked before a test forbids its import
LOW, HIGH = np.array([-2.0, -1.5, 0.0]), np.array([2.0, 1.5, 2.5])
WALLS = np.array([[200, 60, 50], [60, 160, 70], [70, 90, 190], [210, 190, 80], [130, 100, 80], [230, 225, 215]])


def need_blender():
    """Skip a test whose program renders in Blender, where its package is not installed."""
    import pytest

    if not BLENDER_IS_HERE:
        pytest.skip("bpy is not installed")


def write_box_ply(path, *, shift_m=(0.0, 0.0, 0.0)):
    """A box room of six walls, each of one colour, as ASCII PLY with doubles, by hand."""
    walls = box_mesh(LOW, HIGH).vertices_m + shift_m
    lines = ["ply", "format ascii 1.0", "element vertex 24"]
    lines += [f"property double {axis}" for axis in "xyz"]
    lines += [f"property uchar {name}" for name in ("red", "green", "blue")]
    lines += ["element face 6", "property list uchar int vertex_indices", "end_header"]
    for k, vertex in enumerate(walls):
        lines.append(" ".join(map(repr, map(float, vertex))) + " " + " ".join(map(str, WALLS[k // 4])))
    lines += [f"4 {4 * k} {4 * k + 1} {4 * k + 2} {4 * k + 3}" for k in range(6)]
    path.write_text("\n".join(lines) + "\n")


def with_objects(folder, ids):
    """Give the walls of a world's mesh object ids."""
    path = folder / "mesh.ply"
    *lines, last = path.read_text().rstrip("\n").split("end_header\n")[1].split("\n")
    head = path.read_text().split("end_header\n")[0] + "property int object_id\nend_header\n"
    rows = [*lines, last]
    faces = [f"{row} {number}" for row, number in zip(rows[-6:], ids, strict=True)]
    path.write_text(head + "\n".join([*rows[:-6], *faces]) + "\n")


def path_poses(count, *, shift_m=(0.0, 0.0, 0.0)):
    """Poses (count, 4, 4) of a camera that turns in the room's middle."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    eyes = np.stack([0.3 * np.cos(angles), 0.2 * np.sin(angles), 1.2 + 0.1 * np.sin(2 * angles)], axis=-1) + shift_m
    targets = eyes + np.stack([np.cos(angles), np.sin(angles), -0.2 * np.ones(count)], axis=-1)
    return np.stack([look_at(eye, target) for eye, target in zip(eyes, targets, strict=True)])


def write_replica(path, poses):
    path.write_text("\n".join(" ".join(repr(float(x)) for x in pose.ravel()) for pose in poses) + "\n")


def write_world(folder, *, frames=6, size=(64, 48), shift_m=(0.0, 0.0, 0.0), **keys):
    """Write mesh.ply, traj.txt and preset.yaml; keys replace the preset's. Return the preset's path.

    Colour is perturbed by the reference, which needs no Blender, unless `render` says otherwise.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_box_ply(folder / "mesh.ply", shift_m=np.asarray(shift_m))
    write_replica(folder / "traj.txt", path_poses(frames, shift_m=np.asarray(shift_m)))
    preset = {
        "seed": 3,
        "scenes": [{"name": "box", "mesh": "mesh.ply", "trajectory": "traj.txt"}],
        "camera": {
            "width": size[0],
            "height": size[1],
            "fx": size[0] / 2,
            "fy": size[0] / 2,
            "cx": (size[0] - 1) / 2,
            "cy": (size[1] - 1) / 2,
        },
        "render": {"engine": "cycles", "samples": 1, "backend": "reference"},
        "settings": [{"name": "clean"}],
        "output": {"layout": "replica", "image": "png"},
        **keys,
    }
    path = folder / "preset.yaml"
    path.write_text(yaml.safe_dump(preset))
    return path


def generate(*arguments, check=True, **options):
    """Run the command line; return the finished process."""
    command = [sys.executable, str(GENERATE), *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, **options)
    if check and result.returncode != 0:
        raise AssertionError(f"status {result.returncode}\n{result.stdout}\n{result.stderr}")
    return result


def generate_here(*arguments, check=True):
    """Run the command line in this process, which has Blender loaded; return what a process would have left."""
    from noisy_world.cli import command
    from noisy_world.cli.entry import Entry

    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    entry = Entry("generate.py", (sys.executable, str(GENERATE)))
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        try:
            with _streams_to(out, err):
                status = command.run("generate", [str(argument) for argument in arguments], entry)
        except SystemExit as usage:  # argparse's
            status = usage.code
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
        said = [file.seek(0) or file.read() for file in (out, err)]
    if check and status != 0:
        raise AssertionError(f"status {status}\n{said[0]}\n{said[1]}")
    return subprocess.CompletedProcess(arguments, status, *said)


@contextlib.contextmanager
def _streams_to(out, err):
    """Lead the descriptors 1 and 2 to two files, and what Python writes."""
    kept = [os.dup(number) for number in (1, 2)]
    try:
        for number, file in enumerate((out, err), 1):
            os.dup2(file.fileno(), number)
        with (
            os.fdopen(os.dup(1), "w", buffering=1) as stdout,
            os.fdopen(os.dup(2), "w", buffering=1) as stderr,
            contextlib.redirect_stdout(stdout),
            contextlib.redirect_stderr(stderr),
        ):
            yield
    finally:
        for number, saved in enumerate(kept, 1):
            os.dup2(saved, number)
            os.close(saved)


def start_generate(*arguments, **options):
    """Start the command line in a process group of its own, as a shell would."""
    command = [sys.executable, str(GENERATE), *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, **options
    )


def content(folder):
    """Return the SHA-256 of every file of a dataset by name, but for run.json, which holds timings."""
    found = {}
    for base, _, names in os.walk(folder):
        for name in names:
            path = Path(base) / name
            found[str(path.relative_to(folder))] = hashlib.sha256(path.read_bytes()).hexdigest()
    assert found.pop("run.json", None), "no run.json"
    return found
