# SPDX-License-Identifier: GPL-3.0-or-later
"""What messages of ROS say: images, cameras, transforms, poses, and samples of an IMU.

Fields as https://docs.ros.org/en/api of ROS 1 and https://github.com/ros2/common_interfaces have them; encodings of
images as sensor_msgs' image_encodings.h; compressed depth as compressed_depth_image_transport's codec.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.lens import Distortion, distortion_of
from ..core.trajectory import NS_PER_S
from ..images.image_files import decoded_colour, whole_image
from ..images.image_header import UnfitImageError, check_size
from ..images.pixels import decode_png

IMAGE: Final = "sensor_msgs/msg/Image"
COMPRESSED: Final = "sensor_msgs/msg/CompressedImage"
CAMERA: Final = "sensor_msgs/msg/CameraInfo"
IMU: Final = "sensor_msgs/msg/Imu"
TRANSFORMS: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
ODOMETRY: Final = "nav_msgs/msg/Odometry"
MOVED: Final = "geometry_msgs/msg/TransformStamped"
POSES: Final = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    ODOMETRY,
    MOVED,
)
HEAD_BYTES = 1024  # of an image's message that are read for its head; names of frames are shorter
LONGEST_TEXT = 4096  # of the name of a frame or an encoding

_QUAT_TOLERANCE = 1e-2  # of a quaternion's length, as for files of poses


class MessageError(ValueError):
    """A message is not what its type says."""


class Fields:
    """The fields of a message, read one after another. encoding: "ros1", or "cdr" as ROS 2 writes it."""

    def __init__(self, data: bytes, encoding: str) -> None:
        self.data = data
        self.ros1 = encoding == "ros1"
        if not self.ros1 and data[:2] not in (b"\0\0", b"\0\1"):
            raise MessageError("it is no CDR as ROS 2 writes it")
        self.start = self.place = 0 if self.ros1 else 4
        self.order = "<" if self.ros1 or data[1] else ">"

    def numbers(self, code: str, count: int = 1) -> tuple[Any, ...]:
        """Return numbers of one kind, as `struct` names it; CDR begins each at a multiple of its length."""
        size = struct.calcsize("=" + code)
        if not self.ros1 and count:
            self.place += -(self.place - self.start) % size
        if count < 0 or self.place + size * count > len(self.data):
            raise MessageError(f"it ends after {len(self.data)} bytes, before all of its fields")
        found = struct.unpack_from(f"{self.order}{count}{code}", self.data, self.place)
        self.place += size * count
        return found

    def number(self, code: str) -> Any:
        """Return a number."""
        return self.numbers(code)[0]

    def text(self) -> str:
        """Return a text; CDR's ends with a zero."""
        length = self.number("I")
        if length > LONGEST_TEXT or self.place + length > len(self.data):
            raise MessageError(f"a text of it says {length} bytes")
        found = self.data[self.place : self.place + length]
        self.place += length
        try:
            return found.rstrip(b"\0").decode()
        except UnicodeDecodeError:
            raise MessageError("a text of it is not UTF-8") from None

    def header(self) -> tuple[int, str]:
        """Return the time stamp in nanoseconds, and the name of the frame, without a slash before it."""
        if self.ros1:
            self.number("I")
        sec, nsec = self.number("I" if self.ros1 else "i"), self.number("I")
        if sec < 0 or nsec >= NS_PER_S:
            raise MessageError(f"its header says the time {sec} s and {nsec} ns")
        return sec * NS_PER_S + nsec, self.text().lstrip("/")

    def end(self) -> None:
        """Raise MessageError where more follows than CDR fills up with."""
        if len(self.data) - self.place > (0 if self.ros1 else 3):
            raise MessageError(f"it has {len(self.data)} bytes, and its fields {self.place}")


# --- images ---

_RAW: dict[str, tuple[int, type]] = {
    **dict.fromkeys(("rgb8", "bgr8", "8UC3"), (3, np.uint8)),
    **dict.fromkeys(("rgba8", "bgra8", "8UC4"), (4, np.uint8)),
    **dict.fromkeys(("mono8", "8UC1"), (1, np.uint8)),
    **dict.fromkeys(("rgb16", "bgr16", "16UC3"), (3, np.uint16)),
    **dict.fromkeys(("mono16", "16UC1"), (1, np.uint16)),
    **dict.fromkeys(("yuv422", "uyvy", "yuv422_yuy2", "yuyv"), (2, np.uint8)),
    **{f"bayer_{order}8": (1, np.uint8) for order in ("rggb", "bggr", "gbrg", "grbg")},
    "32FC1": (1, np.float32),
    "64FC1": (1, np.float64),
}
"""By encoding: how many values a pixel has, and of which type."""
DEPTHS = ("16UC1", "mono16", "32FC1", "64FC1")
# OpenCV names a mosaic by the second row's second and third pixel, ROS by the first row's first two.
_MOSAICS = {"rggb": "BG", "bggr": "RG", "gbrg": "GR", "grbg": "GB"}
_COMPRESSED_DEPTH = "compressedDepth"
_DEPTH_HEADER = struct.Struct("<iff")  # of compressedDepth: the kind, and the parameters of inverse depth


