# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's content as properties of a scene, derived from the dataclasses that presets are checked against."""

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, get_origin, get_type_hints

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..channels import CHANNELS
from ..core.errors import NoisyWorldError
from ..core.labels import american, title
from ..core.lens import MODELS
from ..core.schema import label_of
from ..layouts import LAYOUTS, RECORDED
from ..layouts.layout import MILLIMETRES
from ..perturbations import registry
from ..perturbations.kinds import SEVERITIES, Perturbation
from ..perturbations.shipped.faster_motion import FasterMotion
from ..perturbations.shipped.motion_deviation import MotionDeviation
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
from ..preset.scene_keys import BodySpec, HandheldSpec, SceneKeys, TrajectorySpec
from ..preset.sensor_keys import OF_ANGLE, DistortionSpec
from ..scenes.polygon_mesh import ROOMS
from ..sources import SOURCES
from ..sources.blend import BlendKeys
from ..sources.mesh import MeshKeys
from ..sources.recording import RecordingKeys
from ..sources.scene_kinds import SourceKind
from ..sources.video import VideoKeys
from .fields import (
    LARGEST_INT,
    LISTENERS,
    SCENE,
    TRAJECTORY,
    channel_flag,
    choice,
    described,
    notify_once,
    property_name,
    sentence,
    set_value,
    tell,
    value_of,
)

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import PropertyFlagItems


# The panel's fields of an IMU that the camera carries: a device, where it sits, its rate and its clock.


IMU_UPDATE = "imu"  # what listeners are told
PLACE = ("imu_x_m", "imu_y_m", "imu_z_m")
NUMBERS = ("rate_hz", "gravity_m_s2", "time_offset_s", "clock_drift_ppm")
_SHOWN = ("device", "translation_m", *NUMBERS)


def imu_members() -> dict[str, Any]:
    """Return the properties, by name."""
    return {
        "has_imu": bpy.props.BoolProperty(
            options=set(),
            name="IMU",
            description="Write what an inertial measurement unit on the camera measures, and its true states",
            update=tell(IMU_UPDATE),
        ),
        "imu_device": described(ImuSpec, "device", label="IMU Device", update=IMU_UPDATE),
        **{
            name: bpy.props.FloatProperty(
                options=set(),
                name=f"IMU {name[4].upper()}",
                description="Where the IMU sits beside the camera, in the axes of the path's poses",
                subtype="DISTANCE",
                precision=4,
                min=-1e6,
                max=1e6,
                soft_min=-0.5,
                soft_max=0.5,
                update=tell(IMU_UPDATE),
            )
            for name in PLACE
        },
        "imu_rate_hz": described(ImuSpec, "rate_hz", label="IMU Rate", update=IMU_UPDATE, soft_min=50, soft_max=1000),
        "imu_gravity_m_s2": described(ImuSpec, "gravity_m_s2", label="Gravity", update=IMU_UPDATE, soft_max=25),
        "imu_time_offset_s": described(
            ImuSpec, "time_offset_s", label="Time Offset", update=IMU_UPDATE, precision=4, soft_min=0, soft_max=0.1
        ),
        "imu_clock_drift_ppm": described(
            ImuSpec, "clock_drift_ppm", label="Clock Drift", update=IMU_UPDATE, soft_min=-200, soft_max=200
        ),
    }


def rig_of(panel: Any) -> dict[str, Any]:
    """Return the rig as a preset has it: {} without an IMU, else under its key; what is the default is left out."""
    if not panel.has_imu:
        return {}
    place = [value_of(panel, name) for name in PLACE]
    given: dict[str, Any] = {"device": panel.imu_device} | ({"translation_m": place} if any(place) else {})
    defaults = {item.name: item.default for item in fields(ImuSpec)}
    for name in NUMBERS:
        if (value := value_of(panel, f"imu_{name}")) != defaults[name]:
            given[name] = value
    return {"rig": {"imu": given}}


def unshown_rig(rig: RigSpec | None) -> dict[str, str | bool]:
    """Return by key what the panel cannot show of a rig; False for nothing."""
    if rig is None:
        return {}
    if rig.imu is None or rig.rgb != SensorSpec() or rig.depth is not None:
        return {"rig": "places sensors on a robot"}
    given = (item.name for item in fields(rig.imu) if getattr(rig.imu, item.name) != item.default)
    return {f"rig.imu.{name}": "is given" for name in given if name not in _SHOWN}


