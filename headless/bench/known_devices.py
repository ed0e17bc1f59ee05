# SPDX-License-Identifier: GPL-3.0-or-later
"""Known in, known out: random devices are put on clean walks of three rooms and measured again.

    python headless/bench/known_devices.py                        60 devices, 20 in each of three rooms
    python headless/bench/known_devices.py --rooms 2 --devices 6  some of one room, to tune by
    python headless/bench/known_devices.py --kept FOLDER          keep the walks there, and take those that are there

Prints a row for each parameter: how often it could be told; came back within 10 %; was covered by its 95 % interval;
either. What is known of a parameter is what was put in, in closed form, and nothing that `measure` calculates.
"""

import argparse
import json
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon")]

import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.core.geometry import Intrinsics, rotation_from_rotvec
from noisy_world.core.progress import PlainProgress
from noisy_world.core.schema import ConfigPath
from noisy_world.core.trajectory import FrameStamps, Trajectory
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.run import Run
from noisy_world.images.pixels import as_bytes
from noisy_world.measure.figure import Figure
from noisy_world.measure.lateness import imu_clock_by_poses
from noisy_world.measure.looking import RecordingFigures, measured
from noisy_world.measure.twin import Twin, twin_of
from noisy_world.preset.keys import check_document
from noisy_world.sources.recording import Recording, read_recording
from noisy_world.trajectories.rig import Imu, ImuModel, RecordedImu, Rig, Sensor, measure

Values = dict[str, Any]

ROOMS = (2, 5, 6)  # seeds of embedded rooms; the figures were tuned on the first alone
DEVICES, BODIES = 20, 4  # a room; a body has one IMU and one lateness of depth
FRAMES, RATE_HZ = 56, 30.0
CAMERA = {"width": 320, "height": 240, "fx": 250.0, "fy": 250.0, "cx": 159.5, "cy": 119.5}
WITHIN = 0.1  # relative
LATE_FRAMES, CORRELATION, EXACTLY = 0.1, 0.1, 1e-3
EXPOSED_MS = 4.0  # by which flicker is seen where no shutter says it; its own default
LEAST_SWING = 0.01
SHAKEN, SHAKEN_HZ = 0.25, (4.0, 8.0)  # share of the devices that shake, and the octave in which
LAGS_PX = (1, 2, 4)
STRAIGHT = {"from_m": 0.0, "linear": 0.0, "steep": 0.0, "lateral_px": 0.0, "lateral_steep_px": 0.0}
HOLE_LAW = (
    ("least light", "least_light", "hole_least_light"),
    ("spread", "reflectance_spread", "hole_light_spread"),
    ("size of clumps", "clump_px", "hole_clump_px"),
    ("frames of clumps", "clump_frames", "hole_clump_frames"),
)
CLOCK_S, MOSTLY = 60.0, 0.7
HOT_LEVELS = 80, 150  # of 255, what a hot pixel is brighter by
MOST_HOT = 255  # of 255 that it reaches


@dataclass(frozen=True)
class Device:
    """What is put on a walk. steps: perturbations of its setting. Others are done to what the generator wrote.

    quality: of JPEG, 0: none. row_std, hot_share: of full scale, and of the pixels. jitter_s: deviation of the stamps.
    drops: frames that are lost. late_frames: of depth. clock_ppm: how much faster the
    IMU's clock goes, over a path of CLOCK_S, as walks are too short.
    """

    name: str
    steps: tuple[Values, ...]
    imu: ImuModel
    late_frames: float
    quality: int = 0
    row_std: float = 0.0
    hot_share: float = 0.0
    jitter_s: float = 0.0
    drops: int = 0
    seed: int = 0
    clock_ppm: float = 0.0

    def given(self, perturbation: str) -> Values:
        """Return a step's parameters; none where it is no step of this."""
        return next((step[perturbation] for step in self.steps if perturbation in step), {})

    @property
    def earlier_frames(self) -> tuple[int, float]:
        """How many whole frames depth is early by, and what is left: what shows later is exposed later."""
        whole = int(np.floor(-self.late_frames))
        return whole, -self.late_frames - whole


