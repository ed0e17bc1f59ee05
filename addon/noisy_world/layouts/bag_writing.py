# SPDX-License-Identifier: GPL-3.0-or-later
"""Sequences as bags of ROS, by rosbags: new ones, and copies of a bag with a sequence's images in place of its own.

A copy keeps every other message, its bytes, the time at which it was recorded, its topic and its type's definition.
"""

import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import read_bytes
from ..core.geometry import Intrinsics, invert_pose, quat_wxyz_from_rotation
from ..core.lens import Distortion
from ..core.schema import read_yaml
from ..core.trajectory import NS_PER_S
from ..images.pixels import as_bytes, encode_colour, encode_png, grey_bytes
from . import LAYOUTS, find_sequence
from . import bag_messages as ros
from .asl import read_poses_csv, read_samples, read_sensor_yaml
from .bag_files import METADATA, Bag, Connection, McapPart, Ros1Part, packed
from .bag_messages import ImageHead
from .bag_recording import BagSequence, Topic, read_bag_sequence
from .described import BAG_SUFFIXES, BagTopics
from .euroc import COLOUR, TRUE_STATE
from .layout import IMU_FILES, MILLIMETRES
from .mcap_copy import Added, copy_mcap
from .stored_recording import StoredSequence, recorded_text, same_camera
from .vslamlab import CALIBRATION, SAMPLES

Form: TypeAlias = Literal["ros1", "mcap", "sqlite3"]

TOPICS = {
    "/cam0/image_raw": ros.IMAGE,
    "/cam0/camera_info": ros.CAMERA,
    "/depth0/image_raw": ros.IMAGE,
    "/depth0/camera_info": ros.CAMERA,
    "/imu0": ros.IMU,
    "/tf_static": ros.TRANSFORMS[0],
    "/tf": ros.TRANSFORMS[0],
}
_SAME_NS = 500  # float64 holds seconds since 1970 to 238 ns, and some layouts have no other stamps
WORLD, CAMERA, DEPTH_CAMERA, BODY = "world", "cam0", "depth0", "imu0"
Float64: TypeAlias = NDArray[np.float64]


class RosMessages:
    """Messages of ROS 1 or ROS 2, by rosbags."""

    def __init__(self, *, first: bool) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.first = first
        self.store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
        if ros.TRANSFORMS[0] not in self.store.types:
            self.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", ros.TRANSFORMS[0]))
        self.types: dict[str, Any] = self.store.types

    def serialised(self, message: Any) -> memoryview:
        """Return the bytes of a message."""
        write = self.store.serialize_ros1 if self.first else self.store.serialize_cdr
        return write(message, message.__msgtype__)

    def header(self, stamp_ns: int, frame: str, number: int = 0) -> Any:
        """Return a header. number: ROS 1's, of the message."""
        time = self.types["builtin_interfaces/msg/Time"](stamp_ns // NS_PER_S, stamp_ns % NS_PER_S)
        return self.types["std_msgs/msg/Header"](*((number,) if self.first else ()), time, frame)

    def image(self, header: Any, pixels: NDArray[Any], encoding: str) -> Any:
        """Return an image of pixels (H, W, C), which are of the encoding's type."""
        height, width = pixels.shape[:2]
        data = np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8)
        step = len(data) // height
        return self.types[ros.IMAGE](header, height, width, encoding, 0, step, data)

    def compressed(self, header: Any, payload: bytes, form: str) -> Any:
        """Return a compressed image of the bytes of a file."""
        return self.types[ros.COMPRESSED](header, form, np.frombuffer(payload, np.uint8))

    def camera(self, header: Any, camera: Intrinsics, lens: Distortion | None) -> Any:
        """Return a camera_info."""
        fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
        coefficients = np.zeros(5) if lens is None else np.array(lens.coefficients, np.float64)
        model = "plumb_bob" if len(coefficients) <= 5 else "rational_polynomial"
        if lens is not None and lens.model == "equidistant":
            model = "equidistant"
        elif len(coefficients) == 4:
            coefficients = np.append(coefficients, 0.0)  # plumb_bob has five
        values = (
            coefficients,
            np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], np.float64),
            np.eye(3).ravel(),
            np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], np.float64),
        )
        return self.types[ros.CAMERA](
            header=header,
            height=camera.height_px,
            width=camera.width_px,
            distortion_model=model,
            binning_x=0,
            binning_y=0,
            roi=self.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, do_rectify=False),
            **dict(zip("DKRP" if self.first else "dkrp", values, strict=True)),
        )

    def sample(self, header: Any, values: NDArray[np.float64]) -> Any:
        """Return a sample of an IMU. values: (6,) angular velocity and specific force."""
        vector = self.types["geometry_msgs/msg/Vector3"]
        unknown = np.zeros(9)
        return self.types[
            ros.IMU
        ](
            header=header,
            orientation=self.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            orientation_covariance=np.array([-1.0, *unknown[1:]]),  # -1: there is none
            angular_velocity=vector(*values[:3].tolist()),
            angular_velocity_covariance=unknown,
            linear_acceleration=vector(*values[3:].tolist()),
            linear_acceleration_covariance=unknown,
        )

    def transforms(self, stamp_ns: int, poses: list[tuple[str, str, Float64]]) -> Any:
        """Return transforms. poses: the frame, the frame in it, and its pose (4, 4) there."""
        found = []
        for parent, child, matrix in poses:
            w, x, y, z = quat_wxyz_from_rotation(matrix[:3, :3]).tolist()
            moved = self.types["geometry_msgs/msg/Vector3"](*matrix[:3, 3].tolist())
            turned = self.types["geometry_msgs/msg/Quaternion"](x, y, z, w)
            transform = self.types["geometry_msgs/msg/Transform"](moved, turned)
            found.append(self.types[ros.MOVED](self.header(stamp_ns, parent), child, transform))
        return self.types[ros.TRANSFORMS[0]](found)


