# SPDX-License-Identifier: GPL-3.0-or-later
"""The layout of the sequences that VSLAM-LAB gives to the systems it runs.

Files, columns and keys are those of https://github.com/VSLAM-LAB/VSLAM-LAB: Datasets/DatasetVSLAMLAB.py,
Datasets/DatasetVSLAMLAB_calibration.py and Datasets/dataset_files/dataset_rgbdtum.py.
"""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import finite_number
from ..core.geometry import Intrinsics, invert_pose
from ..core.lens import Distortion, DistortionModel, Optics
from ..core.schema import quoted, read_yaml
from ..core.trajectory import FrameStamps, Stamps, Trajectory
from ..trajectories.formats import read_trajectory
from ..trajectories.rig import Imu, ImuSamples
from .asl import LARGEST_NS, exact_stamps, pose_columns, stamped_rows, yaml_number, yaml_row
from .estimator_settings import LEAST
from .layout import PATH_SUFFIXES, Layout, SequenceFacts, StampsLike, lines, path_suffix, poses_at
from .stored_recording import (
    PosePolicy,
    StampedFiles,
    StoredSequence,
    associate_frames,
    check_files,
    checked_depth_scale,
    checked_intrinsics,
    recorded_text,
    truth_file,
)

# An IMU as VSLAM-LAB has it: `imu_0.csv`, and its mapping in `calibration.yaml`.
#
# Columns and keys are those of https://github.com/VSLAM-LAB/VSLAM-LAB: Datasets/dataset_files/dataset_euroc.py and
# Datasets/DatasetVSLAMLab_calibration.py.


SAMPLES = "imu_0.csv"
COLUMNS = ("ts (ns)", *(f"w{axis} (rad s^-1)" for axis in "xyz"), *(f"a{axis} (m s^-2)" for axis in "xyz"))
# What VSLAM-LAB says of every IMU: how far its biases may be from 0 at first.
BIAS_PRIORS = {"sigma_bg": 0.01, "sigma_ba": 0.1}  # rad/s, m/s^2
BOUNDLESS = 1000.0  # of an IMU that saturates nowhere, rad/s and m/s^2


def vslamlab_samples(samples: ImuSamples) -> str:
    """Return what an IMU measured: t [ns] of its own clock, angular velocity, specific force."""
    values = np.concatenate([samples.rate_rad_s, samples.force_m_s2], axis=1)
    return lines([",".join(COLUMNS), *stamped_rows(samples.stamps_ns.tolist(), values)])


def vslamlab_imu(imu: Imu) -> list[str]:
    """Return the lines of an IMU that is the body. Noises that are 0 are the least that estimators divide by."""
    model = imu.model
    numbers = {
        "a_max": model.accel_range_m_s2 or BOUNDLESS,
        "g_max": float(np.radians(model.gyro_range_deg_s)) or BOUNDLESS,
        "sigma_g_c": max(model.gyro_noise_density, LEAST),
        "sigma_gw_c": max(model.gyro_random_walk, LEAST),
        "sigma_a_c": max(model.accel_noise_density, LEAST),
        "sigma_aw_c": max(model.accel_random_walk, LEAST),
        **BIAS_PRIORS,
    }
    entries = ["imu_name: imu_0", *(f"{name}: {yaml_number(value)}" for name, value in numbers.items())]
    entries += [
        "a0: [0.0, 0.0, 0.0]",
        "g0: [0.0, 0.0, 0.0]",
        f"g: {yaml_number(imu.gravity_m_s2)}",
        "s_a: [1.0, 1.0, 1.0]",
    ]
    return braced([*entries, f"fps: {yaml_number(imu.rate_hz)}", f"T_BS: {yaml_row(np.eye(4).ravel())}"])


def braced(entries: Sequence[str]) -> list[str]:
    """Return an item of a list, a mapping broken into lines as VSLAM-LAB's own writer does it."""
    return ["  - {" + ",\n     ".join(entries), "    }"]


LISTED = "rgb.csv"
CALIBRATION = "calibration.yaml"
LENSES: dict[str, tuple[DistortionModel, int]] = {
    "radtan4": ("radial-tangential", 4),
    "radtan5": ("radial-tangential", 5),
    "equid4": ("equidistant", 4),
}
"""What VSLAM-LAB calls a lens's model, by `distortion_type`: its model, and how many coefficients it has."""
TRUTH = "groundtruth.csv"
TRUTH_OF = "groundtruth_of"  # ours, beside VSLAM-LAB's keys of a camera: whose poses the truth holds
CAMERA = "rgb_0"
DEPTH = "depth_0"
RGB_COLUMNS = ("ts_rgb_0 (ns)", "path_rgb_0")
DEPTH_COLUMNS = ("ts_depth_0 (ns)", "path_depth_0")
POSE_COLUMNS = ("ts (ns)", "tx (m)", "ty (m)", "tz (m)", "qx", "qy", "qz", "qw")
# Two texts of the identity differ by less than this. Chosen.
_IDENTITY = 1e-9

