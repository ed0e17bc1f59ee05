# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a rig's sensors: a lens that distorts, a depth camera of its own, an IMU."""

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from ..core.errors import Message, PresetKey
from ..core.geometry import Intrinsics
from ..core.lens import Distortion, DistortionModel, Optics, lens_problem
from ..core.schema import Choice, ConfigPath, key, key_of
from ..core.streams import Identifiers, stream
from ..core.trajectory import NS_PER_S
from ..trajectories.rig import DeviceName, ImuModel, ImuSamples, RecordedImu, Triple, device_model

_OF_PLANE = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
EMBREE = PresetKey("render.engine", "embree")
OF_ANGLE = ("k1", "k2", "k3", "k4")
_LARGEST = 100.0  # of a coefficient; Azure Kinect's rational ones are below 10


def _coefficient(meaning: str) -> float:
    value: float = key(meaning, default=0.0, minimum=-_LARGEST, maximum=_LARGEST)
    return value


@dataclass(frozen=True)
class DistortionSpec:
    """A lens that distorts, by OpenCV's names; those of Kalibr and COLMAP are in the docs."""

    model: DistortionModel = key(
        "the lens's model: radial-tangential is Brown and Conrady's (OpenCV's, Kalibr's radtan), equidistant that of "
        "Kannala and Brandt (cv2.fisheye's, COLMAP's OPENCV_FISHEYE)",
        default="radial-tangential",
        choices={
            "radial-tangential": Choice("Radial-Tangential", "Brown and Conrady's: of most lenses"),
            "equidistant": Choice("Equidistant", "Kannala and Brandt's: of fisheyes"),
        },
        label="Lens Model",
    )
    k1: float = _coefficient("radial, by the square of the radius or the angle")
    k2: float = _coefficient("radial, by its 4th power")
    p1: float = _coefficient("tangential, down; of radial-tangential")
    p2: float = _coefficient("tangential, right; of radial-tangential")
    k3: float = _coefficient("radial, by its 6th power")
    k4: float = _coefficient("equidistant: by the 8th power; radial-tangential: the divisor's, by the square")
    k5: float = _coefficient("the divisor's, by the 4th power; of radial-tangential")
    k6: float = _coefficient("the divisor's, by the 6th power; of radial-tangential")
    undistort: bool = key(
        "whether frames that the lens has bent are made a pinhole's again, as a driver does: they are interpolated, "
        "and what the lens did not see is void",
        default=False,
        label="Undistort Again",
    )

    @property
    def lens(self) -> Distortion | None:
        """The lens; None where all coefficients are 0."""
        names = OF_ANGLE if self.model == "equidistant" else _OF_PLANE
        values = [float(getattr(self, name)) for name in names]
        if not any(values):
            return None
        if self.model == "radial-tangential":
            values = values[: 8 if any(values[5:]) else 5 if values[4] else 4]
        return Distortion(self.model, tuple(values))

    @property
    def left(self) -> Optics:
        """What the cameras of frames through this lens have beyond one pinhole."""
        return Optics(distortion=None if self.undistort else self.lens)


def check_distortion(spec: DistortionSpec, place: ConfigPath) -> None:
    """Refuse coefficients that the model has not, and a lens that does nothing. Raises InputError."""
    if spec.model == "equidistant":
        for name in set(_OF_PLANE) - set(OF_ANGLE):
            if getattr(spec, name):
                raise place.at(name).error("goes with radial-tangential: equidistant has k1 to k4", "leave it out")
    if spec.lens is None:
        remedy = "give k1" if spec.model == "radial-tangential" else "give k1; 0.001 is nearly an ideal fisheye"
        raise place.error("has no coefficient that is not 0", remedy)


