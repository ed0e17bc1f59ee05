# SPDX-License-Identifier: GPL-3.0-or-later
"""Casting rays at a mesh from given poses, without a preset."""

from dataclasses import replace

import numpy as np

from noisy_world.render.source import RenderOptions
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.render.ray_session import RaySession

OPTIONS = RenderOptions(near_m=0.01, far_m=1000.0, samples=1, seed=0, engine="embree", threads=1)


def cast(mesh, c2w, camera, *, depth_c2w=None, **options):
    """What a pose sees; depth_c2w: the depth sensor's, where it has another."""
    depth = None if depth_c2w is None else evenly_stamped(np.asarray(depth_c2w)[None])
    paths = SensorPaths(evenly_stamped(np.asarray(c2w)[None]), depth)
    with RaySession(mesh, paths, camera, replace(OPTIONS, **options)) as session:
        return session.frame(paths.request(0))


def polygons(faces, rgb=None):
    """A mesh of separate faces, each (n, 3); rgb: (n, 3) of each face's corners, bytes."""
    sizes = np.array([len(face) for face in faces])
    colours = None if rgb is None else np.concatenate(rgb).astype(np.float32) / np.float32(255)
    starts = (np.cumsum(sizes) - sizes).astype(np.int32)
    return Mesh(np.concatenate(faces).astype(float), colours, np.arange(sizes.sum(), dtype=np.int32), starts)
