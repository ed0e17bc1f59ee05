# SPDX-License-Identifier: GPL-3.0-or-later
"""Out of what was measured: a device's file, and a preset that makes clean frames into such ones.

What a figure cannot tell is left out, and a comment of the file says why.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from statistics import NormalDist
from typing import Any

import numpy as np

from ..core.errors import one_line
from ..core.geometry import Intrinsics
from ..core.lens import Distortion
from ..core.schema import yaml_line
from ..core.srgb import exact_colours
from .depth_blocks import SIDE as DEPTH_SIDE
from .depth_holes import BASELINE, SIDES
from .depth_holes import LAW as HOLES
from .depth_noise import HEAD_ON, LAGS_PX, LEAST_CORRELATION, SHIFT, left_share, shared_by
from .figure import Figure
from .imu_noise import AT_REST, BANDWIDTHS
from .looking import RecordingFigures

# Chosen, as all below.
MOST_FRAMES = 32
LEAST_STEP = 0.3  # of a disparity, over the deviation of depth in inverse metres: smaller ones are not seen
MOST_PHOTONS = 256.0  # that shot_noise counts
LEAST_SHIFT_PX = 0.25  # less is of surfaces that bend: up to .22 where there is none
NO_SHADOW_BASELINE_M = 0.001  # of a projector that stands beside the camera
MIDDLE = 0.5  # intensity at which a noise of photons that are too many is added to the even one
DRAWS = 4000
LEAST_BLUR_PX, LEAST_READOUT_MS, LEAST_EXPOSURE_MS = 0.4, 1.0, 1.0  # of the lower ends of intervals
LEAST_LOSS, LEAST_SWING, LEAST_STOPS = 0.03, 0.01, 0.15
LEAST_CLOCK_S = 0.002
WHITE_ELECTRONS, MOST_ELECTRONS = 1e6, 1000.0  # of white, so that photons' noise is not seen; of a row, at most
HOT_LIGHT, HOT_SEEN = 0.2, 0.86  # of white, on average; share of such pixels that stand out as measured ones do
DARK_S = 0.01  # default of sensor_noise
LEAST_JITTER_S = 1e-6  # less is the rounding of stamps
BANDWIDTH_APART = 1.2
IMU_KEYS = ("gyro_noise_density", "accel_noise_density")

Values = dict[str, Any]
_NO_NOISE: Mapping[str, Any] = {  # of axial_noise
    "from_m": 0.0,
    "offset_m": 0.0,
    "linear": 0.0,
    "quadratic_per_m": 0.0,
    "steep": 0.0,
    "lateral_px": 0.0,
    "lateral_steep_px": 0.0,
    "correlation_px": 0.0,
    "correlation_share": 0.0,
    "correlation_frames": 1,
}


@dataclass
class Twin:
    """What makes clean frames into such as were measured.

    camera: keys of a preset's camera. sensor: how depth is measured, one perturbation; None where it cannot be told.
    shutter, colour, pairing: further steps of a setting. imu: keys of a rig's. delay_ms: how much later than
    colour depth is exposed; between_frames: which is no whole number of frames. depth_scale_per_m: of images of depth.
    untold: why something is not in it, or not as it was measured, a line each.
    """

    camera: Values
    shutter: list[Values] = field(default_factory=list[Values])
    delay_ms: float | None = None
    between_frames: bool = False
    sensor: Values | None = None
    colour: list[Values] = field(default_factory=list[Values])
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
    _shutter(twin, found)
    _light(twin, found)
    _colour(twin, found)
    _lines(twin, found)
    _coding(twin, found)
    _depth(twin, found, camera)
    _pairing(twin, found)
    _imu(twin, found)
    _stamps(twin, found)
    return twin


def _untold(found: RecordingFigures) -> Iterator[Figure]:
    yield from (figure for figure in found.figures.values() if figure.value is None)


def _value(found: RecordingFigures, name: str) -> float | None:
    figure = found.figures.get(name)
    return None if figure is None else figure.value


def _sure(found: RecordingFigures, name: str, least: float = 0.0) -> float | None:
    """Return a figure's value where its whole interval is beyond a number, on one side; None elsewhere."""
    figure = found.figures.get(name)
    return figure.value if figure is not None and figure.sure_beyond(least) else None


def _plain(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}")


