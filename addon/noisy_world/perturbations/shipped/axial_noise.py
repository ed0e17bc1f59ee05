# SPDX-License-Identifier: GPL-3.0-or-later
"""Measured laws of a depth sensor's noise: along the ray by distance and incidence, and sideways."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.schema import Choice, key
from ..kinds import About, DepthPerturbation, FrameContext
from ._arrays import without_void
from ._depth_devices import (
    DEVICE_TOOLTIPS,
    NOISE_SEVERITIES,
    Devices,
    camera_of,
    cosine_of_incidence,
    dim,
    drop_blind,
    filled,
    noise_of_device,
    of_device,
    shared_errors,
    sharing,
)
from ._noise import CODES, SharedNoise, drawn, look_up, scaled

STEEP_RAD = np.pi / 3  # from which on the law has a term of incidence
STEEPEST_RAD = np.radians(80.0)  # from which on it stays: it was measured so far (from memory)
LARGEST_PX = 8.0  # of the sideways error, which the law has grow without bound towards a right angle; chosen


@dataclass(frozen=True)
class AxialNoise:
    """Normal noise of depth and of place.

    Along the axis its deviation at depth z and incidence a is offset + linear (z - from) + quadratic (z - from)^2, and
    beyond 60 degrees also steep / sqrt(z) (a / (90 - a))^2, with no more than 80 degrees. Sideways, in pixels, it is
    lateral + lateral_steep a / (90 - a). Where `least_light` says so, what gives too little light is lost, as
    structured_light says it.
    """

    device: Literal["nguyen_2012", "khoshelham_2012", "azure_kinect", "kinect_v1_law"] = key(
        "the measured law whose values are taken",
        default="nguyen_2012",
        choices={
            "nguyen_2012": Choice("Nguyen", "The first Kinect, as Nguyen and others measured it"),
            "khoshelham_2012": Choice("Khoshelham", "The first Kinect, as Khoshelham measured it"),
            "azure_kinect": Choice("Azure Kinect", "Microsoft's time-of-flight camera, by a law of two numbers"),
            "kinect_v1_law": Choice("Kinect, Measured", "A first Kinect as its own frames say: noise in patches"),
        },
    )
    noise: float = noise_of_device()
    from_m: float = of_device("depth from which on noise grows", 1000, "m")
    offset_m: float = of_device("deviation there", 10, "m")
    linear: float = of_device("what a metre adds to it, in metres", 10)
    quadratic_per_m: float = of_device("what a square metre adds to it, in metres", 10, "1/m")
    steep: float = of_device("factor of the term beyond 60 degrees of incidence, in m^1.5", 10)
    lateral_px: float = of_device("deviation of the place that a pixel shows, on a surface seen head on", 8, "px")
    lateral_steep_px: float = of_device("what incidence adds to it", 8, "px")
    correlation_px: float = sharing("correlation_px")
    correlation_frames: int = sharing("correlation_frames")
    correlation_share: float = sharing("correlation_share")
    least_light: float = sharing("least_light")
    reflectance_spread: float = sharing("reflectance_spread")
    clump_px: float = sharing("clump_px")
    clump_frames: int = sharing("clump_frames")
    blind_px: float = sharing("blind_px")
    blind_left_px: float = sharing("blind_left_px")
    blind_top_px: float = sharing("blind_top_px")
    blind_bottom_px: float = sharing("blind_bottom_px")
    TOOLTIPS: ClassVar[Mapping[str, str]] = DEVICE_TOOLTIPS | {
        "from_m": "Higher: noise begins to grow further away",
        "offset_m": "Higher: everything gets rougher by the same",
        "linear": "Higher: what is far gets rougher",
        "quadratic_per_m": "Higher: what is far gets much rougher",
        "steep": "Higher: surfaces seen at a glancing angle get rougher",
        "lateral_px": "Higher: edges get more ragged",
        "lateral_steep_px": "Higher: edges of surfaces seen at an angle get more ragged",
    }


# Nguyen, Izadi and Lovell, Modeling Kinect sensor noise, 2012; Khoshelham and Elberink, Accuracy and resolution of
# Kinect depth data, 2012: 1.425e-6 z^2 mm, nothing sideways; the Azure Kinect's as BlenderProc has it.
_STRAIGHT = {"linear": 0.0, "quadratic_per_m": 0.0, "steep": 0.0, "lateral_px": 0.0, "lateral_steep_px": 0.0}
DEVICES: Devices = {
    "nguyen_2012": {
        "from_m": 0.4,
        "offset_m": 0.0012,
        "linear": 0.0,
        "quadratic_per_m": 0.0019,
        "steep": 0.0001,
        "lateral_px": 0.8,
        "lateral_steep_px": 0.035,
    },
    "khoshelham_2012": _STRAIGHT | {"from_m": 0.0, "offset_m": 0.0, "quadratic_per_m": 1.425e-3},
    # All of a first Kinect's error, rounding too, of which a part is each pixel's own: docs/sensors.md.
    "kinect_v1_law": _STRAIGHT
    | {"from_m": 0.0, "offset_m": 0.0002, "quadratic_per_m": 1.38e-3}
    | {"correlation_px": 4.0, "correlation_frames": 6, "correlation_share": 0.62},
    "azure_kinect": _STRAIGHT | {"from_m": 0.5, "offset_m": 0.0005, "linear": 0.001, "lateral_px": 0.25},
}


def apply(depth_m: NDArray[np.float32], parameters: AxialNoise, context: FrameContext) -> NDArray[np.float32]:
    """Add the noise to (H, W) metres; needs the context's intrinsics for what depends on incidence."""
    own = filled(parameters, DEVICES)
    depth, valid = without_void(depth_m)
    angles = None
    if own.steep > 0 or own.lateral_steep_px > 0:
        angles = _codes_of_incidence(depth, camera_of(context, "axial_noise"))
    if (own.lateral_px > 0 or own.lateral_steep_px > 0) and own.noise > 0:
        depth = _moved(depth, own, angles, context)
        valid &= depth > 0
    sigma = _sigma_m(depth, own, angles)
    (draws,) = drawn(context, "axial", depth_m.shape, shared_errors(own))
    sigma *= scaled(draws, own.noise)
    depth += sigma
    valid &= depth > 0
    if own.least_light > 0:
        valid &= ~dim(depth_m, own, context, camera_of(context, "axial_noise"))
    drop_blind(depth, own)
    return np.where(valid, depth, np.float32(0))


