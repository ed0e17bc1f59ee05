# SPDX-License-Identifier: GPL-3.0-or-later
"""Converting the panel's content into a preset's document, which generate.py reads, and back."""

import json
import math
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS
from ..core.atomic_files import storage_errors, write_atomic
from ..core.errors import InputError
from ..core.file_access import path_in
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics
from ..core.schema import ConfigPath, unknown_name, yaml_text
from ..core.trajectory import Trajectory, rounded_path
from ..dataset.plan import make_plan
from ..images.measured_depth import Registration
from ..images.pixels import as_float
from ..layouts import LAYOUTS, RECORDED, OutputFormat
from ..nodes.datablocks import layout_of
from ..perturbations import registry
from ..perturbations.execution import chosen_poses, split_motion
from ..perturbations.kinds import Identifiers, MotionPerturbation
from ..perturbations.parsing import parse_settings, parse_steps
from ..perturbations.steps import Setting, Step, steps_of_kind
from ..preset.keys import EngineName, OutputSpec, Preset, check_document, read_preset
from ..preset.names import OnlySpec
from ..render.source import RenderedFrame, RenderOptions, Source
from ..scenes.polygon_mesh import is_embedded, room_mesh, room_name, room_seeds
from ..sources import find_scenes, read_scenes
from ..sources.recording import RecordingKeys
from ..sources.scene_kinds import SceneEntry, SourceKind
from . import open_scene
from . import open_scene as scene_copy
from . import open_scene as this_scene
from .fields import LARGEST_INT, is_offered, notify_once, property_name, set_value, tell, value_of
from .open_scene import absolute
from .properties import (
    FIELDS,
    FOOTAGE,
    OVERRIDE,
    PACKAGED,
    distortion_of,
    field_names,
    keys_class,
    parameters_of,
    perturbation_of,
    rig_of,
    take_distortion,
    take_rig,
    unshown_rig,
)
from .sidebar import write
from .steps import clear_entries, curve_ends, curve_of, levels_of, put_step, take_step

# A recording or a video as what the dataset shows: its part of a preset, of the panel, and its frames for previews.


KEPT = 2  # scenes whose files were looked through; chosen: one is shown at a time

_sources: OrderedDict[str, Source] = OrderedDict()  # by the document of the scene


def is_shown(panel: Any) -> bool:
    """Tell whether the dataset shows a recording, a video, or frames that a package's source gives."""
    return panel.mesh_source in FOOTAGE


# --- frames, for previews ---


@dataclass(frozen=True)
class Footage:
    """What the panel's recording holds. camera: its intrinsics. between: colour and depth, where they have two."""

    source: Source
    camera: Intrinsics
    between: Registration | None

    @cached_property
    def path(self) -> Trajectory:
        """Its path, rounded as the dataset's."""
        return rounded_path(self.source.trajectory())

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of its frames, seconds."""
        return self.source.stamps_s


def footage_of(preset: Preset) -> Footage:
    """Return the recording of the panel's preset; its files are looked through once. Raises InputError."""
    spec = preset.spec
    known = json.dumps([preset.document["scenes"], preset.document.get("camera")])
    if known not in _sources:
        _sources[known] = find_scenes(preset)[0].source
        while len(_sources) > KEPT:
            _sources.popitem(last=False)
    source = _sources[known]
    camera = source.camera(None if spec.camera is None else spec.camera.intrinsics)
    assert camera is not None, "a recording has one, or is refused"
    optics = source.optics(camera)
    return Footage(
        source, camera, None if optics.depth is None else Registration(camera, optics.depth, optics.distortion)
    )


def still(footage: Footage, index: int) -> RenderedFrame:
    """Return a clean frame of a recording. Raises InputError where its files are damaged."""
    path = footage.path.at([index], footage.stamps_s[index : index + 1])
    c2w = path.c2w[0]
    with footage.source.prepare(footage.camera, lambda _: None) as prepared:
        opened = prepared.open(SensorPaths(path), RenderOptions(0.1, 1.0, 1, 0), lambda _: None)
        frame = opened.frame(FrameRequest(index, float(footage.stamps_s[index]), c2w, c2w))
        rgb, depth_m = frame.rgb, frame.depth_m
    assert rgb is not None, "recordings have colour"
    return RenderedFrame(as_float(rgb), depth_m)


def forget() -> None:
    """Look through the files again when a frame is next asked for."""
    _sources.clear()
    _read_layout_names.cache_clear()


# --- the panel's part ---


class NOISYWORLD_PT_layouts(bpy.types.Panel):
    """The layouts of recordings that are read, and the files that tell them"""

    bl_label = "Layouts"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_ui_units_x = 22

    def draw(self, _: bpy.types.Context) -> None:
        """List them."""
        column = layout_of(self).column()
        for label, files in known_layouts():
            split = column.split(factor=0.22)
            split.label(text=label)
            split.label(text=files)


def known_layouts() -> list[tuple[str, str]]:
    """Return the name of each layout that is read, and the files by which it is told."""
    written = [(layout.label, f"as Noisy World writes it: {layout.meaning}") for layout in LAYOUTS.values()]
    return written + [(layout.label, layout.files) for layout in RECORDED.values()]


