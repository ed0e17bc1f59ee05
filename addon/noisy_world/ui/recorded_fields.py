# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's properties of a recording or a video, from the dataclass that presets are checked against."""

from typing import TYPE_CHECKING, Any

import bpy

from ..core.datasets.layouts import LAYOUTS, RECORDED
from ..core.datasets.layouts.recorded import MILLIMETRES
from ..core.presets.scene_keys import SceneSpec
from .described import described, tell

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import PropertyFlagItems

SOURCES: list[tuple[str, str, str]] = [
    ("RECORDING", "Recording", "Frames that were recorded, with their depth and, where there is one, their path"),
    ("VIDEO", "Video", "A video file; a folder beside it may hold its depth"),
]
"""The sources of this kind, as an enumeration has them."""

FIELDS = {
    "recorded_poses": "poses", "undistort": "undistort", "register_depth": "register",
}  # fmt: skip
"""Properties of a recording by the keys of a preset's scene that they give."""

LAYOUT_LABELS = tuple(layout.label for layout in (*LAYOUTS.values(), *RECORDED.values()))


def recorded_members() -> dict[str, Any]:
    """Return the properties by their names."""
    path_options: set[PropertyFlagItems] = {"PATH_SUPPORTS_BLEND_RELATIVE"}
    layouts = f"{', '.join(LAYOUT_LABELS[:-1])} or {LAYOUT_LABELS[-1]}"
    return {
        "sequence_path": described(
            SceneSpec, "sequence", label="Folder", update="sequence_path", subtype="DIR_PATH", options=path_options,
            description=f"Folder of a recording, laid out as {layouts}; which one is told by its files",
        ),
        "recorded_poses": described(
            SceneSpec, "poses", label="Without Pose", update="recorded_poses",
            description="What becomes of frames that have no valid pose",
        ),
        "recorded_rate_hz": described(
            SceneSpec, "rate_hz", label="Frame Rate", update="recorded_rate_hz", default=0.0, min=0.0, soft_min=0.0,
            description="Rate of frames that have no time stamps; 0: the rate of their layout",
        ),
        "undistort": described(
            SceneSpec, "undistort", update="undistort",
            description="Make a pinhole's pictures of those of a lens that distorts",
        ),
        "register_depth": described(
            SceneSpec, "register", label="Register Depth", update="register_depth",
            description="Lay depth of a camera of its own into color, by the calibration",
        ),
        "video_path": described(
            SceneSpec, "video", label="Video", update="video_path", subtype="FILE_PATH", options=path_options,
            description="A video that OpenCV reads, such as .mp4, .mov, .avi or .mkv",
        ),
        "video_depth_path": described(
            SceneSpec, "depth", label="Depth", update="video_depth_path", subtype="DIR_PATH", options=path_options,
            description="Folder of the video's depth: a 16-bit PNG for each frame, in the order of their numbers",
        ),
        "video_depth_scale_per_m": described(
            SceneSpec, "depth_scale_per_m", label="Depth Scale", update="video_depth_scale_per_m", precision=1,
            default=MILLIMETRES, description="Steps a meter of the depth beside the video; 1000: millimeters",
        ),
        "recorded_camera": bpy.props.EnumProperty(
            options=set(),
            name="Intrinsics",
            description="Where the camera's intrinsics come from",
            items=[
                ("RECORDED", "As Recorded", "Those that the recording's files say"),
                ("GIVEN", "As Given", "The numbers below"),
            ],
            update=tell("recorded_camera"),
        ),
    }  # fmt: skip