def drawn_devices(room: int, count: int, seed: int) -> list[list[Device]]:
    """Return a room's devices, by body: those of one share what is of its rig."""
    made: list[list[Device]] = []
    for body in range(BODIES):
        rng = np.random.default_rng([seed, room, body])
        late = round(float(rng.uniform(-3, 3)), 2) if body else 0.0
        imu = ImuModel(_log(rng, 1e-4, 5e-3), 0.0, _log(rng, 1e-3, 5e-2))
        made.append([_drawn(rng, f"d{room}_{place}", late, imu) for place in range(body, count, BODIES)])
    return made


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")


def _drawn(rng: np.random.Generator, name: str, late: float, imu: ImuModel) -> Device:
    def often(share: float) -> bool:
        return bool(rng.random() < share)

    def even(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 4)

    steps: list[Values] = []
    if often(0.2):
        steps.append({"camera_motion_blur": {"shutter_ms": even(3, 16)}})
    if often(0.35):
        steps.append({"rolling_shutter": {"readout_ms": even(6, 30)}})
    if often(0.3):
        steps.append({"gaussian_blur": {"sigma_px": even(0.7, 2.5)}})
    if often(0.4):
        steps.append({"vignetting": {"corner_loss": even(0.15, 0.6)}})
    if often(0.25):
        steps.append({"flicker": {"modulation": even(0.05, 0.3)}})
    if often(0.9):
        steps.append({"gaussian_noise": {"std": _log(rng, 0.008, 0.06)}})
    if often(0.5):
        steps.append({"shot_noise": {"photons": round(_log(rng, 20, 250))}})
    law = STRAIGHT | {"offset_m": _log(rng, 3e-4, 3e-3), "quadratic_per_m": _log(rng, 8e-4, 4e-3)}
    if often(0.6):
        law |= {"correlation_px": even(2, 6), "correlation_share": even(0.4, 0.9)}
        law |= {"correlation_frames": int(rng.integers(1, 9))}
    steps.append({"axial_noise": law})
    if often(0.5):
        steps.append({"depth_random_missing": {"missing_percent": even(2, 20)}})
    device = Device(
        name,
        tuple(steps),
        imu,
        late,
        quality=int(rng.integers(55, 98)) if often(0.3) else 0,
        row_std=_log(rng, 0.004, 0.03) if often(0.25) else 0.0,
        hot_share=_log(rng, 5e-4, 5e-3) if often(0.25) else 0.0,
        jitter_s=_log(rng, 3e-4, 4e-3) if often(0.5) else 0.0,
        drops=int(rng.integers(1, 7)) if often(0.5) else 0,
        seed=int(rng.integers(1 << 30)),
    )
    # Drawn last, so that all before is as it was.
    law |= _hole_law(rng, steps)
    device = replace(device, clock_ppm=even(-400, 400))
    return replace(device, steps=(*_shaking(rng), *device.steps))


def _hole_law(rng: np.random.Generator, steps: Sequence[Values]) -> Values:
    """Return parameters of holes by light for most devices that lose none at random."""
    if rng.random() > MOSTLY or any("depth_random_missing" in step for step in steps):
        return {}
    spread, px = (round(float(rng.uniform(*ends)), 3) for ends in ((0.4, 1.5), (4, 16)))
    light = {"least_light": _log(rng, 0.02, 0.08), "reflectance_spread": spread}
    return light | {"clump_px": px, "clump_frames": int(rng.integers(1, 6))}


def _shaking(rng: np.random.Generator) -> list[Values]:
    """Return the step of a hand or a body that shakes in an octave, for some devices."""
    if rng.random() > SHAKEN:
        return []
    low_hz, high_hz = SHAKEN_HZ
    by = {"translation_m": _log(rng, 1e-3, 1e-2), "rotation_deg": _log(rng, 0.1, 1.0)}
    return [{"vibration": {"source": "band", "low_hz": low_hz, "high_hz": high_hz, **by}}]


# --- put on a walk ---


