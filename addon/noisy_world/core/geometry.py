# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotations, rigid poses, camera axes and pinhole intrinsics, all in float64 and vectorised over leading axes.

Quaternions are Hamilton's, w first. A pose named `a_from_b` takes coordinates in b to coordinates in a; `c2w` is
world_from_camera. OpenCV's camera axes are x right, y down, z forward; Blender's and OpenGL's x right, y up,
z backward; a robot's (ROS REP 103) x forward, y left, z up.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64: TypeAlias = NDArray[np.float64]

# From the axes in the module's docstring.
OPENCV_FROM_BLENDER: Float64 = np.diag([1.0, -1.0, -1.0])
OPENCV_FROM_ROBOT: Float64 = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
OPENCV_FROM_NED: Float64 = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
OPENCV_FROM_BLENDER.setflags(write=False)
OPENCV_FROM_ROBOT.setflags(write=False)
OPENCV_FROM_NED.setflags(write=False)


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion; integer pixel coordinates name pixel centres.

    width_px, height_px: image size. fx_px, fy_px: focal lengths. cx_px, cy_px: principal point, so that the middle of
    the image is (width_px - 1) / 2, (height_px - 1) / 2. Raises ValueError for sizes or focal lengths that are not
    positive and for values that are not finite.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(f"an image of {self.width_px} x {self.height_px} pixels has no pixels")
        if not all(math.isfinite(v) for v in (self.fx_px, self.fy_px, self.cx_px, self.cy_px)):
            raise ValueError(f"intrinsics must be finite: {self}")
        if self.fx_px <= 0.0 or self.fy_px <= 0.0:
            raise ValueError(f"focal lengths must be positive, not {self.fx_px} and {self.fy_px}")

    @property
    def matrix(self) -> Float64:
        """(3, 3) float64, pixels: the K of u ~ K x."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    def shrunk(self, longest_px: int) -> "Intrinsics":
        """Return the same view in an image whose longer side has so many pixels at most."""
        scale = min(1.0, longest_px / max(self.width_px, self.height_px))
        width, height = max(1, round(self.width_px * scale)), max(1, round(self.height_px * scale))
        across, down = width / self.width_px, height / self.height_px
        axis = ((self.cx_px + 0.5) * across - 0.5, (self.cy_px + 0.5) * down - 0.5)
        return Intrinsics(width, height, self.fx_px * across, self.fy_px * down, *axis)

    def ray_directions(self) -> Float64:
        """(H, W, 3) float64: through every pixel's centre, OpenCV axes, z = 1; times planar depth it is the point."""
        rays = np.ones((self.height_px, self.width_px, 3))
        rays[..., 0] = (np.arange(self.width_px) - self.cx_px) / self.fx_px
        rays[..., 1] = ((np.arange(self.height_px) - self.cy_px) / self.fy_px)[:, None]
        return rays


def rotation_from_quat_wxyz(quat_wxyz: ArrayLike) -> Float64:
    """(..., 4) -> (..., 3, 3); any length but zero will do. Raises ValueError for a zero quaternion."""
    w, x, y, z = np.moveaxis(_unit(np.asarray(quat_wxyz, dtype=np.float64)), -1, 0)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quat_wxyz_from_rotation(rotation: ArrayLike) -> Float64:
    """(..., 3, 3) -> (..., 4) of unit length, the first component that is not zero positive.

    Shepperd's method: four times the outer product q q^T is linear in R; its row with the largest diagonal is q well
    conditioned at every angle, half turns included.
    """
    m = np.asarray(rotation, dtype=np.float64)
    m00, m11, m22 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    rows = [
        [1.0 + m00 + m11 + m22, wx, wy, wz],
        [wx, 1.0 + m00 - m11 - m22, xy, xz],
        [wy, xy, 1.0 - m00 + m11 - m22, yz],
        [wz, xz, yz, 1.0 - m00 - m11 + m22],
    ]
    outer = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    best = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    quat = _unit(np.take_along_axis(outer, best[..., None, None], axis=-2)[..., 0, :])
    first = np.take_along_axis(quat, np.argmax(quat != 0.0, axis=-1)[..., None], axis=-1)
    return np.where(first < 0.0, -quat, quat) + 0.0  # + 0.0: no negative zeros


def continuous_quats(quats: ArrayLike) -> Float64:
    """(..., N, 4) -> the same rotations, signs chosen so that neighbours have dot product >= 0; the first is kept."""
    quats = np.asarray(quats, dtype=np.float64)
    dots = np.sum(quats[..., 1:, :] * quats[..., :-1, :], axis=-1)
    signs = np.ones(quats.shape[:-1])
    signs[..., 1:] = np.cumprod(np.where(dots < 0.0, -1.0, 1.0), axis=-1)
    return quats * signs[..., None]


def rotvec_from_rotation(rotation: ArrayLike) -> Float64:
    """(..., 3, 3) -> (..., 3) radians: axis times angle, up to a half turn."""
    quat = quat_wxyz_from_rotation(rotation)
    sine = np.linalg.norm(quat[..., 1:], axis=-1, keepdims=True)
    angle_rad = 2.0 * np.arctan2(sine, quat[..., :1])
    return quat[..., 1:] * np.divide(angle_rad, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)


def rotation_from_rotvec(rotvec_rad: ArrayLike) -> Float64:
    """(..., 3) radians, axis times angle -> (..., 3, 3)."""
    rotvec = np.asarray(rotvec_rad, dtype=np.float64)
    half = 0.5 * np.linalg.norm(rotvec, axis=-1, keepdims=True)
    return rotation_from_quat_wxyz(np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotvec], axis=-1))


