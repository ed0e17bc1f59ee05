# SPDX-License-Identifier: GPL-3.0-or-later
"""A recording or a video as what the dataset shows: its part of a preset, of the panel, and its frames for previews."""

import json
from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property, lru_cache
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
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.rounding import rounded_path
from ..core.trajectories.sensor_paths import SensorPaths
from ..core.trajectories.trajectory import Trajectory
from ..sources import find_scenes
from .source_fields import FOOTAGE

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
