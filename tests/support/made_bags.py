# SPDX-License-Identifier: GPL-3.0-or-later
"""Bags as rosbags writes them, which knows nothing of our readers: of ROS 1, of ROS 2 in SQLite and in MCAP."""

import struct
import tempfile
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

FORMS = ("ros1", "db3", "mcap")
WORLD, BODY, OPTICAL, DEPTH_OPTICAL, IMU_FRAME = "map", "base_link", "camera_optical", "depth_optical", "imu_link"


@cache
def ros_of(form):
    """Return the messages of a form; rosbags compiles what reads and writes them."""
    return Ros(form)


class Ros:
    """Messages of ROS 1 or 2. All stamps are nanoseconds."""

    def __init__(self, form):
        typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")
        self.first = form == "ros1"
        self.store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if self.first else typesys.Stores.ROS2_HUMBLE)
        if "tf2_msgs/msg/TFMessage" not in self.store.types:  # of ROS 1's own packages, tf2's is none
            definition = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(typesys.get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
        self.types = self.store.types

    def serialised(self, message):
        """Return the bytes of a message."""
        name = message.__msgtype__
        write = self.store.serialize_ros1 if self.first else self.store.serialize_cdr
        return bytes(write(message, name))

    def header(self, stamp_ns, frame):
        """Return a header."""
        time = self.types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
        number = (7,) if self.first else ()
        return self.types["std_msgs/msg/Header"](*number, time, frame)

    def image(self, stamp_ns, pixels, encoding, frame=OPTICAL, *, big_endian=False, fill=0):
        """Return an Image of pixels (H, W) or (H, W, C). fill: bytes behind each row."""
        height, width = pixels.shape[:2]
        if big_endian:
            pixels = pixels.astype(pixels.dtype.newbyteorder(">"))
        rows = np.ascontiguousarray(pixels).reshape(height, -1).view(np.uint8)
        rows = np.pad(rows, ((0, 0), (0, fill)), constant_values=99)
        header = self.header(stamp_ns, frame)
        data = np.ascontiguousarray(rows).ravel()
        return self.types["sensor_msgs/msg/Image"](
            header, height, width, encoding, int(big_endian), rows.shape[1], data
        )

    def compressed(self, stamp_ns, payload, form, frame=OPTICAL):
        """Return a CompressedImage of the bytes of a file."""
        data = np.frombuffer(payload, np.uint8)
        return self.types["sensor_msgs/msg/CompressedImage"](self.header(stamp_ns, frame), form, data)

    def camera_info(
        self, stamp_ns, size, k, *, model="plumb_bob", d=(0.0,) * 5, frame=OPTICAL, p=None, binning=0, roi=None
    ):
        """Return a CameraInfo. k: fx, fy, cx, cy, as p of the rectified image."""
        fx, fy, cx, cy = k
        gx, gy, ax, ay = p or k
        names = ("D", "K", "R", "P") if self.first else ("d", "k", "r", "p")
        values = (
            np.array(d, np.float64),
            np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0]),
            np.eye(3).ravel(),
            np.array([gx, 0, ax, 0, 0, gy, ay, 0, 0, 0, 1.0, 0]),
        )
        return self.types["sensor_msgs/msg/CameraInfo"](
            header=self.header(stamp_ns, frame),
            width=size[0],
            height=size[1],
            distortion_model=model,
            binning_x=binning,
            binning_y=binning,
            roi=self.types["sensor_msgs/msg/RegionOfInterest"](*(roi or (0, 0, 0, 0)), do_rectify=False),
            **dict(zip(names, values, strict=True)),
        )

    def imu(self, stamp_ns, rate, force, frame=IMU_FRAME):
        """Return a sample of an IMU."""
        vector = self.types["geometry_msgs/msg/Vector3"]
        unknown = np.zeros(9)
        turned = self.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        return self.types["sensor_msgs/msg/Imu"](
            self.header(stamp_ns, frame), turned, unknown, vector(*rate), unknown, vector(*force), unknown
        )

    def _moved(self, values):
        place, turned = values[:3], values[3:]
        return self.types["geometry_msgs/msg/Vector3"](*place), self.types["geometry_msgs/msg/Quaternion"](*turned)

    def transform(self, stamp_ns, parent, child, values):
        """Return a TransformStamped. values: x, y, z in metres, then a quaternion with w last."""
        made = self.types["geometry_msgs/msg/Transform"](*self._moved(values))
        return self.types["geometry_msgs/msg/TransformStamped"](self.header(stamp_ns, parent), child, made)

    def tf(self, *transforms):
        """Return a message of tf."""
        return self.types["tf2_msgs/msg/TFMessage"](list(transforms))

    def _pose(self, values):
        point = self.types["geometry_msgs/msg/Point"](*values[:3])
        return self.types["geometry_msgs/msg/Pose"](point, self._moved(values)[1])

    def pose_stamped(self, stamp_ns, values, parent=WORLD):
        """Return a PoseStamped."""
        return self.types["geometry_msgs/msg/PoseStamped"](self.header(stamp_ns, parent), self._pose(values))

    def pose_with_covariance(self, stamp_ns, values, parent=WORLD):
        """Return a PoseWithCovarianceStamped."""
        inner = self.types["geometry_msgs/msg/PoseWithCovariance"](self._pose(values), np.zeros(36))
        return self.types["geometry_msgs/msg/PoseWithCovarianceStamped"](self.header(stamp_ns, parent), inner)

    def odometry(self, stamp_ns, values, parent=WORLD, child=BODY):
        """Return an Odometry."""
        still = self.types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        twist = self.types["geometry_msgs/msg/Twist"](still, still)
        moving = self.types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
        inner = self.types["geometry_msgs/msg/PoseWithCovariance"](self._pose(values), np.zeros(36))
        return self.types["nav_msgs/msg/Odometry"](self.header(stamp_ns, parent), child, inner, moving)

    def text(self, text):
        """Return a String, of a topic that nobody reads."""
        return self.types["std_msgs/msg/String"](text)


