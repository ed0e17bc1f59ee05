# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings in the forms of other datasets and devices, of a few pixels, to be mutated."""

import json

import cv2
import numpy as np

COUNT = 3
SIZE = (8, 6)  # width, height


def _image(path, pixels):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pixels)


def _pairs(folder, rng, colour, depth, depth_size=SIZE):
    """Write random images. colour, depth: their names by their numbers."""
    for k in range(COUNT):
        _image(folder / colour(k), rng.integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8))
        _image(folder / depth(k), rng.integers(0, 65536, depth_size[::-1], dtype=np.uint16))


def _pose(k, lost=None):
    rows = np.full((4, 4), -np.inf) if k == lost else np.eye(4)
    rows[0, 3] += k / 10
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist())


def _numbered_poses(folder, name, lost=None):
    for k in range(COUNT):
        path = folder / name(k)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(_pose(k, lost))


def _log():
    return "".join(f"{k} {k} {k + 1}\n{_pose(k)}" for k in range(COUNT))


def seven_scenes(folder, rng):
    """Write a recording as 7-Scenes'."""
    suffix = ("png", "jpg")[int(rng.integers(2))]
    _pairs(folder, rng, lambda k: f"frame-{k:06d}.color.{suffix}", lambda k: f"frame-{k:06d}.depth.png")
    _numbered_poses(folder, lambda k: f"frame-{k:06d}.pose.txt")


def bundlefusion(folder, rng):
    """Write a recording as BundleFusion's, with depth of half the size."""
    _pairs(folder, rng, lambda k: f"frame-{k:06d}.color.jpg", lambda k: f"frame-{k:06d}.depth.png", (4, 3))
    _numbered_poses(folder, lambda k: f"frame-{k:06d}.pose.txt", lost=1)
    lines = ["m_versionNumber = 4", "m_sensorName = StructureSensor", "m_depthShift = 1000"]
    for kind, (wide, high) in (("color", SIZE), ("depth", (4, 3))):
        lines += [f"m_{kind}Width = {wide}", f"m_{kind}Height = {high}"]
        lines += [f"m_calibration{kind.capitalize()}Intrinsic = {wide} 0 {wide / 2} 0 0 {wide} {high / 2} 0 0 0 1 0 0 0 0 1 "]  # fmt: skip  # noqa: E501
        lines += [f"m_calibration{kind.capitalize()}Extrinsic = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 "]
    (folder / "info.txt").write_text("\n".join([*lines, f"m_frames.size = {COUNT}", ""]))


def scannet(folder, rng):
    """Write a recording as ScanNet's is exported, with depth of half the size."""
    _pairs(folder, rng, lambda k: f"color/{k}.jpg", lambda k: f"depth/{k}.png", (4, 3))
    _numbered_poses(folder, lambda k: f"pose/{k}.txt", lost=1)
    (folder / "intrinsic").mkdir()
    for kind, wide in (("color", 8), ("depth", 4)):
        matrix = f"{wide} 0 {wide / 2} 0\n0 {wide} {wide / 3} 0\n0 0 1 0\n0 0 0 1\n"
        (folder / f"intrinsic/intrinsic_{kind}.txt").write_text(matrix)
        (folder / f"intrinsic/extrinsic_{kind}.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")


def icl_nuim(folder, rng):
    """Write a recording as ICL-NUIM's."""
    _pairs(folder, rng, lambda k: f"rgb/{k}.png", lambda k: f"depth/{k}.png")
    (folder / "associations.txt").write_text("".join(f"{k} depth/{k}.png {k} rgb/{k}.png\n" for k in range(COUNT)))
    rows = "".join(f"{k} {k / 10} 0 0 0 0 0 1\n" for k in range(1, COUNT))
    (folder / "livingRoom0.gt.freiburg").write_text(rows)


def open3d(folder, rng):
    """Write a recording as Open3D's recorder does."""
    _pairs(folder, rng, lambda k: f"color/{k:05d}.jpg", lambda k: f"depth/{k:05d}.png")
    told = {"width": SIZE[0], "height": SIZE[1], "intrinsic_matrix": [8.0, 0, 0, 0, 8.0, 0, 3.5, 2.5, 1]}
    (folder / "intrinsic.json").write_text(json.dumps({**told, "fps": 15.0, "depth_scale": 4000.0}, indent=1))
    (folder / "scene").mkdir()
    (folder / "scene/trajectory.log").write_text(_log())


def redwood(folder, rng):
    """Write a recording as Redwood's."""
    _pairs(folder, rng, lambda k: f"colors/{k:05d}.jpg", lambda k: f"depth/{k:05d}.png")
    (folder / "office1-traj.txt").write_text(_log())


def nerfstudio(folder, rng):
    """Write a recording as nerfstudio's, with depth of half the size."""
    _pairs(folder, rng, lambda k: f"images/{k}.png", lambda k: f"depths/{k}.png", (4, 3))
    frames = [
        {
            "file_path": f"images/{k}.png",
            "depth_file_path": f"depths/{k}.png",
            "transform_matrix": [[1.0, 0, 0, k / 10], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        }
        for k in range(COUNT)
    ]
    told = {"w": 8, "h": 6, "fl_x": 8.0, "fl_y": 8.0, "cx": 4.0, "cy": 3.0, "k1": 0.1}
    (folder / "transforms.json").write_text(json.dumps({**told, "camera_model": "OPENCV", "frames": frames}, indent=1))


WRITERS = (seven_scenes, bundlefusion, scannet, icl_nuim, open3d, redwood, nerfstudio)
