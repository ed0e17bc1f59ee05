# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets made by arithmetic in each layout, and parsers of what lies on disk that are the tests' own."""

import csv
import json

import cv2
import numpy as np
import yaml
from worlds import write_world


SIZE = (8, 6)
COUNT = 4
SHAKY = {"name": "shaky", "perturb": [{"motion_deviation": {"rotation_deg": 3, "translation_m": 0.05}}]}
RIG = {
    "rgb": {"translation_m": [0.1, 0.0, 0.2], "rotation_euler_deg": [-90.0, 0.0, -90.0]},
    "depth": {"translation_m": [0.1, 0.05, 0.2], "rotation_euler_deg": [-90.0, 10.0, -90.0]},
}


def world(folder, layout, *, frames=COUNT, output=None, **keys):
    return write_world(folder, frames=frames, size=SIZE, output={"layout": layout, **(output or {})}, **keys)


def stored(folder, source, **output):
    """Write a preset whose scene is a sequence that exists."""
    camera = {"width": 8, "height": 6, "fx": 4.0, "fy": 4.0, "cx": 3.5, "cy": 2.5}
    scene = {"name": "box", "sequence": str(source)}
    preset = {"seed": 3, "scenes": [scene], "camera": camera, "render": {"backend": "reference"}, "output": output}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "stored.json"
    path.write_text(json.dumps(preset))
    return path


# --- parsers of our own ---


def rows_of(path):
    """The rows of a data.csv without its header, as evo and others read them; no line may end in CR."""
    text = path.read_bytes().decode("ascii")
    assert "\r" not in text
    assert text.endswith("\n")
    header, *rows = csv.reader(text.splitlines())
    assert header[0].startswith("#timestamp")
    return rows


def matrix_of(row):
    """The pose (4, 4) of a row of ground truth, its quaternion with w first, by hand."""
    assert len(row) == 8
    x, y, z, qw, qx, qy, qz = map(float, row[1:])
    assert abs(qw * qw + qx * qx + qy * qy + qz * qz - 1) < 1e-9
    return np.array(
        [
            [1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qz * qw), 2 * (qx * qz + qy * qw), x],
            [2 * (qx * qy + qz * qw), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qx * qw), y],
            [2 * (qx * qz - qy * qw), 2 * (qy * qz + qx * qw), 1 - 2 * (qx * qx + qy * qy), z],
            [0, 0, 0, 1],
        ]
    )


def states(folder, name="state_groundtruth_estimate0"):
    rows = rows_of(folder / "mav0" / name / "data.csv")
    return [int(row[0]) for row in rows], np.array([matrix_of(row) for row in rows])


def replica_poses(path):
    return np.loadtxt(path).reshape(-1, 4, 4)


def extrinsics(path):
    sensor = yaml.safe_load(path.read_text())
    assert (sensor["T_BS"]["rows"], sensor["T_BS"]["cols"]) == (4, 4)
    return np.array(sensor["T_BS"]["data"]).reshape(4, 4)


def read(path):
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None, path
    return found


def names_in(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def fake_rgb(frame):
    ramp = np.linspace(0, 1, 48, dtype=np.float32).reshape(6, 8)
    return np.stack([ramp, 1 - ramp, np.full_like(ramp, frame / 255)], axis=-1)


def fake_depth_m(frame):
    return 1 + np.linspace(0, 1, 48).reshape(6, 8) + frame


def write_tum_path(folder, stamps):
    rows = [f"{stamp} {0.1 * k} 0.0 1.2 0.0 0.0 0.0 1.0" for k, stamp in enumerate(stamps)]
    (folder / "path.txt").write_text("\n".join(rows) + "\n")
    return "scenes.0.trajectory=path.txt"