def _qos():
    """Return how a topic of ROS 2 is sent, other than by default."""
    said = pytest.importorskip("rosbags.interfaces")
    time = said.QosTime(3, 5)
    return said.Qos(
        *(said.QosHistory.KEEP_LAST, 7, said.QosReliability.BEST_EFFORT, said.QosDurability.TRANSIENT_LOCAL),
        *(time, time, said.QosLiveliness.AUTOMATIC, time, False),
    )


class Made:
    """A bag that is being written."""

    def __init__(self, ros, writer):
        self.ros, self.writer = ros, writer
        self.connections = {}

    def add(self, log_ns, topic, message):
        """Add a message under the time of its recording."""
        name = message.__msgtype__
        if topic not in self.connections:
            given = {"callerid": "/robot", "latching": 1} if self.ros.first else {"offered_qos_profiles": [_qos()]}
            self.connections[topic] = self.writer.add_connection(topic, name, typestore=self.ros.store, **given)
        self.writer.write(self.connections[topic], log_ns, self.ros.serialised(message))


@contextmanager
def bag(folder, form, name="walk", compression=None):
    """Write a bag into a folder; yield what adds messages, whose `path` is where it will be.

    It lies in a folder of its own there. compression: bz2 or lz4 of ROS 1, "storage" or "message" of ROS 2.
    """
    ros = ros_of(form)
    folder = tempfile.mkdtemp(dir=folder)
    if form == "ros1":
        writing = pytest.importorskip("rosbags.rosbag1")
        path = Path(folder) / f"{name}.bag"
        writer = writing.Writer(path)
        if compression:
            writer.set_compression(getattr(writing.Writer.CompressionFormat, compression.upper()))
    else:
        writing = pytest.importorskip("rosbags.rosbag2")
        path = Path(folder) / name
        plugin = writing.StoragePlugin.MCAP if form == "mcap" else writing.StoragePlugin.SQLITE3
        writer = writing.Writer(path, version=8, storage_plugin=plugin)
        if compression:
            mode = getattr(writing.CompressionMode, compression.upper())
            writer.set_compression(mode, writing.CompressionFormat.ZSTD)
    with writer:
        made = Made(ros, writer)
        made.path = path
        yield made


