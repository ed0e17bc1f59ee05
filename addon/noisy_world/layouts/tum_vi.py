# SPDX-License-Identifier: GPL-3.0-or-later
"""The layout of TUM-VI's exports: EuRoC's folders with the truth of a motion capture, and a folder for DSO's relatives.

Names, headers and columns as published readers have them: rerun's example of TUM-VI's signals, DM-VIO's README, evo,
Basalt's reader, and VSLAM-LAB's Datasets/dataset_vitum.py.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.lens import Distortion
from ..core.schema import quoted
from ..trajectories.rig import ImuSamples
from .asl import yaml_number
from .estimator_settings import CHAINS
from .estimator_settings import FOLDER as SETTINGS
from .euroc import IMU, MOCAP, TRUE_STATE, EurocLayout
from .layout import IMU_FILES, SequenceFacts, lines
from .stored_recording import PosePolicy, StoredSequence, recorded_text

DSO = "dso"
MOCAP_HEADER = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
TRUTH_HEADER = "# timestamp[ns],tx,ty,tz,qw,qx,qy,qz"
IMU_HEADER = "# timestamp[ns] w.x w.y w.z a.x a.y a.z"
TIMES_HEADER = "# filename timestamp[s] exposure_time[ms]"
TIMES = "cam0/times.txt"
DSO_FILES = ("camchain.yaml", "imu_config.yaml", "imu.txt", "gt_imu.csv", TIMES, "cam0/camera.txt")
MS_PER_S = 1000.0
LONGEST_MS = 1e6  # chosen: a quarter of an hour
_EXPOSED_COLUMNS = 3
_POSE_COLUMNS = 8


class TumViLayout(EurocLayout):
    """`mav0` as EuRoC has it, with `mocap0` as its truth, and `dso` with the same numbers as DSO's relatives read them.

    The images are not in `dso` a second time: its readers are given `mav0/cam0/data`.
    """

    name = "tum_vi"
    order = 40
    label = "TUM-VI"
    meaning = "of the TUM visual-inertial benchmark, which ORB-SLAM3, Basalt, DM-VIO and OpenVINS read"
    truth = MOCAP
    patterns: ClassVar[tuple[str, ...]] = (
        *(pattern.replace(TRUE_STATE, MOCAP) for pattern in EurocLayout.patterns),
        *(f"{DSO}/{name}" for name in DSO_FILES),
    )

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return EuRoC's texts with the truth as a motion capture has it, and those of `dso`."""
        texts = super().sequence_texts(facts)
        truth = f"{MOCAP}/data.csv"
        if truth in texts:
            if texts[truth].partition("\n")[0].count(",") >= _POSE_COLUMNS:  # all 17, as the true states are known
                texts[IMU_FILES[2]] = texts[truth]
            rows = [row.split(",")[:_POSE_COLUMNS] for row in texts[truth].splitlines()[1:]]
            texts[truth] = lines([MOCAP_HEADER, *map(",".join, rows)])
            texts[f"{DSO}/gt_imu.csv"] = lines([TRUTH_HEADER, *map(",".join, rows)])
        if "rgb" in facts.format.modalities:
            texts[f"{DSO}/{TIMES}"] = _times_text(facts)
            if (camera := _camera_text(facts)) is not None:
                texts[f"{DSO}/cam0/camera.txt"] = camera
        if facts.imu is not None:
            texts |= _imu_texts(facts.imu, texts)
        return texts

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Read what EuRoC has, and how long its images were exposed."""
        found = super().read(folder, rate_hz, poses)
        return replace(found, exposures_s=_exposures_s(folder / DSO / TIMES, found.rgb_files))

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a folder mav0 with the truth of a motion capture."""
        return (folder / MOCAP).is_dir()


def _times_text(facts: SequenceFacts) -> str:
    """Return the images' names, their stamps in seconds, and exposures, 0 where nobody knows them."""
    names = [PurePosixPath(facts.names.rgb(frame)).stem for frame in facts.frames]
    stamps = (f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}" for stamp_ns in map(int, names))
    exposed_s = np.zeros(len(names)) if facts.exposures_s is None else np.nan_to_num(facts.exposures_s)
    exposed_ms = [f"{MS_PER_S * value:.9g}" for value in exposed_s.tolist()]
    rows = zip(names, stamps, exposed_ms, strict=True)
    return lines([TIMES_HEADER, *map(" ".join, rows)])


def _exposures_s(path: Path, images: Sequence[Path]) -> NDArray[np.float64] | None:
    """Return how long images were exposed, (N,) seconds, by their names; None where no file says any."""
    if not path.is_file():
        return None
    by_name: dict[str, float] = {}
    for number, line in enumerate(recorded_text(path).split("\n"), 1):
        words = line.partition("#")[0].split()
        if len(words) < _EXPOSED_COLUMNS:
            continue
        try:
            exposed_ms = float(words[2])
        except ValueError:
            exposed_ms = -1.0
        if not 0 <= exposed_ms <= LONGEST_MS:
            raise InputError(path, f"{quoted(words[2])} is no exposure in milliseconds", where=f"line {number}")
        by_name[words[0]] = exposed_ms / MS_PER_S
    exposed_s = np.array([by_name.get(image.stem, 0.0) or np.nan for image in images])
    return None if np.isnan(exposed_s).all() else exposed_s


def _camera_text(facts: SequenceFacts) -> str | None:
    """Return DSO's calibration, in pixels; None for a lens whose model it has not."""
    model, values = _dso_lens(facts.optics.distortion)
    if model is None:
        return None
    camera = facts.camera
    numbers = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *values)
    size = f"{camera.width_px} {camera.height_px}"
    return lines(
        [" ".join([model, *map(repr, map(float, numbers))]), size, "none" if not any(values) else "crop", size]
    )


def _dso_lens(lens: Distortion | None) -> tuple[str | None, tuple[float, ...]]:
    if lens is None:
        return "Pinhole", (0.0,)
    if len(lens.coefficients) > 4:
        return None, ()
    return ("EquiDistant" if lens.model == "equidistant" else "RadTan"), lens.coefficients


def _imu_texts(samples: ImuSamples, texts: dict[str, str]) -> dict[str, str]:
    """Return the IMU's samples, its noise, and the chain of cameras, which are those of `mav0` and `settings`."""
    rows = [row.split(",") for row in texts[f"{IMU}/data.csv"].splitlines()[1:]]
    model = samples.imu.model
    noise = {
        "accelerometer_noise_density": model.accel_noise_density,
        "accelerometer_random_walk": model.accel_random_walk,
        "gyroscope_noise_density": model.gyro_noise_density,
        "gyroscope_random_walk": model.gyro_random_walk,
        "update_rate": samples.imu.rate_hz,
    }
    found = {
        f"{DSO}/imu.txt": lines([IMU_HEADER, *map(" ".join, rows)]),
        f"{DSO}/imu_config.yaml": lines(
            ["rostopic: /imu0", *(f"{name}: {yaml_number(value)}" for name, value in noise.items())]
        ),
    }
    chain = texts.get(f"{SETTINGS}/{CHAINS[1]}")
    if chain is not None:
        found[f"{DSO}/camchain.yaml"] = chain.partition("\n")[2]  # without OpenCV's first line
    return found


LAYOUT = TumViLayout()
