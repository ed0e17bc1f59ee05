# SPDX-License-Identifier: GPL-3.0-or-later
"""What a twin draws, measured as its recording was: noise on plain surfaces, holes in its own depth, an IMU at rest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.frame_request import FrameRequest
from ..core.geometry import Intrinsics
from ..core.lens import PINHOLE
from ..core.trajectory import FrameStamps, evenly_stamped
from ..images.measured_depth import completed_m
from ..images.pixels import rgb_bytes
from ..perturbations import registry
from ..perturbations.kinds import ColourPerturbation, DepthPerturbation, FrameContext
from ..render.source import Source
from ..trajectories.rig import ImuErrors, ImuModel
from .colour_noise import colour_noise
from .comparison import points_of
from .depth_noise import CURVE as DEPTH_CURVE
from .depth_noise import depth_noise
from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float32, Float64, RecordingView, footage_of
from .looking import NOISE_FRAMES, WHOLE_PX, RecordingFigures
from .twin import Twin

# Chosen, as all below.
DRAWN = 9  # frames: eight, and the one after them
STRIP_PX, HIGH_PX, MOST_STRIPS = 48, 240, 8  # of walls at one distance each; two of the wide blocks
SLANT = 0.05  # of inverse depth, from a strip's top to its foot
DARKEST, LIGHTEST, BESIDE = 12.0, 243.0, 6.0  # of 255
NOISE = ("gaussian_noise", "shot_noise", "sensor_noise", "jpeg_compression")  # steps that make noise, or take it
CELLS = 32  # across a map
SEGMENTS, LEAST_SEGMENT = 8, 32  # of samples, whose spectra are averaged
POINTS = 14  # of a spectrum
SPECTRA = ("gyro_spectrum", "accel_spectrum")


@dataclass(frozen=True)
class ModelDraw:
    """What the model draws, beside what was measured in the same way.

    measured, drawn: figures by name. holes: maps (rows, columns) of the share of frames in which a cell is void, as it
    was measured and as it is drawn into the same depth; None without depth.
    """

    measured: Mapping[str, Figure]
    drawn: Mapping[str, Figure]
    holes: tuple[Float64, Float64] | None


def model_draw(name: str, source: Source, camera: Intrinsics, found: RecordingFigures, twin: Twin) -> ModelDraw:
    """Draw a recording's twin. camera: of colour. Raises InputError where a file that is looked at is damaged."""
    drawn = {figure.name: figure for figure in (*_colour(found, twin, camera), *_depth(found, twin, camera))}
    measured = dict(found.figures)
    holes = None
    with footage_of(name, source, camera, WHOLE_PX) as footage:
        if footage.has_depth:
            holes, void = _holes(footage, twin)
            drawn[void.name] = void
        if footage.imu is not None:
            samples = footage.imu.samples
            rate_hz = 1e9 / float(np.median(np.diff(samples.stamps_ns)))
            values = samples.rate_rad_s, samples.force_m_s2
            known = {key: value for key, value in twin.imu.items() if key in ImuModel.__dataclass_fields__}
            model = ImuErrors(ImuModel(**known), rate_hz, np.random.default_rng(0))
            rest = model.added(np.zeros_like(values[0]), np.zeros_like(values[1]))[:2]
            for curve, moving, still in zip(SPECTRA, values, rest, strict=True):
                measured |= {figure.name: figure for figure in _spectrum(curve, moving, rate_hz)}
                if known:
                    drawn |= {figure.name: figure for figure in _spectrum(curve, still, rate_hz)}
    return ModelDraw(measured, drawn, holes)


# --- noise on plain surfaces ---


class _Drawn:
    """An open source of frames that are there already."""

    def __init__(self, frames: Sequence[Any]) -> None:
        self._frames = frames

    def frame(self, request: FrameRequest) -> Any:
        """Return the frame of a request."""
        return self._frames[request.frame]


def _view(frames: Sequence[Any], camera: Intrinsics, *, has_depth: bool) -> RecordingView:
    path = evenly_stamped(np.tile(np.eye(4), (len(frames), 1, 1)))
    return RecordingView(
        "twin", _Drawn(frames), camera, 1.0, PINHOLE, path, FrameStamps.of(path.stamps_s), has_depth, None
    )


def _applied(steps: Sequence[Mapping[str, Any]], image: Float32, frame: int, camera: Intrinsics) -> Float32:
    """Return an image or depth after the steps of a twin."""
    for place, step in enumerate(steps):
        ((name, given),) = step.items()
        model = registry()[name]
        assert isinstance(model, ColourPerturbation | DepthPerturbation), "a twin's noise is of images"
        context = FrameContext(frame, (0, "twin", place), intrinsics=camera)
        image = np.asarray(model.apply(image, model.parameters(**given), context), np.float32)
    return image


def _cut(camera: Intrinsics, wide: int) -> Intrinsics:
    return Intrinsics(wide, HIGH_PX, camera.fx_px, camera.fy_px, (wide - 1) / 2, (HIGH_PX - 1) / 2)