# --- a walk: what a robot with an RGB-D camera and an IMU records ---

SIZE = (8, 6)  # width, height
K = (9.0, 9.5, 3.5, 2.5)
START_NS = 1_700_000_000_123_456_789
STEP_NS = 33_333_333
OPTICAL_ON_BODY = (0.1, 0.02, 0.3, -0.5, 0.5, -0.5, 0.5)  # x right, y down, z ahead on a body with x ahead
IMU_ON_BODY = (0.01, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0)
LATE_NS = 2_000_000  # depth is later than colour
LOGGED_NS = 7_000_000  # what is recorded is later than its stamp


def colour(number):
    """Return the colour (6, 8, 3) of a frame."""
    return np.random.default_rng([3, number]).integers(0, 256, (SIZE[1], SIZE[0], 3), np.uint8)


def depth_mm(number):
    """Return the depth (6, 8) of a frame in millimetres, some of it void."""
    steps = np.random.default_rng([5, number]).integers(300, 6000, (SIZE[1], SIZE[0]), np.uint16)
    steps[0, number % SIZE[0]] = 0
    return steps


def body(number):
    """Return where the body is at a frame, as ROS has poses."""
    half = 0.02 * number
    return (0.05 * number, 0.01 * number, 0.0, 0.0, 0.0, np.sin(half), np.cos(half))


def sample(number):
    """Return what the IMU measures: rates, and forces."""
    values = np.random.default_rng([7, number]).normal(size=6)
    return tuple(values[:3].tolist()), tuple(values[3:].tolist())


def walk(folder, form, *, frames=4, name="walk", compression=None, depth="16UC1", change=None):
    """Write a walk; return its path. change: called with the bag at the end, to add more."""
    with bag(folder, form, name, compression) as made:
        ros = made.ros
        on_body = [
            ros.transform(START_NS, BODY, OPTICAL, OPTICAL_ON_BODY),
            ros.transform(START_NS, BODY, IMU_FRAME, IMU_ON_BODY),
        ]
        made.add(START_NS, "/tf_static", ros.tf(*on_body))
        for number in range(frames):
            at_ns = START_NS + number * STEP_NS
            later_ns = at_ns + LOGGED_NS
            made.add(later_ns, "/tf", ros.tf(ros.transform(at_ns, WORLD, BODY, body(number))))
            for part in range(4):
                index = 4 * number + part
                made.add(later_ns, "/imu/data", ros.imu(at_ns + part * STEP_NS // 4, *sample(index)))
            made.add(later_ns, "/camera/color/image_raw", ros.image(at_ns, colour(number), "rgb8"))
            made.add(later_ns, "/camera/color/camera_info", ros.camera_info(at_ns, SIZE, K))
            pixels = depth_mm(number)
            if depth == "32FC1":
                pixels = np.where(pixels, pixels / 1000, np.nan).astype(np.float32)
            if depth:
                made.add(later_ns, "/camera/depth/image_raw", ros.image(at_ns + LATE_NS, pixels, depth))
            made.add(later_ns, "/chatter", ros.text(f"frame {number}"))
        if change is not None:
            change(made)
    return made.path


def compressed_depth(pixels, quantisation=(0.0, 0.0)):
    """Return what compressed_depth_image_transport sends: a header of 12 bytes, and a PNG of (H, W) uint16."""
    return struct.pack("<iff", 0, *quantisation) + cv2.imencode(".png", pixels)[1].tobytes()