def walk_of(room: int, devices: list[Device], folder: Path) -> None:
    """Make a walk through a room as the generator writes it for these devices, which share a body."""
    document = {
        "seed": 100 + room,
        "scenes": [
            {
                "name": "walk",
                "mesh": f"embedded:room?seed={room}",
                "trajectory": {"handheld": {"frames": FRAMES, "rate_hz": RATE_HZ, "seed": room, "speed_m_s": 0.8}},
            }
        ],
        "camera": CAMERA,
        "render": {"engine": "embree", "backend": "reference", "processors": "any"},
        "rig": {
            "imu": {"gyro_noise_density": devices[0].imu.gyro_noise_density},
            "depth": {"delay_ms": round(1e3 * devices[0].earlier_frames[1] / RATE_HZ, 6)},
        },
        "settings": [{"name": device.name, "perturb": list(device.steps)} for device in devices],
        "output": {"layout": "euroc", "colour": "rgb", "overview": False},
    }
    plan = make_plan(check_document(document, folder / "preset.yaml"))
    Run(plan, folder, progress=PlainProgress(sys.stderr), stop=threading.Event()).make_dataset()


@dataclass(frozen=True)
class Finished(Recording):
    """A recording whose colour is finished by a device: rows, hot pixels, JPEG."""

    device: Device | None = None

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator[Any]:
        """Prepare to read frames."""
        device = self.device
        assert device is not None, "it is a device's"
        with super().prepare(camera, note) as opened:
            made = SimpleNamespace()

            def frame(request: Any) -> Any:
                seen: Any = opened.frame(request)
                data, colour = encoded(request.frame, as_bytes(np.asarray(seen.rgb)))
                if data:
                    colour = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
                return SimpleNamespace(rgb=colour, depth_m=seen.depth_m)

            def encoded(number: int, colour: NDArray[np.uint8]) -> tuple[bytes, NDArray[np.uint8]]:
                colour = with_rows_and_hot(device, number, colour)
                if not device.quality:
                    return b"", colour
                options = [cv2.IMWRITE_JPEG_QUALITY, device.quality]
                return cv2.imencode(".jpg", colour[..., ::-1], options)[1].tobytes(), colour

            def encoded_colour(number: int) -> bytes:
                colour = cv2.imread(str(self.stored.rgb_files[number]), cv2.IMREAD_COLOR_RGB)
                return encoded(number, np.asarray(colour, np.uint8))[0]

            made.frame, made.encoded_colour, made.open = frame, encoded_colour, lambda *_: made
            yield made


