# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of three files each: 7-Scenes, and BundleFusion with a file of the calibration beside them.

7-Scenes: https://www.microsoft.com/en-us/research/project/rgb-d-dataset-7-scenes/ (frame-XXXXXX.color.png, .depth.png
in millimetres, .pose.txt camera-to-world; "invalid depth is set to 65535"). BundleFusion:
https://graphics.stanford.edu/projects/bundlefusion/ ("depth in millimetres", info.txt, poses of -inf where tracking was
lost); keys of info.txt as ScanNet/SensReader writes them (sensorData.h, saveToImages).
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import finite_number
from ..core.geometry import Intrinsics
from ..core.lens import DepthCamera, Optics
from .layout import intrinsics_of_matrix, stated_camera
from .numbered import Cameras, ImageFiles, NumberedLayout
from .stored_recording import MatchedFrames, PosePolicy, recorded_text, same_camera

CALIBRATIONS = ("info.txt", "_info.txt")
NO_DEPTH = 65535  # "invalid depth is set to 65535"
# "In the KinectFusion pipeline we used the following default intrinsics for the depth camera: principle point
# (320,240), focal length (585,585)"; "the RGB and depth camera have not been calibrated". naver/kapture's
# kapture_import_7scenes.py quotes the same and uses 585, 320, 240.
KINECT = Intrinsics(640, 480, 585.0, 585.0, 320.0, 240.0)
UNCALIBRATED = (
    "the dataset's depth camera of fx = fy = 585 and (320, 240) stands for both: colour was never calibrated, and "
    "depth is not registered to it; camera says another"
)


class SevenScenesLayout(NumberedLayout):
    """`frame-000000.color.png`, `frame-000000.depth.png` and `frame-000000.pose.txt`."""

    name = "seven_scenes"
    order = 60
    label = "7-Scenes"
    meaning = "a sequence of Microsoft's 7-Scenes: depth in mm, 65535 is void; poses camera-to-world"
    files = "frame-000000.color.png, frame-000000.depth.png, frame-000000.pose.txt"
    rgb = ImageFiles("", r"frame-([0-9]+)\.color\.(?:png|jpg)")
    depth = ImageFiles("", r"frame-([0-9]+)\.depth\.png")
    void_steps = (NO_DEPTH,)

    def recognises(self, folder: Path) -> bool:
        """Tell whether there are colour images of frames, and no calibration."""
        return _has_frames(folder) and _calibration(folder) is None

    def poses_path(self, folder: Path, policy: PosePolicy) -> Path | None:
        """Return the folder itself, where poses lie beside the images."""
        unposed = policy == "none" or (policy == "keep" and not any(folder.glob("frame-*.pose.txt")))
        return None if unposed else folder

    def cameras(self, folder: Path, found: MatchedFrames) -> Cameras:
        """Return the camera that a file says, else the dataset's."""
        stated = stated_camera(folder, found.rgb_files[0])
        return Cameras(KINECT, assumed=UNCALIBRATED) if stated is None else Cameras(*stated)


class BundleFusionLayout(SevenScenesLayout):
    """The files of 7-Scenes, and `info.txt` with the intrinsics of both cameras."""

    name = "bundlefusion"
    order = 70
    label = "BundleFusion"
    meaning = "a sequence of BundleFusion, or ScanNet's images as SensReader writes them: info.txt has both cameras"
    files = "frame-000000.color.jpg, frame-000000.depth.png, frame-000000.pose.txt, info.txt"

    def recognises(self, folder: Path) -> bool:
        """Tell whether there are colour images of frames, and a calibration."""
        return _has_frames(folder) and _calibration(folder) is not None

    def cameras(self, folder: Path, found: MatchedFrames) -> Cameras:
        """Read both cameras, and the depth scale."""
        del found
        path = _calibration(folder)
        assert path is not None, "recognised"
        (scale_per_m,) = _numbers(path, _info(path), "m_depthShift", 1)
        if scale_per_m <= 0:
            raise InputError(path, f"is {scale_per_m:g}, but has to be above 0", where="m_depthShift")
        camera, optics = _cameras(path)
        return Cameras(camera, path, optics, depth_scale_per_m=float(scale_per_m))


def _has_frames(folder: Path) -> bool:
    return any(folder.glob("frame-*.color.png")) or any(folder.glob("frame-*.color.jpg"))


def _calibration(folder: Path) -> Path | None:
    return next((folder / name for name in CALIBRATIONS if (folder / name).is_file()), None)


# --- info.txt ---


def _info(path: Path) -> dict[str, str]:
    lines = [line.partition("=") for line in recorded_text(path).splitlines()]
    return {name.strip(): value.strip() for name, equals, value in lines if equals}


def _numbers(path: Path, values: dict[str, str], name: str, count: int) -> NDArray[np.float64]:
    words = values.get(name, "").split()
    try:
        numbers = [finite_number(float(word)) for word in words]
    except ValueError:
        numbers = []
    found = [number for number in numbers if number is not None]
    if len(found) != count or len(words) != count:
        problem = f"is no {'number' if count == 1 else f'list of {count} numbers'}" if words else "is missing"
        raise InputError(path, problem, where=name, remedy="as SensReader and BundleFusion write it")
    return np.array(found)


def _cameras(path: Path) -> tuple[Intrinsics, Optics]:
    values = _info(path)
    cameras = []
    for kind in ("color", "depth"):
        size_px = [int(_numbers(path, values, f"m_{kind}{side}", 1)[0]) for side in ("Width", "Height")]
        matrix = _numbers(path, values, f"m_calibration{kind.capitalize()}Intrinsic", 16).reshape(4, 4)
        cameras.append(intrinsics_of_matrix(path, matrix, (size_px[0], size_px[1])))
    colour, depth = cameras
    rgb_from_depth = None
    for kind in ("Color", "Depth"):
        name = f"m_calibration{kind}Extrinsic"
        if name in values and not np.array_equal(_numbers(path, values, name, 16).reshape(4, 4), np.eye(4)):
            problem = "is not the identity, and no document says between which frames it leads"
            raise InputError(path, problem, where=name, remedy="register depth to colour, and set it to the identity")
    optics = Optics() if same_camera(colour, depth) else Optics(DepthCamera(depth, rgb_from_depth))
    return colour, optics


LAYOUT = SevenScenesLayout(), BundleFusionLayout()
