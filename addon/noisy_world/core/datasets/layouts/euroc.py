# SPDX-License-Identifier: GPL-3.0-or-later
"""The ASL layout of the EuRoC MAV datasets, which visual-inertial systems read."""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...geometry import invert_pose
from ...trajectories.rig import Sensor, sensor_trajectory
from ...trajectories.trajectory import Trajectory
from ..stored import StoredSequence, pair_by_stamp
from .asl import (
    DEPTH_SCALE_KEY,
    STAMP_DIGITS,
    images_csv,
    poses_csv,
    read_images_csv,
    read_poses_csv,
    read_sensor_yaml,
    sensor_yaml,
    stamp_text,
    stamps_problem,
)
from .layout import Image, Layout, SequenceFacts, lines

MAV = "mav0"
COLOUR = f"{MAV}/cam0"
DEPTH = f"{MAV}/depth0"
TRUE_STATE = f"{MAV}/state_groundtruth_estimate0"
NOMINAL_STATE = f"{MAV}/state_nominal0"
# Text numbers of the same pose differ by less; a sensor that is really elsewhere differs by more.
_SAME_PLACE = 1e-9


class EurocLayout(Layout):
    """`mav0/cam0`, `mav0/depth0`, `mav0/state_groundtruth_estimate0`, each a `data.csv` and a `sensor.yaml`.

    Images are called by their time stamps, in nanoseconds. The body is the robot where there is one, else the colour
    camera itself.
    """

    name = "euroc"
    label = "EuRoC ASL"
    meaning = "of the EuRoC MAV datasets, which visual-inertial systems read"
    images = ("png",)
    colours = ("grey", "rgb")  # Basalt ends at an image that is not one channel
    depth_scale_per_m = 5000.0  # that of TUM, so that depth passes from one to the other untouched
    conventions: ClassVar[dict[str, str]] = {
        "pose": "body-to-world; T_BS of a sensor.yaml is sensor-to-body; camera axes x right, y down, z forward "
        "(OpenCV); metres; world z up",
        "time": "nanoseconds",
    }
    patterns = (
        *(f"{folder}/data/{'[0-9]' * STAMP_DIGITS}.png" for folder in (COLOUR, DEPTH)),
        *(
            f"{folder}/{name}"
            for folder in (COLOUR, DEPTH, TRUE_STATE, NOMINAL_STATE)
            for name in ("data.csv", "sensor.yaml")
        ),
        f"{COLOUR}/timestamps.txt",
        f"{MAV}/body.yaml",
    )

    def rgb_name(self, frame: int, stamp_s: float, image: Image) -> str:
        """Return the name of a frame's colour image."""
        del frame
        return f"{COLOUR}/data/{stamp_text(stamp_s)}.{image}"

    def depth_name(self, frame: int, stamp_s: float) -> str:
        """Return the name of a frame's depth image."""
        del frame
        return f"{DEPTH}/data/{stamp_text(stamp_s)}.png"

    def stamps_problem(self, stamps_s: Sequence[float] | NDArray[np.float64]) -> str:
        """Say which stamp cannot name a file."""
        return stamps_problem(stamps_s)

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return the lists of images, the descriptions of the sensors, and the body's path or paths."""
        body_from_rgb = np.eye(4) if facts.rig is None else facts.rig.rgb.robot_from_sensor
        of_depth = None if facts.rig is None else facts.rig.depth
        body_from_depth = body_from_rgb if of_depth is None else of_depth.robot_from_sensor
        chosen, rate_hz = facts.chosen, _rate_hz(facts.paths.rgb)
        texts = {f"{MAV}/body.yaml": f"comment: {'the colour camera' if facts.rig is None else 'the robot'}\n"}
        if "rgb" in facts.format.modalities:
            names = [PurePosixPath(facts.names.rgb(frame)).name for frame in facts.frames]
            comment = "grey of colour" if facts.format.colour == "grey" else "colour"
            texts[f"{COLOUR}/data.csv"] = images_csv(names)
            # What ORB-SLAM3 takes as its file of times: a line is an image's name without its ending.
            texts[f"{COLOUR}/timestamps.txt"] = lines([PurePosixPath(name).stem for name in names])
            texts[f"{COLOUR}/sensor.yaml"] = sensor_yaml(
                "camera", comment, body_from_rgb, camera=facts.camera, rate_hz=rate_hz
            )
        if "depth" in facts.format.modalities:
            names = [PurePosixPath(facts.names.depth(frame)).name for frame in facts.frames]
            texts[f"{DEPTH}/data.csv"] = images_csv(names)
            texts[f"{DEPTH}/sensor.yaml"] = sensor_yaml(
                "depth-camera",
                "planar depth",
                body_from_depth,
                camera=facts.camera,
                rate_hz=rate_hz,
                depth_scale_per_m=facts.format.depth_scale_per_m,
            )
        states = {TRUE_STATE: (chosen.robot or chosen.rgb, "where the body was")}
        if chosen.nominal is not None:
            # It is the colour camera's, as the other layouts have it; here it is told as the body's.
            rgb_from_body = Sensor(invert_pose(body_from_rgb))
            states[NOMINAL_STATE] = (
                sensor_trajectory(chosen.nominal, rgb_from_body),
                "where the body was meant to be",
            )
        for folder, (path, comment) in states.items():
            texts[f"{folder}/data.csv"] = poses_csv(path)
            texts[f"{folder}/sensor.yaml"] = sensor_yaml("pose", comment, np.eye(4))
        return texts

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a folder mav0."""
        return (folder / MAV).is_dir()

    def read(self, folder: Path) -> StoredSequence:
        """Find the images and poses whose stamps lie near one another; poses become the colour camera's."""
        for place, what in ((COLOUR, "colour"), (DEPTH, "depth")):
            if not (folder / place / "data.csv").is_file():
                remedy = f"{place} has to be there: a sequence needs colour and depth"
                raise InputError(folder / place / "data.csv", f"is not there: no {what}", remedy=remedy)
        rgb, depth = (read_images_csv(folder / place / "data.csv") for place in (COLOUR, DEPTH))
        colour_file, depth_file = (folder / place / "sensor.yaml" for place in (COLOUR, DEPTH))
        colour_sensor, depth_sensor = read_sensor_yaml(colour_file), read_sensor_yaml(depth_file)
        if depth_sensor.depth_scale_per_m is None:
            problem = f"holds no {DEPTH_SCALE_KEY}"
            raise InputError(depth_file, problem, remedy="add it: the steps of the depth images a metre")
        if np.abs(colour_sensor.body_from_sensor - depth_sensor.body_from_sensor).max() > _SAME_PLACE:
            problem = f"T_BS is not that of {COLOUR}, but depth has to be the colour camera's"
            raise InputError(depth_file, problem, remedy="register the depth images to the colour camera")
        poses = folder / TRUE_STATE / "data.csv"
        path = sensor_trajectory(read_poses_csv(poses), Sensor(colour_sensor.body_from_sensor))
        rgb_files, depth_files, trajectory = pair_by_stamp(folder, rgb, depth, poses, path)
        return StoredSequence(
            folder, rgb_files, depth_files, poses, trajectory, depth_sensor.depth_scale_per_m, colour_sensor.camera
        )


def _rate_hz(path: Trajectory) -> float | None:
    """Return how many frames a second there are; None of a single frame."""
    return None if len(path) == 1 else 1 / float(np.median(np.diff(path.stamps_s)))
