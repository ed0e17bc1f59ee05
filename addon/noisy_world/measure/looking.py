# SPDX-License-Identifier: GPL-3.0-or-later
"""A look at a recording before anything is made of it: figures, and what is wrong with it in a line each."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.geometry import Intrinsics
from ..render.source import Source
from .blur import blur_figures, evenly_between
from .calibration import ANGLE, ZOOM, Calibration, calibration
from .coding import coding
from .colour_noise import colour_noise
from .depth_blocks import Registered, evenly
from .depth_noise import depth_noise
from .figure import BLOCKS, Figure, Place
from .fixed_noise import fixed_noise
from .flickering import READOUT
from .footage import RecordingView, footage_of
from .imu_noise import imu_noise
from .late_planes import lateness_of_planes
from .lateness import CLOCK, LATE, depth_lateness, imu_clock, imu_clock_by_poses
from .motion import Steps, steps_of
from .parallax import AS_READ, Parallax, parallax
from .readout import NAMES as READOUTS
from .readout import readout
from .recorded_light import light_figures, light_of
from .shaking import shaking
from .timing import (
    Doubled,
    depth_stamps_later_s,
    doubled,
    per_frame,
    runs_of,
    stamp_figures,
    void_figures,
    without_gaps,
)

# Chosen, as all below: sound recordings stay below, and what breaks a system is above.
LOOKED_AT = 240  # frames in a row, at most, in three runs
NOISE_FRAMES = 16  # whose noise is measured, at the size that they have
LIGHT_FRAMES = 120  # in a row, in two runs, whose light is compared
WHOLE_PX = 1 << 16
EDGE_FRAMES = 24  # whose edges are compared
LATE_FRAMES = 0.6
CLOCK_S, EXACT_S = 0.004, 0.008  # what a clock is off by; half the interval of a figure by images alone that counts
ANGLE_DEG, ZOOMED = 1.0, 0.04  # depth that is larger than colour was never laid onto it, and is no fault of calibration
JITTER, MISSING = 0.18, 0.05  # of the interval between frames, and of the frames
DOUBLED, UNEVENLY = 0.02, 0.15  # share of doubled frames: of even ones, and of such as a busy recorder leaves
EMPTY = 0.1

ONE_OF = 40  # frames to make for each that a run looks at beforehand: some per cent of its time
LEAST_LOOK = 40  # frames: fewer in a row tell little
MOST_LOOK = 90


@dataclass(frozen=True)
class RecordingFigures:
    """What was found of a recording.

    frames, size_px, seconds: what there is. read: how many frames were decoded. figures: by name. faults: a line each.
    told: names of what each fault is about, in their order. remarks: what else has to be said of the figures. places:
    where they lie on the benchmark's severities.
    """

    name: str
    frames: int
    size_px: tuple[int, int]
    seconds: float
    read: int
    figures: dict[str, Figure]
    faults: tuple[str, ...] = ()
    told: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    places: tuple[Place, ...] = ()


@dataclass
class _Heap:
    figures: dict[str, Figure] = field(default_factory=dict[str, Figure])
    faults: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])

    def add(self, *figures: Figure) -> None:
        self.figures |= {figure.name: figure for figure in figures}

    def fault(self, name: str, text: str) -> None:
        self.faults.append((name, text))


def look_at(name: str, source: Source, camera: Intrinsics, looked_at: int = LOOKED_AT) -> RecordingFigures:
    """Measure a recorded source. camera: of colour. looked_at: how many frames in a row, in all; below 2 none.

    Raises InputError where a file that is looked at is damaged.
    """
    with footage_of(name, source, camera) as footage:
        return _looked(footage, looked_at, fine=footage.imu is not None)[0]


def _looked(footage: RecordingView, looked_at: int = LOOKED_AT, *, fine: bool) -> tuple[RecordingFigures, Steps | None]:
    """Return what `look_at` does, and what happens between the frames in a row; None where none were looked at.

    fine: whether motion is wanted as exactly as it can be had.
    """
    heap = _Heap()
    stamps_s = footage.stamps.rgb.seconds
    _stamps(heap, footage)
    by_poses, drift = imu_clock_by_poses(footage.imu, footage.path, footage.stamps.pose.seconds)
    heap.add(by_poses, drift)
    later, steps = 0, None
    if looked_at >= 2:
        runs = runs_of(len(footage), looked_at, busy=_busy(footage))
        steps = steps_of(footage, runs, fine=fine)
        _steps(heap, footage, steps)
        later = _late(heap, footage, steps, runs, fine=fine)
        clock, drift = imu_clock(footage, steps)
        heap.add(clock, drift)
        _clock(heap, clock, by_poses)
    else:
        _clock(heap, Figure.none(CLOCK, "no images are looked at"), by_poses)
    _geometry(heap, footage, later, edges=looked_at >= MOST_LOOK)
    found = RecordingFigures(
        footage.name,
        len(footage),
        (round(footage.whole_px), round(footage.camera.height_px / footage.scale)),
        float(stamps_s[-1] - stamps_s[0]),
        len(footage.read),
        heap.figures,
        tuple(text for _, text in heap.faults),
        tuple(told for told, _ in heap.faults),
    )
    return found, steps


def measured(name: str, source: Source, camera: Intrinsics) -> RecordingFigures:
    """Measure the noise of a recorded source beside what `look_at` does. camera: of colour.

    Raises InputError where a file that is looked at is damaged.
    """
    with footage_of(name, source, camera) as footage:
        found, steps = _looked(footage, fine=True)
        if footage.scale == 1:  # what was read of it is used again
            return _with_noise(found, footage, steps)
    with footage_of(name, source, camera, WHOLE_PX) as whole:
        whole.read |= footage.read
        return _with_noise(found, whole, steps)


def _with_noise(found: RecordingFigures, footage: RecordingView, steps: Steps | None) -> RecordingFigures:
    """Return figures with those of noise. footage: of the size that it was recorded in."""
    inertial = imu_noise(footage.imu)
    last = max(len(footage) - 2, 0)  # depth is compared with the frame after
    frames = np.unique(np.linspace(0, last, NOISE_FRAMES).round().astype(int)).tolist()
    if len(frames) < BLOCKS:
        remark = f"noise is measured where there are {BLOCKS} frames or more"
        return replace(found, figures=found.figures | {noise.name: noise for noise in inertial}, remarks=(remark,))
    stamps_s = footage.stamps.rgb.seconds
    compressed = coding(footage, frames)
    with ThreadPoolExecutor(1) as beside:  # depth is worked on while colour is
        depth = (
            beside.submit(_depth_figures, footage, frames, steps, found.figures[LATE]) if footage.has_depth else None
        )
        colour = colour_noise(footage, frames, jpeg=compressed.jpeg)
        fixed = fixed_noise(footage, frames, jpeg=compressed.jpeg)
        figures = [*colour.figures, *fixed, *compressed.figures, *inertial]
        figures += blur_figures(footage, evenly_between(frames, stamps_s))
        light = light_figures(light_of(footage, runs_of(len(footage), LIGHT_FRAMES, parts=2)))
        if steps is not None:
            figures += _readouts(readout(without_gaps(steps, stamps_s), footage.rate_hz), light)
        figures += [*shaking(footage, steps), *light]
        figures += depth.result() if depth is not None else ()
    remarks = (*((colour.remark,) if colour.remark else ()), *compressed.remarks)
    return replace(
        found,
        figures=found.figures | {figure.name: figure for figure in figures},
        remarks=remarks,
        read=len(footage.read),
    )


def _depth_figures(
    footage: RecordingView, frames: Sequence[int], steps: Steps | None, late: Figure
) -> tuple[Figure, ...]:
    """Return the figures of depth's noise. late: of depth, beside what its stamps say. frames: if none are in a row."""
    if steps is None or not len(steps):
        return depth_noise(footage, frames).figures
    stamps = footage.stamps
    stamped = (footage.rate_hz or 1.0) * depth_stamps_later_s(stamps.rgb.seconds, stamps.depth.seconds)
    registered = Registered(footage, steps, (late.value or 0.0) + stamped)
    return depth_noise(footage, evenly(registered.frames, NOISE_FRAMES), registered).figures


