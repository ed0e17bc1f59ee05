# SPDX-License-Identifier: GPL-3.0-or-later
"""pyrender on software GL, in its own Python: what many researchers would use instead.

    .venv-peer/bin/python headless/bench/pyrender_peer.py MESH.ply TRAJ.txt W H FX FY CX CY

Reads JSON lines {"do": "time", "frames": [...]}, answers `@{...}`: colour and depth rendered, encoded as our own are,
and written.
"""

import json
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

import cv2
import numpy as np
import pyrender
import trimesh

DEPTH_SCALE_PER_M = 6553.5  # Replica's


def main(mesh_path: str, poses_path: str, *numbers: str) -> None:
    """Load, and answer."""
    width, height = int(numbers[0]), int(numbers[1])
    fx, fy, cx, cy = map(float, numbers[2:6])
    start_s = time.perf_counter()
    scene = pyrender.Scene(ambient_light=(1.0, 1.0, 1.0), bg_color=(0, 0, 0))
    scene.add(pyrender.Mesh.from_trimesh(trimesh.load(mesh_path, process=False), smooth=False))
    camera = scene.add(pyrender.IntrinsicsCamera(fx, fy, cx, cy, znear=0.01, zfar=1000.0))
    renderer = pyrender.OffscreenRenderer(width, height)
    poses = np.loadtxt(poses_path).reshape(-1, 4, 4) @ np.diag([1.0, -1.0, -1.0, 1.0])

    def work(frame: int, folder: Path) -> None:
        scene.set_pose(camera, poses[frame % len(poses)])
        rgb, depth_m = renderer.render(scene, flags=pyrender.RenderFlags.FLAT | pyrender.RenderFlags.SKIP_CULL_FACES)
        quality = [cv2.IMWRITE_JPEG_QUALITY, 98, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111]
        cv2.imwrite(str(folder / f"{frame}.jpg"), rgb[..., ::-1], quality)
        steps = np.rint(np.clip(depth_m * DEPTH_SCALE_PER_M, 0, 65535)).astype(np.uint16)
        cv2.imwrite(str(folder / f"{frame}.png"), steps, [cv2.IMWRITE_PNG_COMPRESSION, 1])

    with tempfile.TemporaryDirectory() as folder:
        loaded_s = time.perf_counter()
        work(0, Path(folder))
        first_s = time.perf_counter() - loaded_s
        print("@" + json.dumps({"loading_s": loaded_s - start_s, "first_frame_s": first_s}), flush=True)
        for line in sys.stdin:
            frames = json.loads(line)["frames"]
            start_s = time.perf_counter()
            for frame in frames:
                work(frame, Path(folder))
            print("@" + json.dumps({"frame_s": (time.perf_counter() - start_s) / len(frames)}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
