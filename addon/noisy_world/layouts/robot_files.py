# SPDX-License-Identifier: GPL-3.0-or-later
"""Point clouds of a spinning lidar as files: KITTI's .bin, and PLY with the time of each point.

KITTI's: https://www.cvlibs.net/datasets/kitti/setup.php (x ahead, y to the left, z up; float32 x, y, z, reflectance).
PLY: the field `time` is what KISS-ICP and Open3D look for.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CV_FROM_LIDAR = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_POINT = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("time", "<f8"), ("ring", "<u2")], align=False
)
_PLY_TYPES = {"<f4": "float", "<f8": "double", "<u2": "ushort"}


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The points of one turn, in the order in which they were measured.

    points_m: (N, 3) in the sensor's axes: x ahead, y to the left, z up. intensity: (N,) from 0 to 1. time_s: (N,), from
    the scan's time stamp on. ring: (N,), the row of beams, 0 the lowest.
    """

    points_m: NDArray[np.float64]
    intensity: NDArray[np.float64]
    time_s: NDArray[np.float64]
    ring: NDArray[np.intp]

    def bin_bytes(self) -> bytes:
        """Return KITTI's file: four float32 a point."""
        return np.column_stack([self.points_m, self.intensity]).astype("<f4").tobytes()

    def ply_bytes(self) -> bytes:
        """Return a binary PLY with all that is known of each point."""
        rows = np.empty(len(self.points_m), _POINT)
        rows["x"], rows["y"], rows["z"] = self.points_m.T
        rows["intensity"], rows["time"], rows["ring"] = self.intensity, self.time_s, self.ring
        names = [f"property {_PLY_TYPES[_POINT[name].str]} {name}" for name in _POINT.names or ()]
        head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}", *names, "end_header"]
        return ("\n".join(head) + "\n").encode("ascii") + rows.tobytes()


def kitti_texts(stamps_s: NDArray[np.float64], c2w: NDArray[np.float64]) -> dict[str, str]:
    """Return times.txt, poses.txt and calib.txt.

    stamps_s: (N,) of the scans. c2w: (N, 4, 4), where the sensor is then, with OpenCV's axes, as KITTI has a camera: Tr
    leads from the lidar's axes to these.
    """
    poses = "".join(" ".join(f"{value:.17g}" for value in pose[:3].ravel()) + "\n" for pose in c2w)
    tr = " ".join(f"{value:g}" for value in CV_FROM_LIDAR[:3].ravel())
    times = "".join(f"{stamp_s:.9f}\n" for stamp_s in stamps_s)
    return {"times.txt": times, "poses.txt": poses, "calib.txt": f"Tr: {tr}\n"}
