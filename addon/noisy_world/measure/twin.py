# SPDX-License-Identifier: GPL-3.0-or-later
"""Out of what was measured: a device's file, a preset that makes clean frames into such ones, places on severities.

What a figure cannot tell is left out, and a comment of the file says why.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from ..core.errors import one_line
from ..core.geometry import Intrinsics
from ..core.lens import Distortion
from ..core.schema import yaml_line
from ..perturbations import registry
from ..perturbations.kinds import SEVERITIES
from .depth_noise import LAGS_PX, WIDE_SIDE
from .depth_noise import SIDE as DEPTH_SIDE
from .figure import Figure, Place
from .looking import RecordingFigures

# Chosen, as all below.
LEAST_CORRELATION = 0.05  # less at all lags is noise of independent pixels
FARTHEST_PX, MOST_FRAMES = 40.0, 32
LEAST_HOLES = 0.003  # share of the pixels that is made
LEAST_STEP = 0.3  # of a disparity, over the deviation of depth in inverse metres: smaller ones are not seen
MOST_PHOTONS = 256.0  # that shot_noise counts
SHADOW_BASELINE_M, NO_SHADOW_BASELINE_M = 0.075, 0.001  # of a projector: the first Kinect's, and one beside the camera
MIDDLE = 0.5  # intensity at which a noise of photons that are too many is added to the even one
COMPARED_AT_M = 2.0  # at which noise of depth is compared with that of axial_noise
DRAWS = 4000

Values = dict[str, Any]


@dataclass
class Twin:
    """What makes clean frames into such as were measured.

    camera: keys of a preset's camera. sensor: how depth is measured, one perturbation; None where it cannot be told.
    colour, pairing, holes: further steps of a setting. depth_scale_per_m: of images of depth. untold: why something is
    not in it, or not as it was measured, a line each.
    """

    camera: Values
    sensor: Values | None = None
    colour: list[Values] = field(default_factory=list[Values])
    holes: list[Values] = field(default_factory=list[Values])
    pairing: list[Values] = field(default_factory=list[Values])
    imu: Values = field(default_factory=dict[str, Any])
    depth_scale_per_m: float | None = None
    rate_hz: float | None = None
    untold: list[str] = field(default_factory=list[str])


def twin_of(found: RecordingFigures, camera: Intrinsics, lens: Distortion | None) -> Twin:
    """Return the twin of a measured recording. camera, lens: those of its colour, at the size of its frames."""
    keys: Values = {"width": camera.width_px, "height": camera.height_px}
    keys |= {name: _plain(getattr(camera, f"{name}_px"), 9) for name in ("fx", "fy", "cx", "cy")}
    if lens is not None:
        named = {name: value for name, value in lens.named().items() if name[:1] in "kp" and name[1:].isdigit()}
        keys["distortion"] = {"model": lens.model, **named}
    twin = Twin(keys)
    rate = found.figures.get("rate_hz")
    twin.rate_hz = None if rate is None or rate.value is None else _plain(rate.value)
    twin.untold += [f"{figure.name}: cannot be told here, because {figure.untold}" for figure in _untold(found)]
    _colour(twin, found)
    _depth(twin, found, camera)
    _holes(twin, found)
    _pairing(twin, found)
    for name in ("gyro_noise_density", "accel_noise_density"):
        if (value := _value(found, name)) is not None:
            twin.imu[name] = _plain(value)
    return twin


def _untold(found: RecordingFigures) -> Iterator[Figure]:
    yield from (figure for figure in found.figures.values() if figure.value is None)


def _value(found: RecordingFigures, name: str) -> float | None:
    figure = found.figures.get(name)
    return None if figure is None else figure.value


def _plain(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}")


# --- colour ---


def _colour(twin: Twin, found: RecordingFigures) -> None:
    std, slope = _value(found, "colour_gaussian_std"), _value(found, "colour_variance_per_intensity") or 0.0
    if std is None:
        return
    if slope > 1 / MOST_PHOTONS:
        twin.colour.append({"shot_noise": {"photons": _plain(1 / slope)}})
    elif slope > 0:
        std = float(np.hypot(std, np.sqrt(slope * MIDDLE)))
        twin.untold.append(
            f"colour_variance_per_intensity: {slope:.3g} is of more photons than shot_noise counts ({MOST_PHOTONS:g}); "
            "gaussian_noise has it at middle intensity"
        )
    if std > 0:
        twin.colour.insert(0, {"gaussian_noise": {"std": _plain(std)}})
    beside = _value(found, "colour_noise_correlation")
    if beside is not None and beside > 0.2:
        twin.untold.append(f"colour_noise_correlation: {beside:.2f} was measured, and each pixel of this has its own")


# --- depth ---


def _depth(twin: Twin, found: RecordingFigures, camera: Intrinsics) -> None:
    offset, quadratic = (_value(found, name) for name in ("depth_noise_offset_m", "depth_noise_quadratic_per_m"))
    smallest, step_per_m = _value(found, "depth_step_m"), _value(found, "depth_step_per_m")
    if smallest is not None and smallest > 0 and step_per_m is None:
        round_number = _plain(1 / smallest, 2)
        twin.depth_scale_per_m = round_number if abs(round_number * smallest - 1) < 0.01 else _plain(1 / smallest)
    if offset is None or quadratic is None:
        return
    px, share, frames = _sharing(found)
    whole = 1 / _seen_of(DEPTH_SIDE, round(px, 2), round(share, 3))  # what planes over blocks leave is less
    offset, quadratic = offset * whole, quadratic * whole
    shared: Values = {}
    if share > 0:
        shared = {"correlation_px": _plain(px, 3), "correlation_share": _plain(share, 3), "correlation_frames": frames}
    if step_per_m is not None and step_per_m > LEAST_STEP * quadratic > 0:
        twin.sensor = {"structured_light": _stepped(twin, found, camera, (offset, quadratic, step_per_m), shared)}
        return
    law = {"from_m": 0.0, "offset_m": _plain(offset), "linear": 0.0, "quadratic_per_m": _plain(quadratic)}
    law |= {"steep": 0.0, "lateral_px": 0.0, "lateral_steep_px": 0.0}
    none = {"correlation_px": 0.0, "correlation_share": 0.0, "correlation_frames": 1}
    twin.sensor = {"axial_noise": law | (shared or none)}


def _stepped(
    twin: Twin, found: RecordingFigures, camera: Intrinsics, law: tuple[float, float, float], shared: Values
) -> Values:
    """Return the parameters of a disparity that is rounded. law: offset, quadratic and step, in inverse metres."""
    offset, quadratic, step_per_m = law
    beside = _value(found, "holes_beside_edges_share") or 0.0
    baseline_m = SHADOW_BASELINE_M if beside > LEAST_HOLES else NO_SHADOW_BASELINE_M
    product = camera.fx_px * baseline_m
    rounded = step_per_m**2 / 12
    before = max(quadratic**2 - rounded, 0.0)
    if offset > 0:
        twin.untold.append(f"depth_noise_offset_m: {offset:.3g} was measured, and a disparity's noise has no such part")
    if baseline_m == SHADOW_BASELINE_M:
        twin.untold.append("baseline_m: is a first Kinect's, as holes beside edges do not tell it")
    if shared and before > 0:  # what rounding adds is each pixel's own
        shared = shared | {"correlation_share": _plain(min(shared["correlation_share"] * quadratic**2 / before, 1), 3)}
    values: Values = {
        "focal_px": _plain(camera.fx_px, 6),
        "baseline_m": baseline_m,
        "step_px": _plain(step_per_m * product, 6),
        "sigma_px": _plain(float(np.sqrt(before)) * product, 6),
        "shift_px": 0.0,
        "window_px": 0.0,
        "least_share": 0.0,
        "min_m": 0.0,
        "max_m": 1000.0,
    }
    return values | shared


def _sharing(found: RecordingFigures) -> tuple[float, float, int]:
    """Return the distance in pixels at which shared noise is correlated by 1 / e, its share of the variance, frames.

    0, 0, 1 where pixels have their own.
    """
    lags = [(lag, _value(found, f"depth_correlation_{lag}_px")) for lag in LAGS_PX]
    known = [(lag, value) for lag, value in lags if value is not None]
    later = _value(found, "depth_correlation_1_frame")
    if len(known) < 2 or max(value for _, value in known) < LEAST_CORRELATION:
        return 0.0, 0.0, 1
    distance, measured = (np.array(column, np.float64) for column in zip(*known, strict=True))
    tried = np.geomspace(0.7, FARTHEST_PX, 200)
    shapes = np.exp(-((distance[None, :] / tried[:, None]) ** 2))
    shares = np.clip((shapes @ measured) / (shapes**2).sum(axis=1), 0, 1)
    best = int(np.argmin(((shares[:, None] * shapes - measured) ** 2).sum(axis=1)))
    px, share = float(tried[best]), float(shares[best])
    if later is None or later < LEAST_CORRELATION or share <= 0:
        return px, share, 1
    left = share * _left_share(WIDE_SIDE, round(px, 2))
    kept = min(later * (left + 1 - share) / left, 1 - 1 / MOST_FRAMES)  # 1 - 1 / frames
    return px, share, round(1 / (1 - kept))


@cache
def _left_share(side: int, px: float) -> float:
    """Return the share of shared noise's variance that planes leave of blocks, over that of independent pixels."""
    v, u = np.mgrid[:side, :side].reshape(2, -1).astype(np.float64)
    together = np.exp(-((v[:, None] - v) ** 2 + (u[:, None] - u) ** 2) / px**2)
    terms = np.linalg.qr(np.stack([np.ones(u.size), u, v], axis=1))[0]
    return float((u.size - np.einsum("ni,nm,mi->", terms, together, terms, optimize=True)) / (u.size - terms.shape[1]))