def take_rig(panel: Any, rig: RigSpec | None) -> None:
    """Set the panel from a preset's rig that it can show; None for none."""
    panel.has_imu = rig is not None
    if rig is None or rig.imu is None:
        return
    panel.imu_device = rig.imu.device
    for name, value in zip(PLACE, rig.imu.translation_m, strict=True):
        set_value(panel, name, value)
    for name in NUMBERS:
        set_value(panel, f"imu_{name}", getattr(rig.imu, name))


def draw_imu(layout: bpy.types.UILayout, panel: Any) -> None:
    """Draw the fields."""
    layout.prop(panel, "has_imu")
    if not panel.has_imu:
        return
    layout.prop(panel, "imu_device")
    for names in (PLACE, [f"imu_{name}" for name in NUMBERS]):
        column = layout.column(align=True)
        for name in names:
            column.prop(panel, name)


# The panel's fields of a lens that distorts: of the camera that meshes are seen through, or laid over a recording.


COEFFICIENTS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
LENS_UPDATE = "distortion"  # what listeners are told


def lens_members() -> dict[str, Any]:
    """Return the properties, by name."""
    return {
        "distorts": bpy.props.BoolProperty(
            options=set(),
            name="Distortion",
            description="Show frames through a lens that distorts. Viewport and previews of meshes stay a pinhole's",
            update=tell(LENS_UPDATE),
        ),
        "distortion_model": described(DistortionSpec, "model", label="Lens Model", update=LENS_UPDATE),
        **{
            f"distortion_{name}": described(
                DistortionSpec, name, label=name.upper(), update=LENS_UPDATE, precision=6, soft_min=-1.0, soft_max=1.0
            )
            for name in COEFFICIENTS
        },
        "distortion_undistort": described(DistortionSpec, "undistort", label="Undistort Again", update=LENS_UPDATE),
    }


def distortion_of(panel: Any, *, rendered: bool) -> dict[str, Any]:
    """Return the lens as a preset has it: {} without one, else under its key. rendered: not laid over a recording."""
    if not panel.distorts:
        return {}
    said = {name: value_of(panel, f"distortion_{name}") for name in _shown(panel)}
    given: dict[str, Any] = {"model": panel.distortion_model, **{name: value for name, value in said.items() if value}}
    if rendered and panel.distortion_undistort:
        given["undistort"] = True
    return {"distortion": given}


def take_distortion(panel: Any, spec: DistortionSpec | None) -> None:
    """Set the panel from a preset's lens; None for none."""
    panel.distorts = spec is not None
    if spec is None:
        return
    panel.distortion_model, panel.distortion_undistort = spec.model, spec.undistort
    for name in COEFFICIENTS:
        set_value(panel, f"distortion_{name}", getattr(spec, name))


def draw_distortion(layout: bpy.types.UILayout, panel: Any, *, rendered: bool) -> None:
    """Draw the fields that the lens's model has."""
    layout.prop(panel, "distorts")
    if not panel.distorts:
        return
    layout.prop(panel, "distortion_model")
    column = layout.column(align=True)
    for name in _shown(panel):
        column.prop(panel, f"distortion_{name}")
    if rendered:
        layout.prop(panel, "distortion_undistort")


def _shown(panel: Any) -> tuple[str, ...]:
    return OF_ANGLE if panel.distortion_model == MODELS[1] else COEFFICIENTS


# The list of shots as properties of a scene: each a camera, frames, perturbations, a seed and a folder.


_flag = partial(bpy.props.BoolProperty, options=set())
_whole = partial(bpy.props.IntProperty, options=set())
_text = partial(bpy.props.StringProperty, options=set())

PANEL_LIST, OWN_LIST, PRESET_LIST = "PANEL", "OWN", "PRESET"


def _is_camera(_: Any, item: bpy.types.Object) -> bool:
    return item.type == "CAMERA"


