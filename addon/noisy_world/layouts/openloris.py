# SPDX-License-Identifier: GPL-3.0-or-later
"""OpenLORIS-Scene: lists of colour and aligned depth, sensors.yaml and trans_matrix.yaml.

https://lifelong-robotic-vision.github.io/dataset/scene and https://github.com/lifelong-robotic-vision/
openloris-scene-tools, dataprocess: color.txt and aligned_depth.txt are TUM's lists, depth is in millimetres,
groundtruth.txt has TUM's poses of base_link; sensors.yaml has d400_color_optical_frame, whose intrinsics are
fx cx fy cy; trans_matrix.yaml lists poses of a child_frame in its parent_frame, from base_link on.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import finite_number
from ..core.geometry import nearest_rotation, pose, rotation_error
from ..core.lens import Optics
from ..core.schema import read_yaml
from .cam_params import checked_distortion
from .described import DepthFilesSpec, DescribedLayout, ImageFilesSpec, PoseFilesSpec, SequenceSpec, Told
from .numbered import Cameras
from .stored_recording import checked_intrinsics, recorded_text

SENSORS, TRANSFORMS = "sensors.yaml", "trans_matrix.yaml"
BODY, COLOUR = "base_link", "d400_color_optical_frame"
_ROTATION_TOLERANCE = 5e-3  # as for files of poses


class OpenLorisLayout(DescribedLayout):
    """`color.txt`, `aligned_depth.txt`, `groundtruth.txt`, `sensors.yaml` and `trans_matrix.yaml`."""

    name = "openloris"
    order = 190
    label = "OpenLORIS"
    meaning = "a sequence of OpenLORIS-Scene: its D435i, depth aligned to colour in mm, poses of the robot's base"
    files = "color.txt, aligned_depth.txt, groundtruth.txt, sensors.yaml, trans_matrix.yaml"
    told_by = ("color.txt", SENSORS)
    described = SequenceSpec(
        rgb=ImageFilesSpec(list="color.txt"),
        depth=DepthFilesSpec(list="aligned_depth.txt"),
        poses=PoseFilesSpec("groundtruth.txt", format="tum"),
    )

    def tell(self, folder: Path, images: tuple[Path, ...]) -> Told:
        """Return the colour camera, its lens and its place on the base."""
        del images
        path = folder / SENSORS
        said = _yaml(path).get(COLOUR)
        values = _matrix(path, said.get("intrinsics"), f"{COLOUR}.intrinsics", 4) if isinstance(said, dict) else None
        if values is None or not isinstance(said, dict):
            raise InputError(path, "is missing", where=COLOUR)
        fx, cx, fy, cy = values.ravel().tolist()
        places = ("width", "height", "fx", "fy", "cx", "cy")
        camera = checked_intrinsics(path, places, (said.get("width"), said.get("height"), fx, fy, cx, cy))
        lens = None
        if "distortion_coefficients" in said:
            given = said["distortion_coefficients"]
            listed = given.get("data") if isinstance(given, dict) else given
            model = said.get("distortion_model", "radial-tangential")
            lens = checked_distortion(path, f"{COLOUR}.distortion_coefficients", model, listed)
        return Told(Cameras(camera, path, Optics(distortion=lens), posed_from_camera=_on_body(folder / TRANSFORMS)))


def _on_body(path: Path) -> NDArray[np.float64]:
    """Return the pose (4, 4) of the colour camera on the base."""
    parents: dict[str, tuple[str, NDArray[np.float64]]] = {}
    listed = _yaml(path).get("trans_matrix")
    for number, said in enumerate(listed if isinstance(listed, list) else []):
        where = f"trans_matrix.{number}"
        if not isinstance(said, dict):
            raise InputError(path, "is no mapping", where=where)
        matrix = _matrix(path, said.get("matrix"), f"{where}.matrix", 16).reshape(4, 4)
        if not float(rotation_error(matrix[:3, :3])) <= _ROTATION_TOLERANCE:
            raise InputError(path, "is no pose", where=f"{where}.matrix")
        placed = pose(nearest_rotation(matrix[:3, :3]), matrix[:3, 3])
        parents[str(said.get("child_frame"))] = str(said.get("parent_frame")), placed
    frame, found = COLOUR, np.eye(4)
    for _ in parents:
        if frame not in parents:
            break
        frame, placed = parents[frame]
        found = placed @ found
    if frame != BODY:
        raise InputError(path, f"does not lead from {BODY} to {COLOUR}", where="trans_matrix")
    return found


def _yaml(path: Path) -> dict[str, Any]:
    # OpenCV's FileStorage begins with %YAML:1.0 and tags its matrices, which plain YAML takes for something else.
    lines = ("" if line.startswith("%YAML") else line for line in recorded_text(path).splitlines())
    document = read_yaml("\n".join(lines).replace("!!opencv-matrix", ""), path)
    if not isinstance(document, dict):
        raise InputError(path, "describes no sensor")
    return document


def _matrix(path: Path, value: Any, where: str, count: int) -> NDArray[np.float64]:
    data = value.get("data") if isinstance(value, dict) else None
    numbers = [finite_number(each) for each in data] if isinstance(data, list) else []
    if len(numbers) != count or None in numbers:
        raise InputError(path, f"is no matrix of {count} numbers", where=where)
    return np.array(numbers, dtype=np.float64)


LAYOUT = OpenLorisLayout()
