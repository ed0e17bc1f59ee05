# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of the ASL format as EuRoC has them, read and written: data.csv with nanoseconds, sensor.yaml, an IMU's.

Where these files lie in a sequence is decided in `euroc`.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.file_access import finite_number, open_regular
from ..core.geometry import (
    Intrinsics,
    continuous_quats,
    invert_pose,
    nearest_rotation,
    pose,
    quat_wxyz_from_rotation,
    rotation_error,
)
from ..core.lens import Distortion
from ..core.schema import quoted, read_yaml
from ..core.trajectory import NS_PER_S, Stamps, Trajectory, rounded_numbers, rounded_poses
from ..trajectories.formats import read_trajectory
from ..trajectories.rig import Imu, ImuModel, ImuSamples, ImuStates, RecordedImu, Rig, Sensor
from .cam_params import checked_distortion
from .layout import IMU_FILES, SequenceFacts, lines
from .stored_recording import StampedFiles, StoredSequence, checked_depth_scale, checked_intrinsics, recorded_text

STAMP_DIGITS = 19  # as many as the largest 64-bit integer has: equally long names sort by time
LARGEST_NS = 2**63 - 1  # readers hold stamps in signed 64-bit integers; 292 years
IMAGES_HEADER = "#timestamp [ns],filename"
# The first columns of EuRoC's own header.
POSES_HEADER = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
DEPTH_SCALE_KEY = "depth_scale_per_m"

# Kalibr's and ROS's names for the two models.
_MODELS = {"radtan": "radial-tangential", "plumb_bob": "radial-tangential", "equi": "equidistant"} | {
    name: name for name in ("radial-tangential", "equidistant")
}

# As for trajectory files: rounding is mended, anything more is a mistake and refused.
_ROTATION_TOLERANCE = 5e-3


# --- time stamps ---


def stamp_text(stamp_ns: int) -> str:
    """Return a stamp as in the images' names: nanoseconds, 19 digits."""
    return f"{stamp_ns:0{STAMP_DIGITS}d}"


def stamps_problem(stamps_ns: Sequence[int], what: str = "frame") -> str:
    """Return why stamps in nanoseconds cannot name files or rows, or "" where they can. what: has these stamps."""
    order = sorted(range(len(stamps_ns)), key=stamps_ns.__getitem__)
    for place, frame in enumerate(order):
        stamp_ns = stamps_ns[frame]
        if not 0 <= stamp_ns <= LARGEST_NS:
            seconds = f"{stamp_ns / NS_PER_S!r} s"
            return f"{what} {frame} is at {seconds}, but names are nanoseconds from 0 to {LARGEST_NS}"
        if place and stamp_ns == stamps_ns[order[place - 1]]:
            return f"{what} {frame} has the time stamp of the frame before, in the nanoseconds that name it"
    return ""


# --- data.csv ---


def images_csv(names: Sequence[str]) -> str:
    """Return the list of a camera's images, which are named after their stamps."""
    return lines([IMAGES_HEADER, *(f"{name.partition('.')[0]},{name}" for name in names)])


def poses_csv(path: Trajectory, stamps_ns: Sequence[int]) -> str:
    """Return the poses of a body: t [ns], p [m], q (w first), body-to-world; numbers read back to the same float64."""
    return lines([POSES_HEADER, *stamped_rows(map(stamp_text, stamps_ns), pose_columns(path.c2w))])