def sound_lens(spec: DistortionSpec, camera: Intrinsics, place: ConfigPath, *, all_around: bool = False) -> Distortion:
    """Return the lens. Raises InputError where it folds over within the image of the camera.

    all_around: whether rays may lead sideways and back.
    """
    lens = spec.lens
    assert lens is not None, "this has been checked"
    if problem := lens_problem(camera, lens, all_around=all_around):
        remedy = Message("lower its coefficients, or the field of view (greater fx and fy)")
        if not all_around and not lens_problem(camera, lens, all_around=True):
            remedy = Message("lower the field of view (greater fx and fy), or render a mesh with ", EMBREE)
        raise place.error(problem, remedy)
    return lens


# The keys of a rig's depth sensor beside its place: its own camera, its clock, and whether it is registered.


SIZE = ("width", "height")
FOCAL = ("fx", "fy", "cx", "cy")


@dataclass(frozen=True)
class DepthCameraKeys:
    """What a depth sensor sees through, when, and in which camera's pixels its depth is written."""

    width: int | None = key("width of its image; default colour's", default=None, unit="px", minimum=1, maximum=65500)
    height: int | None = key("height of its image; default colour's", default=None, unit="px", minimum=1, maximum=65500)
    fx: float | None = key("its focal length", default=None, unit="px", above=0, maximum=1e6)
    fy: float | None = key("its focal length", default=None, unit="px", above=0, maximum=1e6)
    cx: float | None = key("its principal point", default=None, unit="px", minimum=-1e6, maximum=1e6)
    cy: float | None = key("its principal point", default=None, unit="px", minimum=-1e6, maximum=1e6)
    horizontal_fov_deg: float | None = key(
        "how wide it sees, instead of fx, fy, cx, cy: square pixels, the principal point in the middle",
        default=None,
        unit="deg",
        above=0,
        maximum=179,
    )
    registered: bool = key(
        "whether its depth is laid into colour's pixels, as the device's library does, or written as it is measured",
        default=False,
    )
    rate_hz: float | None = key(
        "its exposures a second; each frame shows the one that is nearest in time; default one for each frame",
        default=None,
        unit="Hz",
        minimum=0.01,
        maximum=10_000,
    )
    delay_ms: float = key(
        "how much later than colour it exposes", default=0.0, unit="ms", minimum=-10_000, maximum=10_000
    )
    clock_drift_ppm: float = key(
        "how much faster than colour's the clock goes by which it exposes",
        default=0.0,
        unit="ppm",
        minimum=-1e5,
        maximum=1e5,
    )

    @property
    def has_camera(self) -> bool:
        """Whether it has intrinsics of its own."""
        return any(getattr(self, name) is not None for name in (*SIZE, *FOCAL, "horizontal_fov_deg"))

    @property
    def has_clock(self) -> bool:
        """Whether it exposes at other times than colour."""
        return self.rate_hz is not None or self.delay_ms != 0.0 or self.clock_drift_ppm != 0.0

    def intrinsics(self, colour: Intrinsics) -> Intrinsics:
        """Return its camera. colour: the colour camera, which it has where it says none."""
        if not self.has_camera:
            return colour
        width, height = self.width or colour.width_px, self.height or colour.height_px
        if self.horizontal_fov_deg is not None:
            # Rounded, as a tangent's last bits differ between machines.
            focal_px = round(width / 2 / math.tan(math.radians(self.horizontal_fov_deg) / 2), 9)
            return Intrinsics(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2)
        fx, fy, cx, cy = (float(getattr(self, name)) for name in FOCAL)
        return Intrinsics(width, height, fx, fy, cx, cy)


def check_depth_camera(spec: DepthCameraKeys, place: ConfigPath) -> None:
    """Refuse a camera of which some is missing or said twice. Raises InputError."""
    if not spec.has_camera:
        return
    given = [name for name in FOCAL if getattr(spec, name) is not None]
    if missing := [name for name in SIZE if getattr(spec, name) is None]:
        raise place.error(f"has a camera of its own without {missing[0]}", "give width and height")
    if given and spec.horizontal_fov_deg is not None:
        raise place.error(f"gives {given[0]} and horizontal_fov_deg", "keep one of them")
    if spec.horizontal_fov_deg is None and len(given) < len(FOCAL):
        lacking = next(name for name in FOCAL if name not in given)
        raise place.error(f"has a size of its own without {lacking}", "give fx, fy, cx, cy, or horizontal_fov_deg")