@cache
def _seen_of(side: int, px: float, share: float) -> float:
    """Return the median deviation that planes leave of blocks of noise of deviation 1, which neighbours share."""
    v, u = np.mgrid[:side, :side].reshape(2, -1).astype(np.float64)
    square = (v[:, None] - v) ** 2 + (u[:, None] - u) ** 2
    together = np.exp(-square / px**2) if px > 0 else np.eye(side * side)
    covariance = share * together + (1 - share + 1e-9) * np.eye(side * side)
    drawn = np.random.default_rng(0).standard_normal((DRAWS, side * side)) @ np.linalg.cholesky(covariance).T
    terms = np.stack([np.ones(u.size), u, v], axis=1)
    left = drawn - (drawn @ np.linalg.pinv(terms).T) @ terms.T
    return float(np.median(np.sqrt((left**2).sum(axis=1) / (side * side - 3))))


# --- holes, and which depth goes with which colour ---


def _holes(twin: Twin, found: RecordingFigures) -> None:
    names = ("at_border", "beside_edges", "in_dark", "elsewhere")
    shares = {name: _value(found, f"holes_{name}_share") for name in names}
    known = {name: value for name, value in shares.items() if value is not None}
    shadowed = known.pop("beside_edges", 0.0) if _has_shadow(twin) else 0.0  # which the disparity makes
    share = sum(known.values()) / max(1 - shadowed, 1e-3)  # rectangles lie on shadows too
    if share <= LEAST_HOLES:
        return
    twin.holes.append({"depth_random_missing": {"missing_percent": min(_plain(100 * share, 3), 90.0)}})
    told = ", ".join(f"{100 * value:.2g} % {name.replace('_', ' ')}" for name, value in known.items())
    twin.untold.append(f"holes: {told}; all are made as rectangles of a tenth of the sides, anywhere")


