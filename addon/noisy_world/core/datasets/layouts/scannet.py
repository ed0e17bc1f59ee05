# SPDX-License-Identifier: GPL-3.0-or-later
"""ScanNet, as its exporter writes a .sens file, and its subset of every 100th frame.

Exporter: https://github.com/ScanNet/ScanNet, SensReader/python/reader.py and SensorData.py: color/0.jpg, depth/0.png
(16 bits, "depth shift 1000"), pose/0.txt ("camera to world"), intrinsic/intrinsic_color.txt and intrinsic_depth.txt.
The subset scannet_frames_25k has the same folders and intrinsics_color.txt, intrinsics_depth.txt beside them.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...geometry import Intrinsics
from ...optics import DepthCamera, Optics
from ...trajectories.pose_text import read_text as read_numbers
from ...trajectories.pose_text import text_rows
from ..known_poses import PosePolicy
from ..stored import StoredSequence, same_camera, size_of
from .numbered import folder_of_poses, numbered_frames, numbered_images
from .recorded import MILLIMETRES, RECORDED_HZ, RecordedLayout, counted_note, intrinsics_of_matrix

COLOUR = r"([0-9]+)\.(?:jpg|png)"
DEPTH = r"([0-9]+)\.png"


class ScanNetLayout(RecordedLayout):
    """`color/0.jpg`, `depth/0.png`, `pose/0.txt` and `intrinsic/intrinsic_color.txt`."""

    name = "scannet"
    label = "ScanNet"
    meaning = "a scan of ScanNet as its SensReader exports it: colour and depth each have a camera; depth in mm"
    files = "color/0.jpg, depth/0.png, pose/0.txt, intrinsic/"

    def recognises(self, folder: Path) -> bool:
        """Tell whether there are folders of colour, depth and poses, or intrinsics of the exporter."""
        images = (folder / "color").is_dir() and (folder / "depth").is_dir()
        return images and ((folder / "pose").is_dir() or (folder / "intrinsic").is_dir())

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Match images and poses by their numbers; poses of -inf, where tracking was lost, are none."""
        truth = folder / "pose"
        used_hz = rate_hz or RECORDED_HZ
        unposed = poses == "none" or (poses == "keep" and not truth.is_dir())
        colour, depth = numbered_images(folder / "color", COLOUR), numbered_images(folder / "depth", DEPTH)
        given = None if unposed else folder_of_poses(truth, colour)
        found = numbered_frames(folder, colour, depth, given, policy=poses, rate_hz=used_hz)
        camera_file, depth_file = _matrix_file(folder, "color"), _matrix_file(folder, "depth")
        camera = intrinsics_of_matrix(camera_file, _matrix(camera_file), size_of(found.rgb_files[0]))
        seen = intrinsics_of_matrix(depth_file, _matrix(depth_file), size_of(found.depth_files[0]))
        return StoredSequence(
            folder,
            found.rgb_files,
            found.depth_files,
            None if given is None else truth,
            found.trajectory,
            found.stamps,
            MILLIMETRES,
            None,
            camera,
            camera_file,
            (*found.notes, *counted_note(rate_hz, used_hz)),
            used_hz,
            optics=_optics(folder, camera, seen),
        )


def _optics(folder: Path, colour: Intrinsics, depth: Intrinsics) -> Optics:
    # SensReader's exporter writes both extrinsics, and ScanNet's are the identity; where they are not, its documents do
    # not say between which frames they lead.
    for kind in ("color", "depth"):
        path = folder / "intrinsic" / f"extrinsic_{kind}.txt"
        if path.is_file() and not np.array_equal(_matrix(path), np.eye(4)):
            remedy = "register depth to colour, and set it to the identity"
            raise InputError(path, "is not the identity, and ScanNet does not say where it leads", remedy=remedy)
    return Optics() if same_camera(colour, depth) else Optics(DepthCamera(depth))


def _matrix_file(folder: Path, kind: str) -> Path:
    exported = folder / "intrinsic" / f"intrinsic_{kind}.txt"
    beside = folder / f"intrinsics_{kind}.txt"
    return beside if beside.is_file() and not exported.is_file() else exported


def _matrix(path: Path) -> NDArray[np.float64]:
    rows = text_rows(path, read_numbers(path))
    if rows.widths.tolist() != [4, 4, 4, 4]:
        raise InputError(path, "is no matrix of four lines of four numbers", remedy="as ScanNet's exporter writes it")
    return rows.numbers.reshape(4, 4)
