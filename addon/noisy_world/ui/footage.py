# SPDX-License-Identifier: GPL-3.0-or-later
"""A recording or a video as what the dataset shows: its part of a preset, of the panel, and its frames for previews."""

import json
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..blender.typed import layout_of
from ..core.datasets.images import as_float
from ..core.datasets.layouts import LAYOUTS, RECORDED
from ..core.datasets.registration import Registration
from ..core.geometry import Intrinsics
from ..core.planning.source import RenderedFrame, RenderOptions, Source
from ..core.presets.preset import Preset
from ..core.presets.scene_keys import SceneSpec
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths
from ..sources import find_scenes
from .long_text import write
from .recorded_fields import FIELDS, SOURCES
from .typed_numbers import set_value, value_of

KEPT = 2  # scenes whose files were looked through; chosen: one is shown at a time

_sources: OrderedDict[str, Source] = OrderedDict()  # by the document of the scene


def is_shown(panel: Any) -> bool:
    """Tell whether the dataset shows a recording or a video."""
    return panel.mesh_source in {name for name, _, _ in SOURCES}


def takes_camera(panel: Any) -> bool:
    """Tell whether the recording says its intrinsics itself."""
    return is_shown(panel) and panel.recorded_camera == "RECORDED"


# --- as a preset has it ---


def entry(panel: Any, place: Callable[[str], str]) -> dict[str, Any]:
    """Return what a preset's scene says of it. place: gives a file's path as the preset has it."""
    untold = SceneSpec()
    if panel.mesh_source == "VIDEO":
        said: dict[str, Any] = {"video": place(panel.video_path)}
        if panel.video_depth_path:
            said |= {"depth": place(panel.video_depth_path)}
            said |= {"depth_scale_per_m": value_of(panel, "video_depth_scale_per_m")}
        return said
    given = {key: getattr(panel, name) for name, key in FIELDS.items()}
    said = {"sequence": place(panel.sequence_path)}
    said |= {key: value for key, value in given.items() if value != getattr(untold, key)}
    return said | ({"rate_hz": value_of(panel, "recorded_rate_hz")} if panel.recorded_rate_hz else {})


def take(panel: Any, scene: SceneSpec, place: Callable[[str, str], Path]) -> None:
    """Set the panel from a preset's scene that is a recording or a video. place: the file of a key's path."""
    kind = "video" if scene.video is not None else "sequence"
    path = place(getattr(scene, kind), kind)
    panel.mesh_source = "VIDEO" if scene.video is not None else "RECORDING"
    panel.scene_name = scene.name or path.stem
    if scene.video is not None:
        panel.video_path = str(path)
        panel.video_depth_path = "" if scene.depth is None else str(place(scene.depth, "depth"))
        if scene.depth_scale_per_m is not None:
            set_value(panel, "video_depth_scale_per_m", scene.depth_scale_per_m)
        return
    panel.sequence_path = str(path)
    for name, key in FIELDS.items():
        setattr(panel, name, getattr(scene, key))
    set_value(panel, "recorded_rate_hz", scene.rate_hz or 0.0)


# --- frames, for previews ---


@dataclass(frozen=True)
class Footage:
    """What the panel's recording holds. camera: its intrinsics. between: colour and depth, where they have two."""

    source: Source
    camera: Intrinsics
    between: Registration | None

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
    path = footage.source.trajectory().at([index], footage.stamps_s[index : index + 1])
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
    _told.cache_clear()


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


def told_as(folder: str) -> str:
    """Return the names of the layouts that a folder has the files of; "" for none, and for no folder."""
    path = Path(folder)
    try:
        changed_ns = path.stat().st_mtime_ns
    except OSError:
        return ""
    return _told(folder, changed_ns)


@lru_cache(maxsize=16)
def _told(folder: str, _changed_ns: int) -> str:
    path = Path(folder)
    found = [layout.label for layout in LAYOUTS.values() if layout.recognises(path)]
    found = found or [layout.label for layout in RECORDED.values() if layout.recognises(path)]
    return " and ".join(found)


def draw(layout: bpy.types.UILayout, context: bpy.types.Context, panel: Any, place: Callable[[str], str]) -> None:
    """Draw where the frames are, and what is done to them. place: gives a path of the panel as an absolute one."""
    if panel.mesh_source == "VIDEO":
        layout.prop(panel, "video_path")
        layout.prop(panel, "video_depth_path")
        if panel.video_depth_path:
            layout.prop(panel, "video_depth_scale_per_m")
        return
    row = layout.row(align=True)
    row.prop(panel, "sequence_path")
    row.popover(panel=NOISYWORLD_PT_layouts.__name__, text="", icon="INFO")
    folder = place(panel.sequence_path)
    if folder and not Path(folder).is_dir():
        write(layout, context, "There is no such folder", "ERROR")
    elif folder:
        told = told_as(folder)
        write(
            layout, context, f"Layout: {told}" if told else "No layout that is read", "CHECKMARK" if told else "ERROR"
        )
    column = layout.column(heading="Treatment", align=True)
    column.prop(panel, "undistort")
    column.prop(panel, "register_depth")


def draw_path(layout: bpy.types.UILayout, panel: Any) -> None:
    """Draw what becomes of a recording's poses and times; a video has no poses."""
    if panel.mesh_source == "VIDEO":
        layout.label(text="A video has no poses", icon="INFO")
        return
    layout.prop(panel, "recorded_poses")
    layout.prop(panel, "recorded_rate_hz")


register, unregister = bpy.utils.register_classes_factory((NOISYWORLD_PT_layouts,))
