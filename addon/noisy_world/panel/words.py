# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel says of a preset's keys in its own way: labels, tooltips, and the values that a new panel begins with.

All else that a property shows is the schema's.
"""

from typing import Any

from ..layouts import LAYOUTS, RECORDED
from ..layouts.described import SequenceSpec
from ..layouts.layout import MILLIMETRES
from ..preset.keys import (
    REPLICA_CAMERA,
    CameraSpec,
    ImuSpec,
    OutputSpec,
    PresetSpec,
    RenderSpec,
    RigSpec,
    SensorSpec,
    SettingSpec,
)
from ..preset.scene_keys import HandheldSpec, SceneKeys, TrajectorySpec
from ..preset.sensor_keys import DistortionSpec
from ..sources.blend import BlendKeys
from ..sources.mesh import MeshKeys
from ..sources.recording import RecordingKeys
from ..sources.video import VideoKeys
from .fields import GENERATE, LARGEST_INT, TRAJECTORY

FILES: dict[tuple[type, str], str] = {
    (MeshKeys, "mesh"): "FILE_PATH", (SequenceSpec, "folder"): "DIR_PATH", (VideoKeys, "video"): "FILE_PATH",
    (VideoKeys, "depth"): "DIR_PATH", (BlendKeys, "blend"): "FILE_PATH", (TrajectorySpec, "file"): "FILE_PATH",
}  # fmt: skip
"""The keys that name files, beside those whose field reads one; and what Blender's browser looks for."""

LAYOUT_LABELS = tuple(layout.label for layout in (*LAYOUTS.values(), *RECORDED.values()))
_LAYOUTS = f"{', '.join(LAYOUT_LABELS[:-1])} or {LAYOUT_LABELS[-1]}"
_OUTPUT = OutputSpec().format

_WORDS: dict[tuple[type, str], dict[str, Any]] = {
    (SequenceSpec, "folder"): {"description": f"Folder of a recording, laid out as {_LAYOUTS}, as its files tell"},
    (RecordingKeys, "poses"): {"section": TRAJECTORY},
    (RecordingKeys, "rate_hz"): {"section": TRAJECTORY},
    (RecordingKeys, "depth_scale_per_m"): {"precision": 1, "default": MILLIMETRES},
    (VideoKeys, "depth_scale_per_m"): {"precision": 1, "default": MILLIMETRES},
    (SceneKeys, "name"): {"default": "room", "given": True},
    (HandheldSpec, "frames"): {"default": 40},
    **{
        (CameraSpec, name): {"default": getattr(REPLICA_CAMERA, name)}
        for name in ("width", "height", "fx", "fy", "cx", "cy")
    },
    (CameraSpec, "near_m"): {"precision": 4},
    (PresetSpec, "camera"): {"given": True},
    (PresetSpec, "seed"): {"section": GENERATE, "max": LARGEST_INT},
    **{
        (DistortionSpec, name): {"precision": 6, "soft_min": -1.0, "soft_max": 1.0}
        for name in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
    },
    (DistortionSpec, "model"): {"given": True},
    (SensorSpec, "translation_m"): {"precision": 4, "soft_min": -0.5, "soft_max": 0.5},
    (RenderSpec, "compositor_device"): {"label": "Compositor"},
    (RigSpec, "imu"): {"label": "IMU"},
    (ImuSpec, "device"): {"label": "IMU Device", "given": True},
    (ImuSpec, "rate_hz"): {"label": "IMU Rate", "soft_min": 50, "soft_max": 1000},
    (ImuSpec, "gravity_m_s2"): {"label": "Gravity", "soft_max": 25},
    (ImuSpec, "time_offset_s"): {"label": "Time Offset", "precision": 4, "soft_min": 0, "soft_max": 0.1},
    **{
        (ImuSpec, f"{sensor}_{key}"): {"label": f"{sensor.title()} {label}"}
        for sensor in ("gyro", "accel")
        for key, label in (("noise_density", "Noise"), ("random_walk", "Walk"))
    },
    (ImuSpec, "gyro_misalignment_deg"): {"label": "Gyro Skew"},
    (ImuSpec, "accel_misalignment_deg"): {"label": "Accel Skew"},
    (ImuSpec, "accel_range_m_s2"): {"label": "Accel Range"},
    (ImuSpec, "accel_step_m_s2"): {"label": "Accel Step"},
    (ImuSpec, "clock_drift_ppm"): {"label": "Clock Drift", "soft_min": -200, "soft_max": 200},
    (OutputSpec, "image"): {"default": _OUTPUT.image},
    (OutputSpec, "colour"): {"default": _OUTPUT.colour},
    (OutputSpec, "depth_scale_per_m"): {"precision": 1, "default": _OUTPUT.depth_scale_per_m},
    (SettingSpec, "name"): {"default": "perturbed", "given": True, "section": GENERATE},
}  # fmt: skip


def words_of(cls: type, name: str) -> dict[str, Any]:
    """Return what the panel says of a key of a dataclass or of those that it is made from; {} is what the schema says.

    given: whether a new panel gives it. section: of the tab. Else arguments of the property.
    """
    return dict(next((_WORDS[base, name] for base in cls.__mro__ if (base, name) in _WORDS), {}))