def _shot_members() -> dict[str, Any]:
    return {
        "name": _text(name="Name", description="The shot's name, in this list and in what is said of it"),
        "enabled": _flag(name="Enabled", description="Whether Generate Shots takes this shot", default=True),
        "camera": bpy.props.PointerProperty(
            type=bpy.types.Object, name="Camera", poll=_is_camera,
            description="The camera that the shot is seen through",
        ),
        "frame_start": _whole(name="First Frame", description="The scene's frame that the shot begins with", default=1),
        "frame_end": _whole(name="Last Frame", description="The last frame of the scene that is shown", default=250),
        "perturbations": bpy.props.EnumProperty(
            options=set(),
            name="Perturb By",
            description="Where the shot's perturbations come from",
            items=[
                (PANEL_LIST, "Panel", "The list above and the deviation, as they are when Generate Shots is pressed"),
                (OWN_LIST, "Own List", "The list as it was when the shot was added or Keep List was pressed"),
                (PRESET_LIST, "Preset", "A setting of a preset's file"),
            ],
        ),
        "own_list": _text(options={"HIDDEN"}),
        "preset": _text(
            name="Preset", description="The preset whose perturbations the shot has", subtype="FILE_PATH",
            options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        ),
        "setting": _text(
            name="Setting", description="The preset's setting; empty: the first that is not clean"
        ),
        "seed": _whole(name="Seed", description="Seed of the shot's random patterns", min=0, max=LARGEST_INT),
        "output_folder": _text(
            name="Output", description="Folder of the shot's dataset", subtype="DIR_PATH",
            options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        ),
    }  # fmt: skip


NoisyWorldShot: type = type(
    "NoisyWorldShot", (bpy.types.PropertyGroup,), {"__annotations__": _shot_members(), "__module__": __name__}
)


def shot_list_members() -> dict[str, Any]:
    """Return the properties of a scene that hold its shots."""
    return {
        "shots": bpy.props.CollectionProperty(type=NoisyWorldShot, name="Shots", description="Made by Generate Shots"),
        "active_shot": _whole(name="Active Shot", description="The shot whose values are shown", min=0),
    }


def active_shot(panel: Any) -> Any | None:
    """Return the selected shot, where there is one."""
    return panel.shots[panel.active_shot] if 0 <= panel.active_shot < len(panel.shots) else None


# The panel's properties of each source, from the dataclasses that presets are checked against.


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


OUTPUT = OutputSpec().format  # the format of a new scene

# Presets hold no keyframes, so what they hold cannot be animated; but for a severity, which they hold frame by frame.
_enum = partial(bpy.props.EnumProperty, options=set())
OVERRIDE = "override_"  # + a parameter's name: whether its value overrides the severity's


# --- perturbations ---


def _parameters_class(perturbation: Perturbation) -> type:
    """Return the property group of a perturbation's parameters, and of which of them override the severity's."""
    members: dict[str, Any] = {}
    for item in fields(perturbation.parameters):
        more: dict[str, Any] = _soft_range(perturbation, item.name) if item.name in perturbation.severities else {}
        members[property_name(item.name)] = described(
            perturbation.parameters, item.name, update="steps", section=title(perturbation.label), **more
        )
        if item.name in perturbation.severities:
            members[OVERRIDE + item.name] = _flag(
                name=f"Override {label_of(perturbation.parameters, item.name)}",
                description="Set this parameter by hand instead of taking the severity's value",
                update=_take_severity(perturbation, item.name),
                default=False,
            )
    name = "NoisyWorld" + "".join(word.capitalize() for word in perturbation.name.split("_")) + "Parameters"
    members["exact"] = _text(options={"HIDDEN"})
    return type(name, (bpy.types.PropertyGroup,), {"__annotations__": members, "__module__": __name__})


def _soft_range(perturbation: Perturbation, parameter: str) -> dict[str, Any]:
    """Return where a slider ends: at nothing, and at half as much again as at the strongest severity."""
    table = perturbation.severities[parameter]
    low, high = min(table), max(table)
    return {"soft_min": min(0.0, 1.5 * low), "soft_max": float(f"{max(1.5 * high, 0.5 * high):.2g}")}


def _take_severity(perturbation: Perturbation, parameter: str) -> Callable[[Any, bpy.types.Context], None]:
    """Return an update function: a parameter that is to be set by hand starts with the severity's value."""
    on_change = tell("steps")

    def update(group: Any, context: bpy.types.Context) -> None:
        step = group.path_from_id().rpartition(".")[0]
        severity = group.id_data.path_resolve(step).severity
        if getattr(group, OVERRIDE + parameter) and severity >= SEVERITIES[0]:
            set_value(group, parameter, getattr(perturbation.at_severity(severity), parameter))
        on_change(group, context)

    return update


def _snap_severity(step: Any, context: bpy.types.Context) -> None:
    """Round a severity to an allowed value: 0, or 1 to 5; in dynamic mode, which draws from 0 to it, a whole number."""
    severity = step.severity
    if step.mode == "dynamic" or severity < SEVERITIES[0]:
        severity = float(int(severity + 0.5))
    if severity != step.severity:
        step.severity = severity  # calls this again
        return
    tell("steps")(step, context)


