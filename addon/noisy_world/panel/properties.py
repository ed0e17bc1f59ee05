# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's content as properties of a scene: the preset's tree, and what no preset holds."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING, Any

import bpy

from ..core.errors import NoisyWorldError, american, title
from ..core.schema import KeyInfo, label_of
from ..nodes.chain import SLIDER_REACH
from ..perturbations import registry
from ..perturbations.kinds import SEVERITIES, Perturbation
from ..perturbations.shares import WHITE
from ..preset.keys import OutputSpec, PresetSpec, SettingSpec
from ..preset.scene_keys import PathKeys, SceneKeys
from ..scenes.polygon_mesh import ROOMS
from ..sources import SOURCES
from ..sources.recording import RecordingKeys
from .fields import LARGEST_INT, LISTENERS, SCENE, choice, described, notify_once, sentence, tell
from .step_list import add_step, remove_entry
from .tree import (
    GIVEN,
    GROUPS,
    HOOKS,
    field_of,
    group_of,
    is_taking,
    make_group,
    members_of,
    property_name,
    set_value,
    taking,
)

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import PropertyFlagItems


# The list of shots as properties of a scene: each a camera, frames, perturbations, a seed and a folder.


_flag = partial(bpy.props.BoolProperty, options=set())
_whole = partial(bpy.props.IntProperty, options=set())
_text = partial(bpy.props.StringProperty, options=set())

PANEL_LIST, OWN_LIST, PRESET_LIST = "PANEL", "OWN", "PRESET"


def _is_camera(_: Any, item: bpy.types.Object) -> bool:
    return item.type == "CAMERA"


def shot_members() -> dict[str, Any]:
    """Return the properties of a shot."""
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


def shot_list_members(shot: type) -> dict[str, Any]:
    """Return the properties of a scene that hold its shots. shot: the group of one."""
    return {
        "shots": bpy.props.CollectionProperty(type=shot, name="Shots", description="Made by Generate Shots"),
        "active_shot": _whole(name="Active Shot", description="The shot whose values are shown", min=0),
    }


def active_shot(panel: Any) -> Any | None:
    """Return the selected shot, where there is one."""
    return panel.shots[panel.active_shot] if 0 <= panel.active_shot < len(panel.shots) else None


# Presets hold no keyframes, so what they hold cannot be animated; but for severity and mix, which they hold by frames.
_enum = partial(bpy.props.EnumProperty, options=set())
DEVIATION, FASTER = "motion_deviation", "faster_motion"
OWN_SLIDERS = {
    "deviation_rotation": (DEVIATION, "rotation_deg"),
    "deviation_translation_m": (DEVIATION, "translation_m"),
    "speed_factor": (FASTER, "factor"),
}
"""Sliders beside the trajectory that show entries of the list: the perturbation and its parameter."""


# --- perturbations ---


def _take_severity(perturbation: Perturbation, parameter: str) -> Callable[[Any, bpy.types.Context], None]:
    """Return an update function: a parameter that is to be set by hand starts with the severity's value."""
    on_change = tell("steps")

    def update(group: Any, context: bpy.types.Context) -> None:
        severity = group.id_data.path_resolve(group.path_from_id().rpartition(".")[0]).severity
        if getattr(group, GIVEN + parameter) and severity >= SEVERITIES[0] and not is_taking():
            with taking():
                set_value(group, parameter, getattr(perturbation.at_severity(severity), parameter))
        on_change(group, context)

    return update


CHANNELS = ("red", "green", "blue")


def colours_in(parameters: type) -> dict[str, tuple[str, ...]]:
    """Return the colours among a dataclass's fields: by the name of the picker, its red, green and blue."""
    names = [item.name for item in fields(parameters)]
    stems = [name.removesuffix("_red") for name in names if name.endswith("_red")]
    found = {f"{stem}_colour": tuple(f"{stem}_{channel}" for channel in CHANNELS) for stem in stems}
    return {picker: channels for picker, channels in found.items() if set(channels) <= set(names)}


def _picker(parameters: type, picker: str, channels: tuple[str, ...]) -> Any:
    """Return a property that shows three of a group as one colour, sRGB-encoded as they are."""
    info: KeyInfo = field_of(parameters, channels[0]).metadata["key"]

    def pick(group: Any, colour: Sequence[float]) -> None:
        with notify_once():
            for name, value in zip(channels, colour, strict=True):
                setattr(group, name, value)

    return bpy.props.FloatVectorProperty(
        options=set(), name=american(title(picker)), description=sentence(info.meaning.replace("red of", "colour of")),
        subtype="COLOR_GAMMA", size=3, min=info.minimum or 0.0, max=info.maximum or 1.0, soft_max=1.0,
        get=lambda group: [getattr(group, name) for name in channels], set=pick,
    )  # fmt: skip