@cache
def ros_messages(*, first: bool) -> RosMessages:
    """Return the messages of ROS 1 or ROS 2; rosbags compiles what writes each kind once for them."""
    return RosMessages(first=first)


# --- a sequence as a bag of its own ---


@dataclass(frozen=True, eq=False)
class BagMessages:
    """The messages of a sequence in any layout. folder: of the sequence."""

    folder: Path
    ros: RosMessages

    @cached_property
    def stored(self) -> StoredSequence:
        """The sequence; frames without a pose are kept."""
        return find_sequence(self.folder, poses="keep")

    @cached_property
    def _imu(self) -> tuple[NDArray[np.int64], Float64, Float64]:
        """Stamps (N,) in nanoseconds, values (N, 6), and the pose (4, 4) of the colour camera on the IMU."""
        if (recorded := self.stored.imu) is not None and recorded.rig.imu is not None:
            samples = recorded.samples
            values = np.concatenate([samples.rate_rad_s, samples.force_m_s2], axis=1)
            place = invert_pose(recorded.rig.imu.robot_from_sensor) @ recorded.rig.rgb.robot_from_sensor
            return samples.stamps_ns, values, place
        return read_imu_files(self.folder)

    def in_order(self) -> Iterator[tuple[int, str, Any]]:
        """Yield stamp in nanoseconds, topic and message, in the order of time."""
        stored, (imu_ns, imu, imu_from_rgb) = self.stored, self._imu
        frames_ns = stored.stamps.rgb.ns
        poses_ns, parent, poses = self._poses()
        first_ns = min(frames_ns[0], *imu_ns[:1].tolist(), *poses_ns[:1])
        yield first_ns, "/tf_static", self._sensors(first_ns, parent, imu_from_rgb, has_imu=len(imu_ns) > 0)
        events = [(stamp_ns, 0, k) for k, stamp_ns in enumerate(poses_ns)]
        events += [(stamp_ns, 1, k) for k, stamp_ns in enumerate(imu_ns.tolist())]
        events += [(stamp_ns, 2, k) for k, stamp_ns in enumerate(frames_ns)]
        for stamp_ns, kind, number in sorted(events):
            if kind == 0:
                yield stamp_ns, "/tf", self.ros.transforms(stamp_ns, [(WORLD, parent, poses[number])])
            elif kind == 1:
                yield stamp_ns, "/imu0", self.ros.sample(self.ros.header(stamp_ns, BODY), imu[number])
            else:
                yield from self._frame(number, stamp_ns)

    def _poses(self) -> tuple[list[int], str, Float64]:
        """Return stamps, the frame, and its poses (N, 4, 4) in the world: of the body, where a layout has its own."""
        truth = self.folder / TRUE_STATE / "data.csv"
        if LAYOUTS["euroc"].recognises(self.folder) and truth.is_file():
            path = read_poses_csv(truth)
            return np.rint(path.stamps_s * NS_PER_S).astype(np.int64).tolist(), BODY, path.c2w
        path, known = self.stored.trajectory, np.flatnonzero(self.stored.trajectory.known)
        return [self.stored.stamps.pose.ns[row] for row in known], CAMERA, path.c2w[known]

    def _sensors(self, stamp_ns: int, parent: str, imu_from_rgb: Float64, *, has_imu: bool) -> Any:
        """Return where the sensors sit beside one another."""
        depth = self.stored.optics.depth
        rgb_from_depth = np.eye(4) if depth is None else depth.matrix
        if parent == BODY:
            body_from_rgb = read_sensor_yaml(self.folder / COLOUR / "sensor.yaml").body_from_sensor
            places = [(BODY, CAMERA, body_from_rgb), (BODY, DEPTH_CAMERA, body_from_rgb @ rgb_from_depth)]
        else:
            places = [(CAMERA, DEPTH_CAMERA, rgb_from_depth)]
            places += [(CAMERA, BODY, invert_pose(imu_from_rgb))] if has_imu else []
        return self.ros.transforms(stamp_ns, places)

    def _frame(self, number: int, stamp_ns: int) -> Iterator[tuple[int, str, Any]]:
        stored, header = self.stored, self.ros.header
        frame, optics = stored.frame(number), stored.optics
        rgb = as_bytes(frame.rgb)
        grey = bool((rgb == rgb[..., :1]).all())
        image = self.ros.image(header(stamp_ns, CAMERA), rgb[..., :1] if grey else rgb, "mono8" if grey else "rgb8")
        yield stamp_ns, "/cam0/image_raw", image
        if stored.camera is not None:
            info = self.ros.camera(header(stamp_ns, CAMERA), stored.camera, optics.distortion)
            yield stamp_ns, "/cam0/camera_info", info
        if not stored.depth_files:
            return
        depth_ns = stored.stamps.depth.ns[number]
        depth = self.ros.image(header(depth_ns, DEPTH_CAMERA), frame.depth_m[..., None], "32FC1")
        yield stamp_ns, "/depth0/image_raw", depth
        if stored.camera is not None:
            seen = stored.camera if optics.depth is None else optics.depth.intrinsics
            lens = optics.distortion if optics.depth is None or optics.depth.shares_lens else None
            yield stamp_ns, "/depth0/camera_info", self.ros.camera(header(depth_ns, DEPTH_CAMERA), seen, lens)