def pose_columns(c2w: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses (N, 4, 4) as rows (N, 7): p [m], q with w first, its signs chosen so that it never jumps."""
    return np.concatenate([c2w[:, :3, 3], continuous_quats(quat_wxyz_from_rotation(c2w[:, :3, :3]))], axis=1)


def stamped_rows(stamps: Iterable[object], values: NDArray[np.float64]) -> Iterator[str]:
    """Yield a line for each row (N, D): its stamp, and numbers that read back to the same float64."""
    for stamp, row in zip(stamps, (values + 0.0).tolist(), strict=True):  # + 0.0 turns -0.0 into 0.0
        yield ",".join([str(stamp), *map(repr, row)])


def read_images_csv(path: Path) -> StampedFiles:
    """Read the list of a camera's images, which lie in the folder `data` beside it."""
    stamps_ns: list[int] = []
    files: list[Path] = []
    for where, cells in _rows(path):
        if len(cells) != 2 or not cells[1]:
            raise InputError(path, "is no time stamp and file name", where=where, remedy=f"as in {IMAGES_HEADER}")
        stamps_ns.append(_stamp_ns(path, where, cells[0]))
        files.append(path.parent / "data" / cells[1])
    if not files:
        raise InputError(path, "lists no image")
    stamps = Stamps.of_ns(stamps_ns)
    _check_order(path, stamps.seconds)
    return StampedFiles(stamps, tuple(files))


def exact_stamps(path: Path, poses: Trajectory) -> Stamps:
    """Return the stamps of the poses of a file to the nanosecond, where it says them so; else the poses' own."""
    own = Stamps(poses.stamps_s)
    cells = [row[0] for _, row in _rows(path)]
    if not all(map(_is_whole, cells)):
        return own
    stamps = Stamps.of_ns(map(int, cells))
    stamps = stamps.take(np.flatnonzero(np.diff(stamps.seconds, prepend=-np.inf) > 0.0))  # as the poses' reader does
    return stamps if np.array_equal(stamps.seconds, own.seconds) else own


def read_poses_csv(path: Path) -> Trajectory:
    """Read the poses of a body, body-to-world; of 17 columns the last nine (velocities and biases) are not needed."""
    return read_trajectory(path, format="euroc")


def _rows(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield for each row where it is ("line 3"), and its cells without the blanks around them."""
    for number, line in enumerate(recorded_text(path).splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield f"line {number}", [cell.strip() for cell in line.split(",")]


def _stamp_ns(path: Path, where: str, cell: str) -> int:
    if not (_is_whole(cell) and int(cell) <= LARGEST_NS):
        raise InputError(path, f"{cell!r} is no time in whole nanoseconds", where=where)
    return int(cell)


def _is_whole(cell: str) -> bool:
    return cell.isascii() and cell.isdecimal() and len(cell) <= STAMP_DIGITS


def _check_order(path: Path, stamps_s: ArrayLike) -> None:
    late = np.flatnonzero(np.diff(np.asarray(stamps_s)) <= 0)
    if late.size:
        problem = f"row {late[0] + 2} is not later than the one before it"
        raise InputError(path, problem, remedy="sort the rows by time and leave out duplicates")


# --- sensor.yaml ---


@dataclass(frozen=True, eq=False)
class AslSensor:
    """The content of a sensor.yaml. body_from_sensor: T_BS (4, 4). camera, depth_scale_per_m: None if not given.

    distortion: of the lens; None where it does not distort.
    """

    body_from_sensor: NDArray[np.float64]
    camera: Intrinsics | None
    depth_scale_per_m: float | None
    distortion: Distortion | None = None


def sensor_yaml(
    kind: str,
    comment: str,
    body_from_sensor: NDArray[np.float64],
    *,
    camera: Intrinsics | None = None,
    rate_hz: float | None = None,
    depth_scale_per_m: float | None = None,
    distortion: Distortion | None = None,
) -> str:
    """Return the text of a sensor.yaml. rate_hz: None for a single frame, which has no rate."""
    matrix = (",\n" + " " * 9).join(", ".join(map(yaml_number, row)) for row in (body_from_sensor + 0.0).tolist())
    rows = [
        f"sensor_type: {kind}",
        f"comment: {comment}",
        "",
        "# The sensor's pose in the body's frame.",
        "T_BS:",
        "  cols: 4",
        "  rows: 4",
        f"  data: [{matrix}]",
    ]
    if rate_hz is not None:
        rows += ["", f"rate_hz: {f'{rate_hz:.6f}'.rstrip('0').rstrip('.')}"]
    if camera is not None:
        lens = distortion or Distortion("radial-tangential", (0.0, 0.0, 0.0, 0.0))
        numbers = [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]
        rows += [
            f"resolution: [{camera.width_px}, {camera.height_px}]",
            "camera_model: pinhole",
            f"intrinsics: {yaml_row(numbers)} # fu, fv, cu, cv",
            f"distortion_model: {lens.model}",
            f"distortion_coefficients: {yaml_row(lens.coefficients)}",
        ]
    if depth_scale_per_m is not None:
        rows += [
            "",
            "# Planar depth in 16 bits, 0 where there is none; steps a metre.",
            f"{DEPTH_SCALE_KEY}: {yaml_number(depth_scale_per_m)}",
        ]
    return lines(rows)


def yaml_number(value: float) -> str:
    """Return a number with a point: PyYAML and others that follow YAML 1.1 take 1e-05 for a text."""
    digits, e, exponent = repr(float(value)).partition("e")
    return f"{digits}{'' if '.' in digits or not e else '.0'}{e}{exponent}"


def yaml_row(values: Iterable[float]) -> str:
    """Return a list of numbers, as YAML has it on one line."""
    return f"[{', '.join(yaml_number(float(value) + 0.0) for value in values)}]"


def read_sensor_yaml(path: Path) -> AslSensor:
    """Read a sensor.yaml. Raises InputError for a camera that is no plain pinhole, and for missing or wrong values."""
    document = _load_yaml(path)
    camera = _camera(path, document)
    distortion = None if camera is None else _distortion(path, document)
    return AslSensor(_body_from_sensor(path, document), camera, _depth_scale(path, document), distortion)


def _load_yaml(path: Path) -> dict[str, Any]:
    # Some tools begin the file with OpenCV's line %YAML:1.0, which is not valid YAML.
    text = "\n".join("" if line.startswith("%YAML") else line for line in recorded_text(path).splitlines())
    document = read_yaml(text, path)
    if not isinstance(document, dict):
        raise InputError(path, "describes no sensor")
    return document


def _body_from_sensor(path: Path, document: dict[str, Any], where: str = "T_BS") -> NDArray[np.float64]:
    given = document.get("T_BS")
    values = _numbers(path, where, given.get("data") if isinstance(given, dict) else given, 16)
    matrix = values.reshape(4, 4)
    problem = "is no rigid pose"
    with np.errstate(over="ignore", invalid="ignore"):  # numbers as large as that are refused as well
        turned, error = np.linalg.det(matrix[:3, :3]) > 0, float(rotation_error(matrix[:3, :3]))
    if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6 or not turned:
        raise InputError(path, problem, where=where, remedy="write it row by row")
    if not error <= _ROTATION_TOLERANCE:
        raise InputError(path, f"{problem}: R^T R is off by {error:.3g}", where=where)
    return matrix if error < 1e-12 else pose(nearest_rotation(matrix[:3, :3]), matrix[:3, 3])


def _camera(path: Path, document: dict[str, Any]) -> Intrinsics | None:
    if "intrinsics" not in document:
        return None
    if (model := document.get("camera_model", "pinhole")) != "pinhole":
        raise InputError(path, f"is {model!r}, but only pinhole can be read", where="camera_model")
    size = _entries(path, "resolution", document.get("resolution"), 2)
    values = _entries(path, "intrinsics", document["intrinsics"], 4)
    return checked_intrinsics(path, ("resolution",) * 2 + ("intrinsics",) * 4, (*size, *values))


def _distortion(path: Path, document: dict[str, Any]) -> Distortion | None:
    model = _MODELS.get(str(document.get("distortion_model", "radial-tangential")), document.get("distortion_model"))
    coefficients = document.get("distortion_coefficients", [0.0])
    return checked_distortion(path, "distortion_coefficients", model, coefficients)


def _depth_scale(path: Path, document: dict[str, Any]) -> float | None:
    if DEPTH_SCALE_KEY not in document:
        return None
    return checked_depth_scale(path, DEPTH_SCALE_KEY, document[DEPTH_SCALE_KEY])


def _entries(path: Path, name: str, value: object, count: int) -> list[object]:
    if not isinstance(value, list) or len(value) != count:
        raise InputError(path, f"has to be {count} numbers", where=name)
    return value


def _numbers(path: Path, name: str, value: object, count: int | None = None) -> NDArray[np.float64]:
    wanted = "numbers" if count is None else f"{count} numbers"
    if not isinstance(value, list) or (count is not None and len(value) != count):
        raise InputError(path, f"has to be {wanted}", where=name)
    numbers = [finite_number(item) for item in value]
    found = [number for number in numbers if number is not None]
    if len(found) != len(numbers):
        raise InputError(path, f"has to be {wanted}, all finite", where=name)
    return np.array(found, dtype=np.float64)


# The text files of an IMU, as EuRoC has them: its samples, its true states, and what it is.


# EuRoC's own headers.
SAMPLES_HEADER = "#timestamp [ns]," + ",".join(
    [*(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"), *(f"a_RS_S_{axis} [m s^-2]" for axis in "xyz")]
)
STATES_HEADER = POSES_HEADER + "".join(
    f", {name}_{axis} [{unit}]"
    for name, unit in (("v_RS_R", "m s^-1"), ("b_w_RS_S", "rad s^-1"), ("b_a_RS_S", "m s^-2"))
    for axis in "xyz"
)


def samples_csv(samples: ImuSamples) -> str:
    """Return what an IMU measured: t [ns] of its own clock, angular velocity [rad/s], specific force [m/s^2]."""
    values = np.concatenate([samples.rate_rad_s, samples.force_m_s2], axis=1)
    return lines([SAMPLES_HEADER, *stamped_rows(map(stamp_text, samples.stamps_ns.tolist()), values)])


def states_csv(states: ImuStates) -> str:
    """Return true states: t [ns] of the cameras' clock, position, quaternion with w first, velocity, both biases."""
    at = pose_columns(rounded_poses(pose(states.motion.rotation, states.motion.position_m)))
    others = [states.motion.velocity_m_s, states.gyro_bias_rad_s, states.accel_bias_m_s2]
    values = np.concatenate([at, *map(rounded_numbers, others)], axis=1)
    return lines([STATES_HEADER, *stamped_rows(map(stamp_text, states.stamps_ns.tolist()), values)])


def read_samples(text: str, file: Path | str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return stamps (N,) in nanoseconds, and angular velocity and specific force (N, 6), of a text with samples.

    file: for messages. Raises InputError where it is none.
    """
    rows = [line.split(",") for line in text.splitlines() if line and not line.startswith("#")]
    try:
        stamps_ns = np.array([int(row[0]) for row in rows], dtype=np.int64)
        values = np.array([[float(cell) for cell in row[1:]] for row in rows], dtype=np.float64)
    except (ValueError, OverflowError) as error:
        raise InputError(file, f"is no list of samples: {quoted(str(error))}") from error
    if values.shape != (len(rows), 6):
        raise InputError(file, "has to have seven numbers in each row")
    return stamps_ns, values


def read_imu(folder: Path, body_from_rgb: NDArray[np.float64]) -> RecordedImu | None:
    """Return the IMU of a folder with its data.csv and, if there is one, its sensor.yaml; None without samples.

    body_from_rgb: (4, 4), the pose of the colour camera on the body. Raises InputError where the files are wrong.
    """
    path, description = folder / "data.csv", folder / "sensor.yaml"
    return _imu_of(path, description, body_from_rgb) if path.is_file() else None


def imu_beside(path: Path) -> tuple[RecordedImu, str]:
    """Return the IMU of a file of samples, with what a file beside it says: imu.yaml of imu.csv, else sensor.yaml.

    Returns also a note where nothing says where it sits beside the colour camera. Raises InputError.
    """
    own, sensor = path.with_suffix(".yaml"), path.parent / "sensor.yaml"
    description = own if own.is_file() or not sensor.is_file() else sensor
    rgb_from_imu = None
    if description.is_file() and "T_cam_imu" in (document := _load_yaml(description)):
        rows = document["T_cam_imu"] if isinstance(document["T_cam_imu"], list) else []
        flat = [each for row in rows for each in (row if isinstance(row, list) else [row])]
        rgb_from_imu = _body_from_sensor(description, {"T_BS": flat}, "T_cam_imu")
    found = _imu_of(path, description, np.eye(4))
    if rgb_from_imu is None:
        return found, f"nothing says where the IMU of {path.name} sits: it is taken to be where the colour camera is"
    body_from_rgb = found.samples.imu.robot_from_sensor @ invert_pose(rgb_from_imu)
    return replace(found, rig=replace(found.rig, rgb=Sensor(body_from_rgb))), ""


def with_imu(found: StoredSequence) -> StoredSequence:
    """Return a recording with the IMU that this program wrote beside its images, where its layout has no place for it.

    Files of others that are called so are left alone.
    """
    path = found.folder / IMU_FILES[0]
    if found.imu is not None or not (path.is_file() and (found.folder / IMU_FILES[1]).is_file()):
        return found
    with open_regular(path) as file:
        if not file.read(len(SAMPLES_HEADER) + 3).decode("utf-8-sig", "replace").startswith(SAMPLES_HEADER):
            return found
    return replace(found, imu=imu_beside(path)[0])


def _imu_of(path: Path, description: Path, body_from_rgb: NDArray[np.float64]) -> RecordedImu:
    """Return the IMU of a file of samples and of one that describes it, where that is there. Raises InputError."""
    stamps_ns, values = read_samples(recorded_text(path), path)
    if stamps_ns.min() < 0 or not np.isfinite(values).all():
        raise InputError(path, "holds a negative time stamp, or what is no finite number")
    steps_s = np.diff(stamps_ns) / NS_PER_S
    rate_hz = 1.0 / float(np.median(steps_s)) if len(steps_s) and np.median(steps_s) > 0 else Imu.rate_hz
    imu = _described_imu(description, rate_hz) if description.is_file() else Imu(np.eye(4), ImuModel(), rate_hz)
    samples = ImuSamples(imu, stamps_ns, values[:, :3], values[:, 3:])
    return RecordedImu(Rig(Sensor(body_from_rgb), None, imu), samples, path)


def _described_imu(path: Path, rate_hz: float) -> Imu:
    """Return the IMU that a sensor.yaml describes; what it does not say of the noise is 0."""
    document = _load_yaml(path)
    numbers = {
        name: finite_number(document.get(key, 0.0))
        for name, key in (
            ("gyro_noise_density", "gyroscope_noise_density"),
            ("gyro_random_walk", "gyroscope_random_walk"),
            ("accel_noise_density", "accelerometer_noise_density"),
            ("accel_random_walk", "accelerometer_random_walk"),
        )
    }
    if wrong := [name for name, number in numbers.items() if number is None or number < 0]:
        raise InputError(path, "has to be a number from 0 on", where=wrong[0])
    model = replace(ImuModel(), **{name: number or 0.0 for name, number in numbers.items()})
    return Imu(_body_from_sensor(path, document), model, finite_number(document.get("rate_hz")) or rate_hz)


def imu_yaml(imu: Imu, body_from_imu: NDArray[np.float64], more: Sequence[str] = ()) -> str:
    """Return the text of an IMU's sensor.yaml, with EuRoC's keys, its clock and gravity. more: lines at its end."""
    model = imu.model
    rows = {
        "gyroscope_noise_density": (model.gyro_noise_density, "rad/s/sqrt(Hz)"),
        "gyroscope_random_walk": (model.gyro_random_walk, "rad/s^2/sqrt(Hz)"),
        "accelerometer_noise_density": (model.accel_noise_density, "m/s^2/sqrt(Hz)"),
        "accelerometer_random_walk": (model.accel_random_walk, "m/s^3/sqrt(Hz)"),
        "gravity": (imu.gravity_m_s2, "m/s^2, along the world's -z"),
        "time_offset": (imu.time_offset_s, "s: its clock minus the cameras', at the first frame"),
        "clock_drift": (imu.clock_drift_ppm, "ppm: how much faster its clock goes"),
    }
    numbers = [f"{name}: {yaml_number(value)}  # {meaning}" for name, (value, meaning) in rows.items()]
    head = sensor_yaml("imu", "angular velocity and specific force", body_from_imu, rate_hz=imu.rate_hz)
    return head + lines(["", *numbers, *more])


def imu_texts(facts: SequenceFacts) -> dict[str, str]:
    """Return the files of an IMU beside a sequence's images, by name; none where the layout has a place of its own."""
    samples, rig = facts.imu, facts.rig
    if samples is None or rig is None or facts.format.layout.holds_imu:
        return {}
    rgb_from_imu = rounded_poses(invert_pose(rig.rgb.robot_from_sensor) @ samples.imu.robot_from_sensor)
    rows = ["# The IMU's pose in the colour camera's frame; T_BS is its pose in the robot's, with OpenCV's axes."]
    rows += ["T_cam_imu:", *(f"  - {yaml_row(row)}" for row in rgb_from_imu.tolist())]
    texts = [samples_csv(samples), imu_yaml(samples.imu, samples.imu.robot_from_sensor, rows)]
    if (states := samples.true_states(facts.frames_ns)) is not None:
        texts.append(states_csv(states))
    return dict(zip(IMU_FILES, texts, strict=False))
