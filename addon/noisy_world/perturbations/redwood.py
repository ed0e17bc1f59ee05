# SPDX-License-Identifier: GPL-3.0-or-later
"""Redwood's model of the first Kinect, as Open3D and Habitat have it, with a table of distortion if one is given."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ..core.perturbing.about import About
from ..core.perturbing.kinds import DepthPerturbation, FrameContext
from ..core.schema import Choice, key
from ._depth_device import DEVICE_TOOLTIPS, NOISE_SEVERITIES, Devices, filled, noise_of_device, of_device
from ._quantiles import look_up, scaled_normal, uniform_codes
from ._shifted import shifted_places, taken
from ._void import quotient, without_void
from ._warp_table import warp_table, warped


@dataclass(frozen=True)
class Redwood:
    """A pixel takes the depth of a place near its own, of every second row and column; disparity is noisy and rounded.

    z becomes B / round(B / z + N(0, sigma)) with B = product / step; with `warp` it is divided by the table's factor
    before. With `noise: 0` it is Open3D's deterministic mode.
    """

    device: Literal["choi_2015"] = key(
        "the published values that are taken",
        default="choi_2015",
        choices={
            "choi_2015": Choice("Choi", "The values that were published with the model"),
        },
    )
    noise: float = noise_of_device()
    product_px_m: float = of_device("focal length x baseline", 10_000, "px m")
    step_px: float = of_device("what disparity is rounded to", 8, "px")
    sigma_px: float = of_device("standard deviation of disparity before that", 8, "px")
    shift_px: float = of_device("standard deviation of the place, across and down, that a pixel shows", 8, "px")
    max_m: float = of_device("depth from which on nothing is given", 1000, "m", slider=(0.5, 20))
    warp: str = key("a file with a table of distortion, such as Redwood's dist-model.txt", default="", file=warp_table)
    TOOLTIPS: ClassVar[Mapping[str, str]] = DEVICE_TOOLTIPS | {
        "product_px_m": "Higher: depth gets better",
        "sigma_px": "Higher: far surfaces get rougher",
        "warp": "With a file: flat walls bend, otherwise at each distance, and parts of the image have no depth",
    }


# Choi, Zhou and Koltun, Robust reconstruction of indoor scenes, 2015; the same in Open3D and habitat-sim.
DEVICES: Devices = {
    "choi_2015": {
        "product_px_m": 35.130,
        "step_px": 1 / 8,
        "sigma_px": 0.027778,
        "shift_px": 0.25,
        "max_m": 10.0,
    }
}


def apply(depth_m: NDArray[np.float32], parameters: Redwood, context: FrameContext) -> NDArray[np.float32]:
    """Measure (H, W) metres."""
    own = filled(parameters, DEVICES)
    depth, valid = without_void(depth_m)
    shift_px = own.shift_px * own.noise
    if shift_px > 0:
        rows, columns = shifted_places(context.pattern_stream("place"), depth.shape, shift_px)
    else:
        rows, columns = (np.arange(side, dtype=np.int32) for side in depth.shape)
        rows = np.broadcast_to(rows[:, None], depth.shape)
        columns = np.broadcast_to(columns, depth.shape)
    depth = taken(depth, rows & ~1, columns & ~1)
    valid &= (depth > 0) & (depth < np.float32(own.max_m))
    if parameters.warp:
        depth = warped(warp_table(Path(parameters.warp)), depth, rows, columns)
        valid &= depth > 0
    steps = quotient(own.product_px_m / own.step_px, depth, valid)
    if own.sigma_px * own.noise > 0:
        codes = uniform_codes(context.pattern_stream("disparity"), depth.shape)
        steps += look_up(codes, scaled_normal(own.sigma_px * own.noise / own.step_px))
    np.rint(steps, out=steps)
    valid &= steps > 0
    return quotient(own.product_px_m / own.step_px, steps, valid)


PERTURBATION = DepthPerturbation(
    name="redwood",
    label="Depth sensor: Redwood's Kinect",
    order=2,
    parameters=Redwood,
    severities={"noise": NOISE_SEVERITIES},
    source="our own: the published errors, halved and doubled; the law: Choi, Zhou and Koltun, 2015",
    about=About(
        "Roughens and rounds depth as a Kinect does, by Redwood's model",
        "Redwood's model of the first Kinect",
        caption="the model of Open3D and Habitat.",
        picture="Rounded depth at a quarter, once and four times the published noise",
    ),
    apply=apply,
    temporals=("fresh", "fixed"),
    grain=True,
)