def layout_names(folder: str) -> str:
    """Return the names of the layouts that a folder has the files of; "" for none, and for no folder."""
    path = Path(folder)
    try:
        changed_ns = path.stat().st_mtime_ns
    except OSError:
        return ""
    return _read_layout_names(folder, changed_ns)


@lru_cache(maxsize=16)
def _read_layout_names(folder: str, _changed_ns: int) -> str:
    path = Path(folder)
    found = [layout.label for layout in LAYOUTS.values() if layout.recognises(path)]
    found = found or [layout.label for layout in RECORDED.values() if layout.recognises(path)]
    return " and ".join(found)


register, unregister = bpy.utils.register_classes_factory((NOISYWORLD_PT_layouts,))


# What the panel shows of each source: an object each, which is all that presets, sections and runs ask.


ShownSourcesConfigPath = Callable[[str], str]
"""Gives a file's path as the preset has it."""


class ShownSource(ABC):
    """What the panel shows of a source.

    source: its name in presets. files: the keys of a scene that name files, relative to the preset. loads: whether a
    mesh of it is loaded into this file, along the panel's trajectory. lens_field, render_field: the properties that say
    whether the panel gives intrinsics, and engine and samples, or the source; "" where the panel always does. distorts:
    whether its frames can be shown through a lens that distorts, and own_distortion, whether that is said of its scene
    rather than of the camera. carries: whether its camera can carry an IMU.
    """

    source: ClassVar[str]
    files: ClassVar[tuple[str, ...]] = ()
    loads: ClassVar[bool] = False
    lens_field: ClassVar[str] = ""
    render_field: ClassVar[str] = ""
    distorts: ClassVar[bool] = False
    own_distortion: ClassVar[bool] = False
    carries: ClassVar[bool] = True

    def shows(self, keys: Any) -> bool:
        """Tell whether it is what the keys of a preset's scene of its source say."""
        del keys
        return True

    def gives_lens(self, panel: Any) -> bool:
        """Tell whether the panel gives the intrinsics."""
        return not self.lens_field or getattr(panel, self.lens_field) == "GIVEN"

    def gives_render(self, panel: Any) -> bool:
        """Tell whether the panel gives engine and samples."""
        return not self.render_field or getattr(panel, self.render_field) == "GIVEN"

    def has_path(self, panel: Any) -> bool:
        """Tell whether the panel's trajectory is the path, rather than one that the source has itself."""
        del panel
        return self.loads

    @abstractmethod
    def entry(self, panel: Any, place: ShownSourcesConfigPath) -> dict[str, Any]:
        """Return what a preset's scene says of it, but for name and path."""

    @abstractmethod
    def take(self, panel: Any, entry: SceneEntry[Any]) -> str:
        """Set the panel from a preset's scene; return the name of one that the preset gives none."""

    def unshown(self, entry: SceneEntry[Any], *, path: bool) -> Mapping[str, str]:
        """Return by key what of a preset's scene the panel cannot show, in words; "" is nothing.

        path: whether it is asked for its path alone.
        """
        del entry, path
        return {}

    @abstractmethod
    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        """Draw its properties."""

    def draw_path(self, layout: bpy.types.UILayout, panel: Any) -> None:
        """Draw what is said of the path, where the panel's trajectory is none."""
        del layout, panel


def _file(entry: SceneEntry[Any], key: str) -> str:
    """Return the file that a key of a preset's scene names, "" where it names none."""
    text = getattr(entry.keys, key)
    return "" if text is None else str(path_in(entry.preset.folder, text, entry.place.at(key)))


# --- meshes ---


class _MeshFile(ShownSource):
    source = "mesh"
    files = ("mesh",)
    loads = True
    distorts = True

    def shows(self, keys: Any) -> bool:
        return not is_embedded(keys.mesh)

    def entry(self, panel: Any, place: ShownSourcesConfigPath) -> dict[str, Any]:
        return {"mesh": place(panel.mesh_path)}

    def take(self, panel: Any, entry: SceneEntry[Any]) -> str:
        panel.mesh_path = _file(entry, "mesh")
        return Path(entry.keys.mesh).stem

    def unshown(self, entry: SceneEntry[Any], *, path: bool) -> Mapping[str, str]:
        keys = entry.keys
        asked = {
            "mesh": "stands for several files" if "*" in keys.mesh else "",
            "up": f"is {keys.up}" if keys.up is not None else "",
            "light": f"is {keys.light}" if keys.light != "none" else "",
        }
        return {} if path else asked

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        layout.prop(panel, "mesh_path")


class _Room(ShownSource):
    source = "mesh"
    loads = True
    distorts = True

    def shows(self, keys: Any) -> bool:
        return is_embedded(keys.mesh)

    def entry(self, panel: Any, place: ShownSourcesConfigPath) -> dict[str, Any]:
        del place
        return {"mesh": room_mesh(panel.room_seed)}

    def take(self, panel: Any, entry: SceneEntry[Any]) -> str:
        (panel.room_seed,) = room_seeds(entry.keys.mesh)
        return room_name(entry.keys.mesh, panel.room_seed)

    def unshown(self, entry: SceneEntry[Any], *, path: bool) -> Mapping[str, str]:
        try:
            problem = "stands for several rooms" if len(room_seeds(entry.keys.mesh)) > 1 else ""
        except ValueError as error:
            problem = str(error)
        return {} if path else {"mesh": problem}

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        layout.prop(panel, "room_seed")


