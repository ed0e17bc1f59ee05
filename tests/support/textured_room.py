"""A box room of smooth random textures, seen by a pinhole or through a lens, by arithmetic: colour and planar depth."""

import cv2
import numpy as np

TEXELS = 512


def textures(seed=0, contrast=1.0):
    """Six images (T, T) float32, one for each wall, smooth at several sizes."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(6):
        parts = [
            cv2.resize(rng.random((count, count), np.float32), (TEXELS, TEXELS), interpolation=cv2.INTER_CUBIC)
            for count in (16, 64, 160)
        ]
        made.append(128 + contrast * 150 * (sum(parts) / 3 - 0.5))
    return made


def look(c2w, rays, walls, half_m):
    """Return grey (H, W) and planar depth (H, W) from inside a box of half-lengths half_m. rays: (H, W, 3), z 1."""
    world = rays @ c2w[:3, :3].T
    ahead = np.where(world >= 0, half_m, -half_m)
    with np.errstate(divide="ignore"):
        away = (ahead - c2w[:3, 3]) / world
    axis = away.argmin(axis=-1)
    depth_m = np.take_along_axis(away, axis[..., None], axis=-1)[..., 0]
    points = c2w[:3, 3] + world * depth_m[..., None]
    grey = np.zeros(axis.shape, np.float32)
    for wall in range(6):
        across = [k for k in range(3) if k != wall // 2]
        here = (axis == wall // 2) & ((world[..., wall // 2] >= 0) == bool(wall % 2))
        u, v = ((points[..., k] / half_m[k] + 1) / 2 * (TEXELS - 1) for k in across)
        seen = cv2.remap(walls[wall].astype(np.float32), u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
        grey[here] = seen[here]
    return np.clip(grey, 0, 255).round().astype(np.uint8), depth_m
