# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog: uneven haze that lifts the dark and takes contrast."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.perturbation import Frame, Perturbation
from ..core.schema import key
from ._patterns import kept_for_sequence, three_channels, torus_window

_LEAST_CELLS = 256
_VISIBLE = 0.5 / 255


@dataclass(frozen=True)
class Fog:
    """(image + thickness * haze) * m / (m + thickness), with m the frame's brightest value, as ImageNet-C.

    The haze is a plasma fractal in [0, 1] of its own for each frame; `uniform` is the paper's text, a constant grey.
    """

    thickness: float = key("how much haze is added, of full scale", default=2.5, minimum=0, maximum=20)
    smoothness: float = key(
        "how much weaker the haze gets from one scale to the next finer, squared", default=1.7, minimum=1, maximum=10
    )
    uniform: bool = key("the same grey everywhere instead of the plasma", default=False)
    flow_px: float = key(
        "drift: how far the haze flows a frame, to the right", default=3.0, unit="px", minimum=-1000, maximum=1000
    )


def apply(rgb: NDArray[np.float32], parameters: Fog, frame: Frame) -> NDArray[np.float32]:
    """Put haze over (H, W, 3)."""
    thickness = parameters.thickness
    brightest = float(rgb.max())
    if thickness == 0:
        return rgb.copy()
    scale = np.float32(brightest / (brightest + thickness))
    if parameters.uniform:
        return (rgb + np.float32(0.5 * thickness)) * scale
    haze = three_channels(_haze(rgb.shape[:2], parameters, frame) * np.float32(thickness))
    haze += rgb
    haze *= scale
    return haze


def _haze(size: tuple[int, int], parameters: Fog, frame: Frame) -> NDArray[np.float32]:
    """Return the part of the plasma that the frame shows: its upper left corner, unless it flows."""
    levels = max(math.ceil(math.log2(max(size))), 1)
    plasma = _plasma(frame, _levels_seen(levels, parameters.thickness, parameters.smoothness), parameters.smoothness)
    step = plasma.shape[0] / 2**levels
    moved = -frame.drift_frames * parameters.flow_px * step
    return torus_window(plasma, size, (step, step), (0.0, moved))


def _levels_seen(levels: int, thickness: float, smoothness: float) -> int:
    """Return how many of the plasma's levels change a stored value: what is finer is left to interpolation."""
    strength = thickness / (1 + thickness)
    least = min(levels, int(math.log2(_LEAST_CELLS)))
    seen = sum(strength * smoothness ** (-2 * level) > _VISIBLE for level in range(levels))
    return max(least, seen)


@kept_for_sequence
def _plasma(frame: Frame, levels: int, smoothness: float) -> NDArray[np.float32]:
    """Return a plasma fractal (2^levels, 2^levels) on a torus, scaled to [0, 1]: the diamond-square algorithm.

    Each level halves the distance of the points (Fournier, Fussell, Carpenter, "Computer rendering of stochastic
    models", 1982). A new point is the mean of its four neighbours plus a uniform deviation, smoothness^2 times weaker
    from level to level, because ImageNet-C multiplies its wibble by itself.
    """
    generator = frame.pattern_stream()
    field = np.zeros((1, 1), dtype=np.float32)
    for level in range(levels):
        cells = field.shape[0]
        deviation = generator.random((3, cells, cells), dtype=np.float32)
        deviation -= np.float32(0.5)
        deviation *= np.float32(2 * smoothness ** (-2 * level))
        along_rows = field + np.roll(field, -1, axis=1)
        along_columns = field + np.roll(field, -1, axis=0)
        centres = (along_rows + np.roll(along_rows, -1, axis=0)) * np.float32(0.25) + deviation[0]
        finer = np.empty((2 * cells, 2 * cells), dtype=np.float32)
        finer[::2, ::2] = field
        finer[1::2, 1::2] = centres
        finer[::2, 1::2] = (along_rows + centres + np.roll(centres, 1, axis=0)) * np.float32(0.25) + deviation[1]
        finer[1::2, ::2] = (along_columns + centres + np.roll(centres, 1, axis=1)) * np.float32(0.25) + deviation[2]
        field = finer
    field -= field.min()
    field /= field.max()
    field.flags.writeable = False
    return field


PERTURBATION = Perturbation(
    name="fog",
    label="Fog",
    category="environment",
    parameters=Fog,
    severities={"thickness": (1.5, 2.0, 2.5, 2.5, 3.0), "smoothness": (2.0, 2.0, 1.7, 1.5, 1.4)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"; the plasma: ImageNet-C',
    apply=apply,
    temporals=("fresh", "fixed", "drift"),
)