def _parameters_class(perturbation: Perturbation) -> type:
    """Return the property group of a perturbation's parameters, and of which of them are given."""
    cls, members = perturbation.parameters, {"exact": _text(options={"HIDDEN"})}
    for item in fields(cls):
        by_severity = item.name in perturbation.severities
        more = _soft_range(perturbation, item.name) if by_severity else {}
        members |= members_of(cls, item.name, section=title(perturbation.label), **more)
        if by_severity:
            members[GIVEN + item.name] = _flag(
                name=f"Override {label_of(cls, item.name)}",
                description="Set this parameter by hand instead of taking the severity's value",
                update=_take_severity(perturbation, item.name),
            )
    members |= {picker: _picker(cls, picker, channels) for picker, channels in colours_in(cls).items()}
    return make_group("NoisyWorld" + "".join(map(str.capitalize, perturbation.name.split("_"))) + "Parameters", members)


def _soft_range(perturbation: Perturbation, parameter: str) -> dict[str, float]:
    """Return where a slider ends: at nothing, and at half as much again as at the strongest severity."""
    table = perturbation.severities[parameter]
    low, high = min(table), max(table)
    return {"soft_min": min(0.0, SLIDER_REACH * low), "soft_max": float(f"{max(SLIDER_REACH * high, high / 2):.2g}")}


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
        "levels": _text(
            name="Levels", description="The severities that each frame's is drawn from, as YAML", update=tell("steps")
        ),
        "share_mix": bpy.props.FloatProperty(
            name="Mix",
            description="How much of the effect shows: 0 nothing, 1 all",
            default=1.0,
            min=0.0,
            max=1.0,
            subtype="FACTOR",
            update=tell("steps"),
        ),
        "share_mask": _text(
            name="Mask",
            description="An image whose white shows the effect and whose black does not, or a folder with one for each "
            "frame",
            subtype="FILE_PATH",
            options={"PATH_SUPPORTS_BLEND_RELATIVE"},
            update=tell("steps"),
        ),
        "share_colour": bpy.props.FloatVectorProperty(
            name="Color",
            description="How much of the effect shows in red, green and blue; white: all",
            subtype="COLOR_GAMMA",
            size=3,
            default=WHITE,
            min=0.0,
            max=1.0,
            options=set(),
            update=tell("steps"),
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
NoisyWorldStep = make_group("NoisyWorldStep", _step_members())


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


def _take_layout(output: Any) -> None:
    """Show the layout's own image kind, colour and depth scale, which its readers expect, and give none of them."""
    own = OutputSpec(layout=output.layout).format
    with taking():
        if not output.use_image or output.image not in own.layout.images:
            output.image, output.use_image = own.image, False
        output.colour, output.use_colour = own.colour, False
        output.depth_scale_per_m, output.use_depth_scale_per_m = own.depth_scale_per_m, False


def _take_recorded_layout(recording: Any) -> None:
    """Write no depth of plain images, which have none."""
    output = panel_of(recording.id_data).output
    if recording.layout == "images":
        output.modalities = set(output.modalities) - {"depth"}


HOOKS |= {(OutputSpec, "layout"): _take_layout, (RecordingKeys, "layout"): _take_recorded_layout}


def _take_mesh_source(panel: Any, context: bpy.types.Context) -> None:
    """Let path, camera and rendering go with the source: a scene has a camera, a mesh has none."""
    with notify_once():
        if not is_taking():
            own = panel.mesh_source == "SCENE"
            panel.use_clean = not own  # a scene of one's own is dear to render
            panel.use_camera = panel.mesh_source in LOADED
            panel.render.use_engine = panel.render.use_samples = False
            if own and panel.trajectory_source == "HANDHELD":
                panel.trajectory_source = "CAMERA"
            elif not own and panel.trajectory_source == "CAMERA":
                panel.trajectory_source = "HANDHELD"
        tell("mesh_source")(panel, context)


LOADED = ("ROOM", "FILE")
"""Sources whose mesh is loaded into this file."""

SOURCE_GROUP = "of_"  # + a source's name: the property that holds its keys
SHARED = ("name", "trajectory")
"""The keys of a scene that all sources share."""


def _source_items() -> list[tuple[str, str, str, str, int]]:
    """Return what the dataset may show, as an enumeration has it; numbers are those of files saved before."""
    ours = [
        ("ROOM", "Embedded Room", "One of the rooms that come with Noisy World"),
        ("FILE", "Mesh File", "A mesh with its colors or textures, unlit"),
        ("SCENE", "This Scene", "What this file's scene renders: its objects, lights, world and settings"),
        ("RECORDING", "Recording", "Frames that were recorded, with their depth and, where there is one, their path"),
        ("VIDEO", "Video", "A video file; a folder beside it may hold its depth"),
    ]
    named = [(name, american(kind.label), sentence(kind.meaning)) for name, kind in SOURCES.items()]
    packaged = [item for item in named if SOURCES.distribution(item[0])]
    others = [
        ("replica", "Replica", "Rooms of the Replica dataset on this disk"),
        ("blend", "Another File's Scene", "A scene of another .blend, as its artist set it up"),
    ]
    numbered = [(*item, "NONE", place) for place, item in enumerate((*ours, *packaged))]
    return numbered + [(*item, "NONE", 1000 + place) for place, item in enumerate(others)]


ITEMS = _source_items()


def _slider(name: str) -> dict[str, Any]:
    """Return the property of a slider that shows an entry of the list, and makes one where it is moved."""
    step, key = OWN_SLIDERS[name]
    cls = registry()[step].parameters
    still = 1 if step == FASTER else 0.0

    def value(panel: Any) -> Any:
        entry = own_step(panel, step)
        return still if entry is None else getattr(getattr(entry, step), property_name(key))

    def move(panel: Any, to: Any) -> None:
        entry = own_step(panel, step)
        with notify_once():
            if entry is None:
                entry = panel.steps[add_step(panel, step)]
                for other, (owner, other_key) in OWN_SLIDERS.items():
                    if owner == step and other != name:
                        set_value(getattr(entry, step), other_key, 0.0)
            setattr(getattr(entry, step), property_name(key), to)
            held = [getattr(panel, other) for other, (owner, _) in OWN_SLIDERS.items() if owner == step]
            if all(each == still for each in held):
                remove_entry(panel, list(panel.steps).index(entry))

    label = {"deviation_rotation": "Rotation", "deviation_translation_m": "Translation"}.get(name, "Speed Factor")
    more: dict[str, Any] = {"precision": 4} if name == "deviation_translation_m" else {}
    return {name: described(cls, key, label=label, update="motion", default=still, get=value, set=move, **more)}


def own_step(panel: Any, name: str) -> Any | None:
    """Return the first entry of the list of this name that acts; None without one."""
    return next((step for step in panel.steps if step.perturbation == name and step.enabled), None)


NoisyWorldShot = make_group("NoisyWorldShot", shot_members())
NoisyWorldLine = make_group(
    "NoisyWorldLine",
    {
        "name": _text(name="Name", description="What it is called"),
        "line": _text(
            name="As YAML", description="What the preset says of it, as a line of YAML", update=tell("lines")
        ),
    },
)
NoisyWorldSceneGroup = make_group(
    "NoisyWorldSceneGroup",
    {"exact": _text(options={"HIDDEN"})} | members_of(SceneKeys, "name") | members_of(PathKeys, "trajectory"),
)


def _panel_members() -> dict[str, Any]:
    path_options: set[PropertyFlagItems] = {"PATH_SUPPORTS_BLEND_RELATIVE"}
    members: dict[str, Any] = {"exact": _text(options={"HIDDEN"})}
    members |= {
        SOURCE_GROUP + name: bpy.props.PointerProperty(
            type=group_of(kind.keys, leave=SHARED, name=f"NoisyWorld{name.title()}Source", section=SCENE),
            name=american(kind.label),
        )
        for name, kind in SOURCES.items()
    }
    for item in fields(PresetSpec):
        if item.name not in ("scenes", "settings"):
            members |= members_of(PresetSpec, item.name)
    members |= {
        "mesh_source": _enum(
            name="Source", description="What the dataset shows", items=ITEMS, update=_take_mesh_source
        ),
        "scene": bpy.props.PointerProperty(type=NoisyWorldSceneGroup, name="Scene"),
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
        "trajectory_source": choice(
            "trajectory_source", "Trajectory", "Where the path comes from",
            ("HANDHELD", "Hand-Held", "A seeded path of a camera held in the hand, walking through the scene"),
            ("FILE", "File", "A file of poses, or a folder of one pose a file; its format is told by content"),
            ("CAMERA", "Scene Camera", "The scene's own camera, with all that moves it"),
        ),
        "other_scenes": bpy.props.CollectionProperty(
            type=NoisyWorldLine, name="Other Scenes", description="The preset's scenes beside the one above"
        ),
        "scene_place": _whole(options={"HIDDEN"}),
        "steps": bpy.props.CollectionProperty(type=NoisyWorldStep, name="Perturbations"),
        "active_step": _whole(
            name="Active Perturbation", description="The perturbation whose parameters are shown", min=0
        ),
        **_slider("deviation_rotation"), **_slider("deviation_translation_m"), **_slider("speed_factor"),
        "setting": bpy.props.PointerProperty(
            type=group_of(SettingSpec, leave=("perturb", "sweep", "include")), name="Setting"
        ),
        "other_settings": bpy.props.CollectionProperty(
            type=NoisyWorldLine, name="Other Settings", description="The preset's settings beside the one above"
        ),
        "setting_place": _whole(options={"HIDDEN"}),
        "picked": _text(options={"HIDDEN"}),
        **shot_list_members(NoisyWorldShot),
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
    }  # fmt: skip
    return members


NoisyWorldPanelState = make_group("NoisyWorldPanelState", _panel_members())
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(GROUPS)


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