# The keys of a rig's IMU: its clock and its errors.


@dataclass(frozen=True)
class ImuKeys:
    """What an IMU measures by. Errors that are not given are the device's."""

    device: DeviceName = key(
        "whose errors it has: none, EuRoC's ADIS16448, or the BMI055 of a RealSense D435i",
        default="ideal",
        choices={
            "ideal": Choice("Ideal", "Without any error"),
            "adis16448": Choice("ADIS16448", "Of the EuRoC datasets"),
            "bmi055": Choice("BMI055", "Of RealSense's D435i"),
            "bmi055_filtered": Choice("BMI055, Filtered", "Of RealSense's D435i, with its low-pass"),
        },
        identity="meaning",
    )
    rate_hz: float = key("samples a second", unit="Hz", default=200.0, minimum=1, maximum=10_000, identity="meaning")
    gravity_m_s2: float = key(
        "gravity, along the world's -z", unit="m/s^2", default=9.81, minimum=0, maximum=100, identity="meaning"
    )
    time_offset_s: float = key(
        "its clock minus the cameras' at the path's beginning",
        unit="s",
        default=0.0,
        minimum=-1000,
        maximum=1000,
        identity="meaning",
    )
    clock_drift_ppm: float = key(
        "how much faster its clock goes than the cameras'",
        unit="ppm",
        default=0.0,
        minimum=-1e5,
        maximum=1e5,
        identity="meaning",
    )
    gyro_noise_density: float | None = key(
        "white noise of angular velocity; default the device's",
        unit="rad/s/sqrt(Hz)",
        default=None,
        minimum=0,
        maximum=10,
        identity="meaning",
    )
    gyro_random_walk: float | None = key(
        "random walk of the gyro's bias; default the device's",
        unit="rad/s^2/sqrt(Hz)",
        default=None,
        minimum=0,
        maximum=10,
        identity="meaning",
    )
    accel_noise_density: float | None = key(
        "white noise of specific force; default the device's",
        unit="m/s^2/sqrt(Hz)",
        default=None,
        minimum=0,
        maximum=100,
        identity="meaning",
    )
    accel_random_walk: float | None = key(
        "random walk of the accelerometer's bias; default the device's",
        unit="m/s^3/sqrt(Hz)",
        default=None,
        minimum=0,
        maximum=100,
        identity="meaning",
    )
    gyro_bias_rad_s: Triple | None = key(
        "the gyro's bias at the path's beginning; default the device's",
        unit="rad/s",
        default=None,
        minimum=-100,
        maximum=100,
        identity="meaning",
    )
    accel_bias_m_s2: Triple | None = key(
        "the accelerometer's bias at the path's beginning; default the device's",
        unit="m/s^2",
        default=None,
        minimum=-1000,
        maximum=1000,
        identity="meaning",
    )
    gyro_scale_error: Triple | None = key(
        "relative error of the gyro's scale, each axis; default the device's",
        default=None,
        minimum=-1,
        maximum=1,
        identity="meaning",
    )
    accel_scale_error: Triple | None = key(
        "relative error of the accelerometer's scale, each axis; default the device's",
        default=None,
        minimum=-1,
        maximum=1,
        identity="meaning",
    )
    gyro_misalignment_deg: Triple | None = key(
        "of the gyro: by how much of x the y axis, of x the z axis, and of y the z axis measures; default the device's",
        unit="deg",
        default=None,
        minimum=-45,
        maximum=45,
        identity="meaning",
    )
    accel_misalignment_deg: Triple | None = key(
        "the same of the accelerometer; default the device's",
        unit="deg",
        default=None,
        minimum=-45,
        maximum=45,
        identity="meaning",
    )
    gyro_range_deg_s: float | None = key(
        "largest angular velocity; 0: any; default the device's",
        unit="deg/s",
        default=None,
        minimum=0,
        maximum=1e6,
        identity="meaning",
    )
    accel_range_m_s2: float | None = key(
        "largest specific force; 0: any; default the device's",
        unit="m/s^2",
        default=None,
        minimum=0,
        maximum=1e6,
        identity="meaning",
    )
    gyro_step_deg_s: float | None = key(
        "what angular velocity is rounded to; 0: nothing; default the device's",
        unit="deg/s",
        default=None,
        minimum=0,
        maximum=1000,
        identity="meaning",
    )
    accel_step_m_s2: float | None = key(
        "what specific force is rounded to; 0: nothing; default the device's",
        unit="m/s^2",
        default=None,
        minimum=0,
        maximum=1000,
        identity="meaning",
    )

    bandwidth_hz: float | None = key(
        "of the low-pass before samples are taken, where half of the power is left; 0: none; default the device's",
        unit="Hz",
        default=None,
        minimum=0,
        maximum=100_000,
        identity="meaning",
    )

    @property
    def model(self) -> ImuModel:
        """Its errors: the device's, with what is given in place of them."""
        return device_model(self.device, {item.name: getattr(self, item.name) for item in fields(ImuKeys)})


