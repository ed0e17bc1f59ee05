# SPDX-License-Identifier: GPL-3.0-or-later
"""Real cameras: their intrinsics and lens, and `camera: {device: NAME}`, which stands for these keys.

Real cameras as tables: intrinsics and lens, and the perturbations that are their shutter, lens and electronics.

Each figure has its source beside it, or is called assumed with the reason. One unit's calibration stands for its kind:
others of the kind differ by a per cent or so in focal length and by some pixels in the principal point.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..core.geometry import Intrinsics
from ..core.packages import Door, Registry
from ..core.schema import ConfigPath, describe, unknown_name

Values = Mapping[str, Any]

_WELL = (
    "full well and read noise are assumed, as makers do not publish them: 4,500 electrons for a micrometre of pixel "
    "pitch; 2 electrons where the sensor is back-illuminated, else 4"
)
_SHADING = "assumed: what is left after the camera has corrected its own shading"
_FRINGE = "assumed: a lens of plastic; less than a pixel where the lens is better"


@dataclass(frozen=True)
class CameraDevice:
    """A camera that can be bought.

    name: in presets. label: its name in lists. meaning: what it is. intrinsics: of the image that it is taken for.
    distortion: keys of `camera.distortion`; {} where its driver says that there is none. steps: parameters of
    perturbations by their names. sources: for `lens` and each of the steps where the figures are from.
    """

    name: str
    label: str
    meaning: str
    intrinsics: Intrinsics
    distortion: Values
    steps: Mapping[str, Values]
    sources: Mapping[str, str]

    @property
    def camera(self) -> dict[str, Any]:
        """Return its keys of a preset's `camera`."""
        it = self.intrinsics
        keys = {"width": it.width_px, "height": it.height_px, "fx": it.fx_px, "fy": it.fy_px, "cx": it.cx_px}
        return keys | {"cy": it.cy_px} | ({"distortion": dict(self.distortion)} if self.distortion else {})