def _readouts(by_motion: Sequence[Figure], light: Sequence[Figure]) -> Iterator[Figure]:
    """Yield the readouts by motion; that from top to bottom by bands of flicker, where these tell it more exactly."""
    by_bands = next(figure for figure in light if figure.name == READOUT)
    for figure in by_motion:
        down = figure.name == READOUTS[0] and by_bands.half_width < figure.half_width
        yield replace(by_bands, name=figure.name) if down else figure


def remarks_on(source: Source, camera: Intrinsics, making: int) -> Iterator[str]:
    """Yield what a run should say of a scene before it makes frames, a line for each fault.

    making: how many images the run makes of it: it looks at one frame for each ONE_OF of them.
    Raises InputError where a file that is looked at is damaged.
    """
    yield from source.remarks(camera)
    if not source.capabilities.recorded:
        return
    looked_at = making // ONE_OF
    yield from look_at("", source, camera, 0 if looked_at < LEAST_LOOK else min(looked_at, MOST_LOOK)).faults


def _busy(footage: RecordingView) -> Sequence[float]:
    """Return how much the camera's turning changes around each frame, by the IMU; nothing without one."""
    if footage.imu is None:
        return ()
    samples, stamps_s = footage.imu.samples, footage.stamps.rgb.seconds
    at_s = samples.stamps_ns / 1e9
    rates = np.stack([np.interp(stamps_s, at_s, column) for column in samples.rate_rad_s.T], axis=1)
    return np.concatenate([[0.0], np.linalg.norm(np.diff(rates, axis=0), axis=1)]).tolist()