# --- colour: what the shutter and the lens do, light, noise, files ---


def _shutter(twin: Twin, found: RecordingFigures) -> None:
    """Add what acts on a scene while it is rendered: exposure and readout."""
    if (exposure_ms := _sure(found, "exposure_ms", LEAST_EXPOSURE_MS)) is not None:
        twin.shutter.append({"camera_motion_blur": {"shutter_ms": _plain(exposure_ms, 3)}})
    readouts = {
        ways: value
        for name, ways in (("readout_down_ms", ("down", "up")), ("readout_right_ms", ("right", "left")))
        if (value := _sure(found, name, LEAST_READOUT_MS)) is not None
    }
    if readouts:
        ways, readout_ms = max(readouts.items(), key=lambda each: abs(each[1]))
        direction = ways[readout_ms < 0]
        twin.shutter.append({"rolling_shutter": {"readout_ms": _plain(abs(readout_ms), 3), "direction": direction}})
    if len(readouts) > 1:
        twin.untold.append("readout: rows and columns were told to be read one after another; the longer one is taken")
    if twin.shutter:
        names = " and ".join(name for step in twin.shutter for name in step)
        verb = "act" if len(twin.shutter) > 1 else "acts"
        twin.untold.append(
            f"{names} {verb} on what is rendered; over a recording write {{device: {{name: ./FILE, "
            f"{', '.join(f'{name}: false' for step in twin.shutter for name in step)}}}}}"
        )


def _light(twin: Twin, found: RecordingFigures) -> None:
    """Add what the lens does, and how light changes."""
    if (sigma_px := _sure(found, "defocus_sigma_px", LEAST_BLUR_PX)) is not None:
        twin.colour.append({"gaussian_blur": {"sigma_px": _plain(sigma_px, 3)}})
    if (loss := _sure(found, "vignetting_corner_loss", LEAST_LOSS)) is not None and loss > 0:
        twin.colour.append({"vignetting": {"corner_loss": min(_plain(loss, 3), 1.0)}})
    stops, light = _sure(found, "exposure_range_stops", LEAST_STOPS), _value(found, "mean_light")
    if stops is not None and light:
        speed, measured_s = _value(found, "exposure_rate_stops_per_s"), _value(found, "auto_exposure_lag_s")
        guessed_s = min(_plain(stops / speed, 2), 5.0) if speed else 0.4
        lag_s = guessed_s if measured_s is None else _plain(measured_s, 3)
        twin.colour.append({"auto_exposure": {"target": min(_plain(light, 3), 1.0), "lag_s": lag_s}})
        guess = f"lag_s is guessed, {stops:.2g} stops over the fastest that was seen; " if measured_s is None else ""
        twin.untold.append(
            f"auto_exposure: {guess}how bright the scene "
            "itself was is not known, so images stay as bright as they are rendered when light_stops is 0"
        )
    if (balance := _sure(found, "white_balance_range_stops", LEAST_STOPS)) is not None:
        twin.untold.append(
            f"white_balance_range_stops: {balance:.2g} were measured; white_balance would need what was asked for"
        )
    exposure_ms = _value(found, "exposure_ms") if twin.shutter else None
    for mains_hz in (50, 60):
        swing = _sure(found, f"flicker_swing_{2 * mains_hz}_hz", LEAST_SWING)
        if swing is None:
            continue
        exposed_s = (exposure_ms or 0.0) / 1e3
        seen = abs(float(np.sinc(2 * mains_hz * exposed_s)))
        keys: Values = {"mains_hz": mains_hz, "modulation": _plain(min(swing / max(seen, 1e-3), 1.0), 3)}
        if not exposed_s:
            keys["exposure_ms"] = 0.0
            twin.untold.append("flicker: modulation is what frames show, as if they were exposed for no time")
        twin.colour.append({"flicker": keys})


