"""A room in closed form, seen by a moving camera: frames of a textured box, and the true poses, without a renderer."""

import json

import cv2
import numpy as np
from analytic import box_depth, rays

from noisy_world.core.geometry import Intrinsics, pose, quat_wxyz_from_rotation, rotation_from_euler_deg

CAMERA = Intrinsics(160, 120, 80.0, 80.0, 79.5, 59.5)
LOW, HIGH = np.array([-2.0, -1.5, -1.2]), np.array([2.5, 1.8, 1.4])
SCALE_PER_M = 5000.0
RATE_HZ = 20.0
FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # looks along the world's x, z is up


def path(frames, turn_deg=0.0, sway_m=0.3):
    """c2w (N, 4, 4): turning about the vertical by `turn_deg` in all, and swaying."""
    at = np.linspace(0.0, 1.0, frames)
    position = sway_m * np.stack([np.sin(4 * at), np.cos(5 * at) - 1.0, 0.3 * np.sin(6 * at)], axis=-1)
    zero = np.zeros(frames)
    return pose(rotation_from_euler_deg(zero, 8.0 * np.sin(3 * at), turn_deg * at) @ FORWARD, position)


def frame(c2w, camera=CAMERA):
    """Colour (H, W, 3) uint8 and depth (H, W) float64 in metres of the room."""
    depth_m, _ = box_depth(camera, c2w, LOW, HIGH)
    point = c2w[:3, 3] + rays(camera, c2w) * depth_m[..., None]
    x, y, z = np.moveaxis(point, -1, 0)
    waves = (
        np.sin(5 * x + 3 * z) + np.sin(7 * y - 2 * x) + np.sin(6 * z + 4 * y) + np.sin(13 * x) * np.sin(11 * y + 9 * z)
    )
    blocks = np.sin(9 * x) * np.sin(8 * y) * np.sin(10 * z + 1.0) > 0.1
    grey = np.clip(128 + 22 * waves + 40 * blocks, 0, 255)
    return np.repeat(grey[..., None], 3, axis=-1).astype(np.uint8), depth_m


def write(folder, poses, camera=CAMERA, change=lambda number, colour, depth_m: (colour, depth_m)):
    """Write the frames of a path and their index; return its file. change: what is done to each frame."""
    folder.mkdir(parents=True, exist_ok=True)
    entries = []
    for number, c2w in enumerate(poses):
        colour, depth_m = change(number, *frame(c2w, camera))
        steps = np.clip(np.rint(depth_m * SCALE_PER_M), 0, 65535).astype(np.uint16)
        entry = {"index": number, "stamp_s": number / RATE_HZ, "depth_stamp_s": number / RATE_HZ}
        for kind, image in (("colour", colour), ("depth", steps)):
            entry[kind] = str(folder / f"{kind}{number:04d}.png")
            cv2.imwrite(entry[kind], image)
        entries.append(entry)
    sides = {"width": camera.width_px, "height": camera.height_px}
    lens = {"fx": camera.fx_px, "fy": camera.fy_px, "cx": camera.cx_px, "cy": camera.cy_px}
    index = {"camera": sides | lens, "depth_scale_per_m": SCALE_PER_M, "frames": entries}
    file = folder / "frames.json"
    file.write_text(json.dumps(index))
    return file


def ate_rmse_m(estimated, true):
    """RMSE of positions (N, 3) after the best rigid alignment: Umeyama 1991 without scale, by SVD."""
    a, b = np.asarray(estimated), np.asarray(true)
    left, _, right = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
    turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    return float(np.sqrt((((b - b.mean(0)) - (a - a.mean(0)) @ turn.T) ** 2).sum(1).mean()))


def write_sequence(folder, poses, camera=CAMERA, change=lambda number, colour, depth_m: (colour, depth_m)):
    """Write the frames of a path as a sequence in TUM's layout, with true poses and camera; return its folder."""
    entries = json.loads(write(folder / "images", poses, camera, change).read_text())["frames"]
    lists = {"rgb": "colour", "depth": "depth"}
    for name, kind in lists.items():
        rows = [f"{entry['stamp_s']:.6f} {entry[kind].removeprefix(str(folder) + '/')}\n" for entry in entries]
        (folder / f"{name}.txt").write_text("".join(rows))
    rows = []
    for entry, c2w in zip(entries, poses, strict=True):
        wxyz = quat_wxyz_from_rotation(c2w[:3, :3])
        numbers = [*c2w[:3, 3], *np.roll(wxyz, -1)]
        rows.append(f"{entry['stamp_s']:.6f} {' '.join(map(repr, map(float, numbers)))}\n")
    (folder / "groundtruth.txt").write_text("".join(rows))
    lens = {"fx": camera.fx_px, "fy": camera.fy_px, "cx": camera.cx_px, "cy": camera.cy_px}
    whole = {"w": camera.width_px, "h": camera.height_px, **lens, "scale": SCALE_PER_M}
    (folder / "cam_params.json").write_text(json.dumps({"camera": whole}))
    return folder