# --- the open scene ---


class _ThisScene(ShownSource):
    source = "blend"
    files = ("blend",)
    lens_field = "lens_source"
    render_field = "render_source"
    distorts = True

    def has_path(self, panel: Any) -> bool:
        return not this_scene.follows(panel)

    def entry(self, panel: Any, place: ShownSourcesConfigPath) -> dict[str, Any]:
        return this_scene.entry(panel, place)

    def take(self, panel: Any, entry: SceneEntry[Any]) -> str:
        panel.compositing = entry.keys.compositor
        set_value(panel, "depth_alpha", entry.keys.depth_alpha)
        return Path(entry.keys.blend).stem

    def unshown(self, entry: SceneEntry[Any], *, path: bool) -> Mapping[str, str]:
        del path  # the scene's camera is its path
        return {"blend": self._not_open(entry)}

    def _not_open(self, entry: SceneEntry[Any]) -> str:
        """Return why a scene of a .blend is not the one that is open, or ""."""
        open_scene, keys = bpy.context.scene, entry.keys
        file = Path(_file(entry, "blend"))
        if file.resolve() not in {path.resolve() for path in scene_copy.known_files(open_scene)}:
            return f"is {file.name}, which is not the file that is open"
        if keys.scene not in (None, open_scene.name):
            return f"has the scene {keys.scene}, and {open_scene.name} is shown"
        if keys.camera not in (None, open_scene.camera and open_scene.camera.name):
            return f"looks through {keys.camera}, which is not the scene's camera"
        shown, asked = this_scene.frame_range(open_scene), keys.frame_range
        if asked not in (None, replace(shown, step=open_scene.frame_step)) and (
            asked != replace(shown, step=asked.step) or asked.step % open_scene.frame_step
        ):
            return f"has the frames {keys.frames}, which are not the scene's"
        return ""

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        layout.row().prop(panel, "compositing", expand=True)
        layout.prop(panel, "depth_alpha", slider=True)


# --- frames from elsewhere ---


NO_DEPTH_OR_POSES = "Plain images have no depth and no poses"


class _Footage(ShownSource):
    """Frames that the source gives, seen from its own path."""

    lens_field = "recorded_camera"
    carries = False

    def gives_render(self, panel: Any) -> bool:
        del panel
        return False

    def unshown(self, entry: SceneEntry[Any], *, path: bool) -> Mapping[str, str]:
        several = "stands for several" if "*" in str(getattr(entry.keys, self.source)) else ""
        return {self.source: several or ("has a path of its own" if path else "")}


class _Recording(_Footage):
    source = "sequence"
    files = ("sequence",)
    distorts = own_distortion = True

    def entry(self, panel: Any, place: ShownSourcesConfigPath) -> dict[str, Any]:
        defaults = {item.name: item.default for item in fields(RecordingKeys)}
        plain = panel.recorded_layout == "images"
        taken = {"recorded_layout": "layout"} if plain else FIELDS
        given = {key: getattr(panel, name) for name, key in taken.items()}
        said = {"sequence": place(panel.sequence_path)}
        said |= {key: value for key, value in given.items() if value != defaults[key]}
        said |= {} if plain else distortion_of(panel, rendered=False)
        if panel.recorded_depth_scale_per_m and not plain:
            said |= {"depth_scale_per_m": value_of(panel, "recorded_depth_scale_per_m")}
        return said | ({"rate_hz": value_of(panel, "recorded_rate_hz")} if panel.recorded_rate_hz else {})

    def take(self, panel: Any, entry: SceneEntry[Any]) -> str:
        panel.sequence_path = _file(entry, "sequence")
        for name, key in FIELDS.items():
            setattr(panel, name, getattr(entry.keys, key))
        take_distortion(panel, entry.keys.distortion)
        set_value(panel, "recorded_rate_hz", entry.keys.rate_hz or 0.0)
        set_value(panel, "recorded_depth_scale_per_m", entry.keys.depth_scale_per_m or 0.0)
        return Path(panel.sequence_path).stem

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        row = layout.row(align=True)
        row.prop(panel, "sequence_path")
        row.popover(panel=NOISYWORLD_PT_layouts.__name__, text="", icon="INFO")
        folder = absolute(panel.sequence_path)
        if folder and not Path(folder).is_dir():
            write(layout, bpy.context, "There is no such folder", "ERROR")
        layout.prop(panel, "recorded_layout")
        if panel.recorded_layout == "images":
            write(layout, bpy.context, f"{NO_DEPTH_OR_POSES}: colour alone is perturbed", "INFO")
            return
        if folder and Path(folder).is_dir():
            names = layout_names(folder)
            unknown = ("No layout that is read; Plain Images takes PNG and JPEG files as they are", "ERROR")
            write(layout, bpy.context, *((f"Layout: {names}", "CHECKMARK") if names else unknown))
        column = layout.column(heading="Treatment", align=True)
        column.prop(panel, "undistort")
        column.prop(panel, "register_depth")
        layout.prop(panel, "recorded_depth_scale_per_m")
        layout.prop(panel, "recorded_void")

    def draw_path(self, layout: bpy.types.UILayout, panel: Any) -> None:
        if panel.recorded_layout == "images":
            layout.label(text="Plain images have no poses", icon="INFO")
        else:
            layout.prop(panel, "recorded_poses")
        layout.prop(panel, "recorded_rate_hz")