# --- figures, and the faults that they are ---


def _stamps(heap: _Heap, footage: RecordingView) -> None:
    figures = stamp_figures(footage.stamps.rgb.seconds)
    heap.add(*figures)
    rate, jitter, gap, missing = (figure.value for figure in figures)
    if rate is None or jitter is None or gap is None or missing is None:
        return
    if missing > MISSING * len(footage):
        share = missing / (len(footage) + missing)
        frames = "1 frame is" if round(missing) == 1 else f"{missing:.0f} frames are"
        heap.fault(
            "missing_frames", f"{frames} missing by the time stamps ({share:.0%}), the longest gap is {gap:.3g} s"
        )
    if jitter * rate > JITTER:
        heap.fault("jitter_s", f"time stamps jitter by {1e3 * jitter:.3g} ms, {jitter * rate:.0%} of a frame")


def _steps(heap: _Heap, footage: RecordingView, steps: Steps) -> None:
    """Add which frames are doubled, and what has no depth."""
    _doubles(heap, doubled(steps, steps.same, "doubled_share", steps.change), "colour")
    if not footage.has_depth:
        return
    _doubles(heap, doubled(steps, steps.same_depth, "doubled_depth_share", None), "depth")
    void, empty = void_figures(steps.void)
    heap.add(void, empty)
    if empty.value is not None and empty.value > EMPTY:
        heap.fault(empty.name, f"{empty.value:.0%} of the frames that were looked at have no depth at all")


