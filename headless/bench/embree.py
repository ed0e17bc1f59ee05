# SPDX-License-Identifier: GPL-3.0-or-later
"""Embree, through Open3D, in its own Python: the time of casting rays alone, and what each ray truly hits.

    .venv-peer/bin/python headless/bench/embree.py MESH.ply TRAJ.txt W H FX FY CX CY

Reads JSON lines {"do": "time", "frames": [...]} or {"do": "truth", "frames": [...], "to": FOLDER}, answers `@{...}`.
Embree itself computes in float32. For the truth it gives only the triangle that is seen; the point where the ray meets
that triangle's plane is computed here in float64.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[2] / "tests" / "peer"))
from compiled_open3d import open3d


def main(mesh_path: str, poses_path: str, *numbers: str) -> None:
    """Load, and answer."""
    width, height = int(numbers[0]), int(numbers[1])
    fx, fy, cx, cy = map(float, numbers[2:6])
    o3d = open3d()
    start_s = time.perf_counter()
    mesh = o3d.io.read_triangle_mesh(mesh_path)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(mesh))
    poses = np.loadtxt(poses_path).reshape(-1, 4, 4)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    local = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], axis=-1)

    def rays(frame: int) -> np.ndarray:
        directions = local @ poses[frame][:3, :3].T  # of component 1 along the optical axis, so t is planar depth
        return np.concatenate([np.broadcast_to(poses[frame][:3, 3], directions.shape), directions], axis=-1)

    scene.cast_rays(o3d.core.Tensor(rays(0).astype(np.float32)))  # the first call builds the tree
    print("@" + json.dumps({"loading_s": time.perf_counter() - start_s, "open3d": version("open3d")}), flush=True)
    ready: dict[int, Any] = {}
    for line in sys.stdin:
        order = json.loads(line)
        frames = [frame % len(poses) for frame in order["frames"]]
        if order["do"] == "time":
            for frame in frames:  # rays are made before the time is taken
                if frame not in ready:
                    ready[frame] = o3d.core.Tensor(rays(frame).astype(np.float32))
            start_s = time.perf_counter()
            for frame in frames:
                scene.cast_rays(ready[frame])
            print("@" + json.dumps({"frame_s": (time.perf_counter() - start_s) / len(frames)}), flush=True)
        else:
            for frame in frames:
                hit = scene.cast_rays(o3d.core.Tensor(rays(frame).astype(np.float32)))
                seen = np.isfinite(hit["t_hit"].numpy())
                corners = vertices[faces[np.where(seen, hit["primitive_ids"].numpy(), 0)]]
                normal = np.cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])
                ray = rays(frame)
                with np.errstate(divide="ignore", invalid="ignore"):
                    depth_m = ((corners[..., 0, :] - ray[..., :3]) * normal).sum(-1) / (ray[..., 3:] * normal).sum(-1)
                np.save(Path(order["to"]) / f"{frame}.npy", np.where(seen & np.isfinite(depth_m), depth_m, 0.0))
            print("@{}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
