# SPDX-License-Identifier: GPL-3.0-or-later
"""A spinning lidar: rows of beams, of which a depth image keeps the pixels that one of them meets."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
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
    filled,
    noise_of_device,
    of_device,
    range_contradiction,
)


@dataclass(frozen=True)
class Lidar:
    """Beams at even elevations spin about the image's vertical; each measures the range of the pixel that it meets.

    The spin's angle is drawn anew for each frame: it is not locked to the camera. Lost is what returns too little
    light, in proportion to the cosine of incidence over the square of range, and what is out of range. All beams of a
    frame see the scene at its time stamp. Not modelled: the beam's width, several returns, colour, rain.
    """

    device: Literal["velodyne_vlp16", "velodyne_hdl32e"] = key(
        "the lidar whose values are taken",
        default="velodyne_vlp16",
        choices={
            "velodyne_vlp16": Choice("Velodyne VLP-16", "16 rows of beams"),
            "velodyne_hdl32e": Choice("Velodyne HDL-32E", "32 rows of beams"),
        },
    )
    noise: float = noise_of_device()
    rows: int = key("number of beams above each other; below 0: the device's", default=-1, minimum=-1, maximum=2048)
    below_deg: float = of_device("how far below the horizon the lowest beam is", 89, "deg")
    above_deg: float = of_device("how far above the horizon the highest beam is", 89, "deg")
    azimuth_step_deg: float = of_device("turn from one measurement to the next", 10, "deg")
    sigma_m: float = of_device("standard deviation of range", 10, "m")
    step_m: float = of_device("what range is rounded to; 0: not", 10, "m")
    min_m: float = of_device("nearest range that is given", 1000, "m", slider=(0, 2))
    max_m: float = of_device("range at which a surface seen head on is just given", 1000, "m", slider=(0.5, 20))
    TOOLTIPS: ClassVar[Mapping[str, str]] = DEVICE_TOOLTIPS | {
        "rows": "Higher: more rows of points",
        "below_deg": "Higher: rows reach further down",
        "above_deg": "Higher: rows reach further up",
        "azimuth_step_deg": "Higher: fewer points in a row",
        "sigma_m": "Higher: surfaces get rougher, at any distance",
        "step_m": "Higher: ranges are in larger steps",
    }


# At 600 turns a minute. From memory of Velodyne's manuals, 63-9243 and 63-9113, not held against them; their accuracy,
# 3 and 2 cm, is taken for a deviation, which is a guess, like min_m.
DEVICES: Devices = {
    "velodyne_vlp16": {
        "rows": 16,
        "below_deg": 15.0,
        "above_deg": 15.0,
        "azimuth_step_deg": 0.2,
        "sigma_m": 0.03,
        "step_m": 0.002,
        "min_m": 0.5,
        "max_m": 100.0,
    },
    "velodyne_hdl32e": {
        "rows": 32,
        "below_deg": 30.67,
        "above_deg": 10.67,
        "azimuth_step_deg": 0.166,
        "sigma_m": 0.02,
        "step_m": 0.002,
        "min_m": 0.5,
        "max_m": 100.0,
    },
}


def apply(depth_m: NDArray[np.float32], parameters: Lidar, context: FrameContext) -> NDArray[np.float32]:
    """Measure (H, W) metres; needs the context's intrinsics. Pixels that no beam meets are void."""
    camera = camera_of(context, "lidar")
    own = filled(parameters, DEVICES)
    depth, valid = without_void(depth_m)
    generator = context.pattern_stream("beams")
    row, column = met_pixels(camera, own, float(generator.random()))
    row, column = _once(row, column, depth.shape[1])
    ray = np.stack([(column - camera.cx_px) / camera.fx_px, (row - camera.cy_px) / camera.fy_px, np.ones(row.size)])
    length = np.sqrt(np.sum(ray * ray, axis=0))
    cosine = np.ones(row.size)
    if own.max_m > 0:
        cosine = cosine_of_incidence(depth, camera)[row, column].astype(np.float64)
    range_m = np.where(valid[row, column], depth[row, column] * length, 0)
    measured_m = returned(range_m, cosine, own, generator)
    kept = measured_m > 0
    found = np.zeros_like(depth)
    found[row[kept], column[kept]] = (measured_m / length)[kept]
    return found


def returned(
    range_m: NDArray[np.float64], cosine: NDArray[np.float64], own: Lidar, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return the ranges that are measured, of any shape, 0 where too little light comes back.

    range_m: exact, 0 for nothing. cosine: of incidence. own: with the device's values.
    """
    kept = (range_m > 0) & (range_m >= own.min_m)
    if own.max_m > 0:
        kept &= range_m <= own.max_m * np.sqrt(cosine)
    measured_m = range_m + own.sigma_m * own.noise * generator.standard_normal(range_m.shape)
    if own.step_m > 0:
        measured_m = np.rint(measured_m / own.step_m) * own.step_m
    return np.where(kept & (measured_m > 0), measured_m, 0.0)


def met_pixels(camera: Intrinsics, own: Lidar, turn: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns (N,) of the pixels that beams meet, nearest to each beam.

    own: with the device's values. turn: of 0 to 1, how far the spin is into a step at azimuth 0.
    """
    step = math.radians(max(own.azimuth_step_deg, 1e-3))
    count = math.ceil(math.pi / 2 / step)
    azimuth = (np.arange(-count, count + 1) + turn) * step
    azimuth = azimuth[np.abs(azimuth) < math.pi / 2 - 1e-6]
    elevation = np.radians(np.linspace(-own.below_deg, own.above_deg, max(own.rows, 1)))
    x = np.broadcast_to(np.tan(azimuth), (elevation.size, azimuth.size))
    y = -np.tan(elevation)[:, None] / np.cos(azimuth)
    column = np.rint(x * camera.fx_px + camera.cx_px)
    row = np.rint(y * camera.fy_px + camera.cy_px)
    inside = (column >= 0) & (column < camera.width_px) & (row >= 0) & (row < camera.height_px)
    return row[inside].astype(np.intp), column[inside].astype(np.intp)


def _once(row: NDArray[np.intp], column: NDArray[np.intp], width: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return each pixel once: where beams are closer than pixels, one of them is kept."""
    places = np.unique(row * width + column)
    return places // width, places % width


PERTURBATION = DepthPerturbation(
    name="lidar",
    label="Depth sensor: spinning lidar",
    order=2,
    parameters=Lidar,
    severities={"noise": NOISE_SEVERITIES},
    source="our own: the device's errors, halved and doubled; beams and ranges: from memory of Velodyne's manuals",
    about=About(
        "Leaves the ranges of a spinning lidar's beams, and no depth between them",
        "rows of beams that spin",
        caption="what sixteen rows of beams meet.",
        picture="Rows of lidar points at a quarter, once and four times the device's noise",
    ),
    apply=apply,
    contradiction=range_contradiction(DEVICES),
    temporals=("fresh", "fixed"),
    grain=True,
)