class _Video(_Footage):
    source = "video"
    files = ("video", "depth")

    def entry(self, panel: Any, place: ShownSourcesConfigPath) -> dict[str, Any]:
        said: dict[str, Any] = {"video": place(panel.video_path)}
        if panel.video_depth_path:
            said |= {"depth": place(panel.video_depth_path)}
            said |= {"depth_scale_per_m": value_of(panel, "video_depth_scale_per_m")}
            said |= {"void": "sky"} if panel.recorded_void == "sky" else {}
        return said

    def take(self, panel: Any, entry: SceneEntry[Any]) -> str:
        panel.video_path, panel.video_depth_path = _file(entry, "video"), _file(entry, "depth")
        panel.recorded_void = entry.keys.void
        if entry.keys.depth_scale_per_m is not None:
            set_value(panel, "video_depth_scale_per_m", entry.keys.depth_scale_per_m)
        return Path(panel.video_path).stem

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        layout.prop(panel, "video_path")
        layout.prop(panel, "video_depth_path")
        if panel.video_depth_path:
            layout.prop(panel, "video_depth_scale_per_m")
            layout.prop(panel, "recorded_void")

    def draw_path(self, layout: bpy.types.UILayout, panel: Any) -> None:
        del panel
        layout.label(text="A video has no poses", icon="INFO")


class _Packaged(_Footage):
    """A source of an installed package, by the fields of its keys; the panel gives its intrinsics."""

    lens_field = ""

    def __init__(self, kind: SourceKind[Any]) -> None:
        self.source = kind.name  # pyright: ignore[reportAttributeAccessIssue]  one class for all of them
        self._nested = keys_class(kind) is not kind.keys
        self._names = field_names(kind)

    def entry(self, panel: Any, place: ShownSourcesConfigPath) -> dict[str, Any]:
        del place
        group = getattr(panel, self.source)
        given = {name: value_of(group, name) for name in self._names}
        return {self.source: given} if self._nested else given

    def take(self, panel: Any, entry: SceneEntry[Any]) -> str:
        keys = getattr(entry.keys, self.source) if self._nested else entry.keys
        for name in self._names:
            set_value(getattr(panel, self.source), name, getattr(keys, name))
        return self.source

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        column = layout.column(align=True)
        for name in self._names:
            column.prop(getattr(panel, self.source), property_name(name))

    def draw_path(self, layout: bpy.types.UILayout, panel: Any) -> None:
        del panel
        layout.label(text="The path is the source's own", icon="INFO")


PANEL_SOURCES: dict[str, ShownSource] = {
    "ROOM": _Room(),
    "FILE": _MeshFile(),
    "SCENE": _ThisScene(),
    "RECORDING": _Recording(),
    "VIDEO": _Video(),
    **{name: _Packaged(kind) for name, kind in PACKAGED.items()},
}
"""What the panel can show, by the values of its property `mesh_source`."""


def shown(panel: Any) -> ShownSource:
    """Return what the panel shows."""
    return PANEL_SOURCES[panel.mesh_source]


def shown_as(entry: SceneEntry[Any]) -> str:
    """Return the value of `mesh_source` that shows a preset's scene; "" where the panel has none for its source."""
    found = (name for name, item in PANEL_SOURCES.items() if item.source == entry.kind.name and item.shows(entry.keys))
    return next(found, "")


CLEAN = "clean"
HEADING = "# Made in Blender's sidebar by Noisy World; headless/generate.py makes the same dataset from it."
PANEL = "Noisy World panel"  # used like a file's name in messages about the panel's content
DEVIATION = {"deviation_rotation_deg": "rotation_deg", "deviation_translation_m": "translation_m"}
OWN_FIELDS = ("motion_deviation", "faster_motion")  # perturbations that the panel has fields for, beside its list
CAMERA = {
    "width_px": "width", "height_px": "height", "fx_px": "fx", "fy_px": "fy", "cx_px": "cx", "cy_px": "cy",
    "near_m": "near_m", "far_m": "far_m",
}  # fmt: skip
NO_BODY = "NONE"
INTRINSICS = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
HANDHELD = {
    "handheld_frames": "frames", "handheld_rate_hz": "rate_hz", "handheld_speed_m_s": "speed_m_s",
    "handheld_clearance_m": "clearance_m",
}  # fmt: skip
TRAJECTORY = {
    "trajectory_format": "format", "trajectory_pose": "pose", "trajectory_axes": "axes",
    "trajectory_rate_hz": "rate_hz", "trajectory_stamp_unit": "stamp_unit",
}  # fmt: skip


