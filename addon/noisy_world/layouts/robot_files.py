# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings as robots read them: messages of ROS 2, and the scans of a spinning lidar."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.geometry import Intrinsics, quat_wxyz_from_rotation
from ..core.lens import Distortion
from ..core.trajectory import NS_PER_S
from . import LAYOUTS
from .asl import read_poses_csv, read_samples, read_sensor_yaml
from .euroc import COLOUR, DEPTH, IMU, MAV, TRUE_STATE
from .stored_recording import StoredSequence, recorded_text

TOPICS = {
    "/cam0/image_raw": "sensor_msgs/msg/Image",
    "/cam0/camera_info": "sensor_msgs/msg/CameraInfo",
    "/depth0/image_raw": "sensor_msgs/msg/Image",
    "/depth0/camera_info": "sensor_msgs/msg/CameraInfo",
    "/imu0": "sensor_msgs/msg/Imu",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/tf": "tf2_msgs/msg/TFMessage",
}
WORLD, BODY = "world", "imu0"


@dataclass(frozen=True, eq=False)
class BagMessages:
    """The messages of a sequence. folder: with `mav0`. types: ROS's, by name, as rosbags has them."""

    folder: Path
    types: dict[str, Any]

    @cached_property
    def _stored(self) -> StoredSequence:
        layout = LAYOUTS["euroc"]
        if not layout.recognises(self.folder):
            raise InputError(self.folder, f"holds no {MAV}", remedy="name a sequence of the layout euroc")
        return layout.read(self.folder)

    @cached_property
    def imu(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Stamps (N,) in nanoseconds, and angular velocity and specific force (N, 6); none without an IMU."""
        path = self.folder / IMU / "data.csv"
        if not path.is_file():
            return np.zeros(0, np.int64), np.zeros((0, 6))
        return read_samples(recorded_text(path), path)

    def in_order(self) -> Iterator[tuple[int, str, Any]]:
        """Yield stamp in nanoseconds, topic and message, in the order of time."""
        stored, (imu_ns, imu) = self._stored, self.imu
        frames_ns = stored.stamps.rgb.ns
        poses = read_poses_csv(self.folder / TRUE_STATE / "data.csv")
        poses_ns = np.rint(poses.stamps_s * NS_PER_S).astype(np.int64).tolist()
        first_ns = min(frames_ns[0], *imu_ns[:1].tolist(), poses_ns[0])
        yield first_ns, "/tf_static", self._sensors(first_ns)
        events = [(stamp_ns, 0, k) for k, stamp_ns in enumerate(poses_ns)]
        events += [(stamp_ns, 1, k) for k, stamp_ns in enumerate(imu_ns.tolist())]
        events += [(stamp_ns, 2, k) for k, stamp_ns in enumerate(frames_ns)]
        for stamp_ns, kind, number in sorted(events):
            if kind == 0:
                yield stamp_ns, "/tf", self._transforms([(stamp_ns, WORLD, BODY, poses.c2w[number])])
            elif kind == 1:
                yield stamp_ns, "/imu0", self._sample(stamp_ns, imu[number])
            else:
                yield from self._frame(number, stamp_ns)

    def _frame(self, number: int, stamp_ns: int) -> Iterator[tuple[int, str, Any]]:
        frame, optics = self._stored.frame(number), self._stored.optics
        rgb = np.asarray(frame.rgb)
        grey = bool((rgb == rgb[..., :1]).all())
        yield stamp_ns, "/cam0/image_raw", self._image(stamp_ns, "cam0", rgb[..., :1] if grey else rgb)
        depth_ns = self._stored.stamps.depth.ns[number]
        yield stamp_ns, "/depth0/image_raw", self._image(depth_ns, "depth0", frame.depth_m[..., None])
        camera = self._stored.camera
        if camera is not None:
            yield stamp_ns, "/cam0/camera_info", self._camera(stamp_ns, "cam0", camera, optics.distortion)
            seen = camera if optics.depth is None else optics.depth.intrinsics
            bent = optics.distortion if optics.depth is None or optics.depth.shares_lens else None
            yield stamp_ns, "/depth0/camera_info", self._camera(depth_ns, "depth0", seen, bent)

    # --- messages ---

    def _header(self, stamp_ns: int, frame_id: str) -> Any:
        time = self.types["builtin_interfaces/msg/Time"](stamp_ns // NS_PER_S, stamp_ns % NS_PER_S)
        return self.types["std_msgs/msg/Header"](time, frame_id)

    def _image(self, stamp_ns: int, frame_id: str, image: NDArray[Any]) -> Any:
        """Return (H, W, C): mono8 or rgb8 of uint8, 32FC1 in metres of float32; depth that is void is 0."""
        height, width, count = image.shape
        encoding = "32FC1" if image.dtype == np.float32 else ("mono8" if count == 1 else "rgb8")
        data = np.frombuffer(np.ascontiguousarray(image).tobytes(), np.uint8)
        header = self._header(stamp_ns, frame_id)
        step = width * count * image.dtype.itemsize
        return self.types["sensor_msgs/msg/Image"](header, height, width, encoding, 0, step, data)

    def _camera(self, stamp_ns: int, frame_id: str, camera: Intrinsics, distortion: Distortion | None) -> Any:
        fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
        lens = distortion or Distortion("radial-tangential", (0.0,) * 5)
        coefficients = np.array(lens.coefficients, np.float64)
        name = {4: "plumb_bob", 5: "plumb_bob"}.get(len(coefficients), "rational_polynomial")
        if lens.model == "equidistant":
            name = "equidistant"
        elif len(coefficients) == 4:
            coefficients = np.append(coefficients, 0.0)  # plumb_bob has five
        return self.types["sensor_msgs/msg/CameraInfo"](
            header=self._header(stamp_ns, frame_id),
            height=camera.height_px,
            width=camera.width_px,
            distortion_model=name,
            d=coefficients,
            k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], np.float64),
            r=np.eye(3).ravel(),
            p=np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], np.float64),
            binning_x=0,
            binning_y=0,
            roi=self.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, do_rectify=False),
        )

    def _sample(self, stamp_ns: int, values: NDArray[np.float64]) -> Any:
        vector = self.types["geometry_msgs/msg/Vector3"]
        unknown = np.zeros(9)
        return self.types[
            "sensor_msgs/msg/Imu"
        ](
            header=self._header(stamp_ns, BODY),
            orientation=self.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            orientation_covariance=np.array([-1.0, *unknown[1:]]),  # -1: there is none
            angular_velocity=vector(*values[:3].tolist()),
            angular_velocity_covariance=unknown,
            linear_acceleration=vector(*values[3:].tolist()),
            linear_acceleration_covariance=unknown,
        )

    def _sensors(self, stamp_ns: int) -> Any:
        poses = [
            (stamp_ns, BODY, name, read_sensor_yaml(self.folder / sensor / "sensor.yaml").body_from_sensor)
            for name, sensor in (("cam0", COLOUR), ("depth0", DEPTH))
        ]
        return self._transforms(poses)

    def _transforms(self, poses: list[tuple[int, str, str, NDArray[np.float64]]]) -> Any:
        """Return transforms. poses: stamp, the frame, the frame in it, and its pose (4, 4) there."""
        found = []
        for stamp_ns, frame_id, child, matrix in poses:
            w, x, y, z = quat_wxyz_from_rotation(matrix[:3, :3]).tolist()
            moved = self.types["geometry_msgs/msg/Vector3"](*matrix[:3, 3].tolist())
            turned = self.types["geometry_msgs/msg/Quaternion"](x, y, z, w)
            transform = self.types["geometry_msgs/msg/Transform"](moved, turned)
            header = self._header(stamp_ns, frame_id)
            found.append(self.types["geometry_msgs/msg/TransformStamped"](header, child, transform))
        return self.types["tf2_msgs/msg/TFMessage"](found)


# Point clouds of a spinning lidar as files: KITTI's .bin, and PLY with the time of each point.
#
# KITTI's: https://www.cvlibs.net/datasets/kitti/setup.php (x ahead, y to the left, z up; float32 x, y, z, reflectance).
# PLY: the field `time` is what KISS-ICP and Open3D look for.


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