@dataclass(frozen=True, slots=True)
class ImageHead:
    """What a message with an image says before its pixels.

    width_px, height_px: None of a compressed one. encoding: of a raw image's pixels, or the format of a compressed one.
    big_endian, step: of raw pixels, the latter in bytes a row. start, length: where in the message its data are.
    """

    stamp_ns: int
    frame: str
    encoding: str
    compressed: bool
    width_px: int | None
    height_px: int | None
    big_endian: bool
    step: int
    start: int
    length: int

    @property
    def is_depth(self) -> bool:
        """Whether it is depth by its encoding."""
        if self.compressed:
            return _COMPRESSED_DEPTH in self.encoding or self.encoding.split(";")[0].strip() in DEPTHS
        return self.encoding in DEPTHS

    @property
    def size_px(self) -> tuple[int, int] | None:
        """Width and height; None of a compressed image."""
        return None if self.width_px is None or self.height_px is None else (self.width_px, self.height_px)


def image_head(data: bytes, kind: str, encoding: str) -> ImageHead:
    """Return the head of an image's message, of which the first bytes are enough. Raises MessageError."""
    fields = Fields(data, encoding)
    stamp_ns, frame = fields.header()
    if kind == COMPRESSED:
        form = fields.text()
        length = fields.number("I")
        return ImageHead(stamp_ns, frame, form, True, None, None, False, 0, fields.place, length)
    height_px, width_px = fields.numbers("I", 2)
    form = fields.text()
    big_endian, step, length = fields.number("B"), fields.number("I"), fields.number("I")
    return ImageHead(stamp_ns, frame, form, False, width_px, height_px, bool(big_endian), step, fields.place, length)


def _pixels(head: ImageHead, data: bytes) -> NDArray[Any]:
    """Return the values (H, W, C) of a raw image. Raises MessageError for an encoding that is not read."""
    if head.encoding not in _RAW:
        known = ", ".join(_RAW)
        raise MessageError(f"its encoding is {head.encoding[:40]!r}, which is none of {known}")
    count, kind = _RAW[head.encoding]
    assert head.width_px is not None
    assert head.height_px is not None
    try:
        check_size(head.width_px, head.height_px)
    except UnfitImageError as error:
        raise MessageError(error.problem) from None
    dtype = np.dtype(kind).newbyteorder(">" if head.big_endian else "<")
    row = head.width_px * count * dtype.itemsize
    if head.step < row or head.length < head.step * (head.height_px - 1) + row:
        size = f"{head.width_px} x {head.height_px} pixels of {head.encoding}"
        raise MessageError(f"it says {size}, and has {head.length} bytes, {head.step} a row")
    if head.start + head.length > len(data):
        raise MessageError(f"it says {head.length} bytes of pixels, and ends after {len(data)}")
    rows = np.frombuffer(data, np.uint8, head.length, head.start)
    if len(rows) < head.step * head.height_px:  # the last row need not be filled up
        rows = np.append(rows, np.zeros(head.step * head.height_px - len(rows), np.uint8))
    whole = np.ascontiguousarray(rows[: head.step * head.height_px].reshape(head.height_px, head.step)[:, :row])
    values = whole.view(dtype).reshape(head.height_px, head.width_px, count)
    return values.astype(kind, copy=False)