def with_rows_and_hot(device: Device, frame: int, colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image (H, W, 3) with rows' own brightness, drawn for each frame, and pixels that are always hot."""
    made = colour.astype(np.float64)
    if device.row_std:
        rng = np.random.default_rng([device.seed, 1, frame])
        made += 255 * device.row_std * rng.standard_normal((len(made), 1, 1))
    if device.hot_share:
        rng = np.random.default_rng([device.seed, 2])
        pixels = made.shape[0] * made.shape[1]
        hot = rng.permutation(pixels)[: round(pixels * device.hot_share)]
        made.reshape(-1, 3)[hot, rng.integers(0, 3, len(hot))] += rng.uniform(*HOT_LEVELS, len(hot))
    return np.clip(np.rint(made), 0, MOST_HOT).astype(np.uint8)


@dataclass(frozen=True)
class Put:
    """A device on a walk. stamps_off_s: (N,) what stamps of its frames are off by. lost: frames between these.

    late_frames: of the depth that a frame has, as the generator stamped it.
    """

    device: Device
    source: Finished
    stamps_off_s: NDArray[np.float64]
    frames: NDArray[np.int64]
    late_frames: float
    lost: tuple[int, ...]


def put_on(device: Device, folder: Path) -> Put:
    """Return a device's recording of a walk that the generator wrote for it."""
    source = read_recording(folder / device.name / "walk", ConfigPath("known devices"))
    stored = source.stored
    rng = np.random.default_rng([device.seed, 3])
    count = len(stored.rgb_files)
    lost = tuple(sorted(int(frame) for frame in rng.permutation(np.arange(2, count - 2))[: device.drops]))
    whole = device.earlier_frames[0]
    kept = [frame for frame in range(count) if frame not in lost and 0 <= frame + whole < count]
    off_s = np.round(device.jitter_s * rng.standard_normal(count), 9)[kept]
    stamps_s = stored.stamps.rgb.seconds[kept] + off_s
    samples = (
        measure(stored.trajectory, replace(stored.imu.samples.imu, model=device.imu), 0, (device.seed, "imu"))
        if stored.imu
        else None
    )
    imu = None if samples is None or stored.imu is None else replace(stored.imu, samples=samples)
    shown = replace(
        stored,
        rgb_files=tuple(stored.rgb_files[frame] for frame in kept),
        depth_files=tuple(stored.depth_files[frame + whole] for frame in kept),
        trajectory=stored.trajectory.at(kept, stored.stamps.rgb.seconds[kept]),
        stamps=FrameStamps.of(stamps_s),
        imu=imu,
    )
    inside = tuple(frame for frame in lost if kept[0] < frame < kept[-1])
    # Readers pair colour with the depth that is nearest in time, which may be that of the frame before.
    exposed = stored.stamps.depth.seconds[[frame + whole for frame in kept]] - stored.stamps.rgb.seconds[kept]
    late_frames = -RATE_HZ * float(np.median(exposed))
    finished = Finished(shown, source.place, device=device)
    return Put(device, finished, off_s, np.array(kept), late_frames, inside)


# --- what is known, and what came back ---


@dataclass
class Case:
    """A parameter of a device. known: what was put in. value, low, high: what came back; None: it was not told."""

    parameter: str
    device: str
    known: float
    value: float | None
    low: float | None
    high: float | None
    allowed: float  # absolute
    why: str = ""

    @property
    def within(self) -> bool:
        """Whether it came back as near as is asked for."""
        return self.value is not None and abs(self.value - self.known) <= self.allowed

    @property
    def covered(self) -> bool:
        """Whether its interval has what was put in."""
        if self.low is None or self.high is None:
            return False
        edge = 1e-9 * abs(self.known)
        return self.low - edge <= self.known <= self.high + edge


@dataclass(frozen=True)
class Known:
    """A parameter that was put in, and the figure that it is to come back as, so near."""

    parameter: str
    value: float
    figure: str
    allowed: float

    def case(self, device: str, found: RecordingFigures) -> Case:
        """Return what came back."""
        figure = found.figures.get(self.figure, Figure.none(self.figure, "there is no such figure"))
        back = figure.value, figure.low, figure.high
        return Case(self.parameter, device, self.value, *back, allowed=self.allowed, why=figure.untold)


def share(parameter: str, value: float, figure: str) -> Known:
    """Return a parameter that has to come back within WITHIN of itself."""
    return Known(parameter, value, figure, WITHIN * abs(value))


def cases_of(put: Put, found: RecordingFigures, twin: Twin) -> Iterator[Case]:
    """Yield what is known of a device beside what was measured."""
    known_of = (_of_pixels, _of_light, _of_motion, _of_depth)
    for known in (*(each for of in known_of for each in of(put.device)), *_of_clocks(put)):
        yield known.case(put.device.name, found)
    yield from _sigmas(put.device, found, twin)
    yield _clock_case(put.device)


def _of_pixels(device: Device) -> Iterator[Known]:
    if std := device.given("gaussian_noise").get("std"):
        yield share("colour noise, even part", std, "colour_gaussian_std")
    if photons := device.given("shot_noise").get("photons"):
        yield share("colour noise, of photons", 1 / photons, "colour_variance_per_intensity")
    if device.quality:
        yield Known("JPEG quality", device.quality, "jpeg_quality", 0.0)
    if device.row_std:
        yield share("rows", device.row_std, "row_noise_std")
    if device.hot_share:
        yield share("hot pixels", device.hot_share, "hot_pixel_share")


def _of_light(device: Device) -> Iterator[Known]:
    if loss := device.given("vignetting").get("corner_loss"):
        yield share("vignetting", loss, "vignetting_corner_loss")
    shutter_ms = device.given("camera_motion_blur").get("shutter_ms")
    seen = device.given("flicker").get("modulation", 0.0) * abs(float(np.sinc((shutter_ms or EXPOSED_MS) / 10)))
    if seen > LEAST_SWING:
        yield share("flicker", seen, "flicker_swing_100_hz")
    if sigma_px := device.given("gaussian_blur").get("sigma_px"):
        yield share("blur of the lens", sigma_px, "defocus_sigma_px")
    if shutter_ms:
        yield share("exposure by motion blur", shutter_ms, "exposure_ms")
    if readout_ms := device.given("rolling_shutter").get("readout_ms"):
        yield share("readout", readout_ms, "readout_down_ms")


def _of_motion(device: Device) -> Iterator[Known]:
    """Yield what a device shakes by; a walk's own is a hundredth of the least of it in this octave."""
    if shaken := device.given("vibration"):
        octave = "{:g}_to_{:g}_hz".format(*SHAKEN_HZ)
        yield share("shaking, turns", shaken["rotation_deg"], f"shake_turn_deg_{octave}")
        yield share("shaking, shifts", shaken["translation_m"], f"shake_shift_m_{octave}")


def _of_depth(device: Device) -> Iterator[Known]:
    law = device.given("axial_noise")
    px, part = law.get("correlation_px", 0.0), law.get("correlation_share", 0.0)
    for lag in LAGS_PX:
        known = part * float(np.exp(-((lag / px) ** 2))) if px else 0.0
        yield Known(f"correlation at {lag} px", known, f"depth_correlation_{lag}_px", CORRELATION)
    in_time = part * (1 - 1 / law.get("correlation_frames", 1))
    yield Known("correlation in time", in_time, "depth_correlation_1_frame", CORRELATION)
    if holes := device.given("depth_random_missing").get("missing_percent"):
        yield share("holes", holes / 100, "void_share")
    for parameter, key, figure in HOLE_LAW:
        if law.get("least_light"):
            yield share(f"hole law, {parameter}", law[key], figure)


def _clock_case(device: Device) -> Case:
    """Return how an IMU's clock drifts against the poses of a minute; no image is seen."""
    at_s = np.arange(0, CLOCK_S, 1 / RATE_HZ)
    rng = np.random.default_rng([device.seed, 4])
    hz, phase, weight = rng.uniform(0.1, 1.0, (6, 5)), rng.uniform(0, 2 * np.pi, (6, 5)), rng.normal(0, 0.1, (6, 5))
    waves = np.sum(weight * np.sin(2 * np.pi * hz * at_s[:, None, None] + phase), axis=2)
    c2w = np.tile(np.eye(4), (len(at_s), 1, 1))
    c2w[:, :3, :3], c2w[:, :3, 3] = rotation_from_rotvec(waves[:, :3]), waves[:, 3:]
    path, eye = Trajectory(c2w, at_s), np.eye(4)
    imu = Imu(eye, device.imu, time_offset_s=0.01, clock_drift_ppm=device.clock_ppm)
    samples = measure(path, imu, 0, (device.seed, "clock"))
    recorded = RecordedImu(Rig(Sensor(eye), None, imu), samples, Path())
    drift = imu_clock_by_poses(recorded, path, at_s)[1]
    known = Known("drift of an IMU's clock", device.clock_ppm, drift.name, WITHIN * abs(device.clock_ppm))
    return known.case(device.name, RecordingFigures("", 0, (0, 0), 0.0, 0, {drift.name: drift}))


def _of_clocks(put: Put) -> Iterator[Known]:
    device = put.device
    yield Known("lateness of depth", put.late_frames, "depth_late_frames", LATE_FRAMES)
    if device.jitter_s:
        # Rate and beginning are the clock's own: jitter is what stamps have beside the nearest even clock.
        line = np.polyval(np.polyfit(put.frames, put.stamps_off_s, 1), put.frames)
        jitter_s = float(np.sqrt(np.mean((put.stamps_off_s - line) ** 2)))
        yield Known("jitter", jitter_s, "jitter_s", EXACTLY * jitter_s)
    yield Known("drops", len(put.lost), "missing_frames", 0.0)
    yield share("noise of the gyroscope", device.imu.gyro_noise_density, "gyro_noise_density")
    yield share("noise of the accelerometer", device.imu.accel_noise_density, "accel_noise_density")


def _sigmas(device: Device, found: RecordingFigures, twin: Twin) -> Iterator[Case]:
    """Yield the deviation of depth at each distance that was seen, by the law that the twin has."""
    law = device.given("axial_noise")
    back = (twin.sensor or {}).get("axial_noise")
    for figure in found.figures.values():
        if figure.curve != "depth_noise_m" or figure.value is None or figure.at is None:
            continue
        known = law["offset_m"] + law["quadratic_per_m"] * figure.at**2
        case = Case("sigma(z)", device.name, known, None, None, None, allowed=WITHIN * known, why="no law came back")
        if back is None:
            yield case
            continue
        value = back["offset_m"] + back["quadratic_per_m"] * figure.at**2
        low, high = (None if end is None else value * end / figure.value for end in (figure.low, figure.high))
        yield replace(case, value=value, low=low, high=high, why="")


# --- the table ---


@dataclass
class ParameterRow:
    """How often a parameter came back."""

    cases: list[Case] = field(default_factory=list[Case])

    def line(self, parameter: str) -> str:
        """Return a row of the table."""
        known = [case for case in self.cases if case.value is not None]
        of = len(known)
        if not of:
            return f"| {parameter} | 0 of {len(self.cases)} | | | | not told |"
        within, covered = (sum(getattr(case, name) for case in known) for name in ("within", "covered"))
        either = sum(case.within or case.covered for case in known)
        off = float(np.median([abs(case.value / case.known - 1) for case in known if case.value and case.known] or [0]))
        met = "yes" if either >= 0.9 * of else "no"
        shares = (f"{100 * part / of:.0f} %" for part in (within, covered, either))
        return f"| {parameter} | {of} of {len(self.cases)} | {' | '.join(shares)} | {100 * off:.1f} % | {met} |"


def table(cases: list[Case]) -> Iterator[str]:
    """Yield the lines of the table."""
    yield "| parameter | told | near | covered | either | median off | 90 % or more |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    rows: dict[str, ParameterRow] = {}
    for case in cases:
        rows.setdefault(case.parameter, ParameterRow()).cases.append(case)
    for parameter in sorted(rows):
        yield rows[parameter].line(parameter)


def measured_again(put: Put) -> list[Case]:
    """Return what came back of a device."""
    camera = put.source.camera(None)
    found = measured(put.device.name, put.source, camera)
    return list(cases_of(put, found, twin_of(found, camera, None)))


def main(arguments: list[str]) -> int:
    """Make walks, measure, and print the table."""
    parser = argparse.ArgumentParser(prog="known_devices.py", description="Random devices, measured again.")
    parser.add_argument("--rooms", type=int, nargs="+", default=list(ROOMS), help="seeds of embedded rooms")
    parser.add_argument("--devices", type=int, default=DEVICES, help="of each room")
    parser.add_argument("--seed", type=int, default=0, help="of the devices")
    parser.add_argument("--kept", type=Path, help="a folder for the walks, which are taken from it if they are there")
    parser.add_argument("--walks", action="store_true", help="make the walks alone")
    parser.add_argument("--json", type=Path, help="a file for every case")
    parser.add_argument("--of", type=Path, nargs="+", default=[], help="print the table of such files alone")
    options = parser.parse_args(arguments)
    cases = [_case(content) for file in options.of for content in json.loads(file.read_text())]
    with tempfile.TemporaryDirectory() as scratch:
        for device, walk in _walks(options, options.kept or Path(scratch)):
            if options.walks:
                continue
            cases += measured_again(put_on(device, walk))
            print(f"{device.name} measured", file=sys.stderr, flush=True)
            if options.json:
                options.json.write_text(json.dumps([asdict(case) for case in cases], indent=1))
    print("\n".join(table(cases)))
    for case in cases:
        if case.value is not None and not (case.within or case.covered):
            within = f"({case.low:.4g} to {case.high:.4g})" if case.low is not None and case.high is not None else ""
            print(f"missed: {case.parameter} of {case.device}: {case.known:.4g} came back as {case.value:.4g} {within}")
    return 0


def _walks(options: argparse.Namespace, folder: Path) -> Iterator[tuple[Device, Path]]:
    """Yield each device with the folder of its body's walk, which is made where it is not there."""
    if options.of:
        return
    for room in options.rooms:
        for body, devices in enumerate(drawn_devices(room, options.devices, options.seed)):
            walk = folder / f"room{room}_{options.seed}_{options.devices}_{body}"
            if devices and not (walk / "manifest.json").is_file():
                walk_of(room, devices, walk)
            yield from ((device, walk) for device in devices)


def _case(content: Mapping[str, Any]) -> Case:
    return Case(**content)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