# --- the panel as a document ---


def to_document(panel: Any, folder: Path | None = None) -> dict[str, Any]:
    """Return the preset that the panel describes: one scene, clean where it is asked for, and with perturbations.

    Paths are absolute, or relative to `folder` if they are inside it.
    """
    perturb = perturb_of(panel)
    source = shown(panel)
    modalities = [name for name in CHANNELS if getattr(panel, f"use_{name}")]
    return {
        "seed": panel.seed,
        "scenes": [scene_of(panel, folder)],
        **({"camera": camera_of(panel) | _lens(panel)} if source.gives_lens(panel) else {}),
        **(rig_of(panel) if source.carries else {}),
        "render": {
            **({"engine": engine_of(panel), "samples": panel.samples} if source.gives_render(panel) else {}),
            "backend": panel.backend,
        },
        "settings": settings_of(panel, perturb),
        "output": {
            "layout": panel.layout,
            "image": panel.image,
            "colour": panel.colour,
            "depth_scale_per_m": value_of(panel, "depth_scale_per_m"),
            "depth_beyond": panel.depth_beyond,
            "modalities": modalities,
            "overview": panel.overview,
        },
    }


def settings_of(panel: Any, perturb: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the settings that the panel describes: clean alone where nothing is perturbed."""
    clean: list[dict[str, Any]] = [{"name": CLEAN}]
    if not perturb:
        return clean
    return [*(clean if panel.use_clean else []), {"name": panel.setting_name, "perturb": perturb}]


def engine_of(panel: Any) -> EngineName:
    """Return the engine that the panel gives. Raises InputError where a file chose one that this Blender lacks."""
    if not panel.engine:
        problem = "this file chose Embree, which needs the Python package embreex in Blender"
        raise InputError(PANEL, problem, where="render.engine", remedy="choose another engine, or install it")
    return panel.engine


def format_of(panel: Any) -> OutputFormat:
    """Return the format of the dataset that the panel describes."""
    scale_per_m = value_of(panel, "depth_scale_per_m")
    output = OutputSpec(panel.layout, panel.image, panel.colour, scale_per_m, panel.depth_beyond)
    return output.format


def scene_of(panel: Any, folder: Path | None = None) -> dict[str, Any]:
    """Return the panel's scene as a preset has it."""
    source = shown(panel)
    path = {"trajectory": _trajectory(panel, folder)} if source.has_path(panel) else {}
    return {"name": panel.scene_name, **source.entry(panel, lambda path: _path(path, folder)), **path}


def recorded(panel: Any) -> Footage:
    """Return the recording that the panel names. Raises InputError."""
    camera = {"camera": camera_of(panel)} if shown(panel).gives_lens(panel) else {}
    document = {"seed": 0, "scenes": [scene_of(panel)], **camera, "settings": [{"name": CLEAN}]}
    return footage_of(check_document(document, Path(PANEL)))


def camera_of(panel: Any) -> dict[str, Any]:
    """Return the panel's camera as a preset has it."""
    return {key: value_of(panel, name) for name, key in CAMERA.items()}


def _lens(panel: Any) -> dict[str, Any]:
    """Return the lens of the camera; a recording's is said of its scene."""
    source = shown(panel)
    return distortion_of(panel, rendered=source.loads) if source.distorts and not source.own_distortion else {}


def _path(path: str, folder: Path | None) -> str:
    whole = absolute(path)
    if folder is None or not whole or not Path(whole).is_relative_to(folder.resolve()):
        return whole
    return Path(whole).relative_to(folder.resolve()).as_posix()


def _trajectory(panel: Any, folder: Path | None) -> dict[str, Any]:
    if panel.trajectory_source != "FILE":
        made: dict[str, Any] = {"handheld": {key: value_of(panel, name) for name, key in HANDHELD.items()}}
    else:
        made = {"file": _path(panel.trajectory_path, folder)}
        made |= {key: value_of(panel, name) for name, key in TRAJECTORY.items()}
    if panel.body != NO_BODY:
        made["body"] = {"kind": panel.body, "motion": value_of(panel, "body_motion")}
    return made | ({"every": panel.every} if panel.every > 1 else {})


def perturb_of(panel: Any) -> list[dict[str, Any]]:
    """Return what the panel does to a scene, as a preset's `perturb`; what is switched off is left out."""
    listed = []
    for step in panel.steps:
        if step.enabled and step.perturbation not in registry():
            raise unknown_name(ConfigPath(PANEL, "perturbations"), "perturbation", step.perturbation, list(registry()))
        if step.enabled:
            listed.append({step.perturbation: values_of(step)})
    return own_motion(panel) + listed


def own_motion(panel: Any) -> list[dict[str, Any]]:
    """Return what the panel's own fields do to the path."""
    steps: list[dict[str, Any]] = []
    if panel.speed_factor > 1:
        steps.append({"faster_motion": {"factor": panel.speed_factor}})
    if panel.deviation_rotation or panel.deviation_translation_m:
        steps.append({"motion_deviation": {key: value_of(panel, name) for name, key in DEVIATION.items()}})
    return steps


def listed_motion(panel: Any) -> list[dict[str, Any]]:
    """Return what the panel's list does to the path, as a preset's `perturb`."""
    return [
        {step.perturbation: values_of(step)}
        for step in panel.steps
        if step.enabled and isinstance(registry().get(step.perturbation), MotionPerturbation)
    ]


def values_of(step: Any) -> dict[str, Any]:
    """Return an entry of the list as a preset has it."""
    perturbation, group = perturbation_of(step), parameters_of(step)
    defaults = {item.name: item.default for item in fields(perturbation.parameters)}
    given = [name for name in defaults if value_of(group, name) != defaults[name]]
    values: dict[str, Any] = {}
    if perturbation.severities and (step.use_severity or step.mode == "dynamic"):
        values |= _severity_of(step)
        by_severity = {name for name in perturbation.severities if not getattr(group, OVERRIDE + name)}
        given = [
            name for name in defaults if name not in by_severity and (name in perturbation.severities or name in given)
        ]
    elif perturbation.severities and not given:
        given = list(perturbation.severities)  # at least these, as without any key a preset means severity 3
    values |= {name: value_of(group, name) for name in given}
    for item in fields(perturbation.parameters):
        if item.metadata["key"].file is not None and values.get(item.name):
            values[item.name] = absolute(values[item.name])
    if perturbation.temporals and step.temporal != perturbation.temporals[0]:
        values["temporal"] = step.temporal
    return values


def _severity_of(step: Any) -> dict[str, Any]:
    """Return an entry's severity as a preset has it: one, drawn for each frame, or of each frame as it is keyed."""
    levels = levels_of(step, _keyed_frames(step))
    if levels is not None:
        return {"mode": "keyed", "levels": levels} if len(levels) > 1 else {"severity": levels[0]}
    values = {"severity": value_of(step, "severity")}
    return values | {"mode": "dynamic"} if step.mode == "dynamic" else values


def _keyed_frames(step: Any) -> NDArray[np.int64] | None:
    """Return the scene frames that the sequence shows, as far as an entry's severity is keyed; None for all from 0."""
    curve = curve_of(step)
    ends = None if curve is None else curve_ends(curve)
    if ends is None:
        return None
    scene = step.id_data
    _, choosing = split_motion(motion_of(scene.noisy_world))
    count = max(1 + math.ceil(ends[1]) * max(1, scene.noisy_world.speed_factor), scene.frame_end + 1)
    shown = chosen_poses(choosing, count, identifiers_of(scene.noisy_world))
    frames = open_scene.scene_frames(scene, count)
    return np.asarray(frames if shown is None else frames[shown], np.int64)


def steps_of(panel: Any) -> tuple[Step, ...]:
    """Return what the panel does to a scene, in propagation order. Raises InputError naming what is wrong."""
    return parse_steps(perturb_of(panel), ConfigPath(PANEL, "perturbations"), registry())


def motion_of(panel: Any) -> tuple[Step[MotionPerturbation], ...]:
    """Return the steps that act on the path, in propagation order, even if other steps are wrong."""
    perturb = own_motion(panel) + listed_motion(panel)
    return steps_of_kind(parse_steps(perturb, ConfigPath(PANEL, "motion"), registry()), MotionPerturbation)


def intrinsics_of(panel: Any) -> Intrinsics:
    """Return the panel's camera; that of the scene or the recording where it holds. Raises InputError without one."""
    if is_shown(panel):
        return recorded(panel).camera
    if not shown(panel).gives_lens(panel):
        return open_scene.intrinsics_of_scene(panel.id_data)
    return Intrinsics(*(value_of(panel, name) for name in INTRINSICS))


def identifiers_of(panel: Any) -> Identifiers:
    """Return the identifiers of the random streams of the panel's sequence, as in the generator."""
    return (panel.seed, panel.scene_name, panel.setting_name)


def preset_of(panel: Any, path: Path | None = None) -> Preset:
    """Return the checked preset that the panel describes, as if it were read from `path`.

    Raises InputError naming the key.
    """
    return check_document(to_document(panel, path and path.parent), path or Path(PANEL))


def save_preset(panel: Any, path: Path) -> str:
    """Write the preset that the panel describes; return what was done beside that, "" for nothing.

    Raises NoisyWorldError; an existing file is then kept.
    """
    said = ""
    if open_scene.is_shown(panel):
        open_scene.check(panel.id_data)
        said = open_scene.ensure(panel.id_data, path.with_suffix(".blend"))
    preset = preset_of(panel, path)
    make_plan(preset)  # raises for a preset that cannot be generated, which is then not saved
    text = yaml_text(preset.document)
    with storage_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, f"{HEADING}\n{text}".encode(), path.parent)
    panel.preset_path = str(path)
    panel.preset_settings = "\n".join(item["name"] for item in preset.document["settings"])
    return said