def _step_members() -> dict[str, Any]:
    lowest, highest = SEVERITIES[0], SEVERITIES[-1]
    members: dict[str, Any] = {
        "perturbation": _text(name="Perturbation", description="Its name, as in presets", update=tell("steps")),
        "enabled": _flag(
            name="Enabled",
            description="Whether this perturbation acts",
            default=True,
            update=tell("steps"),
        ),
        "use_severity": _flag(
            name="By Severity",
            description="Take the parameters from the severity's table; off: set all of them by hand",
            default=True,
            update=tell("steps"),
        ),
        "severity": bpy.props.FloatProperty(
            name="Severity",
            description=f"How strong: {lowest} to {highest}, between which parameters are interpolated; 0 does nothing",
            default=3.0,
            min=0.0,
            max=float(highest),
            step=10,
            precision=1,
            update=_snap_severity,
        ),
        "mode": _enum(
            name="Mode",
            description="Whether the severity changes from frame to frame",
            items=[
                ("static", "Static", "The same severity for every frame"),
                ("dynamic", "Dynamic", "A severity drawn for each frame, from 0 to the one given"),
            ],
            update=_snap_severity,
        ),
        "temporal": choice(
            "steps",
            "Pattern",
            "How a random pattern changes from frame to frame",
            ("fresh", "Fresh", "A new random pattern for each frame"),
            ("fixed", "Fixed", "One random pattern for all frames"),
            ("drift", "Drift", "One random pattern that moves smoothly"),
        ),
        "exact": _text(options={"HIDDEN"}),
    }
    for name, cls in PARAMETERS.items():
        if name in ("name", *members):
            raise NoisyWorldError(
                f"{registry()[name].distribution}: {name} cannot name a perturbation: the panel uses it"
            )
        members[name] = bpy.props.PointerProperty(type=cls, name=title(registry()[name].label))
    return members


PARAMETERS: dict[str, type] = {item.name: _parameters_class(item) for item in registry().values()}
NoisyWorldStep: type = type(
    "NoisyWorldStep", (bpy.types.PropertyGroup,), {"__annotations__": _step_members(), "__module__": __name__}
)


def perturbation_of(step: Any) -> Perturbation:
    """Return the perturbation that an entry of the list stands for."""
    return registry()[step.perturbation]


def parameters_of(step: Any) -> Any:
    """Return the group of an entry's own parameters."""
    return getattr(step, step.perturbation)


def panel_of(scene: bpy.types.Scene) -> Any:
    """Return what the panel holds for a scene: the properties below."""
    return scene.noisy_world  # pyright: ignore[reportAttributeAccessIssue]  added by register


def active_step(panel: Any) -> Any | None:
    """Return the selected entry of the list of perturbations, where there is one."""
    return panel.steps[panel.active_step] if 0 <= panel.active_step < len(panel.steps) else None


# --- the scene's ---


def _take_layout(panel: Any, context: bpy.types.Context) -> None:
    """Set the layout's own image kind, colour and depth scale, which its readers expect."""
    own = OutputSpec(layout=panel.layout).format
    with notify_once():
        if panel.image not in own.layout.images:
            panel.image = own.image
        panel.colour = own.colour
        panel.depth_scale_per_m = own.depth_scale_per_m
        tell("layout")(panel, context)


def _take_mesh_source(panel: Any, context: bpy.types.Context) -> None:
    """Let the path be one that goes with the mesh's source: a scene has a camera, a mesh has none."""
    with notify_once():
        panel.use_clean = panel.mesh_source != "SCENE"  # a scene of one's own is dear to render
        if panel.mesh_source == "SCENE" and panel.trajectory_source == "HANDHELD":
            panel.trajectory_source = "CAMERA"
        elif panel.mesh_source != "SCENE" and panel.trajectory_source == "CAMERA":
            panel.trajectory_source = "HANDHELD"
        tell("mesh_source")(panel, context)