# The keys of the clock of an IMU that was recorded.


@dataclass(frozen=True)
class ImuClockSpec:
    """What is done to the stamps of an IMU that was recorded; its samples stay as they are."""

    time_offset_s: float = key_of(ImuKeys, "time_offset_s", identity="value")
    clock_drift_ppm: float = key_of(ImuKeys, "clock_drift_ppm", identity="value")
    stamp_jitter_s: float = key(
        "standard deviation of the noise of its stamps, which stay in order",
        unit="s",
        default=0.0,
        minimum=0,
        maximum=1,
    )
    dropped_share: float = key("share of its samples that are lost", default=0.0, minimum=0, maximum=0.99)

    def on(self, imu: RecordedImu, first_ns: int, identifiers: Identifiers) -> RecordedImu:
        """Return an IMU with these deviations. first_ns: when the path begins. identifiers: of seed and scene."""
        if self == ImuClockSpec():
            return imu
        samples, generator = imu.samples, stream(*identifiers, IMU_CLOCK_STREAM)
        noise = generator.standard_normal(len(samples.stamps_ns))  # both are drawn, so that neither moves the other
        kept = generator.random(len(samples.stamps_ns)) >= self.dropped_share
        passed_s = (samples.stamps_ns - first_ns) / NS_PER_S
        moved_s = passed_s * (1e-6 * self.clock_drift_ppm) + self.time_offset_s + noise * self.stamp_jitter_s
        stamps_ns = samples.stamps_ns + np.rint(moved_s * NS_PER_S).astype(np.int64)
        if self.stamp_jitter_s:
            rows = np.arange(len(stamps_ns))
            stamps_ns = np.maximum.accumulate(np.sort(stamps_ns) - rows) + rows  # in order, and none twice
        clocked = replace(
            samples.imu,
            time_offset_s=samples.imu.time_offset_s + self.time_offset_s,
            clock_drift_ppm=samples.imu.clock_drift_ppm + self.clock_drift_ppm,
        )
        rate_rad_s, force_m_s2 = samples.rate_rad_s[kept], samples.force_m_s2[kept]
        found = ImuSamples(clocked, stamps_ns[kept], rate_rad_s, force_m_s2)
        return replace(imu, rig=replace(imu.rig, imu=clocked), samples=found)


IMU_CLOCK_STREAM = "imu.clock"  # what the deviations of a recorded IMU's clock draw by