def _lines(twin: Twin, found: RecordingFigures) -> None:
    """Add hot pixels and what rows share: a sensor that has no other noise."""
    rows, hot = (_sure(found, name) for name in ("row_noise_std", "hot_pixel_share"))
    if (columns := _sure(found, "column_noise_std")) is not None:
        twin.untold.append(f"column_noise_std: {columns:.2g} of white was measured, and no sensor here has columns")
    if rows is None and hot is None:
        return
    light = _value(found, "mean_light") or MIDDLE**2.2
    codes = exact_colours(np.array([0.99, 1.01]) * light)
    of_row = (rows or 0.0) * 0.02 * light / float(codes[1] - codes[0])  # in light
    white = min(WHITE_ELECTRONS, MOST_ELECTRONS / of_row) if of_row > 0 else WHITE_ELECTRONS
    keys: Values = {
        "gain_db": 0.0,
        "full_well_electrons": _plain(white, 3),
        "read_noise_electrons": 0.0,
        "dark_electrons_per_s": 0.0,
        "hot_percent": _plain(100 * (hot or 0.0) / (3 * HOT_SEEN), 3),
        "hot_electrons_per_s": _plain(HOT_LIGHT * white / DARK_S, 3),
        "row_noise_electrons": min(_plain(of_row * white, 3), MOST_ELECTRONS),
        "bits": 16,
    }
    twin.colour.append({"sensor_noise": keys})
    if hot is not None:
        twin.untold.append("hot_pixel_share: how bright hot pixels are was not measured")
    if rows is not None:
        twin.untold.append(
            f"row_noise_std: rows share as much at the mean light, {light:.2g} of white; in light, not in pixels"
        )


def _coding(twin: Twin, found: RecordingFigures) -> None:
    """Add JPEG, which comes last."""
    quality = _value(found, "jpeg_quality")
    if quality is None:
        return
    twin.colour.append({"jpeg_compression": {"quality": round(quality)}})
    halved = _value(found, "jpeg_420_share")
    if halved is not None and halved < MIDDLE:
        twin.untold.append("jpeg_420_share: chroma was not halved both ways, as jpeg_compression has it")
    if twin.colour[0].keys() & {"gaussian_noise", "shot_noise"} or len(twin.colour) > 1:
        twin.untold.append("jpeg_quality: noise was measured behind the JPEG, and is compressed once more here")


def _colour(twin: Twin, found: RecordingFigures) -> None:
    std, slope = _value(found, "colour_gaussian_std"), _value(found, "colour_variance_per_intensity") or 0.0
    left = [each.value for each in found.figures.values() if each.curve == "colour_noise" and each.value is not None]
    if std is None and left:
        std = float(np.sqrt(np.mean(np.square(left)))) / 255
        twin.untold.append("colour_gaussian_std: gaussian_noise has what is left at the intensities, all together")
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
        shot = 1 if twin.colour and "shot_noise" in twin.colour[-1] else 0
        twin.colour.insert(len(twin.colour) - shot, {"gaussian_noise": {"std": _plain(std)}})
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
        if more := _lost(twin, found):
            twin.sensor = {"axial_noise": {**_NO_NOISE, **more}}
        return
    px, share, frames = _sharing(found)
    shift_px = _value(found, SHIFT) or 0.0
    shift_px = _shift_of(shift_px / np.sqrt(left_share(DEPTH_SIDE, round(px, 2)))) if shift_px > LEAST_SHIFT_PX else 0.0
    if shift_px > 0:  # what it adds to the deviation is not added again
        offset, quadratic = (_value(found, name) or 0.0 for name in HEAD_ON)
    whole = 1 / _seen_of(DEPTH_SIDE, round(px, 2), round(share, 3))  # what planes over blocks leave is less
    offset, quadratic = offset * whole, quadratic * whole
    more: Values = _lost(twin, found)
    if share > 0:
        more |= {"correlation_px": _plain(px, 3), "correlation_share": _plain(share, 3), "correlation_frames": frames}
    if step_per_m is not None and step_per_m > LEAST_STEP * quadratic > 0:
        law = offset, quadratic, step_per_m
        twin.sensor = {"structured_light": _stepped(twin, found, camera, law, more | {"shift_px": shift_px})}
        return
    values = {"offset_m": _plain(offset), "quadratic_per_m": _plain(quadratic), "lateral_px": shift_px}
    twin.sensor = {"axial_noise": {**_NO_NOISE, **values, **more}}
    if _value(found, BASELINE):
        twin.untold.append("shadow_baseline_m: axial_noise has no shadows; holes beside edges are not made")


