# SPDX-License-Identifier: GPL-3.0-or-later
"""Pinhole intrinsics on a Blender camera, and trajectories as its keyframes."""

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.geometry import (
    Intrinsics,
    blender_from_opencv_c2w,
    continuous_quats,
    quat_wxyz_from_rotation,
)
from .scene import get_origin
from .typed import camera_of, interpolation, new_action

SENSOR_WIDTH_MM = 36.0  # Blender's default; only its ratio to the focal length matters
SMALLEST_PX = 4  # the smallest width and height that Blender renders


def add_camera(scene: bpy.types.Scene, name: str) -> bpy.types.Object:
    """Link a camera whose rotation is a quaternion, and make it the scene's if the scene has none."""
    camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
    camera.rotation_mode = "QUATERNION"
    scene.collection.objects.link(camera)
    if scene.camera is None:
        scene.camera = camera
    return camera


def set_intrinsics(
    scene: bpy.types.Scene,
    camera: bpy.types.Object,
    intrinsics: Intrinsics,
    *,
    near_m: float,
    far_m: float,
    sample_offset_px: float = 0.0,
    sensor_width_mm: float = SENSOR_WIDTH_MM,
    blurred: bool = False,
) -> None:
    """Give the camera and the scene's image the intrinsics; depth outside [near_m, far_m] is void.

    Blender measures its shift from the image's centre, in image widths; with integer coordinates at pixel centres, the
    image's centre is (width - 1) / 2. fx != fy becomes a pixel aspect, which Blender allows from 1 up. An image smaller
    than Blender's smallest is rendered larger, to the right and below. sample_offset_px: by how much the renderer's
    rays miss the pixel's centre, to the right and up; the shift compensates it. sensor_width_mm: decides the lens'
    length, and thereby what is out of focus. blurred: whether that is shown as it is.
    """
    width_px = max(intrinsics.width_px, SMALLEST_PX)
    height_px = max(intrinsics.height_px, SMALLEST_PX)
    scene.render.resolution_x = width_px
    scene.render.resolution_y = height_px
    scene.render.resolution_percentage = 100
    scene.render.use_border = False
    aspect = intrinsics.fx_px / intrinsics.fy_px
    scene.render.pixel_aspect_x = max(1.0, 1.0 / aspect)
    scene.render.pixel_aspect_y = max(1.0, aspect)
    data = camera_of(camera)
    data.type = "PERSP"
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = sensor_width_mm
    data.lens_unit = "MILLIMETERS"
    data.lens = intrinsics.fx_px * sensor_width_mm / width_px
    data.shift_x = ((width_px - 1) / 2 - intrinsics.cx_px - sample_offset_px) / width_px
    data.shift_y = (intrinsics.cy_px - (height_px - 1) / 2 - sample_offset_px) * aspect / width_px
    data.clip_start = near_m
    data.clip_end = far_m
    assert data.dof is not None
    data.dof.use_dof = blurred


def place_camera(scene: bpy.types.Scene, camera: bpy.types.Object, c2w: NDArray[np.float64]) -> None:
    """Set a camera's pose (4, 4), camera-to-world with OpenCV axes, metres."""
    blender_c2w = blender_from_opencv_c2w(c2w)
    camera.location = (blender_c2w[:3, 3] - get_origin(scene)).tolist()
    camera.rotation_quaternion = quat_wxyz_from_rotation(blender_c2w[:3, :3]).tolist()


def key_trajectory(
    scene: bpy.types.Scene, camera: bpy.types.Object, c2w: NDArray[np.float64], *, first_frame: int = 0
) -> None:
    """Key the poses (N, 4, 4), camera-to-world with OpenCV axes, metres, at consecutive scene frames.

    The scene's range becomes theirs.
    """
    key_poses(scene, camera, c2w, np.arange(first_frame, first_frame + len(c2w)))
    scene.frame_start = first_frame
    scene.frame_end = first_frame + len(c2w) - 1


def key_poses(scene: bpy.types.Scene, camera: bpy.types.Object, c2w: NDArray[np.float64], frames: NDArray[Any]) -> None:
    """Key the poses (N, 4, 4), camera-to-world with OpenCV axes, metres, at scene frames (N,).

    Quaternion signs are continuous, so that Blender interpolates between two keys along the shorter arc.
    """
    blender_c2w = blender_from_opencv_c2w(c2w)
    location_m = blender_c2w[:, :3, 3] - get_origin(scene)
    quat_wxyz = continuous_quats(quat_wxyz_from_rotation(blender_c2w[:, :3, :3]))
    camera.animation_data_clear()
    action = new_action(camera, f"{camera.name} trajectory")
    for path, values in (("location", location_m), ("rotation_quaternion", quat_wxyz)):
        for index, column in enumerate(values.T):
            curve = action.fcurve_ensure_for_datablock(camera, path, index=index)
            _set_keys(curve, frames, column)


def _set_keys(curve: bpy.types.FCurve, frames: NDArray[Any], values: NDArray[np.float64]) -> None:
    points = curve.keyframe_points
    points.add(len(frames))
    points.foreach_set("co", np.stack([frames, values], axis=1).astype(np.float32).ravel())
    points.foreach_set("interpolation", np.full(len(frames), interpolation("LINEAR"), dtype=np.int32))
    curve.update()
