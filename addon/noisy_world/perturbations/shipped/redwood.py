# SPDX-License-Identifier: GPL-3.0-or-later
"""Redwood's model of the first Kinect, as Open3D and Habitat have it, with a table of distortion if one is given."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.file_access import read_text
from ...core.schema import Choice, key
from ..kinds import About, DepthPerturbation, FrameContext
from ._arrays import quotient, without_void
from ._depth_devices import (
    DEVICE_TOOLTIPS,
    NOISE_SEVERITIES,
    Devices,
    filled,
    noise_of_device,
    of_device,
    shared_errors,
    sharing,
)
from ._noise import SharedNoise, drawn, scaled, shifted_places, taken

# The table by which Redwood's simulator warps depth: over the image and at five distances, in a text file.
#
# The format is that of redwood-data.org's dist-model.txt, which Open3D reads: five lines of head, comments after %,
# then for each of 80 x 80 cells, row by row, 3 numbers that do not count, 5 of how often it was measured, 10 that do
# not count, and 5 factors, at 1, 3, 5, 7 and 9 m. A cell that was nowhere measured 8000 times has no depth.


CELLS, DISTANCES = 80, 5
HEAD, NUMBERS = 5, 23  # lines; numbers of a cell
MEASURED, FACTORS = slice(3, 8), slice(18, 23)
LEAST = 8000.0  # measurements
WIDTH_PX, HEIGHT_PX = 640, 480  # of the image that the table was measured in
NOTHING = 1e-5  # a factor that gives no depth


def warp_table(path: Path) -> NDArray[np.float32]:
    """Return the factors (80, 80, 5) of a file, 0 where a cell has no depth; it is kept while the file stays.

    Raises OSError where it cannot be read, and ValueError, with what is wrong, where it is no such table.
    """
    status = path.stat()
    return _read(str(path), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=4)
def _read(path: str, _changed_ns: int, _size: int) -> NDArray[np.float32]:
    try:
        lines = read_text(path).splitlines()[HEAD:]
    except UnicodeDecodeError as error:
        raise ValueError("is no text") from error
    wanted = f"after {HEAD} lines a table has {CELLS * CELLS * NUMBERS} numbers"
    words = " ".join(line.partition("%")[0] for line in lines).split()
    if len(words) != CELLS * CELLS * NUMBERS:
        raise ValueError(f"holds {len(words)} words, but {wanted}")
    try:
        values = np.array(words, np.float64)
    except ValueError as error:
        raise ValueError(f"holds something else than numbers, but {wanted}") from error
    if not np.isfinite(values).all():
        raise ValueError("holds numbers that are not finite")
    cells = values.reshape(CELLS, CELLS, NUMBERS)
    known = (cells[..., MEASURED] >= LEAST).any(axis=-1, keepdims=True)
    table = np.where(known, cells[..., FACTORS], 0.0).astype(np.float32)
    table.setflags(write=False)
    return table


def warped(
    table: NDArray[np.float32], depth_m: NDArray[np.float32], rows: NDArray[np.int32], columns: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Return depth (H, W) over the table's factor at the places (H, W) of the image, 0 where there is none.

    The factor is interpolated between the distances; an image of another size than the table's is taken for it scaled.
    """
    height, width = depth_m.shape
    cell = tuple(
        (np.rint(place * ((size - 1) / max(side - 1, 1))).astype(np.int32)) // (size // CELLS)
        for place, side, size in ((rows, height, HEIGHT_PX), (columns, width, WIDTH_PX))
    )
    after = ((depth_m + np.float32(1)) / np.float32(2)).astype(np.int32)
    part = (depth_m - (2 * after - 1).astype(np.float32)) / np.float32(2)
    near, far = (table[(*cell, np.clip(index, 0, DISTANCES - 1))] for index in (after - 1, after))
    factor = (np.float32(1) - part) * near + part * far
    return np.divide(depth_m, factor, out=np.zeros_like(depth_m), where=factor > NOTHING)


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
    correlation_px: float = sharing("correlation_px")
    correlation_frames: int = sharing("correlation_frames")
    correlation_share: float = sharing("correlation_share")
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
    shared = shared_errors(own)
    shift_px = own.shift_px * own.noise
    if shift_px > 0:
        down, right = drawn(context, "place", depth_m.shape, SharedNoise(shared.px), count=2)
        rows, columns = shifted_places(down, right, shift_px)
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
        (draws,) = drawn(context, "disparity", depth_m.shape, shared)
        steps += scaled(draws, own.sigma_px * own.noise / own.step_px)
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
