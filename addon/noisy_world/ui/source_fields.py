# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's properties of each source, from the dataclasses that presets are checked against."""

from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, Literal, get_origin, get_type_hints

import bpy

from ..core.datasets.layouts import LAYOUTS, RECORDED
from ..core.datasets.layouts.recorded import MILLIMETRES
from ..core.labels import american
from ..core.planning.scene import SourceKind
from ..core.scenes.embedded import ROOMS
from ..sources import SOURCES
from ..sources.blend import BlendKeys
from ..sources.mesh import MeshKeys
from ..sources.recording import RecordingKeys
from ..sources.video import VideoKeys
from .described import SCENE, TRAJECTORY, choice, described, notify_once, sentence, tell
from .typed_numbers import property_name

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import PropertyFlagItems

FIELDS = {
    "recorded_layout": "layout", "recorded_poses": "poses", "undistort": "undistort", "register_depth": "register",
    "recorded_void": "void",
}  # fmt: skip
"""Properties of a recording by the keys of a preset's scene that they give."""

LAYOUT_LABELS = tuple(layout.label for layout in (*LAYOUTS.values(), *RECORDED.values()))


def keys_class(kind: SourceKind[Any]) -> type:
    """Return the dataclass of what a preset says of a package's source: what its one key holds."""
    hint = get_type_hints(kind.keys)[kind.name]
    return hint if isinstance(hint, type) and is_dataclass(hint) else kind.keys


def field_names(kind: SourceKind[Any]) -> list[str]:
    """Return the fields of `keys_class` that are the source's own."""
    cls = keys_class(kind)
    return [kind.name] if cls is kind.keys else [item.name for item in fields(cls)]


def _can_be_shown(kind: SourceKind[Any]) -> bool:
    """Tell whether each field is one number, text, choice or switch, as a property of Blender's is."""
    hints, simple = get_type_hints(keys_class(kind)), (int, float, bool, str)
    return all(hints[name] in simple or get_origin(hints[name]) is Literal for name in field_names(kind))


PACKAGED = {name: kind for name, kind in SOURCES.items() if SOURCES.distribution(name) and _can_be_shown(kind)}
"""The sources of installed packages that the panel can show, by their names."""


def _group_of(kind: SourceKind[Any]) -> type:
    name = "NoisyWorld" + "".join(word.capitalize() for word in kind.name.split("_")) + "Source"
    members = {
        property_name(item): described(keys_class(kind), item, section=SCENE, update=kind.name)
        for item in field_names(kind)
    }
    members["exact"] = bpy.props.StringProperty(options={"HIDDEN"})
    return type(name, (bpy.types.PropertyGroup,), {"__annotations__": members, "__module__": __name__})


GROUPS = {name: _group_of(kind) for name, kind in PACKAGED.items()}

FOOTAGE = frozenset({"RECORDING", "VIDEO", *PACKAGED})
"""Sources whose frames are shown as the source itself gives them, without a mesh or a path in this file."""

ITEMS: list[tuple[str, str, str]] = [
    ("ROOM", "Embedded Room", "One of the rooms that come with Noisy World"),
    ("FILE", "Mesh File", "A mesh with its colors or textures, unlit"),
    ("SCENE", "This Scene", "What this file's scene renders: its objects, lights, world and settings"),
    ("RECORDING", "Recording", "Frames that were recorded, with their depth and, where there is one, their path"),
    ("VIDEO", "Video", "A video file; a folder beside it may hold its depth"),
    *((name, american(kind.label), sentence(kind.meaning)) for name, kind in PACKAGED.items()),
]
"""What the dataset may show, as an enumeration has it."""


def _take_recorded_layout(panel: Any, context: bpy.types.Context) -> None:
    """Write no depth of plain images, which have none."""
    with notify_once():
        if panel.recorded_layout == "images":
            panel.use_depth = False
        tell("recorded_layout")(panel, context)