def _panel_members() -> dict[str, Any]:
    replica = REPLICA_CAMERA
    path_options: set[PropertyFlagItems] = {"PATH_SUPPORTS_BLEND_RELATIVE"}
    camera = {"width_px": "width", "height_px": "height", "fx_px": "fx", "fy_px": "fy", "cx_px": "cx", "cy_px": "cy"}
    members: dict[str, Any] = {
        "mesh_source": _enum(
            name="Source",
            description="What the dataset shows",
            items=ITEMS,
            update=_take_mesh_source,
        ),
        "lens_source": choice(
            "lens_source", "Intrinsics", "Where the camera's intrinsics come from",
            ("SCENE", "Scene Camera", "Its lens, sensor and clipping, and the scene's resolution"),
            ("GIVEN", "As Given", "The numbers below"),
        ),
        "render_source": choice(
            "render_source", "Render", "Where engine and samples come from",
            ("SCENE", "As Set Up", "The scene's own engine and samples"),
            ("GIVEN", "As Given", "The engine and samples below"),
        ),
        **source_members(),
        "scene_name": described(
            SceneKeys, "name", label="Name", update="scene_name", default="room",
            description="The scene's folder in the dataset",
        ),
        "trajectory_source": choice(
            "trajectory_source", "Trajectory", "Where the path comes from",
            ("HANDHELD", "Hand-Held", "A seeded path of a camera held in the hand, walking through the scene"),
            ("FILE", "File", "A file of poses, or a folder of one pose a file; its format is told by content"),
            ("CAMERA", "Scene Camera", "The scene's own camera, with all that moves it"),
        ),
        "trajectory_path": described(
            TrajectorySpec, "file", label="File", update="trajectory_path", subtype="FILE_PATH", options=path_options,
            description="Poses of Replica, KITTI, TUM, EuRoC, ScanNet, Open3D (.log) or nerfstudio (transforms.json)",
        ),
        "trajectory_format": described(TrajectorySpec, "format", update="trajectory_format"),
        "trajectory_stamp_unit": described(TrajectorySpec, "stamp_unit", update="trajectory_stamp_unit"),
        "trajectory_rate_hz": described(TrajectorySpec, "rate_hz", label="Frame Rate", update="trajectory_rate_hz"),
        "trajectory_pose": described(TrajectorySpec, "pose", update="trajectory_pose"),
        "trajectory_axes": described(TrajectorySpec, "axes", update="trajectory_axes"),
        "handheld_frames": described(HandheldSpec, "frames", label="Length", update="handheld_frames", default=40),
        "handheld_rate_hz": described(HandheldSpec, "rate_hz", label="Frame Rate", update="handheld_rate_hz"),
        "handheld_speed_m_s": described(HandheldSpec, "speed_m_s", update="handheld_speed_m_s"),
        "handheld_clearance_m": described(HandheldSpec, "clearance_m", update="handheld_clearance_m"),
        "body": choice(
            "body", "Body", "What carries the camera along the path, with its own motion",
            ("NONE", "None", "The path is the camera's"),
            ("walker", "Walker", "A head that walks"),
            ("runner", "Runner", "A head that runs"),
            ("quadruped", "Quadruped", "A small robot on four legs that trots"),
            ("rover", "Rover", "A robot on four wheels, on a rough floor"),
            ("drone", "Drone", "A multicopter, which leans into its acceleration"),
        ),
        "body_motion": described(BodySpec, "motion", label="Body Motion", update="body_motion"),
        "every": described(
            TrajectorySpec, "every", label="Every Nth Pose", update="every",
            description="Use every pose, every second one, every third, and so on",
        ),
        "deviation_rotation": described(
            MotionDeviation, "rotation_deg", label="Rotation", update="deviation_rotation", default=0.0
        ),
        "deviation_translation_m": described(
            MotionDeviation, "translation_m", label="Translation", update="deviation_translation_m", default=0.0,
            precision=4,
        ),
        "speed_factor": described(
            FasterMotion, "factor", label="Speed Factor", update="speed_factor", default=1
        ),
        **{
            name: described(
                CameraSpec, field, label=field if len(field) == 2 else title(field), update=name,
                default=getattr(replica, field),
            )
            for name, field in camera.items()
        },
        "near_m": described(CameraSpec, "near_m", update="near_m", precision=4),
        "far_m": described(CameraSpec, "far_m", update="far_m"),
        **lens_members(),
        **imu_members(),
        "steps": bpy.props.CollectionProperty(type=NoisyWorldStep, name="Perturbations"),
        "active_step": _whole(
            name="Active Perturbation", description="The perturbation whose parameters are shown", min=0
        ),
        **shot_list_members(),
        "seed": described(PresetSpec, "seed", update="seed", max=LARGEST_INT),
        **{
            name: described(RenderSpec, name, update=name) for name in ("engine", "backend", "samples")
        },
        "layout": described(
            OutputSpec, "layout", description="The layout of the files", update=_take_layout
        ),
        "image": described(
            OutputSpec, "image", label="Images", update="image", default=OUTPUT.image,
            description="Format of color: JPEG at quality 98 without chroma subsampling, PNG, or EXR of light",
        ),
        "colour": described(
            OutputSpec, "colour", label="Channels", update="colour", default=OUTPUT.colour,
            description="What color images hold: red, green and blue, or one channel of gray",
        ),
        "depth_scale_per_m": described(
            OutputSpec, "depth_scale_per_m", label="Depth Scale", update="depth_scale_per_m", precision=1,
            default=OUTPUT.depth_scale_per_m, description="Steps of the 16-bit depth images a metre",
        ),
        "depth_beyond": described(OutputSpec, "depth_beyond", label="Beyond Range", update="depth_beyond"),
        "overview": described(OutputSpec, "overview", update="overview"),
        **{f"use_{name}": channel_flag(item) for name, item in CHANNELS.items()},
        "use_clean": _flag(
            name="Clean Frames",
            description="Render and write the frames without perturbations too; Run SLAM compares with them",
            default=True,
            update=tell("use_clean"),
        ),
        "output_folder": _text(
            name="Output",
            description="Folder of the dataset",
            default="//noisy_world",
            subtype="DIR_PATH",
            options=path_options,
            update=tell("output_folder"),
        ),
        "setting_name": described(
            SettingSpec, "name", label="Setting", update="setting_name", default="perturbed"
        ),
        "preview": _flag(
            name="Preview",
            description="Show the perturbations of color live in the viewport and on the render",
            update=tell("preview"),
        ),
        "preview_split": bpy.props.FloatProperty(
            options=set(),
            name="Before / After",
            description="Share of the frame, from the left, that is shown as it was before",
            subtype="FACTOR",
            min=0.0,
            max=1.0,
            default=0.0,
            update=tell("preview_split"),
        ),
        "preset_path": _text(name="Preset", description="The preset that was opened or saved", subtype="FILE_PATH"),
        "preset_settings": _text(options={"HIDDEN"}),
        "exact": _text(options={"HIDDEN"}),
    }  # fmt: skip
    return members


