# SPDX-License-Identifier: GPL-3.0-or-later
"""The ASL layout of the EuRoC MAV datasets, which visual-inertial systems read."""

from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.frame_request import SensorPaths
from ..core.geometry import invert_pose
from ..core.lens import DepthCamera, Optics
from ..core.trajectory import FrameStamps, Stamps, Trajectory
from ..trajectories.rig import Rig, Sensor, sensor_trajectory
from .asl import (
    DEPTH_SCALE_KEY,
    STAMP_DIGITS,
    AslSensor,
    exact_stamps,
    images_csv,
    imu_yaml,
    poses_csv,
    read_images_csv,
    read_imu,
    read_poses_csv,
    read_sensor_yaml,
    samples_csv,
    sensor_yaml,
    stamp_text,
    stamps_problem,
    states_csv,
)
from .estimator_settings import FOLDER as SETTINGS
from .estimator_settings import NAMES as SETTINGS_NAMES
from .estimator_settings import settings_texts
from .layout import Layout, SequenceFacts, StampsLike, lines, poses_at
from .stored_recording import PosePolicy, StoredSequence, associate_frames, check_files, same_camera, truth_file

MAV = "mav0"
COLOUR = f"{MAV}/cam0"
DEPTH = f"{MAV}/depth0"
IMU = f"{MAV}/imu0"
TRUE_STATE = f"{MAV}/state_groundtruth_estimate0"
MOCAP = f"{MAV}/mocap0"
"""The truth of TUM-VI."""
NOMINAL_STATE = f"{MAV}/state_nominal0"
# Two texts of the same pose differ by less than this, sensors at different poses by more. Chosen.
_SAME_POSE = 1e-9