def _lost(twin: Twin, found: RecordingFigures) -> Values:
    """Return the parameters of what is lost at the sides, and for little light."""
    values: Values = {}
    for side in SIDES:
        if wide := _value(found, f"border_{side}_px"):
            values["blind_px" if side == "right" else f"blind_{side}_px"] = wide
    least, spread, px, frames = (_value(found, name) for name in HOLES)
    if least is None or spread is None:
        return values
    values |= {"least_light": _plain(least), "reflectance_spread": _plain(spread)}
    values |= {"clump_px": _plain(px or 0.0, 3), "clump_frames": max(round(frames or 1.0), 1)}
    twin.untold.append(
        "holes: lie where little light comes back, and else anywhere: which surfaces are dark is not told"
    )
    return values


def _stepped(
    twin: Twin, found: RecordingFigures, camera: Intrinsics, law: tuple[float, float, float], more: Values
) -> Values:
    """Return the parameters of a disparity that is rounded. law: offset, quadratic and step, in inverse metres."""
    offset, quadratic, step_per_m = law
    baseline_m = _value(found, BASELINE) or 0.0
    if baseline_m < 0:
        twin.untold.append(f"{BASELINE}: {baseline_m:.3g} was measured, and structured_light's shadows lie to the left")
    baseline_m = max(_plain(baseline_m), NO_SHADOW_BASELINE_M)
    product = camera.fx_px * baseline_m
    rounded = step_per_m**2 / 12
    before = max(quadratic**2 - rounded, 0.0)
    if offset > 0:
        twin.untold.append(f"{HEAD_ON[0]}: {offset:.3g} was measured, and a disparity's noise has no such part")
    if "correlation_share" in more and before > 0:  # what rounding adds is each pixel's own
        more = more | {"correlation_share": _plain(min(more["correlation_share"] * quadratic**2 / before, 1), 3)}
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
    return values | more


