# SPDX-License-Identifier: GPL-3.0-or-later
"""A time-of-flight camera: the phase of modulated light, summed over what a pixel sees, from four noisy samples."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.schema import Choice, key
from ...core.srgb import decoded
from ..kinds import About, DepthPerturbation, FrameContext
from ._arrays import quotient, without_void
from ._depth_devices import (
    DEVICE_TOOLTIPS,
    NOISE_SEVERITIES,
    TINY,
    Devices,
    camera_of,
    cosine_of_incidence,
    filled,
    noise_of_device,
    of_device,
    range_contradiction,
    shared_errors,
    sharing,
    smaller,
)
from ._noise import drawn, scaled

# Light that reaches a surface by one bounce off others: what makes a time of flight camera's corners too deep.
#
# An approximation. Other surfaces are those of the frame alone, in patches of some pixels whose normals are their
# middle pixel's; surfaces are matt, hide nothing from one another, and reflect once. Between patches light goes as
# between a point and a disc (Siegel and Howell, Thermal Radiation Heat Transfer: cos cos A / (pi d^2 + A)), and
# between their middles the result is interpolated.


COLUMNS = 40  # of patches; chosen: two patches from a corner within 2 % of an integral, in 60 ms
PAIRS_AT_ONCE = 1 << 15  # whose arrays stay in the processor's cache


@dataclass(frozen=True, eq=False)
class _Patches:
    """Patches of an image. places_m, towards: (N, 3) of their middles and of their normals, towards the camera.

    share: (N,) albedo times solid angle, steradians. range_m, area_m2: (N,).
    """

    places_m: NDArray[np.float32]
    towards: NDArray[np.float32]
    share: NDArray[np.float32]
    range_m: NDArray[np.float32]
    area_m2: NDArray[np.float32]


def by_one_bounce(
    depth_m: NDArray[np.float32], albedo: NDArray[np.float32], camera: Intrinsics, turn_m: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return real and imaginary part (H, W) of the phasor of light by one bounce, and its amount.

    depth_m: (H, W), 0 = void. albedo: (H, W). turn_m: the range of a whole turn. In units of the light that a white
    surface gives back at 1 m, seen head on; of a white surface, so times a pixel's own albedo.
    """
    import cv2

    height, width = depth_m.shape
    step = max(math.ceil(width / COLUMNS), 2)
    rows, columns = (np.arange(step // 2, size, step) for size in (height, width))
    if len(rows) < 1 or len(columns) < 1:
        nothing = np.zeros_like(depth_m)
        return nothing, nothing, nothing
    patches = _patches(depth_m, albedo, camera, (rows, columns), step)
    found = np.zeros((len(patches.range_m), 3), np.float32)
    size = max(PAIRS_AT_ONCE // len(found), 1)
    for first in range(0, len(found), size):
        at = slice(first, first + size)
        found[at] = _received(patches, at, turn_m)
    grid = found.reshape(len(rows), len(columns), 3)
    # Pixel x lies between the middles step / 2, 3 step / 2, ...
    u = ((np.arange(width) - step // 2) / step).astype(np.float32)
    v = ((np.arange(height) - step // 2) / step).astype(np.float32)
    maps = np.meshgrid(u, v)
    smooth = cv2.remap(grid, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    real, imaginary, amount = (np.asarray(smooth[..., part], np.float32) for part in range(3))
    x = (np.arange(width) - camera.cx_px) / camera.fx_px
    y = (np.arange(height) - camera.cy_px)[:, None] / camera.fy_px
    phase = (depth_m * np.sqrt(1 + x * x + y * y) * (math.pi / turn_m)).astype(np.float32)
    cosine, sine = np.cos(phase), np.sin(phase)
    return real * cosine - imaginary * sine, real * sine + imaginary * cosine, amount


def _received(patches: _Patches, at: slice, turn_m: float) -> NDArray[np.float32]:
    """Return (n, 3) of some patches: real, imaginary part and amount of what they get, without their own way back."""
    places_m, towards = patches.places_m, patches.towards
    across, down, ahead = (places_m[None, :, axis] - places_m[at, None, axis] for axis in range(3))
    square = across * across + down * down + ahead * ahead
    leaving = across * towards[:, 0] + down * towards[:, 1] + ahead * towards[:, 2]
    coming = across * towards[at, None, 0] + down * towards[at, None, 1] + ahead * towards[at, None, 2]
    weight = patches.share * np.maximum(-leaving, 0) * np.maximum(coming, 0)
    weight /= (np.float32(math.pi) * square + patches.area_m2) * square + np.float32(TINY)
    phase = (patches.range_m + np.sqrt(square)) * np.float32(math.pi / turn_m)
    return np.stack([part.sum(axis=1) for part in (weight * np.cos(phase), weight * np.sin(phase), weight)], axis=-1)


def _patches(
    depth_m: NDArray[np.float32],
    albedo: NDArray[np.float32],
    camera: Intrinsics,
    grid: tuple[NDArray[np.intp], NDArray[np.intp]],
    step: int,
) -> _Patches:
    inverse = np.divide(1.0, depth_m, out=np.zeros(depth_m.shape), where=depth_m > 0)
    padded = np.pad(inverse, 1)
    row, column = (part.ravel() + 1 for part in np.meshgrid(*grid, indexing="ij"))
    here = padded[row, column]
    right = smaller(padded[row, column + 1] - here, here - padded[row, column - 1])
    down = smaller(padded[row + 1, column] - here, here - padded[row - 1, column])
    x, y = column - 1 - camera.cx_px, row - 1 - camera.cy_px
    normal = np.stack([right * camera.fx_px, down * camera.fy_px, here - x * right - y * down], axis=-1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + TINY
    ray = np.stack([x / camera.fx_px, y / camera.fy_px, np.ones(len(x))], axis=-1)
    length = np.linalg.norm(ray, axis=1)
    z_m = np.divide(1.0, here, out=np.zeros_like(here), where=here > 0)
    solid = (step * step) / (camera.fx_px * camera.fy_px * length**3) * (here > 0)
    facing = np.maximum(np.einsum("nk,nk->n", normal, ray) / length, 1e-2)
    range_m = z_m * length
    share = albedo[row - 1, column - 1] * solid
    made = (ray * z_m[:, None], -normal, share, range_m, solid * range_m**2 / facing)
    return _Patches(*(values.astype(np.float32) for values in made))


SPEED_OF_LIGHT_M_S = 299_792_458.0


@dataclass(frozen=True)
class TimeOfFlight:
    """Range is c phase / (4 pi f), of the argument of a sum of phasors: a pixel on an edge shows what is not there.

    The light of a surface goes with its albedo, here the colour's luminance, with the cosine of incidence and with the
    inverse square of its range. A pixel's phasor is its own and a share of its neighbours'. Four samples of n electrons
    each, with their shot noise and the read noise, give the phase; further frequencies tell whole turns up to
    `unambiguous_m`, beyond which range begins again at 0. Lost is what is too dark, too bright, out of range, or beside
    a jump of depth. `multipath` adds light that comes by one bounce off other surfaces of the image, which makes
    corners deeper: an approximation in patches, and none by default. Not modelled: further bounces, motion between the
    samples, the lens's scattering.
    """

    device: Literal["azure_kinect_nfov", "azure_kinect_nfov_binned", "azure_kinect_wfov"] = key(
        "the camera and mode whose values are taken",
        default="azure_kinect_nfov",
        choices={
            "azure_kinect_nfov": Choice("Azure Kinect, Narrow", "Its narrow field of view"),
            "azure_kinect_nfov_binned": Choice("Azure Kinect, Narrow, Binned", "Narrow, two by two pixels in one"),
            "azure_kinect_wfov": Choice("Azure Kinect, Wide", "Its wide field of view"),
        },
    )
    noise: float = noise_of_device()
    frequency_mhz: float = of_device("frequency that the phase is measured at", 10_000, "MHz")
    unambiguous_m: float = of_device("range that further frequencies tell apart, rounded to turns; 0: one", 10_000, "m")
    electrons: float = of_device("of a sample, from a white surface at 1 m, head on", 1e9)
    ambient_electrons: float = of_device("of a sample, from other light", 1e9, label="Ambient")
    read_electrons: float = of_device("standard deviation of reading a sample", 1e6)
    contrast: float = of_device("modulation contrast of the samples", 1)
    least_electrons: float = of_device("least amplitude that is taken for a signal", 1e9)
    most_electrons: float = of_device("what a sample holds; above it nothing is given", 1e9)
    spread: float = of_device("share of a pixel's light that goes to each neighbour beside, above and below it", 0.25)
    jump_m: float = of_device(
        "jump of depth to one of eight neighbours beside which nothing is given; 0: never", 1000, "m"
    )
    multipath: float = key(
        "light by one bounce off other surfaces of the image, times what an approximation gives; 0: none",
        default=0.0,
        minimum=0,
        maximum=10,
    )
    min_m: float = of_device("nearest depth that is given", 1000, "m", slider=(0, 2))
    max_m: float = of_device("farthest depth that is given", 1000, "m", slider=(0.5, 20))
    correlation_px: float = sharing("correlation_px")
    correlation_frames: int = sharing("correlation_frames")
    correlation_share: float = sharing("correlation_share")
    TOOLTIPS: ClassVar[Mapping[str, str]] = DEVICE_TOOLTIPS | {
        "frequency_mhz": "Higher: depth gets better, and begins again at 0 sooner",
        "unambiguous_m": "Lower: what is far comes back as near",
        "electrons": "Higher: less noise, and what is near gets too bright",
        "ambient_electrons": "Higher: more noise, as in sunlight",
        "read_electrons": "Higher: more noise where it is dark or far",
        "contrast": "Higher: less noise",
        "least_electrons": "Higher: more of what is dark or far has no depth",
        "most_electrons": "Lower: more of what is bright and near has no depth",
        "spread": "Higher: more pixels hang in the air between near and far",
        "jump_m": "Lower: wider gaps beside edges; 0: none",
        "multipath": "Higher: corners of rooms get deeper and rounder",
    }


# Ranges: Microsoft, Azure Kinect DK hardware specifications. electrons: so that the deviation on a grey of albedo 0.5
# is 1 mm a metre, as BlenderProc's law; it also has jump_m. All else is a guess.
_AZURE = {"frequency_mhz": 200.0, "unambiguous_m": 15.0, "electrons": 22_400.0, "ambient_electrons": 0.0}
_AZURE |= {"read_electrons": 6.0, "contrast": 0.8, "least_electrons": 40.0, "most_electrons": 100_000.0}
_AZURE |= {"spread": 0.1, "jump_m": 0.8}
DEVICES: Devices = {
    "azure_kinect_nfov": _AZURE | {"min_m": 0.5, "max_m": 3.86},
    "azure_kinect_nfov_binned": _AZURE | {"min_m": 0.5, "max_m": 5.46},
    "azure_kinect_wfov": _AZURE | {"min_m": 0.25, "max_m": 2.21},
}


def apply(depth_m: NDArray[np.float32], parameters: TimeOfFlight, context: FrameContext) -> NDArray[np.float32]:
    """Measure (H, W) metres; needs the context's colour and intrinsics."""
    camera = camera_of(context, "time_of_flight")
    own = filled(parameters, DEVICES)
    depth, valid = without_void(depth_m)
    length = _ray_lengths(camera)
    range_m = depth * length
    electrons = _electrons(depth, range_m, own, camera, context.rgb)
    fine_m = SPEED_OF_LIGHT_M_S / (2e6 * max(own.frequency_mhz, 1e-3))
    phasor: Sequence[NDArray[np.float32]] = _phasor(electrons, range_m, fine_m)
    if own.multipath > 0:
        albedo = _albedo(context.rgb)
        scale = albedo * np.float32(own.electrons * own.multipath)
        *bounced, amount = by_one_bounce(depth, albedo, camera, fine_m)
        phasor = [np.asarray(part + scale * more, np.float32) for part, more in zip(phasor, bounced, strict=True)]
        electrons = np.asarray(electrons + scale * amount, np.float32)
    real, imaginary = (_mixed(part, own.spread) for part in phasor)
    mixed = _mixed(electrons, own.spread)
    deviation = mixed + np.float32(own.ambient_electrons + own.read_electrons**2)
    deviation *= np.float32(own.noise**2 / 2)
    np.sqrt(deviation, out=deviation)
    samples = drawn(context, "samples", depth_m.shape, shared_errors(own), count=2)
    for part, draws in zip((real, imaginary), samples, strict=True):
        np.multiply(part, np.float32(own.contrast), out=part)
        noise = scaled(draws, 1.0)
        noise *= deviation
        np.add(part, noise, out=part)
    found_m = _turned(real, imaginary, fine_m)
    turns = round(own.unambiguous_m / fine_m)
    if turns > 1:
        coarse_m = _coarse(electrons, range_m, own.spread, fine_m, turns * fine_m)
        found_m += np.rint((coarse_m - found_m) * np.float32(1 / fine_m)) * np.float32(fine_m)
        found_m = _begun_again(found_m, turns * fine_m)
    amplitude = real * real + imaginary * imaginary
    valid &= amplitude >= np.float32(own.least_electrons**2)
    valid &= mixed <= np.float32(own.most_electrons - own.ambient_electrons)
    if own.jump_m > 0:
        valid &= ~_beside_jump(depth, own.jump_m)
    found_m /= length
    valid &= (found_m >= np.float32(own.min_m)) & (found_m <= np.float32(own.max_m)) & (found_m > 0)
    return np.where(valid, found_m, np.float32(0))


def _ray_lengths(camera: Intrinsics) -> NDArray[np.float32]:
    """Return (H, W): the length of each ray whose planar depth is 1."""
    x = np.square((np.arange(camera.width_px) - camera.cx_px) / camera.fx_px)
    y = np.square((np.arange(camera.height_px) - camera.cy_px) / camera.fy_px)
    return np.sqrt((x + 1).astype(np.float32) + y.astype(np.float32)[:, None])


def _electrons(
    depth_m: NDArray[np.float32],
    range_m: NDArray[np.float32],
    own: TimeOfFlight,
    camera: Intrinsics,
    rgb: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return (H, W): the mean electrons of a sample of each pixel, from its own surface; 0 where void."""
    found = _albedo(rgb)
    found *= cosine_of_incidence(depth_m, camera)
    found *= np.float32(own.electrons)
    return quotient(found, range_m * range_m, range_m > 0)


def _albedo(rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (H, W): linear luminance of encoded colour (H, W, 3)."""
    import cv2

    grey = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.float32).reshape(rgb.shape[:2])
    return decoded(grey)


def _phasor(
    electrons: NDArray[np.float32], range_m: NDArray[np.float32], turn_m: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return real and imaginary part, of any shape. turn_m: the range of a whole turn."""
    phase = range_m * np.float32(1 / turn_m)
    phase -= np.floor(phase)
    phase *= np.float32(math.tau)
    return np.cos(phase) * electrons, np.sin(phase) * electrons


def _mixed(image: NDArray[np.float32], spread: float) -> NDArray[np.float32]:
    """Return (H, W): of each pixel its own and its share of the neighbours'."""
    import cv2

    kernel = np.array([spread, 1 - 2 * spread, spread], np.float32)
    mixed = cv2.sepFilter2D(image, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(mixed, np.float32).reshape(image.shape)


def _turned(real: NDArray[np.float32], imaginary: NDArray[np.float32], turn_m: float) -> NDArray[np.float32]:
    """Return the range of a phasor's argument, in [0, turn_m)."""
    turns = np.arctan2(imaginary, real)
    turns *= np.float32(1 / math.tau)
    turns -= np.floor(turns)
    turns *= np.float32(turn_m)
    return turns


def _coarse(
    electrons: NDArray[np.float32], range_m: NDArray[np.float32], spread: float, fine_m: float, whole_m: float
) -> NDArray[np.float32]:
    """Return (H, W): the range that a phasor whose turn is whole_m tells, without noise.

    Where ranges are alike, within a part of fine_m, that is the pixel's own.
    """
    coarse_m = _begun_again(range_m, whole_m)
    row, column = np.nonzero(_beside_jump(range_m, fine_m / 8))
    if spread > 0 and row.size:
        real, imaginary = np.zeros(row.size, np.float32), np.zeros(row.size, np.float32)
        for down, right in product((-1, 0, 1), repeat=2):
            at = (row + down).clip(0, range_m.shape[0] - 1), (column + right).clip(0, range_m.shape[1] - 1)
            steps = abs(down) + abs(right)
            share = spread**steps * (1 - 2 * spread) ** (2 - steps)
            x, y = _phasor(electrons[at] * np.float32(share), range_m[at], whole_m)
            real += x
            imaginary += y
        coarse_m[row, column] = _turned(real, imaginary, whole_m)
    return coarse_m


def _begun_again(range_m: NDArray[np.float32], turn_m: float) -> NDArray[np.float32]:
    """Return (H, W): ranges in [0, turn_m)."""
    return range_m - np.floor(range_m * np.float32(1 / turn_m)) * np.float32(turn_m)


def _beside_jump(depth_m: NDArray[np.float32], jump_m: float) -> NDArray[np.bool_]:
    """Return the mask (H, W) of pixels in whose 3 x 3 depths differ by more than this; void is no depth."""
    import cv2

    around = np.ones((3, 3), np.uint8)
    farthest = np.asarray(cv2.dilate(depth_m, around), np.float32).reshape(depth_m.shape)
    known = np.where(depth_m > 0, depth_m, np.float32(1e9))
    nearest = np.asarray(cv2.erode(known, around), np.float32).reshape(depth_m.shape)
    return farthest - nearest > np.float32(jump_m)


PERTURBATION = DepthPerturbation(
    name="time_of_flight",
    label="Depth sensor: time of flight",
    order=2,
    parameters=TimeOfFlight,
    severities={"noise": NOISE_SEVERITIES},
    source="our own: the device's errors, halved and doubled; the law: derived from four samples of a phase",
    about=About(
        "Measures depth by the phase of light: noisy where it is dark, with pixels in the air at edges",
        "the phase of modulated light; needs colour",
        caption="an Azure Kinect in its narrow view.",
        picture="Depth by time of flight at a quarter, once and four times the device's noise",
    ),
    apply=apply,
    contradiction=range_contradiction(DEVICES),
    needs_rgb=True,
    temporals=("fresh", "fixed"),
    grain=True,
)
