# SPDX-License-Identifier: GPL-3.0-or-later
"""An independent renderer for comparison: Embree through Open3D, in an environment and a Python of its own.

    .venv-peer/bin/python tests/peer/raycast.py MESH.ply TRAJ.txt OUT.npz W H FX FY CX CY FRAME [FRAME ...]

Reads the mesh with Open3D's own reader and the poses (Replica layout) with numpy; writes depth_m (N, H, W) float32,
0 = void, and rgb (N, H, W, 3) float64 in [0, 255], interpolated between vertices as stored.
"""

import sys

import numpy as np
from compiled_open3d import open3d


def main(mesh_path, poses_path, out_path, *numbers):
    width, height = map(int, numbers[:2])
    fx, fy, cx, cy = map(float, numbers[2:6])
    frames = list(map(int, numbers[6:]))
    o3d = open3d()
    mesh = o3d.io.read_triangle_mesh(mesh_path)
    faces = np.asarray(mesh.triangles)
    colours = np.asarray(mesh.vertex_colors) * 255
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(mesh))
    poses = np.loadtxt(poses_path).reshape(-1, 4, 4)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    local = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], axis=-1)
    depths, images = [], []
    for frame in frames:
        c2w = poses[frame]
        directions = local @ c2w[:3, :3].T  # component 1 along the axis, so that t is planar depth
        rays = np.concatenate([np.broadcast_to(c2w[:3, 3], directions.shape), directions], axis=-1)
        hit = scene.cast_rays(o3d.core.Tensor(rays.astype(np.float32)))
        t = hit["t_hit"].numpy()
        seen = np.isfinite(t)
        triangle = faces[np.where(seen, hit["primitive_ids"].numpy(), 0)]
        uv = hit["primitive_uvs"].numpy().astype(float)
        weights = np.concatenate([1 - uv.sum(-1, keepdims=True), uv], axis=-1)
        rgb = (colours[triangle] * weights[..., None]).sum(-2) if len(colours) else np.full((*t.shape, 3), 128.0)
        depths.append(np.where(seen, t, 0).astype(np.float32))
        images.append(np.where(seen[..., None], rgb, 0))
    np.savez(out_path, depth_m=np.array(depths), rgb=np.array(images))


if __name__ == "__main__":
    main(*sys.argv[1:])