# Applies a preset to the panel: all of it, or the part that a section shows.


Part: TypeAlias = Literal["SCENE", "PATH", "CAMERA", "OUTPUT"]
"""What a section of the panel shows, beside the perturbations."""


def open_preset(panel: Any, path: Path, setting: str = "") -> None:
    """Load a preset's file into the panel: its scene and one of its settings, by default the first that is not clean.

    Raises InputError where it cannot be read, or has content that the panel cannot show; the panel is then unchanged.
    """
    _apply(panel, read_preset(path), setting)
    panel.preset_path = str(path)


def add_perturbations(panel: Any, path: Path, setting: str = "") -> tuple[list[Step], list[Step]]:
    """Put the perturbations of one of a preset's settings into the panel, and change nothing else in it.

    One that is in the panel already is set as the preset has it; the others are added. setting: by default the first
    that is not clean. Returns those that were added, and those that were set. Raises InputError where the file cannot
    be read or its perturbations cannot be shown; the panel is then unchanged.
    """
    _, chosen = _settings_of(read_preset(path), setting)
    added: list[Step] = []
    changed: list[Step] = []
    with notify_once():
        for step in chosen.steps:
            if step.perturbation.name in OWN_FIELDS:
                before = own_motion(panel)
                _apply_own_motion(panel, step)
                was_there = any(step.perturbation.name in item for item in before)
            else:
                was_there = put_step(panel, step)
            (changed if was_there else added).append(step)
        tell("steps")(panel, bpy.context)
    return added, changed