def _colour(found: RecordingFigures, twin: Twin, camera: Intrinsics) -> tuple[Figure, ...]:
    """Return figures of noise on a ramp between the intensities at which the recording has them."""
    steps = [step for step in twin.colour if step.keys() & set(NOISE)]
    levels = [float(point.at or 0) for point in points_of(found.figures, "colour_noise")]
    if not levels or not steps:
        return ()
    low, high = max(min(levels) - BESIDE, DARKEST), min(max(levels) + BESIDE, LIGHTEST)
    wide = STRIP_PX * MOST_STRIPS
    row = np.linspace(low / 255, high / 255, wide)
    ramp = np.asarray(np.broadcast_to(row[None, :, None], (HIGH_PX, wide, 3)), np.float32)
    cut = _cut(camera, wide)
    frames = [
        SimpleNamespace(rgb=rgb_bytes(_applied(steps, ramp.copy(), frame, cut)), depth_m=None) for frame in range(DRAWN)
    ]
    return colour_noise(_view(frames, cut, has_depth=False), range(DRAWN - 1)).figures


def _depth(found: RecordingFigures, twin: Twin, camera: Intrinsics) -> tuple[Figure, ...]:
    """Return figures of noise of depth on slanted walls at the distances at which the recording has them."""
    points = points_of(found.figures, DEPTH_CURVE)
    if not points or twin.sensor is None:
        return ()
    chosen = np.unique(np.linspace(0, len(points) - 1, MOST_STRIPS).round().astype(int))
    walls_m = [float(points[place].at or 1) for place in chosen]
    slant = 1 + SLANT * np.linspace(-0.5, 0.5, HIGH_PX)
    clean_m = np.asarray(np.repeat(walls_m, STRIP_PX)[None, :] / slant[:, None], np.float32)
    cut = _cut(camera, clean_m.shape[1])
    grey = np.full((*clean_m.shape, 3), 128, np.uint8)
    frames = [
        SimpleNamespace(rgb=grey, depth_m=_stored(_applied([twin.sensor], clean_m.copy(), frame, cut), twin))
        for frame in range(DRAWN)
    ]
    figures = depth_noise(_view(frames, cut, has_depth=True), range(DRAWN - 1)).figures
    return tuple(figure for figure in figures if figure.name.startswith("depth_"))


def _stored(depth_m: Float32, twin: Twin) -> Float32:
    """Return depth as images hold it."""
    scale = twin.depth_scale_per_m
    return depth_m if scale is None else np.asarray(np.rint(depth_m * scale) / scale, np.float32)


# --- holes in its own depth ---


def _holes(footage: RecordingView, twin: Twin) -> tuple[tuple[Float64, Float64], Figure]:
    """Return maps of void, measured and drawn, and the share of what is drawn."""
    steps = [twin.sensor] if twin.sensor else []
    frames = np.unique(np.linspace(0, len(footage) - 1, NOISE_FRAMES).round().astype(int)).tolist()
    maps: list[Float64] = [np.zeros(0), np.zeros(0)]
    shares: list[float] = []
    for frame in frames:
        depth_m = footage.look(frame).depth_m
        if depth_m is None:
            continue
        made_m = _applied(steps, completed_m(depth_m).copy(), frame, footage.camera)
        for place, void in enumerate((depth_m <= 0, made_m <= 0)):
            cells = _cells(void)
            maps[place] = maps[place] + cells if maps[place].size else cells
        shares.append(float(np.mean(made_m <= 0)))
    count = max(len(shares), 1)
    error = float(np.std(shares)) / count**0.5
    return (maps[0] / count, maps[1] / count), Figure.within("void_share", float(np.mean(shares)), error, count)


def _cells(void: NDArray[np.bool_]) -> Float64:
    """Return the share of void in cells of a map (rows, CELLS)."""
    import cv2

    high, wide = void.shape
    size = min(CELLS, wide), max(1, round(min(CELLS, wide) * high / wide))
    return np.asarray(cv2.resize(void.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float64)


# --- spectra ---


def _spectrum(curve: str, values: Float64, rate_hz: float) -> tuple[Figure, ...]:
    """Return the root of the power density of samples (N, 3), the mean over axes, by Welch's method."""
    long = len(values) // SEGMENTS
    if long < LEAST_SEGMENT:
        return ()
    window = np.hanning(long)
    parts = values[: long * SEGMENTS].reshape(SEGMENTS, long, 3)
    parts = (parts - parts.mean(axis=1, keepdims=True)) * window[None, :, None]
    power = (np.abs(np.fft.rfft(parts, axis=1)) ** 2).mean(axis=2) * 2 / (rate_hz * np.sum(window**2))
    hertz = np.fft.rfftfreq(long, 1 / rate_hz)
    edges = np.geomspace(hertz[1], rate_hz / 2, POINTS + 1)
    which = np.clip(np.searchsorted(edges, hertz, side="right") - 1, 0, POINTS - 1)
    made: list[Figure] = []
    groups = blocks_of(SEGMENTS)
    for band in range(POINTS):
        here = (which == band) & (hertz > 0)
        if not here.any():
            continue
        each = power[:, here].mean(axis=1)
        left_out = np.array([each[groups != group].mean() for group in range(BLOCKS)])
        at = float(np.exp(np.log(hertz[here]).mean()))
        value = float(np.sqrt(each.mean()))
        error = jackknifed(left_out) / (2 * max(value, 1e-12))
        made.append(Figure.within(f"{curve}_at_{at:.3g}_hz", value, error, SEGMENTS, "segments").on(curve, at))
    return tuple(made)