NoisyWorldPanelState: type = type(
    "NoisyWorldPanelState", (bpy.types.PropertyGroup,), {"__annotations__": _panel_members(), "__module__": __name__}
)
CLASSES = (*PARAMETERS.values(), *GROUPS.values(), NoisyWorldStep, NoisyWorldShot, NoisyWorldPanelState)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    """Give every scene what the panel holds."""
    _register_classes()
    state = bpy.props.PointerProperty(type=NoisyWorldPanelState, name="Noisy World")
    bpy.types.Scene.noisy_world = state  # pyright: ignore[reportAttributeAccessIssue]  Blender's way to add one


def unregister() -> None:
    """Remove the properties; their values stay in the files."""
    del bpy.types.Scene.noisy_world  # pyright: ignore[reportAttributeAccessIssue]  as above
    _unregister_classes()
    LISTENERS.clear()


# Angles of files that were saved when the panel held them in degrees.


OWN = "deviation_rotation_deg"


@persistent
def _on_load(*_: object) -> None:
    for scene in bpy.data.scenes:
        stored = scene.bl_system_properties_get()
        if scene.library is None and stored is not None and "noisy_world" in stored:
            take_degrees(panel_of(scene), stored["noisy_world"])


def take_degrees(panel: Any, stored: Any) -> None:
    """Take the angles that are stored in degrees into the panel. stored: the values as the file holds them."""
    for group, values, name in _angles(panel, stored):
        if name in values:
            set_value(group, name, float(str(np.float32(values[name]))))
            del values[name]


def _angles(panel: Any, stored: Any) -> Iterator[tuple[Any, Any, str]]:
    """Yield each group of the panel with angles, what the file stores of it, and an angle's name."""
    yield panel, stored, OWN
    for step, values in zip(panel.steps, stored.get("steps", ()), strict=False):
        for name, perturbation in registry().items():
            for item in fields(perturbation.parameters):
                if item.name.endswith("_deg") and name in values:
                    yield getattr(step, name), values[name], item.name


def register_older_files() -> None:
    """Register the handler of files that are opened."""
    bpy.app.handlers.load_post.append(_on_load)


def unregister_older_files() -> None:
    """Unregister it."""
    bpy.app.handlers.load_post.remove(_on_load)
