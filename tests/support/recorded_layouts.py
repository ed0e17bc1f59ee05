# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings as others write them, of a box seen from inside: each at its own conventions, by its own arithmetic."""

import json
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

HALF_M = np.array([2.0, 1.5, 1.2])  # of the box's sides; symmetric, so that it may be mirrored
FRAMES = 4


@dataclass(frozen=True)
class Written:
    """What a recording holds. c2w: (N, 4, 4), OpenCV's axes; NaN where a pose is lost. steps: depth of each frame."""

    c2w: np.ndarray
    steps: list
    scale_per_m: float
    depth_k: tuple
    colour_k: tuple
    numbers: tuple = tuple(range(FRAMES))
    hz: float = 30.0
    lost: tuple = ()


def poses(count=FRAMES, seed=0):
    random = np.random.default_rng(seed)
    c2w = np.tile(np.eye(4), (count, 1, 1))
    c2w[:, :3, :3] = Rotation.random(count, rng=random).as_matrix()
    c2w[:, :3, 3] = random.uniform(-0.5, 0.5, (count, 3)) * HALF_M
    return c2w


def box_depth_m(k, c2w):
    """Planar depth of the box by slabs. k: width, height, fx, fy, cx, cy; a negative fy is a camera with y up."""
    wide, high, fx, fy, cx, cy = k
    u, v = np.meshgrid(np.arange(wide), np.arange(high))
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u, dtype=float)], axis=-1) @ c2w[:3, :3].T
    with np.errstate(divide="ignore"):
        return (np.where(rays > 0, HALF_M - c2w[:3, 3], -HALF_M - c2w[:3, 3]) / rays).min(axis=-1)


def text_of(matrix):
    return "".join(" ".join(f"{value:.17g}" for value in row) + "\n" for row in matrix)


def image(path, pixels):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pixels)


def colour(k, frame):
    pixels = np.zeros((k[1], k[0], 3), np.uint8)
    pixels[...] = (10 * frame, 100, 200)  # BGR
    return pixels


def _steps(k, c2w, scale, void=0):
    steps = [np.rint(box_depth_m(k, one) * scale).astype(np.uint16) for one in c2w]
    for one in steps:
        one[:2, :3] = void
    return steps


def seven_scenes(folder, suffix="png"):
    k = (640, 480, 585.0, 585.0, 320.0, 240.0)
    c2w = poses()
    steps = _steps(k, c2w, 1000.0, void=65535)
    for n in range(FRAMES):
        image(folder / f"frame-{n:06d}.color.{suffix}", colour(k, n))
        image(folder / f"frame-{n:06d}.depth.png", steps[n])
        (folder / f"frame-{n:06d}.pose.txt").write_text("\t ".join(text_of(c2w[n]).split(" ")))
    return Written(c2w, steps, 1000.0, k, k)


def bundlefusion(folder):
    rgb, seen = (64, 48, 58.0, 59.0, 32.0, 24.0), (32, 24, 29.5, 30.0, 15.5, 12.0)
    c2w = poses(seed=1)
    steps = _steps(seen, c2w, 1000.0)
    for n in range(FRAMES):
        image(folder / f"frame-{n:06d}.color.jpg", colour(rgb, n))
        image(folder / f"frame-{n:06d}.depth.png", steps[n])
        lost = np.full((4, 4), -np.inf)
        (folder / f"frame-{n:06d}.pose.txt").write_text(text_of(lost if n == 2 else c2w[n]))
    lines = ["m_versionNumber = 4", "m_sensorName = StructureSensor", "m_depthShift = 1000"]
    for kind, (wide, high, fx, fy, cx, cy) in (("color", rgb), ("depth", seen)):
        lines += [f"m_{kind}Width = {wide}", f"m_{kind}Height = {high}"]
        lines += [f"m_calibration{kind.capitalize()}Intrinsic = {fx} 0 {cx} 0 0 {fy} {cy} 0 0 0 1 0 0 0 0 1 "]
        lines += [f"m_calibration{kind.capitalize()}Extrinsic = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 "]
    (folder / "info.txt").write_text("\n".join([*lines, "m_frames.size = 4", ""]))
    return Written(c2w, steps, 1000.0, seen, rgb, lost=(2,))


def scannet(folder):
    rgb, seen = (64, 48, 58.5, 59.0, 32.25, 24.5), (32, 24, 28.5, 28.75, 16.0, 11.5)
    c2w = poses(seed=2)
    steps = _steps(seen, c2w, 1000.0)
    for n in range(FRAMES):
        image(folder / f"color/{n}.jpg", colour(rgb, n))
        image(folder / f"depth/{n}.png", steps[n])
        (folder / "pose").mkdir(exist_ok=True)
        (folder / f"pose/{n}.txt").write_text(text_of(np.full((4, 4), -np.inf) if n == 1 else c2w[n]))
    (folder / "intrinsic").mkdir()
    for kind, (_, _, fx, fy, cx, cy) in (("color", rgb), ("depth", seen)):
        matrix = np.diag([fx, fy, 1.0, 1.0])
        matrix[:2, 2] = cx, cy
        (folder / f"intrinsic/intrinsic_{kind}.txt").write_text(text_of(matrix))
        (folder / f"intrinsic/extrinsic_{kind}.txt").write_text(text_of(np.eye(4)))
    return Written(c2w, steps, 1000.0, seen, rgb, lost=(1,))