def _has_shadow(twin: Twin) -> bool:
    model = (twin.sensor or {}).get("structured_light")
    return model is not None and model["baseline_m"] == SHADOW_BASELINE_M


def _pairing(twin: Twin, found: RecordingFigures) -> None:
    late = found.figures.get("depth_late_frames")
    if late is None or late.value is None:
        return
    frames = round(late.value)
    if frames and late.sure_beyond(0.5):
        twin.pairing.append({"desync": {"offset": -frames}})
    if late.sure_beyond(0.05) and abs(late.value - frames) > 0.1 and twin.rate_hz:
        shift_ms = 0.0 - 1e3 * late.value / twin.rate_hz
        twin.untold.append(
            f"depth_late_frames: {late.value:.2f} was measured, and desync counts whole frames; of a rendered scene "
            f"rig.depth.delay_ms: {shift_ms:.3g} is exact"
        )


# --- places on severities ---


def places(found: RecordingFigures) -> tuple[Place, ...]:
    """Return where measured noise lies on the severities of the perturbations that make such noise.

    Below 1 a place is the strength over severity 1's: a deviation, the inverse number of photons, a share.
    """
    made: list[Place] = []
    for name, perturbation, parameter, inverse in (
        ("colour_gaussian_std", "gaussian_noise", "std", False),
        ("colour_variance_per_intensity", "shot_noise", "photons", True),
    ):
        figure = found.figures.get(name)
        if figure is not None and figure.value is not None and figure.value > 0:
            made.append(_place(perturbation, parameter, figure, inverse=inverse))
    names = ("depth_noise_offset_m", "depth_noise_quadratic_per_m")
    law = [figure for name in names if (figure := found.figures.get(name)) is not None and figure.value is not None]
    if len(law) == len(names):
        made.append(_place("axial_noise", "noise", _times_the_model(law)))
    void = found.figures.get("void_share")
    if void is not None and void.value is not None and void.value > 0:
        made.append(_place("depth_random_missing", "missing_percent", _percent(void)))
    return tuple(made)


