"""Recordings in TUM's layout from arrays, and a camera for them."""

import cv2
import numpy as np

SIZE_PX = (96, 72)
CAMERA = {"width": 96, "height": 72, "fx": 80.0, "fy": 80.0, "cx": 47.5, "cy": 35.5}
RATE_HZ = 10


def write_tum(folder, rgbs, depth_steps, poses=None):
    """Write images (H, W, 3) RGB and (H, W) uint16, one of each a frame, and rows tx ty tz qx qy qz qw, if any."""
    lists = {"rgb": [], "depth": [], **({} if poses is None else {"groundtruth": []})}
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
    for n, (rgb, steps) in enumerate(zip(rgbs, depth_steps, strict=True)):
        at = f"{100 + n / RATE_HZ:.6f}"
        cv2.imwrite(str(folder / f"rgb/{at}.png"), rgb[..., ::-1])
        cv2.imwrite(str(folder / f"depth/{at}.png"), np.asarray(steps, np.uint16))
        for kind in ("rgb", "depth"):
            lists[kind].append(f"{at} {kind}/{at}.png")
        if poses is not None:
            lists["groundtruth"].append(" ".join([at, *(repr(float(value)) for value in poses[n])]))
    for name, rows in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(rows) + "\n")
    return folder
