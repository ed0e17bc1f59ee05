# SPDX-License-Identifier: GPL-3.0-or-later
"""Four poses as the texts of trajectory files, and the matrices that they mean, worked out here."""

import io
import json

import numpy as np

# Four poses: position, then the quaternion w, x, y, z, normalised.
RNG = np.random.default_rng(5)
POSITIONS = RNG.normal(size=(4, 3))
QUATS = RNG.normal(size=(4, 4))
QUATS /= np.linalg.norm(QUATS, axis=1, keepdims=True)
NS = [1403636579763555584, 1403636579813555456, 1403636579863555584, 1403636580013555456]
EUROC_HEADER = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
    "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], "
    "b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]"
)


def matrix_of(w, x, y, z):
    """v -> q v q* by Hamilton's products, column by column."""

    def product(a, b):
        real = a[0] * b[0] - a[1:] @ b[1:]
        return np.concatenate([[real], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])

    q, inverse = np.array([w, x, y, z]), np.array([w, -x, -y, -z])
    columns = [product(product(q, np.concatenate([[0.0], axis])), inverse)[1:] for axis in np.eye(3)]
    return np.array(columns).T


def expected(quats=QUATS, positions=POSITIONS):
    poses = np.tile(np.eye(4), (len(quats), 1, 1))
    poses[:, :3, :3] = [matrix_of(*quat) for quat in quats]
    poses[:, :3, 3] = positions
    return poses


def rows(stamps, order="pwxyz", separator=",", more=()):
    """Lines of stamps, positions and quaternions, in an order such as EuRoC's pwxyz or TUM's pxyzw."""
    lines = []
    for stamp, position, (w, x, y, z) in zip(stamps, POSITIONS, QUATS, strict=True):
        parts = {"p": position, "w": [w], "x": [x], "y": [y], "z": [z]}
        numbers = [repr(float(v)) for letter in order for v in parts[letter]]
        lines.append(separator.join([str(stamp), *numbers, *map(repr, more)]))
    return "\n".join(lines) + "\n"


def blocks(poses=None):
    return ["\n".join(" ".join(map(repr, row)) for row in pose.tolist()) + "\n" for pose in poses or expected()]


def open3d_text(extrinsics):
    """Open3D's PinholeCameraTrajectory of world-to-camera matrices, each written column by column."""
    columns = [matrix.T.ravel().tolist() for matrix in extrinsics]
    cameras = [{"class_name": "PinholeCameraParameters", "extrinsic": numbers} for numbers in columns]
    return json.dumps({"class_name": "PinholeCameraTrajectory", "parameters": cameras, "version_major": 1})


def colmap_text(quats, translations, names=None):
    """COLMAP's images.txt of world-to-camera poses, with and without points."""
    names = names or [f"rgb/{number}.png" for number in range(len(quats))]
    lines = ["# Image list with two lines of data per image:"]
    lines += ["#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"]
    for number, (quat, at) in enumerate(zip(quats, translations, strict=True)):
        numbers = " ".join(map(repr, [*quat.tolist(), *at.tolist()]))
        lines += [f"{number + 1} {numbers} 1 {names[number]}", "2362.39 248.498 58396" if number else ""]
    return "\n".join(lines) + "\n"


def saved(save, *arrays, **named):
    """Return what numpy's `save` or `savez` writes."""
    save(stream := io.BytesIO(), *arrays, **named)
    return stream.getvalue()


def kitti_text(trajectory):
    """One line a frame: 12 row-major numbers of c2w without its last row."""
    return "".join(" ".join(map(repr, c2w[:3].ravel().tolist())) + "\n" for c2w in trajectory.c2w)


def is_expected(trajectory, stamps_s=None):
    np.testing.assert_allclose(trajectory.c2w, expected(), rtol=0, atol=1e-14)
    if stamps_s is not None:
        np.testing.assert_array_equal(trajectory.stamps_s, stamps_s)
    return True