DEPTH_SCALE_PER_M = 5000.0  # TUM's, so that depth images can be linked from one layout to the other


class VslamLabLayout(Layout):
    """`rgb_0/*.png`, `depth_0/*.png`, `rgb.csv`, `calibration.yaml` and `groundtruth.csv`.

    A line of rgb.csv pairs a colour image with a depth image, each with a time stamp of its own. The poses are the
    colour camera's, so T_BS is the identity.
    """

    name = "vslamlab"
    order = 50
    label = "VSLAM-LAB"
    meaning = "of VSLAM-LAB, which runs many systems"
    images = ("png", "jpg")
    colours = ("rgb", "grey")
    depth_scale_per_m = DEPTH_SCALE_PER_M
    conventions: ClassVar[dict[str, str]] = {"time": "nanoseconds"}
    rgb_file = f"{CAMERA}/{{frame:06d}}.{{image}}"
    depth_file = f"{DEPTH}/{{frame:06d}}.png"
    patterns = (LISTED, CALIBRATION, SAMPLES, *(f"groundtruth{suffix}.csv" for suffix in PATH_SUFFIXES))

    def stamps_problem(self, stamps: StampsLike) -> str:
        """Return which stamp a row cannot have, or "". Rows are told apart by the stamps of colour, poses by theirs."""
        found = FrameStamps.of(stamps)
        return (
            _stamps_problem("frame", found.rgb, distinct=True)
            or _stamps_problem("the depth of frame", found.depth, distinct=False)
            or _stamps_problem("the pose of frame", found.pose, distinct=True)
        )

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return the list of images, the calibration, and a file of poses for each path."""
        texts = {LISTED: _listed_text(facts), CALIBRATION: _calibration_text(facts)}
        if facts.imu is not None:
            texts[SAMPLES] = vslamlab_samples(facts.imu)
        if facts.timed is None:
            return texts
        paths, stamps = facts.timed
        return texts | {
            f"groundtruth{path_suffix(name)}.csv": _poses_text(path, stamps) for name, path in paths.named().items()
        }

    def says_lens(self, lens: Distortion) -> bool:
        """Tell whether VSLAM-LAB has a name for the lens's model."""
        return _type_of(lens) is not None

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a list of colour images as a table."""
        return (folder / LISTED).is_file()

    def written_poses(self, folder: Path, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the poses of groundtruth.csv by their stamps."""
        poses = folder / TRUTH
        return poses_at(read_trajectory(poses, format="tum", stamp_unit="ns"), time_s, poses)

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Pair colour and depth as rgb.csv does, whatever their stamps; poses are those with close stamps."""
        del rate_hz  # the list has stamps
        rgb, depth = _read_listed(folder / LISTED)
        camera, depth_scale_per_m, lens = _read_calibration(folder / CALIBRATION, has_depth=depth is not None)
        file = truth_file(folder / TRUTH, poses)
        path = None if file is None else read_trajectory(file)
        exact = None if file is None or path is None else exact_stamps(file, path)
        found = associate_frames(folder, rgb, depth, path, exact, paired=True, policy=poses)
        check_files(folder / LISTED, found.rgb_files)
        check_files(folder / LISTED, found.depth_files)
        return StoredSequence(
            folder,
            found.rgb_files,
            found.depth_files,
            file,
            found.trajectory,
            found.stamps,
            depth_scale_per_m,
            folder / LISTED,
            camera,
            folder / CALIBRATION,
            found.notes,
            optics=Optics(distortion=lens),
        )


def _stamps_problem(what: str, stamps: Stamps, *, distinct: bool) -> str:
    seen: set[int] = set()
    for frame, stamp_ns in enumerate(stamps.ns):
        if abs(stamp_ns) > LARGEST_NS:
            return f"{what} {frame} is at {stamps.seconds[frame]:g} s, but stamps are nanoseconds in 64 bits"
        if distinct and stamp_ns in seen:
            return f"{what} {frame} has the time stamp of an earlier one, in the nanoseconds of {LISTED} and {TRUTH}"
        seen.add(stamp_ns)
    return ""


# --- written ---


def _listed_text(facts: SequenceFacts) -> str:
    names, taken = facts.names, facts.taken
    columns: list[list[str]] = []
    if "rgb" in facts.format.modalities:
        columns += [[RGB_COLUMNS[0], *map(str, taken.rgb.ns)], [RGB_COLUMNS[1], *map(names.rgb, facts.frames)]]
    if "depth" in facts.format.modalities:
        columns += [[DEPTH_COLUMNS[0], *map(str, taken.depth.ns)], [DEPTH_COLUMNS[1], *map(names.depth, facts.frames)]]
    return lines([",".join(row) for row in zip(*columns, strict=True)])


def _poses_text(path: Trajectory, stamps: Stamps) -> str:
    """Return t [ns], p [m], q (w last), camera-to-world; numbers read back to the same float64."""
    values = pose_columns(path.c2w)[:, [0, 1, 2, 4, 5, 6, 3]]
    return lines([",".join(POSE_COLUMNS), *stamped_rows(stamps.ns, values)])


def _calibration_text(facts: SequenceFacts) -> str:
    """Return the calibration: a mapping a camera, broken into lines as VSLAM-LAB's own writer does it."""
    camera, seconds = facts.camera, facts.paths.rgb.stamps_s
    rate_hz = 1 / float(np.median(np.diff(seconds))) if len(seconds) > 1 else 20.0
    entries = ["cam_name: rgb_0"]
    if "depth" in facts.format.modalities:
        entries += ["cam_type: rgb+depth", "depth_name: depth_0"]
    else:
        entries += ["cam_type: rgb"]
    entries += [
        "cam_model: pinhole",
        f"focal_length: {yaml_row((camera.fx_px, camera.fy_px))}",
        f"principal_point: {yaml_row((camera.cx_px, camera.cy_px))}",
        f"image_dimension: [{camera.width_px}, {camera.height_px}]",
    ]
    if (lens := facts.optics.distortion) is not None:
        entries += [f"distortion_type: {_type_of(lens)}", f"distortion_coefficients: {yaml_row(lens.coefficients)}"]
    if "depth" in facts.format.modalities:
        entries += [f"depth_factor: {yaml_number(facts.format.depth_scale_per_m)}"]
    entries += [f"fps: {yaml_number(round(rate_hz, 6))}"]
    body_from_rgb, imus = np.eye(4), []
    if facts.imu is not None and facts.rig is not None:
        # The body is the IMU, as in VSLAM-LAB's own sequences; the truth stays the colour camera's.
        body_from_rgb = invert_pose(facts.imu.imu.robot_from_sensor) @ facts.rig.rgb.robot_from_sensor
        entries += [f"{TRUTH_OF}: {CAMERA}"]
        imus = ["", "imus:", *vslamlab_imu(facts.imu.imu)]
    entries += [f"T_BS: {yaml_row(body_from_rgb.ravel().tolist())}"]
    return lines(["%YAML 1.2", "---", "cameras:", *braced(entries), *imus])


