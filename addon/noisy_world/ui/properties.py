# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's content as properties of a scene, derived from the dataclasses that presets are checked against."""

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING, Any

import bpy

from ..core.channels import CHANNELS
from ..core.errors import NoisyWorldError
from ..core.labels import title
from ..core.perturbing.kinds import SEVERITIES, Perturbation
from ..core.presets.output import OutputSpec
from ..core.presets.preset import (
    REPLICA_CAMERA,
    CameraSpec,
    PresetSpec,
    RenderSpec,
    SettingSpec,
)
from ..core.presets.scene_keys import BodySpec, HandheldSpec, SceneKeys, TrajectorySpec
from ..core.schema import label_of
from ..perturbations import registry
from ..perturbations.faster_motion import FasterMotion
from ..perturbations.motion_deviation import MotionDeviation
from .described import LARGEST_INT, LISTENERS, channel_flag, choice, described, notify_once, tell
from .imu_fields import imu_members
from .lens_fields import lens_members
from .shot_fields import NoisyWorldShot, shot_list_members
from .source_fields import GROUPS, ITEMS, source_members
from .typed_numbers import property_name, set_value

OUTPUT = OutputSpec().format  # the format of a new scene
if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import PropertyFlagItems

# Presets hold no keyframes, so what they hold cannot be animated; but for a severity, which they hold frame by frame.
_flag = partial(bpy.props.BoolProperty, options=set())
_enum = partial(bpy.props.EnumProperty, options=set())
_whole = partial(bpy.props.IntProperty, options=set())
_text = partial(bpy.props.StringProperty, options=set())
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