def read_imu_files(folder: Path) -> tuple[NDArray[np.int64], Float64, Float64]:
    """Return what an IMU's files beside a sequence's images hold; no samples where there are none."""
    plain, described = (folder / name for name in IMU_FILES[:2])
    if plain.is_file():
        rgb_from_imu = _matrix(described, read_yaml(recorded_text(described), described), ("T_cam_imu",))
        return (*read_samples(recorded_text(plain), plain), invert_pose(rgb_from_imu))
    if (file := folder / SAMPLES).is_file():
        rows = recorded_text(file).split("\n", 1)[-1]
        described = folder / CALIBRATION
        document = read_yaml(recorded_text(described).replace("%YAML 1.2\n", ""), described)
        return (*read_samples(rows, file), _matrix(described, document, ("cameras", 0, "T_BS")))
    return np.zeros(0, np.int64), np.zeros((0, 6)), np.eye(4)


def _matrix(path: Path, document: Any, keys: tuple[Any, ...]) -> Float64:
    try:
        for key in keys:
            document = document[key]
        matrix = np.array(document, np.float64).reshape(4, 4)
    except (KeyError, IndexError, TypeError, ValueError):
        raise InputError(path, "is no pose of 4 x 4 numbers", where=".".join(map(str, keys))) from None
    return matrix


def write_sequence(folder: Path, out: Path, form: Form) -> Counter[str]:
    """Write a sequence as a bag; return how many messages each topic has. Raises InputError."""
    messages = BagMessages(folder, ros_messages(first=form == "ros1"))
    counts: Counter[str] = Counter()
    with _writing(out, form, compressed=False) as writer:
        connections: dict[str, Any] = {}
        for stamp_ns, topic, message in messages.in_order():
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, TOPICS[topic], typestore=messages.ros.store)
            writer.write(connections[topic], stamp_ns, messages.ros.serialised(message))
            counts[topic] += 1
    return counts