def colour_of(head: ImageHead, data: bytes) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Return colour (H, W, 3), RGB: uint8, or float32 in [0, 1] of 16 bits. Raises MessageError where it is none."""
    if head.is_depth:
        raise MessageError(f"its encoding is {head.encoding[:40]!r}, that of depth and no colour")
    if head.compressed:
        try:
            return decoded_colour(*whole_image(_payload(head, data)))
        except UnfitImageError as error:
            raise MessageError(error.problem) from None
    return _as_rgb(head.encoding, _pixels(head, data))


def _as_rgb(encoding: str, values: NDArray[Any]) -> NDArray[np.uint8] | NDArray[np.float32]:
    import cv2

    if encoding in ("mono8", "8UC1"):
        return np.repeat(values, 3, axis=2)
    if encoding.startswith("bayer_"):
        code = getattr(cv2, f"COLOR_Bayer{_MOSAICS[encoding[6:10]]}2RGB")
        return np.asarray(cv2.cvtColor(values[..., 0], code), np.uint8)
    if encoding.startswith(("yuv", "uyvy", "yuyv")):
        if values.shape[1] % 2:
            raise MessageError(f"its encoding {encoding} has two pixels at once, and a row of it {values.shape[1]}")
        code = cv2.COLOR_YUV2RGB_UYVY if encoding in ("yuv422", "uyvy") else cv2.COLOR_YUV2RGB_YUY2
        return np.asarray(cv2.cvtColor(values, code), np.uint8)
    rgb = values[..., :3] if encoding.startswith("rgb") else values[..., 2::-1]
    rgb = np.ascontiguousarray(rgb)
    return rgb if rgb.dtype == np.uint8 else np.divide(rgb, np.float32(65535), dtype=np.float32)


def depth_of(head: ImageHead, data: bytes, scale_per_m: float) -> NDArray[np.float32]:
    """Return planar depth (H, W) in metres, 0 where there is none. scale_per_m: steps a metre of whole numbers.

    In float, NaN and infinity are void, as REP 118 says. Raises MessageError where it is no depth.
    """
    if not head.is_depth:
        raise MessageError(f"its encoding is {head.encoding[:40]!r}, that of colour and no depth")
    values = _compressed_depth(head, data) if head.compressed else _pixels(head, data)[..., 0]
    if values.dtype == np.uint16:
        return (values / np.float64(scale_per_m)).astype(np.float32)
    with np.errstate(invalid="ignore", over="ignore"):
        depth_m = values.astype(np.float32)
    depth_m[~(np.isfinite(depth_m) & (depth_m > 0))] = 0
    return depth_m


def _compressed_depth(head: ImageHead, data: bytes) -> NDArray[Any]:
    """Return steps (H, W) uint16, or metres in float."""
    payload = _payload(head, data)
    if _COMPRESSED_DEPTH not in head.encoding:
        return _steps(payload)
    if "rvl" in head.encoding.lower():
        raise MessageError("its depth is compressed as RVL, which is not read; record it as png")
    if len(payload) < _DEPTH_HEADER.size:
        raise MessageError(f"its compressed depth has {len(payload)} bytes")
    _, slope, shift = _DEPTH_HEADER.unpack_from(payload)
    steps = _steps(payload[_DEPTH_HEADER.size :])
    if not head.encoding.startswith("32FC1"):
        return steps
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth_m = np.float32(slope) / (steps.astype(np.float32) - np.float32(shift))
    depth_m[steps == 0] = 0
    return depth_m


def _steps(payload: bytes) -> NDArray[np.uint16]:
    import cv2

    try:
        header, whole = whole_image(payload)
    except UnfitImageError as error:
        raise MessageError(f"its PNG {error.problem}") from None
    if (header.kind, header.bits, header.channels, header.alpha) != ("png", 16, 1, False):
        raise MessageError(f"it holds {header.description}, but depth is a PNG of 16-bit grey")
    pixels = decode_png(whole)
    if pixels is None:
        pixels = cv2.imdecode(np.frombuffer(whole, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != np.uint16 or pixels.shape != (header.height_px, header.width_px):
        raise MessageError("its PNG cannot be decoded")
    return np.asarray(pixels, np.uint16)


def _payload(head: ImageHead, data: bytes) -> bytes:
    if head.start + head.length > len(data):
        raise MessageError(f"it says {head.length} bytes of an image, and ends after {len(data)}")
    return data[head.start : head.start + head.length]


# --- cameras ---

_LENSES: dict[str, tuple[str, tuple[int, ...]]] = {
    "plumb_bob": ("radial-tangential", (4, 5)),
    "radtan": ("radial-tangential", (4, 5)),
    "rational_polynomial": ("radial-tangential", (8, 12, 14)),
    "equidistant": ("equidistant", (4,)),
    "fisheye": ("equidistant", (4,)),
    "kannala_brandt4": ("equidistant", (4,)),
}
"""By ROS's name of a lens: ours, and how many coefficients it has."""


@dataclass(frozen=True)
class CameraInfo:
    """What a camera_info says. camera: None where it is not calibrated. lens: of the raw image, None for a pinhole.

    rectified: the pinhole of the rectified image; None where it says none.
    """

    frame: str
    camera: Intrinsics | None
    lens: Distortion | None
    rectified: Intrinsics | None


def camera_info(data: bytes, encoding: str) -> CameraInfo:
    """Return what a camera_info says. Raises MessageError where it is no camera."""
    fields = Fields(data, encoding)
    _, frame = fields.header()
    height_px, width_px = fields.numbers("I", 2)
    model = fields.text()
    count = fields.number("I")
    if count > 64:
        raise MessageError(f"its lens has {count} coefficients")
    coefficients = fields.numbers("d", count)
    k, _, p = fields.numbers("d", 9), fields.numbers("d", 9), fields.numbers("d", 12)
    binning, region = fields.numbers("I", 2), fields.numbers("I", 4)
    fields.numbers("B")
    fields.end()
    if not np.isfinite([*coefficients, *k, *p]).all():
        raise MessageError("it holds what is no finite number")
    if k[0] == 0:
        return CameraInfo(frame, None, None, None)
    camera = _pinhole((k[0], k[4], k[2], k[5]), (width_px, height_px), binning, region)
    rectified = _pinhole((p[0], p[5], p[2], p[6]), (width_px, height_px), binning, region) if p[0] > 0 else None
    return CameraInfo(frame, camera, _lens(model, coefficients), rectified)


