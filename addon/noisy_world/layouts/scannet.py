# SPDX-License-Identifier: GPL-3.0-or-later
"""ScanNet, as its exporter writes a .sens file, and its subset of every 100th frame.

Exporter: https://github.com/ScanNet/ScanNet, SensReader/python/reader.py and SensorData.py: color/0.jpg, depth/0.png
(16 bits, "depth shift 1000"), pose/0.txt ("camera to world"), intrinsic/intrinsic_color.txt and intrinsic_depth.txt.
The subset scannet_frames_25k has the same folders and intrinsics_color.txt, intrinsics_depth.txt beside them.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.lens import DepthCamera, Optics
from ..trajectories.matrix_poses import row_text
from ..trajectories.pose_files import read_text as read_numbers
from ..trajectories.pose_files import text_rows
from .layout import MILLIMETRES, SequenceFacts, intrinsics_of_matrix
from .numbered import Cameras, ImageFiles, NumberedLayout
from .stored_recording import MatchedFrames, same_camera, size_of
from .with_reader import LayoutWithReader, unpadded


class ScanNetRecordings(NumberedLayout):
    """`color/0.jpg`, `depth/0.png`, `pose/0.txt` and `intrinsic/intrinsic_color.txt`.

    Poses of -inf, where tracking was lost, are none.
    """

    name = "scannet"
    order = 80
    label = "ScanNet"
    meaning = "a scan of ScanNet as its SensReader exports it: colour and depth each have a camera; depth in mm"
    files = "color/0.jpg, depth/0.png, pose/0.txt, intrinsic/"
    rgb = ImageFiles("color", r"([0-9]+)\.(?:jpg|png)")
    depth = ImageFiles("depth", r"([0-9]+)\.png")
    pose_folder = "pose"

    def recognises(self, folder: Path) -> bool:
        """Tell whether there are a folder of colour and one of poses, or intrinsics of the exporter."""
        return (folder / "color").is_dir() and ((folder / "pose").is_dir() or (folder / "intrinsic").is_dir())

    def cameras(self, folder: Path, found: MatchedFrames) -> Cameras:
        """Read both cameras."""
        path = _matrix_file(folder, "color")
        camera = intrinsics_of_matrix(path, _matrix(path), size_of(found.rgb_files[0]))
        if not found.depth_files:
            return Cameras(camera, path)
        of_depth = _matrix_file(folder, "depth")
        seen = intrinsics_of_matrix(of_depth, _matrix(of_depth), size_of(found.depth_files[0]))
        return Cameras(camera, path, _optics(folder, camera, seen))


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


class ScanNetLayout(LayoutWithReader):
    """`color/0.jpg`, `depth/0.png`, `pose/0.txt`, and four matrices in `intrinsic`. A lost pose is -inf."""

    reader = ScanNetRecordings()
    images = ("jpg", "png")
    colours = ("rgb",)
    depth_scale_per_m = MILLIMETRES
    rgb_file, depth_file = "color/{frame}.{image}", "depth/{frame}.png"
    patterns = (
        *unpadded("pose/{}.txt"),
        *(f"intrinsic/{what}_{kind}.txt" for what in ("intrinsic", "extrinsic") for kind in ("color", "depth")),
    )

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return a file for each pose, and the matrices of both cameras, which are in one place."""
        path, matrix = facts.chosen.rgb, np.eye(4)
        matrix[0, 0], matrix[0, 2] = facts.camera.fx_px, facts.camera.cx_px
        matrix[1, 1], matrix[1, 2] = facts.camera.fy_px, facts.camera.cy_px
        texts = {f"intrinsic/intrinsic_{kind}.txt": row_text(matrix) for kind in ("color", "depth")}
        texts |= {f"intrinsic/extrinsic_{kind}.txt": row_text(np.eye(4)) for kind in ("color", "depth")}
        if not path.known.any():
            return texts
        found = np.where(path.known[:, None, None], path.c2w, -np.inf)
        return texts | {f"pose/{frame}.txt": row_text(c2w) for frame, c2w in zip(facts.frames, found, strict=True)}


LAYOUT = ScanNetLayout()