@contextmanager
def _writing(out: Path, form: Form, *, compressed: bool) -> Iterator[Any]:
    """Yield rosbags' writer of a bag. compressed: its chunks are."""
    if form == "ros1":
        from rosbags.rosbag1 import Writer

        first = Writer(out)
        if compressed:
            first.set_compression(Writer.CompressionFormat.LZ4)
        with first:
            yield first
        return
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as SecondWriter

    alone = out.suffix in (".mcap", ".db3")  # a file of its own, without the folder
    place = out.with_name(out.stem + ".folder") if alone else out
    plugin = StoragePlugin.MCAP if form == "mcap" else StoragePlugin.SQLITE3
    second = SecondWriter(place, version=8, storage_plugin=plugin)  # version 8 is read by Humble and later
    if compressed and form == "mcap":
        second.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with second:
        yield second
    if alone:
        (place / f"{place.name}{out.suffix}").replace(out)


# --- a bag with other images ---


@dataclass(frozen=True, eq=False)
class Replaced:
    """The images and cameras of a bag that a sequence takes the place of.

    rows: by the number of a message in the bag, what makes it, None for a message that goes. added: of frames whose
    stamps the bag has not: when recorded, the connection, and what makes them. notes: on what goes and is added.
    """

    rows: dict[int, Any] = field(default_factory=dict)
    added: list[tuple[int, int, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Overlay:
    """A sequence over a bag. original: the bag as a recording. depth_scale_per_m: of its depth in whole numbers."""

    stored: StoredSequence
    original: BagSequence
    depth_scale_per_m: float

    @cached_property
    def ros(self) -> RosMessages:
        """The messages of the bag's kind."""
        assert self.original.rgb is not None
        return ros_messages(first=self.original.rgb.encoding == "ros1")

    @property
    def bag(self) -> Bag:
        """The bag."""
        return self.original.bag

    def replaced(self) -> Replaced:
        """Return what of the bag becomes other."""
        found = Replaced()
        stored, rgb, depth = self.stored, self.original.rgb, self.original.depth
        assert rgb is not None
        self._images(rgb, stored.stamps.rgb.ns, self._colour, found)
        if depth is not None and stored.depth_files:
            self._images(depth, stored.stamps.depth.ns, self._depth, found)
        self._cameras(found)
        return found

    def _images(self, topic: Topic, stamps_ns: tuple[int, ...], make: Any, found: Replaced) -> None:
        """Put the frames in the place of a topic's images by their stamps."""
        heads = [topic.image_head(row) for row in range(len(topic.rows))]
        numbers, log_ns = self._numbers(topic), topic.rows.log_ns
        taken_ns = np.array([head.stamp_ns for head in heads], np.int64)
        if not taken_ns.any():  # headers say no time: those of recording count, as where the bag is read
            taken_ns = log_ns
        order = np.argsort(taken_ns, kind="stable")
        rows = _nearest(taken_ns[order], order, np.array(stamps_ns, np.int64))
        if all(row is None for row in rows):
            problem = f"has no image of {topic.name} at the stamp of a frame of {self.stored.folder}"
            raise InputError(self.bag.path, problem, remedy="name the bag that the sequence was made of")
        found.rows.update(dict.fromkeys(numbers))
        for frame, (row, stamp_ns) in enumerate(zip(rows, stamps_ns, strict=True)):
            if row is not None:
                found.rows[numbers[row]] = lambda frame=frame, row=row: make(topic, frame, row, heads[row])
            else:
                head = replace(heads[0], stamp_ns=stamp_ns)
                made = lambda frame=frame, head=head: make(topic, frame, 0, head)  # noqa: E731
                late_ns = stamp_ns + int(np.median(log_ns - taken_ns))
                found.added.append((late_ns, int(topic.rows.connection[0]), made))
        if gone := sum(found.rows[number] is None for number in numbers):
            found.notes.append(
                f"{gone} of {len(numbers)} images of {topic.name} are left out: no frame has their stamp"
            )
        if more := rows.count(None):
            found.notes.append(f"{more} frames are put in beside the images of {topic.name}: none has their stamp")

    def _numbers(self, topic: Topic) -> list[int]:
        """Return the numbers of a topic's messages among all of the bag."""
        everything = self.bag.rows
        chosen = np.isin(everything.connection, np.unique(topic.rows.connection))
        return np.flatnonzero(chosen).tolist()

    def _header(self, topic: Topic, row: int, stamp_ns: int, frame: str) -> Any:
        number = 0
        if self.ros.first:
            (number,) = struct.unpack("<I", self.bag.data(topic.rows, row, 4))
        return self.ros.header(stamp_ns, frame, number)

    def _colour(self, topic: Topic, frame: int, row: int, head: ImageHead) -> memoryview:
        header = self._header(topic, row, head.stamp_ns, head.frame)
        rgb = as_bytes(self.stored.frame(frame).rgb)
        if head.compressed:
            image = "jpg" if "jp" in head.encoding.lower() else "png"
            stored = self.stored.rgb_files[frame]
            whole = stored.suffix.lower() in (".jpg", ".jpeg") and image == "jpg"
            payload = read_bytes(stored) if whole else encode_colour(rgb, image)
            return self.ros.serialised(self.ros.compressed(header, payload, head.encoding))
        return self.ros.serialised(self.ros.image(header, *_as_encoded(rgb, head.encoding)))

    def _depth(self, topic: Topic, frame: int, row: int, head: ImageHead) -> memoryview:
        header = self._header(topic, row, head.stamp_ns, head.frame)
        depth_m = self.stored.frame(frame).depth_m
        if head.compressed:
            parameters = self.bag.data(topic.rows, row)[head.start : head.start + 12]
            payload = _compressed_depth(depth_m, head.encoding, parameters, self.depth_scale_per_m)
            return self.ros.serialised(self.ros.compressed(header, payload, head.encoding))
        if head.encoding in ("32FC1", "64FC1"):
            kind = np.float32 if head.encoding == "32FC1" else np.float64
            values = np.where(depth_m > 0, depth_m, np.nan).astype(kind)  # REP 118: what was not measured is NaN
        else:
            values = _steps(depth_m, self.depth_scale_per_m)
        return self.ros.serialised(self.ros.image(header, values[..., None], head.encoding))

    def _cameras(self, found: Replaced) -> None:
        """Replace the messages of cameras that are not those of the bag any more."""
        stored, original = self.stored, self.original
        pairs = [
            (original.rgb_info, stored.camera, stored.optics.distortion, original.camera, original.optics.distortion)
        ]
        if stored.depth_files and original.depth_info is not None:
            now, before = stored.optics.depth, original.optics.depth
            pairs.append(
                (
                    original.depth_info,
                    stored.camera if now is None else now.intrinsics,
                    stored.optics.distortion if now is None else None,
                    original.camera if before is None else before.intrinsics,
                    original.optics.distortion if before is None else None,
                )
            )
        for topic, camera, lens, was, lens_was in pairs:
            same = camera is None or was is None or (same_camera(camera, was) and lens == lens_was)
            if topic is None or same or camera is None:
                continue
            for row, number in enumerate(self._numbers(topic)):
                make = lambda topic=topic, row=row, camera=camera, lens=lens: self._camera(topic, row, camera, lens)  # noqa: E731
                found.rows[number] = make

    def _camera(self, topic: Topic, row: int, camera: Intrinsics, lens: Distortion | None) -> memoryview:
        stamp_ns, frame = topic.read(row, lambda data: ros.Fields(data, topic.encoding).header())
        return self.ros.serialised(self.ros.camera(self._header(topic, row, stamp_ns, frame), camera, lens))


def _nearest(stamps_ns: NDArray[np.int64], rows: NDArray[np.intp], wanted_ns: NDArray[np.int64]) -> list[int | None]:
    """Return for each stamp the first row of the nearest one; None beyond what seconds in float64 are rounded by.

    stamps_ns: in order. rows: of each.
    """
    after = np.searchsorted(stamps_ns, wanted_ns).clip(0, len(stamps_ns) - 1)
    before = np.searchsorted(stamps_ns, stamps_ns[np.maximum(after - 1, 0)])
    sooner = np.abs(stamps_ns[before] - wanted_ns) < np.abs(stamps_ns[after] - wanted_ns)
    best = np.where(sooner, before, after)
    near = np.abs(stamps_ns[best] - wanted_ns) <= _SAME_NS
    return [row if fits else None for row, fits in zip(rows[best].tolist(), near.tolist(), strict=True)]


def _as_encoded(rgb: NDArray[np.uint8], encoding: str) -> tuple[NDArray[Any], str]:
    """Return the pixels (H, W, C) of RGB (H, W, 3) as a raw image has them, and its encoding.

    Mosaics and YUV become rgb8: what was between their pixels is there now.
    """
    alpha = np.full((*rgb.shape[:2], 1), 255, np.uint8)
    match encoding:
        case "bgr8" | "8UC3":
            return rgb[..., ::-1], encoding
        case "rgba8":
            return np.concatenate([rgb, alpha], axis=2), encoding
        case "bgra8" | "8UC4":
            return np.concatenate([rgb[..., ::-1], alpha], axis=2), encoding
        case "mono8" | "8UC1":
            grey = rgb[..., 0] if (rgb == rgb[..., :1]).all() else grey_bytes(rgb)
            return grey[..., None], encoding
        case _:
            return rgb, "rgb8"


def _steps(depth_m: NDArray[np.float32], scale_per_m: float) -> NDArray[np.uint16]:
    """Return depth in steps, 0 where there is none or it is beyond 16 bits."""
    steps = np.rint(depth_m.astype(np.float64) * scale_per_m)
    return np.where((steps > 0) & (steps <= 65535), steps, 0).astype(np.uint16)


def _compressed_depth(depth_m: NDArray[np.float32], form: str, parameters: bytes, scale_per_m: float) -> bytes:
    """Return the payload of a compressed depth image; parameters: of the one that it replaces (12 bytes)."""
    if "compressedDepth" not in form:
        return encode_png(_steps(depth_m, scale_per_m))
    steps = _steps(depth_m, scale_per_m)
    if form.startswith("32FC1"):
        _, slope, shift = struct.unpack("<iff", parameters)
        inverse = np.divide(np.float32(slope), depth_m, out=np.zeros_like(depth_m), where=depth_m > 0) + np.float32(
            shift
        )
        steps = np.where(depth_m > 0, np.clip(np.rint(inverse), 0, 65535), 0).astype(np.uint16)
    return parameters + encode_png(steps)


def write_over(
    folder: Path, over: Path, out: Path, topics: BagTopics, depth_scale_per_m: float | None = None
) -> tuple[Counter[str], list[str]]:
    """Write a bag with the images of a sequence in place of its own.

    Return how many messages each topic has, and what the user should know of them, in sentences.

    over: the bag. topics: of colour and depth there, found where exactly one fits. depth_scale_per_m: of its depth in
    whole numbers, else 1000. Raises InputError.
    """
    asked = replace(topics, imu="none", poses="none")
    original = read_bag_sequence(over, asked, "none", depth_scale_per_m)
    overlay = Overlay(find_sequence(folder, poses="keep"), original, depth_scale_per_m or MILLIMETRES)
    bag, replaced = original.bag, overlay.replaced()
    if isinstance(bag.parts[0], Ros1Part):
        return _copied(overlay, replaced, out), replaced.notes
    if over.is_dir():
        out.mkdir()
    files = [out / part.path.name if over.is_dir() else out for part in bag.parts]
    for number, (part, file) in enumerate(zip(bag.parts, files, strict=True)):
        rows = {row: make for row, make in replaced.rows.items() if int(bag.rows.part[row]) == number}
        added = replaced.added if number == len(files) - 1 else []
        if isinstance(part, McapPart):
            _copy_in_mcap(overlay, part, file, rows, added)
        else:
            _copy_in_database(overlay, part.path, file, rows, added)
    if over.is_dir():
        _copied_metadata(over, out, files)
    whole = Bag(out)
    counts: Counter[str] = Counter()
    for item in whole.connections:
        counts[item.topic] += item.count
    whole.close()
    return counts, replaced.notes


def check_copy(over: Path, out: Path) -> None:
    """Raise InputError where a copy of a bag would be of another kind than it is, by its name."""
    part = Bag(over).parts[0]
    if over.is_dir():
        if out.suffix in BAG_SUFFIXES:
            problem = f"is a folder, and {out.name} would be a file"
            raise InputError(over, problem, remedy=f"name a folder: {out.stem}")
        return
    wanted = ".bag" if isinstance(part, Ros1Part) else ".mcap" if isinstance(part, McapPart) else ".db3"
    if out.suffix != wanted:
        raise InputError(
            over,
            f"is a bag in one file, and its copy is too, but ends {out.suffix or 'otherwise'}",
            remedy=f"name {out.stem}{wanted}",
        )


def _copied(overlay: Overlay, replaced: Replaced, out: Path) -> Counter[str]:
    """Copy a bag of ROS 1 message by message."""
    bag = overlay.bag
    chunks = [chunk for part in bag.parts if isinstance(part, Ros1Part) for chunk in part.chunks]
    counts: Counter[str] = Counter()
    added = sorted(replaced.added, key=lambda item: item[0])
    with _writing(out, "ros1", compressed=any(chunk.compression for chunk in chunks)) as writer:
        made: dict[tuple[Any, ...], Any] = {}
        connections = [_connection(writer, item, made) for item in bag.connections]

        def write(number: int, log_ns: int, data: bytes | memoryview) -> None:
            writer.write(connections[number], log_ns, data)
            counts[bag.connections[number].topic] += 1

        for row in range(len(bag.rows)):
            log_ns, number = int(bag.rows.log_ns[row]), int(bag.rows.connection[row])
            while added and added[0][0] < log_ns:
                at_ns, of, make = added.pop(0)
                write(of, at_ns, make())
            if row not in replaced.rows:
                write(number, log_ns, bag.data(bag.rows, row))
            elif (make := replaced.rows[row]) is not None:
                write(number, log_ns, make())
        for at_ns, of, make in added:
            write(of, at_ns, make())
    return counts


def _connection(writer: Any, item: Connection, made: dict[tuple[Any, ...], Any]) -> Any:
    """Return the writer's connection of one of a bag; those that are written alike are one."""
    given: dict[str, Any] = {"msgdef": item.definition, "md5sum": item.digest or "*"}
    given |= {"callerid": item.caller, "latching": item.latching}
    name = (item.topic, item.kind, *given.values())
    if name not in made:
        made[name] = writer.add_connection(item.topic, item.kind, **given)
    return made[name]


def _copy_in_mcap(overlay: Overlay, part: McapPart, out: Path, rows: dict[int, Any], added: list[Any]) -> None:
    where = overlay.bag.rows
    changed = {(int(where.chunk[row]), int(where.offset[row])): make for row, make in rows.items()}
    channels = part.channels_by_topic()
    of = overlay.bag.connections
    copy_mcap(part, out, changed, [Added(log_ns, channels[of[number].topic], make) for log_ns, number, make in added])


def _copy_in_database(overlay: Overlay, part: Path, out: Path, rows: dict[int, Any], added: list[Any]) -> None:
    """Copy a database whole, and change the rows of images in it."""
    bag = overlay.bag
    shutil.copyfile(part, out)
    with closing(sqlite3.connect(out)) as database, database:
        for row, make in rows.items():
            key = int(bag.rows.offset[row])
            if make is None:
                database.execute("DELETE FROM messages WHERE id = ?", (key,))
                continue
            data = packed(bytes(make()), bag.data(bag.rows, row, 4, raw=True))
            database.execute("UPDATE messages SET data = ? WHERE id = ?", (data, key))
        for log_ns, number, make in added:
            topic = bag.connections[number].topic
            (key,) = database.execute("SELECT id FROM topics WHERE name = ?", (topic,)).fetchone()
            new = (key, log_ns, bytes(make()))
            database.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", new)


def _copied_metadata(over: Path, out: Path, files: list[Path]) -> None:
    """Write the folder's metadata.yaml as it was, with the counts and times that are there now."""
    import yaml

    if not (over / METADATA).is_file():
        return
    document = read_yaml(recorded_text(over / METADATA), over / METADATA)
    stated, counts, spans = document["rosbag2_bagfile_information"], Counter[str](), []
    for file in files:
        part = Bag(file)
        counts.update({item.topic: item.count for item in part.connections})
        times_ns = part.rows.log_ns
        spans.append((int(times_ns.min()), int(times_ns.max()), len(times_ns)) if len(times_ns) else (0, 0, 0))
        part.close()
    for item in stated.get("topics_with_message_count") or ():
        item["message_count"] = counts[item["topic_metadata"]["name"]]
    full = [span for span in spans if span[2]] or spans
    whole = (min(span[0] for span in full), max(span[1] for span in full), counts.total())
    for item, (first_ns, last_ns, count) in ((stated, whole), *zip(stated.get("files") or (), spans, strict=False)):
        item["starting_time"] = {"nanoseconds_since_epoch": first_ns}
        item["duration"] = {"nanoseconds": last_ns - first_ns}
        item["message_count"] = count
    text = yaml.safe_dump(document, sort_keys=False, default_flow_style=False)
    (out / METADATA).write_text(text, encoding="utf-8", newline="\n")