def source_members() -> dict[str, Any]:
    """Return the properties of all sources by their names."""
    path_options: set[PropertyFlagItems] = {"PATH_SUPPORTS_BLEND_RELATIVE"}
    layouts = f"{', '.join(LAYOUT_LABELS[:-1])} or {LAYOUT_LABELS[-1]}"
    return {
        "mesh_path": described(
            MeshKeys, "mesh", label="Mesh File", update="mesh_path", subtype="FILE_PATH", options=path_options,
            description="Mesh with colors or textures: PLY, glTF, OBJ, USD, FBX or STL",
        ),
        "room_seed": bpy.props.IntProperty(
            options=set(), name="Room", description="Which of the embedded rooms", min=0, max=ROOMS - 1,
            update=tell("room_seed"),
        ),
        "compositing": choice(
            "compositing", "Compositing", "What becomes of the scene's own compositing, in the dataset and in previews",
            ("off", "Off", "Frames are as rendered, before the compositing"),
            ("keep", "Keep", "Frames are as the compositing makes them"),
            ("auto", "As Rendered", "Keep where a render of the scene is composited, else Off"),
            default="auto",
        ),
        "depth_alpha": described(
            BlendKeys, "depth_alpha", label="Depth Alpha", update="depth_alpha",
            description="Higher: depth sees through surfaces that are less transparent",
        ),
        "sequence_path": described(
            RecordingKeys, "sequence", label="Folder", update="sequence_path", subtype="DIR_PATH", options=path_options,
            description=f"Folder of a recording, laid out as {layouts}; which one is told by its files",
        ),
        "recorded_layout": described(
            RecordingKeys, "layout", label="Layout", update=_take_recorded_layout,
            description="What the folder holds: a recording, or plain images alone",
        ),
        "recorded_poses": described(
            RecordingKeys, "poses", label="Without Pose", section=TRAJECTORY, update="recorded_poses",
            description="What becomes of frames that have no valid pose",
        ),
        "recorded_rate_hz": described(
            RecordingKeys, "rate_hz", label="Frame Rate", section=TRAJECTORY, update="recorded_rate_hz",
            default=0.0, min=0.0, soft_min=0.0,
            description="Rate of frames that have no time stamps; 0: the rate of their layout",
        ),
        "undistort": described(
            RecordingKeys, "undistort", update="undistort",
            description="Make a pinhole's pictures of those of a lens that distorts",
        ),
        "register_depth": described(
            RecordingKeys, "register", label="Register Depth", update="register_depth",
            description="Lay depth of a camera of its own into color, by the calibration",
        ),
        "recorded_void": described(
            RecordingKeys, "void", label="Void", update="recorded_void",
            description="What depth 0 means to fog, weather and defocus by depth; depth is written as it is",
        ),
        "recorded_depth_scale_per_m": described(
            RecordingKeys, "depth_scale_per_m", label="Depth Scale", update="recorded_depth_scale_per_m", precision=1,
            default=0.0, min=0.0, soft_min=0.0,
            description="Steps a meter of depth, such as 1000 for millimeters; 0: what files and layout say",
        ),
        "video_path": described(
            VideoKeys, "video", label="Video", update="video_path", subtype="FILE_PATH", options=path_options,
            description="A video that OpenCV reads, such as .mp4, .mov, .avi or .mkv",
        ),
        "video_depth_path": described(
            VideoKeys, "depth", label="Depth", update="video_depth_path", subtype="DIR_PATH", options=path_options,
            description="Folder of the video's depth: a 16-bit PNG for each frame, in the order of their numbers",
        ),
        "video_depth_scale_per_m": described(
            VideoKeys, "depth_scale_per_m", label="Depth Scale", update="video_depth_scale_per_m", precision=1,
            default=MILLIMETRES, description="Steps a meter of the depth beside the video; 1000: millimeters",
        ),
        "recorded_camera": choice(
            "recorded_camera", "Intrinsics", "Where the camera's intrinsics come from",
            ("RECORDED", "As Recorded", "Those that the recording's files say"),
            ("GIVEN", "As Given", "The numbers below"),
        ),
        **{name: bpy.props.PointerProperty(type=group) for name, group in GROUPS.items()},
    }  # fmt: skip