def _problem(item: CameraDevice) -> str:
    """Return what is wrong with the camera of a package, in a sentence, or ""."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", item.name):
        return f"{item.name!r} is no name of a camera: small letters, digits and underscores, a letter first"
    return "" if item.label and item.meaning else f"its camera {item.name} needs a label and a meaning"


def _sensor(
    pitch_um: float, *, back_illuminated: bool, gain_db: float, exposure_ms: float = 10.0, bits: int = 10
) -> Values:
    return {
        "gain_db": gain_db,
        "full_well_electrons": round(4500 * pitch_um),
        "read_noise_electrons": 2.0 if back_illuminated else 4.0,
        "exposure_ms": exposure_ms,
        "bits": bits,
    }


def _glass(corner_loss: float, fringe_px: float) -> dict[str, Values]:
    return {
        "vignetting": {"corner_loss": corner_loss},
        "chromatic_aberration": {"red_px": fringe_px, "blue_px": -fringe_px},
    }


def _sources(lens: str, sensor: str, rolling: str = "") -> dict[str, str]:
    found = {"lens": lens, **({"rolling_shutter": rolling} if rolling else {})}
    return found | {"vignetting": _SHADING, "chromatic_aberration": _FRINGE, "sensor_noise": f"{sensor}; {_WELL}"}


_OURS = (
    CameraDevice(
        "realsense_d435",
        "RealSense D435",
        "colour camera of Intel's stereo camera: rows are read one by one, depth is of one moment",
        Intrinsics(1280, 720, 918.608, 915.973, 631.377, 356.666),
        {},
        {
            "rolling_shutter": {"readout_ms": 16.7, "depth": "global"},
            **_glass(0.3, 0.3),
            "sensor_noise": _sensor(1.4, back_illuminated=True, gain_db=6.0),
        },
        _sources(
            "a unit's rs-enumerate-devices in librealsense thread 7300, which says distortion 0; 69.4 x 42.5 degrees "
            "and 1.5 % of distortion at most: FRAMOS, manual of the D435e",
            "OV2740, 1.4 um pitch and 10 bits: the manual (pitch from memory); gain assumed, of a lit room",
            "rolling: the manual; assumed 16.7 ms, the period of its highest rate, 60 Hz: its time is not published "
            "(librealsense threads 7066, 12716)",
        ),
    ),
    CameraDevice(
        "realsense_d455",
        "RealSense D455",
        "colour camera of Intel's stereo camera with a longer baseline: all rows of one moment",
        Intrinsics(1280, 720, 632.4, 632.0, 639.8, 363.3),
        {"k1": -0.056522, "k2": 0.068801, "p1": -0.000717, "p2": -0.000025, "k3": -0.022386},
        {**_glass(0.4, 0.4), "sensor_noise": _sensor(3.0, back_illuminated=False, gain_db=6.0)},
        _sources(
            "a unit's intrinsics as librealsense gives them, printed in a public program (at 720 rows). "
            "It calls the model inverse Brown-Conrady; thread 13833 says that it is Brown-Conrady, as taken here",
            "OV9782, 3 um pitch, from memory; gain assumed, of a lit room",
        ),
    ),
    CameraDevice(
        "azure_kinect",
        "Azure Kinect",
        "colour camera of Microsoft's time-of-flight camera: rows are read one by one, depth is of one moment",
        Intrinsics(1280, 720, 613.024, 612.935, 648.104, 373.494),
        {
            "k1": 0.40386343,
            "k2": -2.60288429,
            "p1": 0.00089407846,
            "p2": -0.000041651688,
            "k3": 1.51187789,
            "k4": 0.28427526,
            "k5": -2.42072129,
            "k6": 1.43542445,
        },
        {
            "rolling_shutter": {"readout_ms": 22.0, "depth": "global"},
            **_glass(0.3, 0.3),
            "sensor_noise": _sensor(1.25, back_illuminated=True, gain_db=6.0),
        },
        _sources(
            "a unit's calibration of 4096 x 3072 in Azure-Kinect-Sensor-SDK thread 1488, its middle 2304 rows halved "
            "and so on to 720; rational as in OpenCV",
            "OV12A10: thread 1062; 1.25 um pitch, from memory; 10 bits assumed; gain assumed, of a lit room",
            "rolling: the SDK's thread 1062; about 22 ms: in thread 1094 a lamp that goes out 20 ms after the "
            "trigger is not seen at 0.5 ms of exposure, one that goes out after 22 ms is",
        ),
    ),
    CameraDevice(
        "kinect_v1",
        "Kinect",
        "colour camera of Microsoft's first Kinect",
        Intrinsics(640, 480, 517.3, 516.5, 318.6, 255.3),
        {"k1": 0.2624, "k2": -0.9531, "p1": -0.0054, "p2": 0.0026, "k3": 1.1633},
        {
            "rolling_shutter": {"readout_ms": 30.0},
            **_glass(0.35, 0.6),
            "sensor_noise": _sensor(2.8, back_illuminated=False, gain_db=12.0, exposure_ms=20.0),
        },
        _sources(
            "TUM RGB-D's calibration of its first camera (freiburg1)",
            "MT9M112, 2.8 um pitch and 10 bits, from memory; gain assumed, of a room by day",
            "assumed: cameras of 640 x 480 at 30 Hz of its time took 28 to 31 ms (Ringaby and Forssen, 2012)",
        ),
    ),
    CameraDevice(
        "phone",
        "Phone",
        "the camera of a telephone, held across, without stabilisation",
        Intrinsics(1280, 720, 1084.4, 1082.4, 643.308, 354.322),
        {"k1": 0.0366, "k2": 0.0803, "p1": 0.000215, "p2": 0.000783},
        {
            "rolling_shutter": {"readout_ms": 23.8},
            **_glass(0.2, 0.2),
            "sensor_noise": _sensor(1.22, back_illuminated=True, gain_db=6.0),
        },
        _sources(
            "ADVIO's calibration of an iPhone 6s (iphone-03), turned from upright to across",
            "1.22 um pitch: of the iPhone 6s, from memory; 10 bits and gain assumed",
            "the driver of a Xiaomi Mi 8 says 23.85 ms (mobile-ar-sensor-logger, thread 12); that of the iPhone 6s is "
            "not published, the iPhone 4's was 32 ms (Ringaby and Forssen, 2012)",
        ),
    ),
    CameraDevice(
        "action_camera",
        "Action Camera",
        "a wide camera that is worn, without stabilisation: GoPro's HERO10",
        Intrinsics(1920, 1080, 898.16, 898.611, 959.436, 531.336),
        {
            "model": "equidistant",
            "k1": 0.034213889574,
            "k2": 0.067673207654,
            "k3": -0.074089699970,
            "k4": 0.029944425249,
        },
        {
            "rolling_shutter": {"readout_ms": 17.0},
            **_glass(0.4, 0.8),
            "sensor_noise": _sensor(1.12, back_illuminated=True, gain_db=6.0),
        },
        _sources(
            "gyroflow's lens profile of the HERO10 Black, wide, 3840 x 2160 without stabilisation, halved",
            "1.12 um pitch, from memory; 10 bits and gain assumed",
            "the HERO8 Black's in OpenDroneMap's table of readout times; the HERO10's is not there",
        ),
    ),
    CameraDevice(
        "webcam",
        "Webcam",
        "a cheap camera on a screen: Logitech's C270",
        Intrinsics(640, 480, 822.317, 822.317, 319.495, 242.502),
        {"k1": -0.0449369, "k2": 1.17277, "k3": -3.63244},
        {
            "rolling_shutter": {"readout_ms": 30.0},
            **_glass(0.45, 0.8),
            "sensor_noise": _sensor(2.8, back_illuminated=False, gain_db=18.0, exposure_ms=30.0, bits=8),
        },
        _sources(
            "the calibration of the C270 that comes with the kit of the FIRST Tech Challenge",
            "2.8 um pitch: parallel-ml's list of webcams; 8 bits and gain assumed, of a room in the evening",
            "assumed: cameras of 640 x 480 at 30 Hz took 28 to 31 ms (Ringaby and Forssen, 2012)",
        ),
    ),
)

DOOR = Door("noisy_world.cameras", "camera", "CAMERA", (CameraDevice,), _problem)

CAMERA_DEVICES = Registry(DOOR, __package__, listed=_OURS)
"""The cameras, by the names that presets have for them."""


# `camera: {device: NAME}`: a real camera's intrinsics and lens, written out as the keys that they stand for.


_SIZE = ("width", "height")
_FOCUS = ("fx", "fy", "cx", "cy")


def with_device(document: dict[str, Any], place: ConfigPath) -> dict[str, Any]:
    """Return a preset's document with what its camera's device stands for in its stead; what is given stays.

    With another size than the device's own, focal lengths and principal point are scaled. Raises InputError.
    """
    camera = document.get("camera")
    if not isinstance(camera, Mapping) or camera.get("device") is None:
        return document
    device = device_named(camera["device"], place.at("camera").at("device"))
    return {**document, "camera": in_place_of_device(camera, device, place.at("camera"))}


def in_place_of_device(camera: Mapping[str, Any], device: CameraDevice, place: ConfigPath) -> dict[str, Any]:
    """Return the keys of a preset's `camera` with those of a device in its stead. Raises InputError."""
    given = {
        name: value
        for name, value in camera.items()
        if name != "device" and (value is not None or name == "distortion")
    }
    return {**_sized(device, given, place), **given}