def apply_part(panel: Any, path: Path, part: Part) -> None:
    """Set one section of the panel from a preset, and change nothing else.

    Raises InputError where the file cannot be read, or the panel cannot show that part; it is then unchanged.
    """
    preset = read_preset(path)
    _refuse_unshown(preset, part)
    with notify_once():
        if part == "SCENE":
            _apply_mesh(panel, preset)
        elif part == "PATH":
            _apply_path(panel, preset)
        elif part == "CAMERA":
            _apply_camera(panel, preset)
        else:
            _apply_output(panel, preset)
            panel.backend = preset.spec.render.backend


def can_apply(path: Path, part: Part) -> bool:
    """Tell whether the panel can take a part of a preset."""
    try:
        _refuse_unshown(read_preset(path), part)
    except InputError:
        return False
    return True


def _apply(panel: Any, preset: Preset, wanted: str) -> None:
    _refuse_unshown(preset)
    found, chosen = _settings_of(preset, wanted)
    if chosen.stream != chosen.name:
        problem = f"{chosen.name}: draws by the stream {chosen.stream}: the panel cannot show that"
        raise preset.place("settings").error(problem, "run it with generate.py")
    with notify_once():
        _apply_mesh(panel, preset)
        _apply_path(panel, preset)
        _apply_camera(panel, preset)
        _apply_output(panel, preset)
        panel.seed, panel.backend = preset.spec.seed, chosen.backend
        take_rig(panel, preset.spec.rig)
        if chosen.name != CLEAN:
            panel.setting_name = chosen.name
        _apply_steps(panel, chosen)
        panel.use_clean = any(item.name == CLEAN for item in found)
        panel.preset_settings = "\n".join(item.name for item in found)


def setting_of(preset: Preset, wanted: str) -> Setting:
    """Return the setting of a preset that is wanted: "" is the first that is not clean.

    Raises InputError where there is none of this name, or the panel cannot show it.
    """
    return _settings_of(preset, wanted)[1]


def show_setting(panel: Any, setting: Setting) -> None:
    """Let the panel's perturbations be those of a setting, in place of what it holds."""
    with notify_once():
        panel.backend = setting.backend
        if setting.name != CLEAN:
            panel.setting_name = setting.name
        _apply_steps(panel, setting)


def _settings_of(preset: Preset, wanted: str) -> tuple[tuple[Setting, ...], Setting]:
    """Return a preset's settings, and that which is wanted: "" is the first that is not clean."""
    place = preset.place("settings")
    found = parse_settings(preset.spec.settings, preset.setting_places, registry(), preset.spec.render.backend)
    chosen = next((item for item in found if item.name == wanted or (not wanted and item.steps)), None)
    if chosen is None and wanted:
        raise unknown_name(place, "setting", wanted, [item.name for item in found])
    chosen = chosen or found[0]
    for step in chosen.steps:
        if step.levels is not None and step.severity is None and not step.keyed:
            raise place.error(f"{chosen.name}: levels cannot be shown in the panel", "use severity")
    return found, chosen


