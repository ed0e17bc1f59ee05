# SPDX-License-Identifier: GPL-3.0-or-later
"""The layout of the Replica sequences that iMAP and NICE-SLAM read."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, Message, PresetKey
from ..core.frame_table import FRAMES
from ..core.geometry import Intrinsics
from ..core.lens import PINHOLE, Optics
from ..core.trajectory import FrameStamps
from ..trajectories.formats import TRAJECTORY_FORMATS, read_trajectory, read_trajectory_file
from ..trajectories.matrix_poses import replica_text
from .cam_params import CAM_PARAMS, cam_params_text, read_cam_params
from .layout import PATH_SUFFIXES, Image, Layout, SequenceFacts, counted_note, path_suffix
from .stored_recording import RATE_HZ, PosePolicy, StoredSequence, chosen_by_pose, read_frame_times, truth_file, unposed

RESULTS = "results"
LARGEST_NUMBER = 10**9  # 19 months at 20 Hz: what is larger is no count


class ReplicaLayout(Layout):
    """`results/frame000000.jpg`, `results/depth000000.png`, `traj.txt`, and `cam_params.json` one level up."""

    name = "replica"
    order = 10
    label = "Replica"
    meaning = "of iMAP and NICE-SLAM"
    images = ("jpg", "png", "exr")
    colours = ("rgb", "grey")
    depth_scale_per_m = 6553.5  # 16 bits are 10 m
    rgb_file = f"{RESULTS}/frame{{frame:06d}}.{{image}}"
    depth_file = f"{RESULTS}/depth{{frame:06d}}.png"
    patterns = (*(f"traj{suffix}.txt" for suffix in PATH_SUFFIXES), CAM_PARAMS)
    setting_files = (CAM_PARAMS,)
    optics = True  # in cam_params.json
    gaps = False  # traj.txt has a line for each frame

    def image_note(self, image: Image) -> str:
        """Say that PNG and EXR are not found: NICE-SLAM and its successors list results/frame*.jpg."""
        if image == "jpg":
            return ""
        others = "NICE-SLAM, Co-SLAM, GO-SLAM, SplaTAM and others that read this layout"
        message = f"{others} look for results/frame*.jpg and find no colour in {image}; set "
        return Message(message, PresetKey("output.image", "jpg"), " for them")

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return a file of poses for each path, where they are known."""
        if not facts.chosen.rgb.known.any():
            return {}
        return {f"traj{path_suffix(name)}.txt": replica_text(path) for name, path in facts.chosen.named().items()}

    def setting_texts(self, camera: Intrinsics, depth_scale_per_m: float, optics: Optics = PINHOLE) -> dict[str, str]:
        """Return cam_params.json."""
        return {CAM_PARAMS: cam_params_text(camera, depth_scale_per_m, optics)}

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a folder `results`."""
        return (folder / RESULTS).is_dir()

    def written_poses(self, folder: Path, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the poses of traj.txt, one line a frame."""
        poses = read_trajectory(folder / "traj.txt", format="replica")
        if len(poses) != len(time_s):
            raise InputError(folder / "traj.txt", f"has {len(poses)} poses for {len(time_s)} frames")
        return poses.c2w

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Find the images, which match by number, and the poses, one for each image in the order of the numbers.

        The stamps are those of frames.jsonl, where there is one; else frame i is at i / rate_hz.
        """
        results = folder / RESULTS
        rgb = sorted((path for kind in self.images for path in results.glob(f"frame*.{kind}")), key=_number)
        depth = sorted(results.glob("depth*.png"), key=_number)
        numbers = [_number(path) for path in rgb]
        if not rgb or numbers != [_number(path) for path in depth] or any(a == b for a, b in pairwise(numbers)):
            problem = f"has {len(rgb)} colour and {len(depth)} depth images, which do not match by number"
            raise InputError(results, problem)
        file = truth_file(folder / "traj.txt", poses)
        held = None if file is None else read_trajectory_file(file)
        trajectory = unposed(len(rgb)) if held is None else held.trajectory
        if file is not None and len(trajectory) != len(rgb):
            raise InputError(file, f"has {len(trajectory)} poses for {len(rgb)} frames", remedy="one line a frame")
        stamps, stamps_path = read_frame_times(folder, numbers), folder / FRAMES
        _, pose_note = chosen_by_pose(folder, trajectory.known, poses)
        notes = (*trajectory.notes, *((pose_note,) if pose_note else ()))
        if stamps is None and held is not None and TRAJECTORY_FORMATS[held.format].stamped:
            stamps, stamps_path = FrameStamps.of(trajectory.stamps_s), file
        elif stamps is None:
            stamps, stamps_path = _counted(rgb[-1], numbers, rate_hz or RATE_HZ), None
            notes += counted_note(rate_hz, RATE_HZ)
        params = read_cam_params(folder)
        return StoredSequence(
            folder,
            tuple(rgb),
            tuple(depth),
            file,
            trajectory.at(slice(None), stamps.rgb.seconds),
            stamps,
            params.depth_scale_per_m if params else self.depth_scale_per_m,
            stamps_path,
            params.camera if params else None,
            params.path if params else None,
            notes,
            None if stamps_path else rate_hz or RATE_HZ,
            optics=params.optics if params else PINHOLE,
        )


def _counted(last: Path, numbers: list[int], rate_hz: float) -> FrameStamps:
    """Return the stamps of frames whose numbers count them. last: the image of the last one."""
    if numbers[-1] > LARGEST_NUMBER:
        raise InputError(last, "its number is too large to count frames", remedy=f"say the time stamps in {FRAMES}")
    return FrameStamps.of(np.array(numbers) / rate_hz)


def _number(path: Path) -> int:
    digits = re.search(r"(\d+)$", path.stem)
    if digits is None:
        raise InputError(path, "has no number in its name", remedy="frame000000.jpg, depth000000.png and so on")
    return int(digits[1])


LAYOUT = ReplicaLayout()
