# SPDX-License-Identifier: GPL-3.0-or-later
"""What a camera's keyframes say, by Blender's own quaternions."""

import numpy as np
from mathutils import Quaternion

from noisy_world.render.mesh_session import get_origin


def keyed_poses(scene, camera, frames):
    """Return the poses (N, 4, 4) of the camera's curves at scene frames (N,), camera-to-world, OpenCV axes, metres."""
    action = camera.animation_data.action
    location, quaternion = (
        [action.fcurve_ensure_for_datablock(camera, path, index=index) for index in range(size)]
        for path, size in (("location", 3), ("rotation_quaternion", 4))
    )
    c2w = np.tile(np.eye(4), (len(frames), 1, 1))
    for pose, frame in zip(c2w, map(float, frames), strict=True):
        turned = Quaternion([curve.evaluate(frame) for curve in quaternion]).normalized().to_matrix()
        pose[:3, :3] = np.array(turned) * [1, -1, -1]  # Blender's y and z are OpenCV's -y and -z
        pose[:3, 3] = [curve.evaluate(frame) for curve in location] + get_origin(scene)
    return c2w
