# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene of BOP, as BlenderProc's BopWriter writes it too: rgb, depth and scene_camera.json.

https://github.com/thodan/bop_toolkit, docs/bop_datasets_format.md: by the number of each image cam_K, "3x3 intrinsic
camera matrix K (saved row-wise)", depth_scale, "Multiply the depth image with this factor to get depth in mm", and
optionally cam_R_w2c and cam_t_w2c, "3x3 rotation matrix R_w2c (saved row-wise)", translations in mm; cameras as
OpenCV's. Images are rgb/000000.png or .jpg (gray/ without colour), depth/000000.png.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import finite_number, parse_json_file
from ..core.geometry import invert_pose, nearest_rotation, pose, rotation_error
from ..core.lens import PINHOLE
from .cam_params import matrix_in
from .described import DepthFilesSpec, DescribedLayout, ImageFilesSpec, SequenceSpec, Told, median_camera
from .layout import MILLIMETRES, intrinsics_of_matrix
from .numbered import Cameras
from .stored_recording import checked_depth_scale, recorded_text, size_of

SCENE_CAMERA = "scene_camera.json"
_ROTATION_TOLERANCE = 5e-3  # as for files of poses


class BopLayout(DescribedLayout):
    """`rgb/000000.png`, `depth/000000.png` and `scene_camera.json`."""

    name = "bop"
    order = 160
    label = "BOP"
    meaning = "a scene of BOP or of BlenderProc's BOP writer: poses world-to-camera in mm, depth by its own scale"
    files = "rgb/000000.png (or gray/), depth/000000.png, scene_camera.json"
    told_by = (SCENE_CAMERA,)
    described = SequenceSpec(rgb=ImageFilesSpec("rgb/*.*g"), depth=DepthFilesSpec("depth/*.png"))

    def description(self, folder: Path) -> SequenceSpec:
        """Return where the files are: grey images where there is no colour."""
        spec = super().description(folder)
        return spec if (folder / "rgb").is_dir() else replace(spec, rgb=ImageFilesSpec("gray/*.*g"))

    def tell(self, folder: Path, images: tuple[Path, ...]) -> Told:
        """Return cameras, depth scale and poses by the numbers of the images."""
        path = folder / SCENE_CAMERA
        document = parse_json_file(recorded_text(path), path)
        if (
            not isinstance(document, dict)
            or not document
            or not all(
                number.isdecimal() and len(number) < 10 and isinstance(said, dict) for number, said in document.items()
            )
        ):
            raise InputError(path, "has to hold a camera by the number of each image", remedy="as BOP has it")
        size_px = size_of(images[0])
        cameras = [
            intrinsics_of_matrix(path, matrix_in(path, said.get("cam_K"), f"{number}.cam_K"), size_px)
            for number, said in document.items()
        ]
        scales = {finite_number(said.get("depth_scale", 1.0)) for said in document.values()}
        if len(scales) > 1:
            raise InputError(path, "has several depth_scale", remedy="a recording has one: take images of one apart")
        mm = next(iter(scales), None)
        scale_per_m = checked_depth_scale(path, "depth_scale", MILLIMETRES / mm if mm else mm)
        camera, note = median_camera(path, cameras)
        by_number = {int(number): _pose(path, number, said) for number, said in document.items()}
        poses = [by_number.get(int(image.stem)) if image.stem.isdecimal() else None for image in images]
        return Told(Cameras(camera, path, PINHOLE, depth_scale_per_m=scale_per_m), poses, path, notes=(note,))


def _pose(path: Path, number: str, said: dict[str, Any]) -> NDArray[np.float64] | None:
    """Return the pose (4, 4), c2w in metres, of an image; None where nothing says it."""
    if "cam_R_w2c" not in said or "cam_t_w2c" not in said:
        return None
    rotation = matrix_in(path, said["cam_R_w2c"], f"{number}.cam_R_w2c")
    given = said["cam_t_w2c"] if isinstance(said["cam_t_w2c"], list) else []
    place_mm = [finite_number(value) for value in given]
    if len(place_mm) != 3 or None in place_mm:
        raise InputError(path, "is no three numbers", where=f"{number}.cam_t_w2c")
    if not float(rotation_error(rotation)) <= _ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise InputError(path, "is no rotation", where=f"{number}.cam_R_w2c")
    return invert_pose(pose(nearest_rotation(rotation), np.array(place_mm, dtype=np.float64) / MILLIMETRES))


LAYOUT = BopLayout()
