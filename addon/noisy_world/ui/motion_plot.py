# SPDX-License-Identifier: GPL-3.0-or-later
"""A small picture of what a perturbation of motion does: how it moves and turns the camera in time, and how often.

It perturbs a camera that stands still, by the step's own values and the panel's seed, as the generator would.
"""

from typing import Any

import bpy
import bpy.utils.previews
import numpy as np
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError
from ..core.geometry import rotvec_from_rotation
from ..core.perturbing.execution import move
from ..core.perturbing.kinds import MotionPerturbation
from ..core.perturbing.reading import parse_steps
from ..core.perturbing.steps import steps_of_kind
from ..core.schema import ConfigPath
from ..core.trajectories.trajectory import Trajectory
from ..perturbations import registry
from .document import PANEL, identifiers_of, values_of
from .properties import perturbation_of

FAST, SLOW = (8.0, 4.0, 500.0), (60.0, 60.0, 50.0)
"""Seconds that are perturbed, seconds that are shown, and poses a second: rotors turn 200 times a second."""
SIZE_PX = 384
SCALE = 11.0  # of the picture in the panel; chosen: as wide as the tab
LEAST_HZ, MOST_HZ = 0.5, 250.0
BACK, INK, GRID = (30, 30, 30), (190, 190, 190), (64, 64, 64)
AXES = ((237, 90, 90), (115, 205, 90), (102, 153, 250))  # x, y and z, as Blender colours them
KEPT = 8  # pictures
_loaded: dict[str, Any] = {}


def draw_motion(layout: bpy.types.UILayout, panel: Any, step: Any) -> None:
    """Draw the picture of a step that moves the camera continuously; nothing for any other."""
    perturbation = perturbation_of(step)
    if not isinstance(perturbation, MotionPerturbation) or not perturbation.continuous:
        return
    try:
        icon = _icon(panel, step)
    except NoisyWorldError:  # beside the list stands what is wrong
        return
    if icon:
        layout.template_icon(icon_value=icon, scale=SCALE)


def signals(panel: Any, step: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far a step moves, m, and turns, deg, a camera that stands still: (N, 3) each, as `window_of` says.

    Along and about the camera's x right, y down, z ahead. Raises NoisyWorldError where its values are wrong.
    """
    given = [{step.perturbation: values_of(step)}]
    steps = steps_of_kind(parse_steps(given, ConfigPath(PANEL, "motion"), registry()), MotionPerturbation)
    seconds, _, rate_hz = window_of(step.perturbation)
    count = int(seconds * rate_hz)
    still = Trajectory(np.tile(np.eye(4), (count, 1, 1)), np.arange(count) / rate_hz)
    c2w = move(steps, still, identifiers_of(panel)).c2w
    return c2w[:, :3, 3], np.degrees(rotvec_from_rotation(c2w[:, :3, :3]))


def window_of(perturbation: str) -> tuple[float, float, float]:
    """Return the seconds that are perturbed, those that are shown, and poses a second."""
    return FAST if perturbation == "vibration" else SLOW


def power(values: NDArray[np.float64], rate_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies (F,) in Hz and the power spectral density (F, 3) of signals (N, 3), by a Hann window."""
    window = np.hanning(len(values))[:, None]
    spectrum = np.abs(np.fft.rfft((values - values.mean(axis=0)) * window, axis=0)) ** 2
    return np.fft.rfftfreq(len(values), 1 / rate_hz), 2 * spectrum / (rate_hz * np.sum(window**2))


def picture(
    moved_m: NDArray[np.float64], turned_deg: NDArray[np.float64], shown_s: float, rate_hz: float
) -> NDArray[np.uint8]:
    """Return a picture (SIZE_PX, SIZE_PX, 3), uint8: translation and rotation in time, and their spectra."""
    import cv2

    made = np.full((SIZE_PX, SIZE_PX, 3), BACK, np.uint8)
    half, third = SIZE_PX // 2, SIZE_PX // 3
    shown = int(shown_s * rate_hz)
    along = np.linspace(0, SIZE_PX - 1, shown)
    for row, (values, unit) in enumerate(((1000 * moved_m, "mm"), (turned_deg, "deg"))):
        most = max(float(np.abs(values[:shown]).max()), 1e-9)
        middle = third * row + third // 2
        cv2.line(made, (0, middle), (SIZE_PX, middle), GRID, 1)
        for axis, colour in enumerate(AXES):
            _line(made, along, middle - 0.42 * third * values[:shown, axis] / most, colour)
        _text(made, f"{unit}, to {most:.3g}, {shown_s:g} s", third * row + 14)
    top, low = 2 * third, SIZE_PX - 4
    for half_at, values in ((0, moved_m), (half, turned_deg)):
        hz, density = power(values, rate_hz)
        kept = (hz >= LEAST_HZ) & (hz <= MOST_HZ)
        at = half_at + 4 + (half - 8) * np.log(hz[kept] / LEAST_HZ) / np.log(MOST_HZ / LEAST_HZ)
        for decade in (1, 10, 100):
            x = int(half_at + 4 + (half - 8) * np.log(decade / LEAST_HZ) / np.log(MOST_HZ / LEAST_HZ))
            cv2.line(made, (x, top + 18), (x, low), GRID, 1)
            _text(made, f"{decade}", low - 2, x + 3)
        level = np.log10(np.maximum(density[kept], density[kept].max() * 1e-6 + 1e-30))
        level = (level - level.min()) / max(float(np.ptp(level)), 1e-9)
        for axis, colour in enumerate(AXES):
            _line(made, at, low - (low - top - 20) * level[:, axis], colour)
        _text(made, "moves, Hz" if half_at == 0 else "turns, Hz", top + 14, half_at + 4)
    return made


def _line(made: NDArray[np.uint8], x: NDArray[np.float64], y: NDArray[np.float64], colour: tuple[int, ...]) -> None:
    import cv2

    points = np.column_stack([x, y]).round().astype(np.int32)
    cv2.polylines(made, [points], isClosed=False, color=colour, thickness=1)


def _text(made: NDArray[np.uint8], text: str, bottom: int, left: int = 4) -> None:
    import cv2

    cv2.putText(made, text, (left, bottom), cv2.FONT_HERSHEY_SIMPLEX, 0.42, INK, 1)


def _icon(panel: Any, step: Any) -> int:
    """Return the icon of a step's picture, which is made again only where its values have changed."""
    key = repr((step.perturbation, values_of(step), identifiers_of(panel)))
    if "pictures" not in _loaded:
        _loaded["pictures"] = bpy.utils.previews.new()
    pictures = _loaded["pictures"]
    if key not in pictures:
        made = picture(*signals(panel, step), *window_of(step.perturbation)[1:])
        if len(pictures) >= KEPT:
            pictures.clear()
        entry: Any = pictures.new(key)  # the stubs take no tuples and arrays
        entry.image_size = (SIZE_PX, SIZE_PX)
        opaque = np.ones((SIZE_PX, SIZE_PX, 4), np.float32)
        opaque[..., :3] = made[::-1] / np.float32(255)
        entry.image_pixels_float.foreach_set(opaque.ravel())
    return pictures[key].icon_id


def register_motion_plot() -> None:
    """Pictures are made when they are shown."""


def unregister_motion_plot() -> None:
    """Let the pictures go."""
    if "pictures" in _loaded:
        bpy.utils.previews.remove(_loaded.pop("pictures"))