class EurocLayout(Layout):
    """`mav0/cam0`, `mav0/depth0`, `mav0/state_groundtruth_estimate0`, each a `data.csv` and a `sensor.yaml`.

    Images are named after their time stamps in nanoseconds. The body is the IMU if there is one, with `mav0/imu0`;
    else the robot if there is one, else the colour camera.
    """

    name = "euroc"
    order = 30
    label = "EuRoC ASL"
    meaning = "of the EuRoC MAV datasets, which visual-inertial systems read"
    images = ("png",)
    colours = ("grey", "rgb")  # grey by default: Basalt aborts at images of more than one channel
    lists_depth = True
    optics = True  # in sensor.yaml
    holds_imu = True
    truth: ClassVar[str] = TRUE_STATE
    depth_scale_per_m = 5000.0  # TUM's, so that depth images can be linked from one layout to the other
    conventions: ClassVar[dict[str, str]] = {
        "pose": "body-to-world; T_BS of a sensor.yaml is sensor-to-body; camera axes x right, y down, z forward "
        "(OpenCV); metres; world z up",
        "time": "nanoseconds",
    }
    rgb_file = f"{COLOUR}/data/{{stamp_ns:0{STAMP_DIGITS}d}}.{{image}}"
    depth_file = f"{DEPTH}/data/{{stamp_ns:0{STAMP_DIGITS}d}}.png"
    patterns = (
        *(
            f"{folder}/{name}"
            for folder in (COLOUR, DEPTH, IMU, TRUE_STATE, NOMINAL_STATE)
            for name in ("data.csv", "sensor.yaml")
        ),
        f"{COLOUR}/timestamps.txt",
        f"{MAV}/body.yaml",
        *(f"{SETTINGS}/{name}" for name in SETTINGS_NAMES),
    )

    def channel_name(self, channel: str, frame: int, stamps: FrameStamps, suffix: str) -> str:
        """Return the name of an image of another channel: beside the cameras, with colour's stamp."""
        return f"{MAV}/{channel}0/data/{stamp_text(stamps.rgb.ns[frame])}.{suffix}"

    def channel_patterns(self, channel: str) -> tuple[str, ...]:
        """Return glob patterns of all files of another channel."""
        return (f"{MAV}/{channel}0/data/{'[0-9]' * STAMP_DIGITS}.*", f"{channel}.json")

    def stamps_problem(self, stamps: StampsLike) -> str:
        """Return which stamp cannot name a file, or ""."""
        found = FrameStamps.of(stamps)
        parts = (("frame", found.rgb), ("the depth of frame", found.depth), ("the pose of frame", found.pose))
        return next((problem for what, part in parts if (problem := stamps_problem(part.ns, what))), "")

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return the lists of images, the descriptions of the sensors, and the body's path or paths."""
        body, body_from_robot = _body(facts.rig)
        body_from_rgb = np.eye(4) if facts.rig is None else body_from_robot @ facts.rig.rgb.robot_from_sensor
        of_depth = None if facts.rig is None else facts.rig.depth
        body_from_depth = body_from_rgb if of_depth is None else body_from_robot @ of_depth.robot_from_sensor
        rate_hz, seen = _rate_hz(facts.paths.rgb), facts.optics.depth
        texts = {f"{MAV}/body.yaml": f"comment: {body}\n"}
        if "rgb" in facts.format.modalities:
            names = [PurePosixPath(facts.names.rgb(frame)).name for frame in facts.frames]
            comment = "grey of colour" if facts.format.colour == "grey" else "colour"
            texts[f"{COLOUR}/data.csv"] = images_csv(names)
            # The file of times that ORB-SLAM3 asks for: each line is an image's name without its suffix.
            texts[f"{COLOUR}/timestamps.txt"] = lines([PurePosixPath(name).stem for name in names])
            texts[f"{COLOUR}/sensor.yaml"] = sensor_yaml(
                "camera",
                comment,
                body_from_rgb,
                camera=facts.camera,
                rate_hz=rate_hz,
                distortion=facts.optics.distortion,
            )
        if "depth" in facts.format.modalities:
            # Names sort by time, which the order of the frames need not be for depth.
            names = sorted(PurePosixPath(facts.names.depth(frame)).name for frame in facts.frames)
            texts[f"{DEPTH}/data.csv"] = images_csv(names)
            texts[f"{DEPTH}/sensor.yaml"] = sensor_yaml(
                "depth-camera",
                "planar depth",
                body_from_depth if seen is None else body_from_rgb @ seen.matrix,
                camera=facts.camera if seen is None else seen.intrinsics,
                rate_hz=rate_hz,
                distortion=facts.optics.distortion if seen is None or seen.shares_lens else None,
                depth_scale_per_m=facts.format.depth_scale_per_m,
            )
        if facts.timed is not None:
            texts |= self._state_texts(facts, *facts.timed, body_from_robot, body_from_rgb)
        if facts.imu is None:
            return texts
        known = None if facts.timed is None else facts.imu.true_states(facts.frames_ns)
        if known is not None:
            texts[f"{self.truth}/data.csv"] = states_csv(known)
        texts[f"{IMU}/data.csv"] = samples_csv(facts.imu)
        texts[f"{IMU}/sensor.yaml"] = imu_yaml(facts.imu.imu, np.eye(4))
        return texts | settings_texts(
            *(facts.camera, facts.optics.distortion, facts.imu.imu, body_from_rgb),
            rate_hz=rate_hz or 1.0,
            depth_scale_per_m=facts.format.depth_scale_per_m,
        )

    def _state_texts(
        self,
        facts: SequenceFacts,
        chosen: SensorPaths,
        stamps: Stamps,
        body_from_robot: NDArray[np.float64],
        body_from_rgb: NDArray[np.float64],
    ) -> dict[str, str]:
        """Return the files of where the body was and, where that is another path, was meant to be."""
        rgb_from_body = Sensor(invert_pose(body_from_rgb))
        followed = chosen.rgb if facts.rig is None else sensor_trajectory(chosen.rgb, rgb_from_body)
        if chosen.robot is not None:
            followed = sensor_trajectory(chosen.robot, Sensor(invert_pose(body_from_robot)))
        states = {self.truth: (followed, "where the body was")}
        if chosen.nominal is not None:
            # The nominal path is the colour camera's; this layout holds poses of the body.
            meant = sensor_trajectory(chosen.nominal, rgb_from_body)
            states[NOMINAL_STATE] = (meant, "where the body was meant to be")
        texts: dict[str, str] = {}
        for folder, (path, comment) in states.items():
            texts[f"{folder}/data.csv"] = poses_csv(path, stamps.ns)
            texts[f"{folder}/sensor.yaml"] = sensor_yaml("pose", comment, np.eye(4))
        return texts

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a folder mav0, whose truth is not TUM-VI's."""
        return (folder / MAV).is_dir() and not (folder / MOCAP).is_dir()

    def written_poses(self, folder: Path, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the body's poses as the colour camera's; as the depth camera's, where there is no colour."""
        sensors = (folder / sensor / "sensor.yaml" for sensor in (COLOUR, DEPTH))
        sensor = read_sensor_yaml(next((path for path in sensors if path.is_file()), folder / COLOUR / "sensor.yaml"))
        poses = folder / self.truth / "data.csv"
        path = sensor_trajectory(read_poses_csv(poses), Sensor(sensor.body_from_sensor))
        return poses_at(path, time_s, poses)

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Find images and poses with close stamps; the body's poses are converted to the colour camera's."""
        del rate_hz  # the lists have stamps
        listing, of_depth = (folder / sensor / "data.csv" for sensor in (COLOUR, DEPTH))
        if not listing.is_file():
            raise InputError(listing, "is not there: no colour", remedy=f"{COLOUR} has to be there")
        rgb = read_images_csv(listing)
        colour_file, depth_file = (path.with_name("sensor.yaml") for path in (listing, of_depth))
        colour_sensor = read_sensor_yaml(colour_file)
        depth, optics, scale_per_m = None, Optics(distortion=colour_sensor.distortion), self.depth_scale_per_m
        if (folder / DEPTH).is_dir():
            depth, depth_sensor = read_images_csv(of_depth), read_sensor_yaml(depth_file)
            optics, scale_per_m = _optics(depth_file, colour_sensor, depth_sensor)
        file = truth_file(folder / self.truth / "data.csv", poses)
        path = exact = None
        if file is not None:
            body = read_poses_csv(file)
            path = replace(sensor_trajectory(body, Sensor(colour_sensor.body_from_sensor)), notes=body.notes)
            exact = exact_stamps(file, path)
        found = associate_frames(folder, rgb, depth, path, exact, policy=poses)
        check_files(listing, found.rgb_files)
        check_files(of_depth, found.depth_files)
        return StoredSequence(
            folder,
            found.rgb_files,
            found.depth_files,
            file,
            found.trajectory,
            found.stamps,
            scale_per_m,
            listing,
            colour_sensor.camera,
            colour_file,
            found.notes,
            optics=optics,
            imu=read_imu(folder / IMU, colour_sensor.body_from_sensor),
        )


def _optics(path: Path, colour: AslSensor, depth: AslSensor) -> tuple[Optics, float]:
    """Return what the cameras have beyond one pinhole, and depth's scale. Raises InputError for depth without one."""
    if depth.depth_scale_per_m is None:
        raise InputError(path, f"holds no {DEPTH_SCALE_KEY}", remedy="add it: the steps of the depth images a metre")
    return _beyond_pinhole(path, colour, depth), depth.depth_scale_per_m


def _beyond_pinhole(path: Path, colour: AslSensor, depth: AslSensor) -> Optics:
    """Return what the cameras have beyond one pinhole. Raises InputError for depth with a lens of its own."""
    apart = np.abs(colour.body_from_sensor - depth.body_from_sensor).max() > _SAME_POSE
    if not apart and (depth.camera is None or (colour.camera and same_camera(colour.camera, depth.camera))):
        if depth.distortion not in (None, colour.distortion):
            problem = f"is not that of {COLOUR}, which has the same intrinsics and pose"
            raise InputError(path, problem, where="distortion_coefficients", remedy="leave it out, or set both alike")
        return Optics(distortion=colour.distortion)
    if depth.camera is None or colour.camera is None:
        lacking = path if depth.camera is None else path.parents[2] / COLOUR / "sensor.yaml"
        raise InputError(
            lacking, "says no intrinsics, but depth has a pose of its own", remedy="add them, or register it"
        )
    if depth.distortion not in (None, colour.distortion):
        remedy = "undistort the depth images, and set these to zeros"
        raise InputError(path, "are not zero: the lens distorts", where="distortion_coefficients", remedy=remedy)
    between = invert_pose(colour.body_from_sensor) @ depth.body_from_sensor
    rows = tuple(tuple(row) for row in between.tolist()) if apart else None
    lens = depth.distortion is not None and not apart
    return Optics(DepthCamera(depth.camera, rows, lens), colour.distortion)


def _body(rig: Rig | None) -> tuple[str, NDArray[np.float64]]:
    """Return what the body is, and the robot's pose in its frame (4, 4)."""
    if rig is None:
        return "the colour camera", np.eye(4)
    if rig.imu is None:
        return "the robot", np.eye(4)
    return "the IMU", invert_pose(rig.imu.robot_from_sensor)


def _rate_hz(path: Trajectory) -> float | None:
    """Return the frames per second; None for a single frame."""
    return None if len(path) == 1 else 1 / float(np.median(np.diff(path.stamps_s)))


LAYOUT = EurocLayout()