def icl_nuim(folder):
    left = (640, 480, 481.2, -480.0, 319.5, 239.5)  # as the dataset says it
    c2w = poses(seed=3)
    steps = _steps(left, c2w, 5000.0)
    pairs, truth = [], []
    for n in range(FRAMES):
        image(folder / f"rgb/{n}.png", colour(left, n))
        image(folder / f"depth/{n}.png", steps[n])
        pairs.append(f"{n} depth/{n}.png {n} rgb/{n}.png\n")
        if n:  # the first frame has no pose
            xyzw = Rotation.from_matrix(c2w[n, :3, :3]).as_quat()
            truth.append(" ".join([str(n), *map(repr, [*c2w[n, :3, 3].tolist(), *xyzw.tolist()])]) + "\n")
    (folder / "associations.txt").write_text("".join(pairs))
    (folder / "livingRoom0.gt.freiburg").write_text("".join(truth))
    flip = np.diag([1.0, -1.0, 1.0, 1.0])
    return Written(flip @ c2w @ flip, steps, 5000.0, (640, 480, 481.2, 480.0, 319.5, 239.5), left, lost=(0,))


def open3d(folder):
    k = (64, 48, 61.0, 60.5, 31.25, 23.75)
    c2w = poses(seed=4)
    steps = _steps(k, c2w, 4000.0)
    for n in range(FRAMES):
        image(folder / f"color/{n:05d}.jpg", colour(k, n))
        image(folder / f"depth/{n:05d}.png", steps[n])
    columns = [k[2], 0, 0, 0, k[3], 0, k[4], k[5], 1]
    told = {"width": 64, "height": 48, "intrinsic_matrix": columns, "fps": 15.0, "depth_scale": 4000.0}
    (folder / "intrinsic.json").write_text(json.dumps({**told, "device_name": "Intel RealSense D435"}))
    (folder / "scene").mkdir()
    log = "".join(f"{n} {n} {n + 1}\n{text_of(c2w[n])}" for n in range(FRAMES))
    (folder / "scene/trajectory.log").write_text(log)
    return Written(c2w, steps, 4000.0, k, k, hz=15.0)


def redwood(folder):
    k = (640, 480, 525.0, 525.0, 319.5, 239.5)
    c2w = poses(seed=5)
    steps = _steps(k, c2w, 1000.0)
    for n in range(FRAMES):
        image(folder / f"colors/{n + 7:05d}.jpg", colour(k, n))
        image(folder / f"depth/{n + 7:05d}.png", steps[n])
    log = "".join(f"{n} {n} {n + 1}\n{text_of(c2w[n])}" for n in range(FRAMES))
    (folder / "office1-traj.txt").write_text(log)
    return Written(c2w, steps, 1000.0, k, k, numbers=(7, 8, 9, 10))


def nerfstudio(folder):
    rgb = (64, 48, 61.0, 60.5, 31.25, 23.75)
    # Depth shows the same view in a quarter of the pixels a side: corners scale with it, and centres do not.
    seen = (16, 12, 61.0 / 4, 60.5 / 4, (31.25 + 0.5) / 4 - 0.5, (23.75 + 0.5) / 4 - 0.5)
    c2w = poses(seed=6)
    steps = _steps(seen, c2w, 1000.0)
    frames = []
    for n in range(FRAMES):
        image(folder / f"images/frame_{n + 1}.png", colour(rgb, n))
        image(folder / f"depths/frame_{n + 1}.png", steps[n])
        opengl = c2w[n] * np.array([1.0, -1.0, -1.0, 1.0])
        names = {"file_path": f"images/frame_{n + 1}.png", "depth_file_path": f"depths/frame_{n + 1}.png"}
        frames.append({**names, "transform_matrix": opengl.tolist()})
    told = {"w": 64, "h": 48, "fl_x": 61.0, "fl_y": 60.5, "cx": 31.75, "cy": 24.25, "k1": 0.1, "k2": -0.05}
    (folder / "transforms.json").write_text(json.dumps({**told, "camera_model": "OPENCV", "frames": frames[::-1]}))
    return Written(c2w, steps, 1000.0, seen, rgb)


WRITERS = {
    writer.__name__: writer for writer in (seven_scenes, bundlefusion, scannet, icl_nuim, open3d, redwood, nerfstudio)
}