def _type_of(lens: Distortion) -> str | None:
    """Return VSLAM-LAB's name of a lens's model; None where it has none."""
    return next((name for name, known in LENSES.items() if known == (lens.model, len(lens.coefficients))), None)


# --- read ---


def _read_listed(path: Path) -> tuple[StampedFiles, StampedFiles | None]:
    """Read the colour of a list, in any order, and the depth paired with it; None where it has no columns of depth.

    Raises InputError where a stamp of colour is given twice.
    """
    rows = _rows(path)
    header = next(rows, ("", []))[1]
    sensors = [RGB_COLUMNS, *([DEPTH_COLUMNS] if set(DEPTH_COLUMNS) & set(header) else [])]
    columns = [name for sensor in sensors for name in sensor]
    if lacking := [name for name in columns if name not in header]:
        raise InputError(path, f"has no column {lacking[0]}", remedy=f"it has to have {', '.join(columns)}")
    found: dict[int, list[tuple[int, Path]]] = {}
    for where, cells in rows:
        if len(cells) != len(header):
            raise InputError(path, f"has {len(cells)} values for {len(header)} columns", where=where)
        images = [
            (_stamp_ns(path, where, cells[header.index(stamp)]), cells[header.index(name)]) for stamp, name in sensors
        ]
        if not all(name for _, name in images):
            raise InputError(path, "names no colour or no depth image", where=where)
        if (rgb_ns := images[0][0]) in found:
            raise InputError(path, f"the time stamp {rgb_ns} is that of an earlier line", where=where)
        found[rgb_ns] = [(stamp_ns, path.parent / name) for stamp_ns, name in images]
    if not found:
        raise InputError(path, "lists no image")
    ordered = [found[stamp_ns] for stamp_ns in sorted(found)]
    rgb, *depth = (
        StampedFiles(Stamps.of_ns([stamp_ns for stamp_ns, _ in column]), tuple(file for _, file in column))
        for column in zip(*ordered, strict=True)
    )
    if np.any(np.diff(rgb.stamps.seconds) <= 0):
        raise InputError(path, "has two time stamps of colour that are equal in float64")
    return rgb, depth[0] if depth else None