def _pinhole(
    values: tuple[float, ...], size_px: tuple[int, int], binning: tuple[int, ...], region: tuple[int, ...]
) -> Intrinsics:
    """Return the camera of the image as it was sent: a region of the whole one, of whose pixels some were made one."""
    fx_px, fy_px, cx_px, cy_px = values
    if fx_px <= 0 or fy_px <= 0:
        raise MessageError(f"its focal lengths are {fx_px:g} and {fy_px:g}")
    left, top, high, wide = region
    by_x, by_y = (max(each, 1) for each in binning)
    width_px, height_px = ((wide, high) if wide and high else size_px) if (wide or high) else size_px
    return Intrinsics(
        width_px // by_x, height_px // by_y, fx_px / by_x, fy_px / by_y, (cx_px - left) / by_x, (cy_px - top) / by_y
    )


def _lens(model: str, coefficients: tuple[float, ...]) -> Distortion | None:
    if not any(coefficients):
        return None
    name, counts = _LENSES.get(model, ("", ()))
    if not name:
        raise MessageError(f"its lens is {model[:40]!r}, which is none of {', '.join(_LENSES)}")
    if len(coefficients) not in counts:
        raise MessageError(f"its lens {model} has {len(coefficients)} coefficients, not {counts[0]}")
    if any(coefficients[8:]):
        raise MessageError(f"its lens {model} has coefficients of a thin prism, which are not modelled")
    values = coefficients[:8]
    if len(values) == 5 and values[4] == 0:
        values = values[:4]
    try:
        return distortion_of("equidistant" if name == "equidistant" else "radial-tangential", values)
    except ValueError as error:
        raise MessageError(f"its lens holds {error}") from None


# --- poses ---


@dataclass(frozen=True, slots=True)
class Moved:
    """A pose of one frame in another at a time.

    child: "" where nothing names it. values: the translation in metres, and the quaternion with w last.
    """

    stamp_ns: int
    parent: str
    child: str
    values: tuple[float, ...]


def transforms(data: bytes, encoding: str) -> list[Moved]:
    """Return the transforms of a message of tf. Raises MessageError."""
    fields = Fields(data, encoding)
    count = fields.number("I")
    if count * 60 > len(data):
        raise MessageError(f"it says {count} transforms in {len(data)} bytes")
    found = []
    for _ in range(count):
        stamp_ns, parent = fields.header()
        child = fields.text().lstrip("/")
        found.append(Moved(stamp_ns, parent, child, _checked_pose(fields.numbers("d", 7))))
    fields.end()
    return found


def stamped_pose(data: bytes, kind: str, encoding: str) -> Moved:
    """Return the pose of a message of one of POSES. Raises MessageError."""
    fields = Fields(data, encoding)
    stamp_ns, parent = fields.header()
    child = fields.text().lstrip("/") if kind in (ODOMETRY, MOVED) else ""
    values = _checked_pose(fields.numbers("d", 7))
    after = {POSES[1]: 36, ODOMETRY: 36 + 6 + 36}.get(kind, 0)
    fields.numbers("d", after)
    fields.end()
    return Moved(stamp_ns, parent, child, values)


def _checked_pose(values: tuple[float, ...]) -> tuple[float, ...]:
    length = math.hypot(*values[3:])
    if not math.isfinite(sum(values)) or abs(length - 1) > _QUAT_TOLERANCE:
        raise MessageError(f"a pose of it is none: {', '.join(f'{value:g}' for value in values)}")
    return values


def imu_sample(data: bytes, encoding: str) -> tuple[int, str, tuple[float, ...]]:
    """Return the stamp, the frame, and angular velocity and specific force (6) of a sample. Raises MessageError."""
    fields = Fields(data, encoding)
    stamp_ns, frame = fields.header()
    values = fields.numbers("d", 4 + 9 + 3 + 9 + 3 + 9)
    fields.end()
    return stamp_ns, frame, (*values[13:16], *values[25:28])


def saying(path: Path, topic: str, number: int, read: Callable[[], Any]) -> Any:
    """Return what is read of a message. Raises InputError, which names the bag, the topic and the message."""
    try:
        return read()
    except MessageError as error:
        problem = f"message {number} is not as its type says: {error}"
        raise InputError(path, problem, where=topic, remedy="name another topic, or record it again") from None