def _sigma_m(depth_m: NDArray[np.float32], own: AxialNoise, angles: NDArray[np.uint16] | None) -> NDArray[np.float32]:
    beyond: NDArray[np.float32] = depth_m - np.float32(own.from_m)
    sigma: NDArray[np.float32] = np.square(beyond)
    sigma *= np.float32(own.quadratic_per_m)
    if own.linear > 0:
        sigma += np.maximum(beyond, 0) * np.float32(own.linear)
    sigma += np.float32(own.offset_m)
    if own.steep > 0 and angles is not None:
        oblique = angles < round(np.cos(STEEP_RAD) * (CODES - 1))
        ratio = np.minimum(_angle_ratios()[angles[oblique]], np.float32(STEEPEST_RAD / (np.pi / 2 - STEEPEST_RAD)))
        near = np.maximum(depth_m[oblique], np.float32(1e-3))  # void has no depth to take the root of
        sigma[oblique] += np.float32(own.steep) * ratio * ratio / np.sqrt(near)
    return sigma


def _moved(
    depth_m: NDArray[np.float32], own: AxialNoise, angles: NDArray[np.uint16] | None, context: FrameContext
) -> NDArray[np.float32]:
    """Return (H, W): each pixel's depth from a place near it."""
    places: list[NDArray[np.int32]] = []
    reach = None
    if own.lateral_steep_px > 0 and angles is not None:
        reach = look_up(angles, _lateral(own.lateral_px * own.noise, own.lateral_steep_px * own.noise))
    draws = drawn(context, "lateral", depth_m.shape, SharedNoise(own.correlation_px), count=2)
    for axis, side in enumerate(depth_m.shape):
        off = scaled(draws[axis], own.lateral_px * own.noise if reach is None else 1.0)
        if reach is not None:
            off *= reach
        np.rint(off, out=off)
        off += np.arange(side, dtype=np.float32).reshape((-1, 1) if axis == 0 else (1, -1))
        np.clip(off, 0, side - 1, out=off)
        places.append(off.astype(np.int32))
    rows, columns = places
    rows *= np.int32(depth_m.shape[1])
    rows += columns
    return depth_m.reshape(-1).take(rows)


def _codes_of_incidence(depth_m: NDArray[np.float32], camera: Intrinsics) -> NDArray[np.uint16]:
    """Return (H, W): the cosine of incidence in steps of 1 / 65535."""
    cosine = cosine_of_incidence(depth_m, camera)
    cosine *= np.float32(CODES - 1)
    return cosine.astype(np.uint16)


@lru_cache(maxsize=1)
def _angle_ratios() -> NDArray[np.float32]:
    """Return (CODES,): a / (90 degrees - a) of the angle whose cosine is in the middle of each step."""
    angle = np.arccos((np.arange(CODES) + 0.5) / CODES)
    return (angle / (np.pi / 2 - angle)).astype(np.float32)


@lru_cache(maxsize=8)
def _lateral(level_px: float, steep_px: float) -> NDArray[np.float32]:
    return np.minimum(level_px + steep_px * _angle_ratios(), max(LARGEST_PX, level_px)).astype(np.float32)


PERTURBATION = DepthPerturbation(
    name="axial_noise",
    label="Depth sensor: axial and lateral noise",
    order=2,
    parameters=AxialNoise,
    severities={"noise": NOISE_SEVERITIES},
    source="our own: the measured errors, halved and doubled; the laws: Nguyen, Izadi and Lovell, 2012, and others",
    about=About(
        "Roughens depth with distance and makes edges ragged, as measured on depth cameras",
        "[measured laws](sensors.md) of a sensor's noise, by distance and incidence, and sideways",
        caption="Nguyen's law of the first Kinect. Of all sensors the strengths are a quarter of the device's own "
        "random errors, these, and four times these.",
        picture="Noise of a measured law at a quarter, once and four times the device's",
    ),
    apply=apply,
    temporals=("fresh", "fixed"),
    grain=True,
    version=2,  # its term of incidence ends at 80 degrees
)