@cache
def _shifts() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return deviations of normal numbers, and those of the same rounded to whole ones."""
    steps = np.arange(0.5, 40)
    tried = np.linspace(0.05, 8, 400)
    tails = [[NormalDist().cdf(-float(step / each)) for step in steps] for each in tried]
    # Each half step more adds the odd numbers to the square.
    rounded = [float(np.sqrt(2 * np.sum(np.array(each) * (2 * steps)))) for each in tails]
    return tuple(tried.tolist()), tuple(rounded)


def _shift_of(moved_px: float) -> float:
    """Return the deviation of places that, rounded to whole pixels, deviate by so much."""
    tried, rounded = _shifts()
    return _plain(float(np.interp(moved_px, rounded, tried)), 3)


def _sharing(found: RecordingFigures) -> tuple[float, float, int]:
    """Return the distance in pixels at which shared noise is correlated by 1 / e, its share of the variance, frames.

    0, 0, 1 where pixels have their own.
    """
    lags = [(lag, _value(found, f"depth_correlation_{lag}_px")) for lag in LAGS_PX]
    known = [(lag, value) for lag, value in lags if value is not None]
    later = _value(found, "depth_correlation_1_frame")
    if len(known) < 2 or max(value for _, value in known) < LEAST_CORRELATION:
        return 0.0, 0.0, 1
    px, share = shared_by(*zip(*known, strict=True))
    if later is None or later < LEAST_CORRELATION or share <= 0:
        return px, share, 1
    kept = min(later / share, 1 - 1 / MOST_FRAMES)  # 1 - 1 / frames
    return px, share, round(1 / (1 - kept))


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


# --- which depth goes with which colour ---


def _pairing(twin: Twin, found: RecordingFigures) -> None:
    late = found.figures.get("depth_late_frames")
    if late is None or late.value is None or not late.sure_beyond(0.05):
        return
    frames = round(late.value)
    if twin.rate_hz:
        twin.delay_ms = 0.0 - _plain(1e3 * late.value / twin.rate_hz)
    if abs(late.value - frames) > 0.1 and twin.delay_ms is not None:
        twin.between_frames = True
        nearest = f"desync: {{offset: {-frames}}} is the nearest" if frames else "there is nothing so near"
        twin.untold.append(
            f"depth_late_frames: {late.value:.2f} was measured; rig.depth.delay_ms has it, of what is rendered; over a "
            f"recording {nearest}"
        )
    elif frames and late.sure_beyond(0.5):
        twin.pairing.append({"desync": {"offset": -frames}})


# --- the IMU, and stamps ---


def _imu(twin: Twin, found: RecordingFigures) -> None:
    for name, at_rest in zip(IMU_KEYS, AT_REST, strict=True):
        resting = _value(found, at_rest)
        if (value := _value(found, name) if resting is None else resting) is not None:
            twin.imu[name] = _plain(value)
    bandwidths = [value for name in BANDWIDTHS if (value := _value(found, name)) is not None]
    if bandwidths:
        twin.imu["bandwidth_hz"] = _plain(bandwidths[0], 3)
        if max(bandwidths) > BANDWIDTH_APART * min(bandwidths):
            twin.untold.append("accel_bandwidth_hz: is another than the gyroscope's, and an IMU here has one")
    clocks = [
        figure
        for name in ("imu_clock_s", "imu_clock_by_poses_s")
        if (figure := found.figures.get(name)) is not None and figure.sure_beyond(LEAST_CLOCK_S)
    ]
    if clocks and (later_s := min(clocks, key=lambda figure: figure.half_width).value) is not None:
        twin.imu["time_offset_s"] = _plain(later_s)
    drifts = [
        figure
        for name in ("imu_clock_drift_ppm", "imu_clock_by_poses_drift_ppm")
        if (figure := found.figures.get(name)) is not None and figure.sure_beyond(0)
    ]
    if drifts and (ppm := min(drifts, key=lambda figure: figure.half_width).value) is not None:
        twin.imu["clock_drift_ppm"] = _plain(ppm, 3)


def _stamps(twin: Twin, found: RecordingFigures) -> None:
    """Add frames that were lost, and depth that came twice; stamps of a preset are even."""
    missing = _value(found, "missing_frames") or 0.0
    shares = {
        "lost_percent": missing / max(missing + found.frames, 1),
        "repeated_percent": _value(found, "doubled_depth_share") or 0.0,
    }
    keys = {name: _plain(100 * share, 3) for name, share in shares.items() if share > 0}
    if keys:
        earlier = twin.pairing.pop()["desync"] if twin.pairing else {"offset": 0}
        twin.pairing.append({"desync": earlier | keys})
    for name, least, told in (
        ("jitter_s", LEAST_JITTER_S, "deviation of the stamps, in seconds; those of a preset come evenly"),
        ("doubled_share", 0.0, "of the frames show the colour of the one before; a preset's have their own"),
    ):
        value = _value(found, name)
        if value and value > least:
            twin.untold.append(f"{name}: {value:.3g} {told}")


# --- the files ---


def device_text(twin: Twin, found: RecordingFigures) -> str:
    """Return the device's file as YAML, with what could not be told as comments."""
    perturb = [*twin.shutter, *twin.colour]
    parts: Mapping[str, Any] = {
        "camera": twin.camera,
        "depth": twin.sensor,
        "delay_ms": twin.delay_ms,
        "imu": twin.imu,
        "perturb": perturb,
    }
    lines = [
        *_head(found, "A measured device"),
        "# In a preset: camera: {device: ./FILE}, rig: {depth: {sensor: ./FILE}, imu: {device: ./FILE}}, and",
        "# {device: ./FILE} in perturb.",
        *(f"# {line}" for line in twin.untold),
        *(f"{name}: {yaml_line(value)}" for name, value in parts.items() if value),
    ]
    return "\n".join(lines) + "\n"


def preset_text(twin: Twin, found: RecordingFigures) -> str:
    """Return a preset whose setting `twin` makes clean frames into such ones, of an embedded room as an example."""
    steps = [*twin.shutter, *twin.colour, *([twin.sensor] if twin.sensor else []), *twin.pairing]
    rig = {"imu": twin.imu} if twin.imu else {}
    rig |= {"depth": {"delay_ms": twin.delay_ms}} if twin.between_frames else {}
    rate_hz = twin.rate_hz or 30.0
    room = {"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 100, "rate_hz": rate_hz}}}
    lines = [
        *_head(found, "A twin"),
        "# Take the setting for scenes of your own, or put them in place of this one.",
        "scenes:",
        f"  - {yaml_line(room)}",
        f"camera: {yaml_line(twin.camera)}",
        "render: {engine: embree, backend: reference}",
        *([f"rig: {yaml_line(rig)}"] if rig else []),
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
