# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel says of a preset's keys in its own way: labels, tooltips, and the values that a new panel begins with.

All else that a property shows is the schema's.
"""

from typing import Any

from ..layouts import LAYOUTS, RECORDED
from ..layouts.layout import MILLIMETRES
from ..preset.keys import REPLICA_CAMERA, CameraSpec, ImuSpec, OutputSpec, PresetSpec, RigSpec, SensorSpec, SettingSpec
from ..preset.scene_keys import BodySpec, HandheldSpec, SceneKeys, TrajectorySpec
from ..preset.sensor_keys import DistortionSpec
from ..sources.blend import BlendKeys
from ..sources.mesh import MeshKeys
from ..sources.recording import RecordingKeys
from ..sources.video import VideoKeys
from .fields import LARGEST_INT, PERTURBATIONS, TRAJECTORY

FILES: dict[tuple[type, str], str] = {
    (MeshKeys, "mesh"): "FILE_PATH", (RecordingKeys, "sequence"): "DIR_PATH", (VideoKeys, "video"): "FILE_PATH",
    (VideoKeys, "depth"): "DIR_PATH", (BlendKeys, "blend"): "FILE_PATH", (TrajectorySpec, "file"): "FILE_PATH",
}  # fmt: skip
"""The keys that name files, beside those whose field reads one; and what Blender's browser looks for."""

LAYOUT_LABELS = tuple(layout.label for layout in (*LAYOUTS.values(), *RECORDED.values()))
_LAYOUTS = f"{', '.join(LAYOUT_LABELS[:-1])} or {LAYOUT_LABELS[-1]}"
_OUTPUT = OutputSpec().format

_WORDS: dict[tuple[type, str], dict[str, Any]] = {
    (MeshKeys, "mesh"): {
        "label": "Mesh File", "description": "Mesh with colors or textures: PLY, glTF, OBJ, USD, FBX or STL",
    },
    (BlendKeys, "depth_alpha"): {"description": "Higher: depth sees through surfaces that are less transparent"},
    (RecordingKeys, "sequence"): {
        "label": "Folder",
        "description": f"Folder of a recording, laid out as {_LAYOUTS}; which one is told by its files",
    },
    (RecordingKeys, "layout"): {"description": "What the folder holds: a recording, or plain images alone"},
    (RecordingKeys, "poses"): {
        "label": "Without Pose", "section": TRAJECTORY, "description": "What becomes of frames that have no valid pose",
    },
    (RecordingKeys, "rate_hz"): {
        "label": "Frame Rate", "section": TRAJECTORY,
        "description": "Rate of frames that have no time stamps, where it is not that of their layout",
    },
    (RecordingKeys, "undistort"): {"description": "Make a pinhole's pictures of those of a lens that distorts"},
    (RecordingKeys, "register"): {
        "label": "Register Depth",
        "description": "Lay depth of a camera of its own into color, by the calibration",
    },
    (RecordingKeys, "void"): {
        "label": "Void",
        "description": "What depth 0 means to fog, weather and defocus by depth; depth is written as it is",
    },
    (RecordingKeys, "depth_scale_per_m"): {
        "label": "Depth Scale", "precision": 1, "default": MILLIMETRES,
        "description": "Steps a meter of depth, such as 1000 for millimeters, where files and layout do not say it",
    },
    (VideoKeys, "video"): {
        "label": "Video", "description": "A video that OpenCV reads, such as .mp4, .mov, .avi or .mkv",
    },
    (VideoKeys, "depth"): {
        "label": "Depth",
        "description": "Folder of the video's depth: a 16-bit PNG for each frame, in the order of their numbers",
    },
    (VideoKeys, "depth_scale_per_m"): {
        "label": "Depth Scale", "precision": 1, "default": MILLIMETRES,
        "description": "Steps a meter of the depth beside the video; 1000: millimeters",
    },
    (SceneKeys, "name"): {
        "label": "Name", "default": "room", "given": True, "description": "The scene's folder in the dataset",
    },
    (TrajectorySpec, "file"): {
        "label": "File",
        "description": "Poses of Replica, KITTI, TUM, EuRoC, ScanNet, Open3D (.log) or nerfstudio (transforms.json)",
    },
    (TrajectorySpec, "rate_hz"): {"label": "Frame Rate"},
    (TrajectorySpec, "every"): {
        "label": "Every Nth Pose", "description": "Use every pose, every second one, every third, and so on",
    },
    (HandheldSpec, "frames"): {"label": "Length", "default": 40},
    (HandheldSpec, "rate_hz"): {"label": "Frame Rate"},
    (BodySpec, "kind"): {"label": "Body"},
    (BodySpec, "motion"): {"label": "Body Motion"},
    **{
        (CameraSpec, name): {"label": name, "default": getattr(REPLICA_CAMERA, name)}
        for name in ("fx", "fy", "cx", "cy")
    },
    **{(CameraSpec, name): {"default": getattr(REPLICA_CAMERA, name)} for name in ("width", "height")},
    (CameraSpec, "near_m"): {"precision": 4},
    (PresetSpec, "camera"): {"given": True},
    (RigSpec, "imu"): {"label": "IMU"},
    **{
        (DistortionSpec, name): {"label": name.upper(), "precision": 6, "soft_min": -1.0, "soft_max": 1.0}
        for name in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
    },
    (DistortionSpec, "model"): {"label": "Lens Model", "given": True},
    (DistortionSpec, "undistort"): {"label": "Undistort Again"},
    (ImuSpec, "device"): {"label": "IMU Device", "given": True},
    (SensorSpec, "translation_m"): {
        "label": "Place", "precision": 4, "soft_min": -0.5, "soft_max": 0.5,
        "description": "Where the sensor sits beside the camera, in the axes of the path's poses",
    },
    (ImuSpec, "rate_hz"): {"label": "IMU Rate", "soft_min": 50, "soft_max": 1000},
    (ImuSpec, "gravity_m_s2"): {"label": "Gravity", "soft_max": 25},
    (ImuSpec, "time_offset_s"): {"label": "Time Offset", "precision": 4, "soft_min": 0, "soft_max": 0.1},
    (ImuSpec, "clock_drift_ppm"): {"label": "Clock Drift", "soft_min": -200, "soft_max": 200},
    (PresetSpec, "seed"): {"section": PERTURBATIONS, "max": LARGEST_INT},
    (OutputSpec, "layout"): {"description": "The layout of the files"},
    (OutputSpec, "image"): {
        "label": "Images", "default": _OUTPUT.image,
        "description": "Format of color: JPEG at quality 98 without chroma subsampling, PNG, or EXR of light",
    },
    (OutputSpec, "colour"): {
        "label": "Channels", "default": _OUTPUT.colour,
        "description": "What color images hold: red, green and blue, or one channel of gray",
    },
    (OutputSpec, "depth_scale_per_m"): {
        "label": "Depth Scale", "precision": 1, "default": _OUTPUT.depth_scale_per_m,
        "description": "Steps of the 16-bit depth images a metre",
    },
    (OutputSpec, "depth_beyond"): {"label": "Beyond Range"},
    (OutputSpec, "modalities"): {"label": "Write", "description": "The channels that are rendered and written"},
    (SettingSpec, "name"): {"label": "Setting", "default": "perturbed", "given": True},
}  # fmt: skip


def words_of(cls: type, name: str) -> dict[str, Any]:
    """Return what the panel says of a key of a dataclass or of those that it is made from; {} is what the schema says.

    given: whether a new panel gives it. section: of the tab. Else arguments of the property.
    """
    return dict(next((_WORDS[base, name] for base in cls.__mro__ if (base, name) in _WORDS), {}))