def _times_the_model(law: Sequence[Figure]) -> Figure:
    """Return how strong noise of depth is at COMPARED_AT_M, times that of axial_noise."""
    from ..perturbations.shipped.axial_noise import DEVICES

    model = DEVICES[registry()["axial_noise"].parameters().device]
    beyond_m = COMPARED_AT_M - model["from_m"]
    of_model = model["offset_m"] + model["linear"] * beyond_m + model["quadratic_per_m"] * beyond_m**2

    def times(*parts: float | None) -> float | None:
        offset, quadratic = parts
        return None if offset is None or quadratic is None else (offset + quadratic * COMPARED_AT_M**2) / of_model

    one, other = law
    return Figure("depth_noise", times(one.value, other.value), times(one.low, other.low), times(one.high, other.high))


def _percent(figure: Figure) -> Figure:
    value, low, high = (None if share is None else 100 * share for share in (figure.value, figure.low, figure.high))
    return Figure(figure.name, value, low, high)


def _place(perturbation: str, parameter: str, figure: Figure, *, inverse: bool = False) -> Place:
    """Return the place of a figure. inverse: whether the table has one over it."""
    table = np.asarray(registry()[perturbation].severities[parameter], np.float64)
    strengths = 1 / table if inverse else table

    def severity(strength: float | None) -> float | None:
        if strength is None:
            return None
        if strength <= strengths[0]:
            return max(float(strength / strengths[0]), 0.0)
        if strength >= strengths[-1]:
            return SEVERITIES[-1]
        # Between severities the table is linear in the parameter itself.
        at, values = (1 / strength, table[::-1]) if inverse else (strength, table)
        return float(np.interp(at, values, SEVERITIES[::-1] if inverse else SEVERITIES))

    assert figure.value is not None
    place = severity(figure.value)
    assert place is not None
    return Place(perturbation, place, severity(figure.low), severity(figure.high), float(figure.value / strengths[-1]))


# --- the files ---


def device_text(twin: Twin, found: RecordingFigures) -> str:
    """Return the device's file as YAML, with what could not be told as comments."""
    parts: Mapping[str, Any] = {"camera": twin.camera, "depth": twin.sensor, "perturb": twin.colour}
    lines = [
        *_head(found, "A measured device"),
        "# In a preset: camera: {device: ./FILE}, rig: {depth: {sensor: ./FILE}}, and {device: ./FILE} in perturb.",
        *(f"# {line}" for line in twin.untold),
        *(f"{name}: {yaml_line(value)}" for name, value in parts.items() if value),
    ]
    return "\n".join(lines) + "\n"


def preset_text(twin: Twin, found: RecordingFigures) -> str:
    """Return a preset whose setting `twin` makes clean frames into such ones, of an embedded room as an example."""
    steps = [*twin.colour, *([twin.sensor] if twin.sensor else []), *twin.holes, *twin.pairing]
    rate_hz = twin.rate_hz or 30.0
    room = {"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 100, "rate_hz": rate_hz}}}
    lines = [
        *_head(found, "A twin"),
        "# Take the setting for scenes of your own, or put them in place of this one.",
        "scenes:",
        f"  - {yaml_line(room)}",
        f"camera: {yaml_line(twin.camera)}",
        "render: {engine: embree, backend: reference}",
        *([f"rig: {yaml_line({'imu': twin.imu})}"] if twin.imu else []),
        "settings:",
        "  - {name: clean}",
        "  - name: twin",
        *([] if steps else ["    perturb: []"]),
        *(["    perturb:"] if steps else []),
        *(f"      - {yaml_line(step)}" for step in steps),
        *(f"      # {line}" for line in twin.untold),
        *([f"output: {yaml_line({'depth_scale_per_m': twin.depth_scale_per_m})}"] if twin.depth_scale_per_m else []),
    ]
    return "\n".join(lines) + "\n"


def _head(found: RecordingFigures, what: str) -> list[str]:
    wide, high = found.size_px
    return [f"# {what}, by noisy-world measure of {found.frames} frames of {wide} x {high}: {one_line(found.name)}"]
