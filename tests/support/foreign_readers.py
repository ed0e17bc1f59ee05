# SPDX-License-Identifier: GPL-3.0-or-later
"""What a sequence on disk says, read by the tests' own parsers of each layout: json, csv, yaml, numpy and OpenCV."""

import csv
import json
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
import yaml
from written import matrix_of, read, rows_of


@dataclass
class Said:
    """camera: w, h, fx, fy, cx, cy. Stamps in whole nanoseconds by frame; depth_m (N, H, W); rgb: images; c2w."""

    camera: tuple
    rgb_ns: list
    depth_ns: list
    pose_ns: list
    rgb: list
    depth_m: np.ndarray
    c2w: np.ndarray
    depth_scale: float


def ns_of(text):
    """Nanoseconds of seconds that are written in decimals."""
    return int((Decimal(text) * 10**9).to_integral_value())


def cam_params(folder):
    near = [path for path in (folder / "cam_params.json", folder.parent / "cam_params.json") if path.exists()]
    told = json.loads(near[0].read_text())["camera"]
    return tuple(told[name] for name in ("w", "h", "fx", "fy", "cx", "cy")), told["scale"]


def read_replica(folder):
    camera, scale = cam_params(folder)
    records = [json.loads(line) for line in (folder / "frames.jsonl").read_text().splitlines()]
    rgb = sorted((folder / "results").glob("frame*"))
    depth = sorted((folder / "results").glob("depth*"))
    assert len(rgb) == len(depth) == len(records)
    rgb_ns = [ns_of(repr(record["time_s"])) for record in records]
    depth_ns = [ns_of(repr(record.get("depth_time_s", record["time_s"]))) for record in records]
    c2w = np.loadtxt(folder / "traj.txt").reshape(-1, 4, 4)
    depth_m = np.array([read(path) for path in depth]) / scale
    return Said(camera, rgb_ns, depth_ns, rgb_ns, [read(path) for path in rgb], depth_m, c2w, scale)


def table(path):
    rows = [line.split() for line in path.read_text().splitlines() if not line.startswith("#")]
    assert [float(row[0]) for row in rows] == sorted(float(row[0]) for row in rows)
    return rows


def read_tum(folder):
    camera, scale = cam_params(folder)
    pairs = [line.split() for line in (folder / "associations.txt").read_text().splitlines()]
    listed = {name: stamp for kind in ("rgb", "depth") for stamp, name in table(folder / f"{kind}.txt")}
    assert all(listed[row[1]] == row[0] and listed[row[3]] == row[2] for row in pairs)
    assert len(listed) == 2 * len(pairs)
    poses = table(folder / "groundtruth.txt")
    return Said(
        camera,
        [ns_of(row[0]) for row in pairs],
        [ns_of(row[2]) for row in pairs],
        [ns_of(row[0]) for row in poses],
        [read(folder / row[1]) for row in pairs],
        np.array([read(folder / row[3]) for row in pairs]) / scale,
        np.array([matrix_of([row[0], *row[1:4], row[7], *row[4:7]]) for row in poses]),
        scale,
    )


def read_euroc(folder, truth="state_groundtruth_estimate0"):
    mav = folder / "mav0"
    sensors = {name: yaml.safe_load((mav / name / "sensor.yaml").read_text()) for name in ("cam0", "depth0")}
    camera = (*sensors["cam0"]["resolution"], *sensors["cam0"]["intrinsics"])
    assert camera == (*sensors["depth0"]["resolution"], *sensors["depth0"]["intrinsics"])
    scale = sensors["depth0"]["depth_scale_per_m"]
    rows = {name: rows_of(mav / name / "data.csv") for name in ("cam0", "depth0", truth)}
    for name in ("cam0", "depth0"):
        assert [row[1] for row in rows[name]] == sorted(path.name for path in (mav / name / "data").iterdir())
        assert all(row[1] == f"{int(row[0]):019d}.png" for row in rows[name])
    poses = rows[truth]
    return Said(
        camera,
        *([int(row[0]) for row in rows[name]] for name in rows),
        [read(mav / "cam0/data" / row[1]) for row in rows["cam0"]],
        np.array([read(mav / "depth0/data" / row[1]) for row in rows["depth0"]]) / scale,
        np.array([matrix_of(row) for row in poses]),
        scale,
    )


def read_vslamlab(folder):
    text = (folder / "calibration.yaml").read_text()
    assert text.startswith("%YAML 1.2\n---\ncameras:\n")
    (told,) = yaml.safe_load(text.partition("---\n")[2])["cameras"]
    camera = (*told["image_dimension"], *told["focal_length"], *told["principal_point"])
    assert told["T_BS"] == np.eye(4).ravel().tolist()
    rows = list(csv.DictReader((folder / "rgb.csv").open(newline="")))
    poses = list(csv.DictReader((folder / "groundtruth.csv").open(newline="")))
    columns = ("ts (ns)", "tx (m)", "ty (m)", "tz (m)", "qw", "qx", "qy", "qz")
    return Said(
        camera,
        [int(row["ts_rgb_0 (ns)"]) for row in rows],
        [int(row["ts_depth_0 (ns)"]) for row in rows],
        [int(row["ts (ns)"]) for row in poses],
        [read(folder / row["path_rgb_0"]) for row in rows],
        np.array([read(folder / row["path_depth_0"]) for row in rows]) / told["depth_factor"],
        np.array([matrix_of([row[name] for name in columns]) for row in poses]),
        told["depth_factor"],
    )


def read_tum_vi(folder):
    return read_euroc(folder, "mocap0")


READERS = {
    "replica": read_replica,
    "tum": read_tum,
    "euroc": read_euroc,
    "tum_vi": read_tum_vi,
    "vslamlab": read_vslamlab,
}