def _late(heap: _Heap, footage: RecordingView, steps: Steps, runs: Sequence[range], *, fine: bool) -> int:
    """Add how late depth is; return by how many frames, where it is a fault."""
    if not footage.has_depth:
        return 0
    stamps_s = footage.stamps.rgb.seconds
    late, drift = depth_lateness(per_frame(steps, stamps_s), stamps_s)
    shifted = round(late.value) if late.value is not None and late.sure_beyond(LATE_FRAMES) else 0
    if (
        shifted and not fine
    ):  # again with the depth that belongs to each frame, as motion by colour is measured with depth too
        steps = steps_of(footage, runs, fine=fine, depth_later=shifted)
        more, again = depth_lateness(per_frame(steps, stamps_s), stamps_s)
        late, drift = (late, drift) if more.value is None else (more.plus(shifted), again)
    if fine and len(steps):
        late = lateness_of_planes(footage, steps, late)
        shifted = round(late.value) if late.value is not None and late.sure_beyond(LATE_FRAMES) else 0
    # Stamps that say the same are no fault.
    rate_hz = footage.rate_hz or 1.0
    stamped = rate_hz * depth_stamps_later_s(footage.stamps.rgb.seconds, footage.stamps.depth.seconds)
    late = late.plus(-stamped)
    heap.add(late, drift)
    if late.value is not None and late.sure_beyond(LATE_FRAMES):
        way, shown = ("late", "earlier") if late.value > 0 else ("early", "later")
        heap.fault(
            LATE,
            f"depth is {abs(late.value):.2f} frames ({abs(late.value) / rate_hz * 1e3:.0f} ms, within "
            f"{late.half_width:.2f} frames) {way}: it shows what colour shows so much {shown}; pair them anew",
        )
    return shifted


def _doubles(heap: _Heap, found: Doubled, whose: str) -> None:
    heap.add(found.share)
    share = found.share.value
    if share is None or share < (DOUBLED if found.every else UNEVENLY):
        return
    every = f"every {_ordinal(found.every)} image of {whose} is"
    often = every if found.every else f"{share:.1%} of the images of {whose} are"
    how = "equal to" if found.exact else "all but equal to"
    heap.fault(
        found.share.name,
        f"{often} doubled, {how} the one before ({share:.1%} of {found.share.samples} looked at); "
        "leave the doubles out",
    )


def _ordinal(number: int) -> str:
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10 if number % 100 not in (11, 12, 13) else 0, "th")
    return f"{number}{ending}"


def _clock(heap: _Heap, clock: Figure, by_poses: Figure) -> None:
    """Say how far the IMU's clock is off: by poses where images do not speak against them, as they are more exact."""
    best, against = clock, "the images"
    if by_poses.value is not None:
        wide = 2 * (clock.half_width + by_poses.half_width)
        agrees = clock.value is not None and abs(clock.value - by_poses.value) < wide
        if clock.value is None or (agrees and by_poses.half_width < clock.half_width):
            best, against = by_poses, "the poses and the images" if agrees else "the poses"
    exact = best is by_poses or best.half_width < EXACT_S
    if best.value is not None and exact and best.sure_beyond(CLOCK_S):
        way = "ahead of" if best.value > 0 else "behind"
        heap.fault(
            best.name,
            f"the IMU's clock is {1e3 * abs(best.value):.1f} ms {way} {against} (within "
            f"{1e3 * best.half_width:.1f} ms); take {1e3 * best.value:.1f} ms from its stamps",
        )


def _geometry(heap: _Heap, footage: RecordingView, later: int, *, edges: bool) -> None:
    found: Parallax = parallax(footage, later)
    heap.add(found.factor)
    if found.remark:
        heap.fault("poses" if found.reading != AS_READ else found.factor.name, found.remark)
    if not footage.has_depth:
        return
    if edges:
        frames = np.unique(np.linspace(0, len(footage) - 1, EDGE_FRAMES).round().astype(int)).tolist()
        lies: Calibration = calibration(footage, frames, later)
        heap.add(lies.angle_deg, lies.zoom)
        _lies(heap, lies)
    else:
        heap.add(*(Figure.none(name, "no edges are looked at") for name in (ANGLE, ZOOM)))


def _lies(heap: _Heap, lies: Calibration) -> None:
    angle, zoom = lies.angle_deg, lies.zoom
    if angle.value is None or zoom.value is None or lies.turn_deg is None:
        return
    if angle.sure_beyond(ANGLE_DEG) and abs(zoom.value) < ZOOMED:
        down, across, roll = lies.turn_deg
        heap.fault(
            ANGLE,
            f"depth lies {angle.value:.2f} degrees beside colour (within {angle.half_width:.2f}): edges meet where "
            f"it is turned by {down:.2f}, {across:.2f}, {roll:.2f} degrees about x, y, z; mend the calibration",
        )