def _refuse_unshown(preset: Preset, part: Part | None = None) -> None:
    """Refuse content that the panel cannot show, as it would be lost when the preset is saved again.

    part: what is looked at; by default everything.
    """
    spec, (entry, *others) = preset.spec, read_scenes(preset)
    source, path = PANEL_SOURCES.get(shown_as(entry)), getattr(entry.keys, "trajectory", None)
    handheld = None if path is None else path.handheld
    asked: dict[str, Any] = {}
    if part in (None, "SCENE", "PATH"):
        lacking = {entry.kind.name: "is a source that the panel has no fields for"}
        unshown = lacking if source is None else source.unshown(entry, path=part == "PATH")
        asked = {
            "scenes": others and f"holds {len(others) + 1} scenes, and the panel shows one",
            **{f"scenes.0.{key}": problem for key, problem in unshown.items()},
        }
    if part in (None, "PATH") and path is not None:
        asked |= {
            "scenes.0.trajectory.start": path.start != 0 and "chooses a part of the path",
            "scenes.0.trajectory.stop": path.stop is not None and "chooses a part",
            "scenes.0.trajectory.resample_hz": path.resample_hz is not None and "resamples the path",
            "scenes.0.trajectory.handheld.seed": handheld is not None
            and handheld.seed is not None
            and "is another seed than the preset's",
            "scenes.0.trajectory.handheld.revisit": handheld is not None and handheld.revisit and "is true",
            "scenes.0.trajectory.handheld.wander_m": handheld is not None
            and handheld.wander_m > 0.0
            and "is more than 0",
        }
    if part in (None, "OUTPUT"):
        asked |= {
            "render.engine": not is_offered(spec.render.engine)
            and f"is {spec.render.engine}, which needs the Python package embreex in Blender",
            "render.device": spec.render.device != "cpu" and f"is {spec.render.device}",
            "output.formats": bool(spec.output.format.formats) and "says what files of channels are",
            "output.licence": spec.output.licence is not None and "states a licence",
            "render.allow_empty": spec.render.allow_empty and "is true",
            "render.processors": spec.render.processors != "same" and f"is {spec.render.processors}",
        }
    if part is None:
        asked |= {
            "only": spec.only != OnlySpec() and "chooses a part of the scenes or settings",
            **unshown_rig(spec.rig),
            "seed": spec.seed > LARGEST_INT and f"is {spec.seed}, and the panel counts to {LARGEST_INT}",
        }
    for key, problem in asked.items():
        if problem:
            raise preset.place(key).error(f"{problem}: the panel cannot show that", "run it with generate.py")


def _apply_mesh(panel: Any, preset: Preset) -> None:
    (entry,) = read_scenes(preset)
    panel.mesh_source = shown_as(entry)
    unnamed = shown(panel).take(panel, entry)
    panel.scene_name = entry.keys.name or unnamed


def _apply_path(panel: Any, preset: Preset) -> None:
    (entry,) = read_scenes(preset)
    if is_shown(panel):
        return
    path = getattr(entry.keys, "trajectory", None)
    if path is None:
        panel.trajectory_source = "CAMERA"
        chosen = getattr(entry.keys, "frame_range", None)
        panel.every = max(1, (1 if chosen is None else chosen.step) // panel.id_data.frame_step)
        return
    handheld = path.handheld
    panel.trajectory_source = "FILE" if handheld is None else "HANDHELD"
    if handheld is None:
        assert path.file is not None
        file = path_in(preset.folder, path.file, entry.place.at("trajectory"))
        panel.trajectory_path = str(file)
        for name, field in TRAJECTORY.items():
            set_value(panel, name, getattr(path, field))
    else:
        for name, field in HANDHELD.items():
            set_value(panel, name, getattr(handheld, field))
    panel.body = NO_BODY if path.body is None else path.body.kind
    if path.body is not None:
        set_value(panel, "body_motion", path.body.motion)
    panel.every = path.every


def _apply_camera(panel: Any, preset: Preset) -> None:
    panel.lens_source = "SCENE" if preset.spec.camera is None else "GIVEN"
    panel.recorded_camera = "RECORDED" if preset.spec.camera is None else "GIVEN"
    source = shown(panel)
    if source.distorts and not source.own_distortion:
        take_distortion(panel, preset.spec.mesh_camera.distortion)
    if preset.spec.camera is None and source.lens_field:
        return
    for name, field in CAMERA.items():
        set_value(panel, name, getattr(preset.spec.mesh_camera, field))


def _apply_output(panel: Any, preset: Preset) -> None:
    spec = preset.spec
    given = preset.document.get("render") or {}
    panel.render_source = "GIVEN" if {"engine", "samples"} & set(given) else "SCENE"
    panel.engine, panel.samples = spec.render.engine, spec.render.samples
    output = spec.output.format
    panel.layout = output.layout.name
    panel.image, panel.colour = output.image, output.colour
    set_value(panel, "depth_scale_per_m", output.depth_scale_per_m)
    panel.depth_beyond = output.depth_beyond
    for name in CHANNELS:
        setattr(panel, f"use_{name}", name in spec.output.modalities)
    panel.overview = spec.output.overview


def _apply_own_motion(panel: Any, step: Step) -> None:
    """Set the panel's own fields from a step of one of OWN_FIELDS."""
    if step.perturbation.name == "faster_motion":
        panel.speed_factor = step.parameters(None).factor
        return
    for name, field in DEVIATION.items():
        set_value(panel, name, getattr(step.parameters(None), field))


def _apply_steps(panel: Any, setting: Setting) -> None:
    for name in DEVIATION:
        set_value(panel, name, 0.0)
    panel.speed_factor = 1
    clear_entries(panel)
    panel.active_step = 0
    for step in setting.steps:
        if step.perturbation.name in OWN_FIELDS:
            _apply_own_motion(panel, step)
        else:
            take_step(panel.steps.add(), step, speed_factor=panel.speed_factor)
    tell("steps")(panel, bpy.context)