def _rows(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield for each row where it is ("line 3"), and its cells without the blanks around them."""
    reader = csv.reader(io.StringIO(recorded_text(path), newline=""), strict=True)
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells):
                yield f"line {reader.line_num}", [cell.strip() for cell in cells]
    except csv.Error as error:
        raise InputError(path, f"is no table: {error}", where=f"line {reader.line_num}") from None


def _stamp_ns(path: Path, where: str, cell: str) -> int:
    digits = cell.removeprefix("-")
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= 19 and int(digits) <= LARGEST_NS):
        raise InputError(path, f"{quoted(cell)} is no time in whole nanoseconds", where=where)
    return int(cell)


def _read_calibration(path: Path, *, has_depth: bool) -> tuple[Intrinsics, float, Distortion | None]:
    """Return the intrinsics of the camera rgb_0, its depth scale per metre, and its lens. Raises InputError."""
    # Another version's directive, which PyYAML might not take.
    text = "\n".join("" if line.startswith("%YAML") else line for line in recorded_text(path).splitlines())
    document = read_yaml(text, path)
    cameras = document.get("cameras") if isinstance(document, dict) else None
    found = [item for item in cameras if _is_colour(item)] if isinstance(cameras, list) else []
    if len(found) != 1:
        raise InputError(path, f"describes {len(found)} cameras of the name {CAMERA}, but has to describe one")
    (camera,) = found
    if (model := camera.get("cam_model", "pinhole")) != "pinhole":
        raise InputError(path, f"is {quoted(str(model))}, but only pinhole can be read", where=_at("cam_model"))
    lens = _lens(path, camera)
    apart = np.abs(_numbers(path, camera, "T_BS", 16) - np.eye(4).ravel()).max() > _IDENTITY
    if apart and camera.get(TRUTH_OF) != CAMERA:
        remedy = f"{TRUTH} has to hold the poses of {CAMERA}; add {TRUTH_OF}: {CAMERA} where it does"
        raise InputError(path, "is not the identity", where=_at("T_BS"), remedy=remedy)
    said = camera.get("depth_factor")
    without = said is None and not has_depth
    scale_per_m = DEPTH_SCALE_PER_M if without else checked_depth_scale(path, _at("depth_factor"), said)
    keys = {"image_dimension": 2, "focal_length": 2, "principal_point": 2}
    values = [value for name, count in keys.items() for value in _numbers(path, camera, name, count).tolist()]
    places = tuple(_at(name) for name, count in keys.items() for _ in range(count))
    return checked_intrinsics(path, places, tuple(values)), scale_per_m, lens


def _lens(path: Path, camera: dict[str, Any]) -> Distortion | None:
    values = _numbers(path, camera, "distortion_coefficients", None)
    if not values.any():
        return None
    model, count = LENSES.get(str(camera.get("distortion_type")), (None, 0))
    if model is None or len(values) != count:
        known = ", ".join(f"{name} ({number} numbers)" for name, (_, number) in LENSES.items())
        given = f"{quoted(str(camera.get('distortion_type')))} with {len(values)} coefficients"
        remedy = "undistort the images, and set these to zeros"
        raise InputError(path, f"is {given}, but {known} can be read", where=_at("distortion_type"), remedy=remedy)
    return Distortion(model, tuple(values.tolist()))


def _is_colour(camera: Any) -> bool:
    return isinstance(camera, dict) and camera.get("cam_name") == CAMERA


def _at(name: str) -> str:
    return f"{CAMERA}.{name}"


def _numbers(path: Path, camera: dict[str, Any], name: str, count: int | None) -> NDArray[np.float64]:
    """Return the finite numbers of a key; of one that may be left out, where count is None."""
    if name not in camera and count is None:
        return np.zeros(0)
    value = camera.get(name)
    values = [value] if count == 1 else value
    numbers = [finite_number(item) for item in values] if isinstance(values, list) else []
    found = [number for number in numbers if number is not None]
    wanted = "numbers" if count is None else "a number" if count == 1 else f"{count} numbers"
    if not isinstance(values, list) or len(found) != len(values) or (count is not None and len(found) != count):
        raise InputError(path, f"has to be {wanted}, finite", where=_at(name))
    return np.array(found, dtype=np.float64)


LAYOUT = VslamLabLayout()