def device_named(name: object, place: ConfigPath) -> CameraDevice:
    """Return the camera of a name. Raises InputError for another."""
    if not isinstance(name, str):
        raise place.error(f"is {describe(name)}, but has to be one of {', '.join(CAMERA_DEVICES)}")
    if name not in CAMERA_DEVICES:
        raise unknown_name(place, "camera", name, list(CAMERA_DEVICES))
    return CAMERA_DEVICES[name]


def _sized(device: CameraDevice, given: Mapping[str, Any], place: ConfigPath) -> dict[str, Any]:
    """Return the keys of a device at the size that is given."""
    own = device.camera
    sizes = {name: given[name] for name in _SIZE if name in given}
    if not sizes or all(name in given for name in _FOCUS):
        return own
    if not all(type(value) is int and value >= 1 for value in sizes.values()):
        return own  # which is refused where keys are checked
    scale = sizes["width"] / own["width"] if "width" in sizes else sizes["height"] / own["height"]
    size = {name: sizes.get(name, max(1, round(own[name] * scale))) for name in _SIZE}
    if abs(size["height"] - own["height"] * scale) >= 1:
        problem = (
            f"is {size['width']} x {size['height']}, another shape than the device's {own['width']} x {own['height']}"
        )
        raise place.error(problem, "give width alone, or fx, fy, cx and cy too")
    across, down = (size[name] / own[name] for name in _SIZE)
    focus = {"fx": own["fx"] * across, "fy": own["fy"] * down}
    return own | size | focus | {"cx": (own["cx"] + 0.5) * across - 0.5, "cy": (own["cy"] + 0.5) * down - 0.5}