def nearest_rotation(matrix: ArrayLike) -> Float64:
    """(..., 3, 3) -> the rotation (determinant +1) nearest to it in the Frobenius norm."""
    m = np.asarray(matrix, dtype=np.float64)
    near = (rotation_error(m) < 5e-3) & (np.linalg.det(m) > 0.0)
    out = np.empty_like(m)
    out[near] = _polished(m[near])
    left, _, right = np.linalg.svd(m[~near])
    left[..., :, 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    out[~near] = left @ right
    return out


def rotation_error(matrix: ArrayLike) -> Float64:
    """(..., 3, 3) -> (...): the largest entry of |R^T R - I|; 0 for rotations and for reflections."""
    m = np.asarray(matrix, dtype=np.float64)
    return np.max(np.abs(np.swapaxes(m, -1, -2) @ m - np.eye(3)), axis=(-2, -1))


def rotation_angle_rad(rotation_a: ArrayLike, rotation_b: ArrayLike) -> Float64:
    """(..., 3, 3), (..., 3, 3) -> (...): the angle between them in [0, pi], good to 1e-15 at both ends."""
    a, b = np.asarray(rotation_a, dtype=np.float64), np.asarray(rotation_b, dtype=np.float64)
    m = np.swapaxes(a, -1, -2) @ b
    axis = [m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]]
    # The arguments are twice the sine and twice the cosine; acos alone would lose half the digits.
    return np.arctan2(np.linalg.norm(np.stack(axis, axis=-1), axis=-1), np.trace(m, axis1=-2, axis2=-1) - 1.0)


def rotation_from_euler_deg(rx_deg: ArrayLike, ry_deg: ArrayLike, rz_deg: ArrayLike) -> Float64:
    """(...), (...), (...) degrees -> (..., 3, 3): Rz Ry Rx, x first about fixed axes; quarter turns are exact."""
    (cx, sx), (cy, sy), (cz, sz) = (_cos_sin_deg(angle) for angle in np.broadcast_arrays(rx_deg, ry_deg, rz_deg))
    rows = [
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def blender_from_opencv_c2w(c2w: ArrayLike) -> Float64:
    """(..., 4, 4) c2w with OpenCV's camera axes -> c2w of the same camera with Blender's; the world stays."""
    return _with_camera_axes(c2w, OPENCV_FROM_BLENDER)


def opencv_from_blender_c2w(c2w: ArrayLike) -> Float64:
    """(..., 4, 4) c2w with Blender's camera axes -> c2w of the same camera with OpenCV's; the world stays."""
    return _with_camera_axes(c2w, OPENCV_FROM_BLENDER.T)


def opencv_from_robot_c2w(c2w: ArrayLike) -> Float64:
    """(..., 4, 4) world_from_body with a robot's axes -> c2w with OpenCV's, looking along the robot's x."""
    return _with_camera_axes(c2w, OPENCV_FROM_ROBOT.T)


def opencv_from_ned_c2w(c2w: ArrayLike) -> Float64:
    """(..., 4, 4) world_from_body with an aircraft's axes (x forward, y right, z down) -> c2w with OpenCV's."""
    return _with_camera_axes(c2w, OPENCV_FROM_NED.T)


def pose(rotation: ArrayLike, translation: ArrayLike) -> Float64:
    """(..., 3, 3), (..., 3) -> (..., 4, 4) with the last row 0 0 0 1; leading axes are broadcast."""
    rotation, translation = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
    out = np.zeros((*np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1]), 4, 4))
    out[..., :3, :3] = rotation
    out[..., :3, 3] = translation
    out[..., 3, 3] = 1.0
    return out


def invert_pose(a_from_b: ArrayLike) -> Float64:
    """(..., 4, 4) rigid -> its inverse by R^T and -R^T t, exact in the rotation."""
    a_from_b = np.asarray(a_from_b, dtype=np.float64)
    transposed = np.swapaxes(a_from_b[..., :3, :3], -1, -2)
    return pose(transposed, -(transposed @ a_from_b[..., :3, 3:])[..., 0])


def _with_camera_axes(c2w: ArrayLike, old_from_new: Float64) -> Float64:
    out = np.array(c2w, dtype=np.float64)
    out[..., :3, :3] = out[..., :3, :3] @ old_from_new + 0.0  # + 0.0: no negative zeros
    return out


def _polished(nearly: Float64) -> Float64:
    # Newton-Schulz gives SVD's polar factor in a third of the time. Each step squares the error: 0.015 becomes 4e-16.
    for _ in range(3):
        nearly = 1.5 * nearly - 0.5 * nearly @ (np.swapaxes(nearly, -1, -2) @ nearly)
    return nearly


def _unit(vectors: Float64) -> Float64:
    # Scaled by the largest component first, or the squares of tiny components would underflow.
    largest = np.max(np.abs(vectors), axis=-1, keepdims=True)
    if np.any(largest == 0.0):
        raise ValueError("a zero quaternion is no rotation")
    scaled = vectors / largest
    return scaled / np.linalg.norm(scaled, axis=-1, keepdims=True)


def _cos_sin_deg(angle_deg: ArrayLike) -> tuple[Float64, Float64]:
    # Whole quarter turns are handled in degrees, before the conversion to radians: so cos(90 degrees) is 0, not 6e-17.
    angle_deg = np.asarray(angle_deg, dtype=np.float64)
    quarters = np.round(angle_deg / 90.0)
    rest = np.deg2rad(angle_deg - 90.0 * quarters)
    cos, sin = np.cos(rest), np.sin(rest)
    turn = np.mod(quarters, 4.0).astype(np.int64)
    return np.choose(turn, [cos, -sin, -cos, sin]), np.choose(turn, [sin, cos, -sin, -cos])
