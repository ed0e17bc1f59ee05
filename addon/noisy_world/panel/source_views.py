# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel shows of each source, an object each, which is all that presets, sections and runs ask of it."""

import json
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, ClassVar

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics
from ..core.trajectory import Trajectory, rounded_path
from ..images.measured_depth import Registration
from ..images.pixels import as_float
from ..layouts import EVERY, recognising
from ..layouts.described import SequenceSpec
from ..nodes.datablocks import layout_of
from ..preset.keys import Preset
from ..render.source import RenderedFrame, RenderOptions, Source
from ..scenes.polygon_mesh import is_embedded, room_mesh, room_name, room_seeds
from ..sources import SOURCES, find_scenes
from ..sources.scene_kinds import SceneEntry
from . import open_scene
from .open_scene import absolute
from .properties import SHARED, SOURCE_GROUP
from .sidebar import write
from .tree import FileText, draw_keys, take
from .tree import to_document as said_by

KEPT = 2  # scenes whose files were looked through; chosen: one is shown at a time

_sources: OrderedDict[str, Source] = OrderedDict()  # by the document of the scene


def shows_footage(panel: Any) -> bool:
    """Tell whether the dataset shows a recording, a video, or frames that a package's source gives."""
    return panel.mesh_source not in ("ROOM", "FILE", "SCENE")


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
    ours = "as Noisy World writes it: {}"
    return [(item.label, getattr(item, "files", "") or ours.format(item.meaning)) for item in EVERY.values()]


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
    return " and ".join(layout.label for layout in recognising(Path(folder)))


register, unregister = bpy.utils.register_classes_factory((NOISYWORLD_PT_layouts,))


# --- what the panel shows of each source ---


class ShownSource:
    """What the panel shows of a source.

    source: its name in presets. files: the keys of a scene that name files, relative to the preset. loads: whether a
    mesh of it is loaded into this file, along the panel's trajectory. own_lens, own_render: whether it has intrinsics,
    and engine and samples, of its own where the panel gives none. distorts: whether its frames can be shown through a
    lens that distorts, and own_distortion, whether that is said of its scene rather than of the camera. carries:
    whether its camera can carry an IMU. previewed: whether its frames can be shown here. has_own_path: whether the
    path is always its own.
    """

    source: ClassVar[str]
    files: ClassVar[tuple[str, ...]] = ()
    loads: ClassVar[bool] = False
    own_lens: ClassVar[bool] = False
    own_render: ClassVar[bool] = False
    distorts: ClassVar[bool] = False
    own_distortion: ClassVar[bool] = False
    carries: ClassVar[bool] = True
    previewed: ClassVar[bool] = True
    has_own_path: ClassVar[bool] = False

    @property
    def keys(self) -> type:
        """The dataclass of its keys."""
        return SOURCES[self.source].keys

    def group(self, panel: Any) -> Any:
        """Return the properties of its keys."""
        return getattr(panel, SOURCE_GROUP + self.source)

    def shows(self, entry: SceneEntry[Any]) -> bool:
        """Tell whether it is what a preset's scene of its source says."""
        del entry
        return True

    def has_path(self, panel: Any) -> bool:
        """Tell whether the panel's trajectory is the path, rather than one that the source has itself."""
        del panel
        return self.loads

    def entry(self, panel: Any, file: FileText) -> dict[str, Any]:
        """Return what a preset's scene says of it, but for name and path."""
        return said_by(self.group(panel), self.keys, file, leave=SHARED)

    def take(self, panel: Any, entry: SceneEntry[Any], given: Mapping[str, Any], file: FileText) -> None:
        """Set the panel from a preset's scene."""
        take(self.group(panel), entry.keys, given, file, leave=SHARED)

    def unnamed(self, panel: Any) -> str:
        """Return the name of a scene that the preset gives none."""
        text = getattr(self.group(panel), self.source, "")
        text = getattr(text, "folder", text)  # of a recording, which is described or a folder
        return Path(text).stem if self.files and text else self.source

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        """Draw its properties."""
        draw_keys(layout, self.group(panel), self.keys, leave=SHARED)

    def draw_path(self, layout: bpy.types.UILayout, panel: Any) -> None:
        """Draw what is said of the path, where the panel's trajectory is none."""
        del panel
        layout.label(text="The path is the source's own", icon="INFO")


# --- meshes ---


class _MeshFile(ShownSource):
    source = "mesh"
    files = ("mesh",)
    loads = True
    distorts = True

    def entry(self, panel: Any, file: FileText) -> dict[str, Any]:
        return {"mesh": file(self.group(panel).mesh)} | super().entry(panel, file)

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        group = self.group(panel)
        layout.prop(group, "mesh")
        for name in ("up", "light"):
            if getattr(group, f"use_{name}"):
                layout.prop(group, name)


def _seeds(mesh: str) -> list[int]:
    """Return the embedded rooms that a mesh stands for, [] where it is none of them."""
    try:
        return room_seeds(mesh) if is_embedded(mesh) else []
    except ValueError:
        return []


class _Room(ShownSource):
    source = "mesh"
    loads = True
    distorts = True

    def shows(self, entry: SceneEntry[Any]) -> bool:
        return len(_seeds(entry.keys.mesh)) == 1

    def entry(self, panel: Any, file: FileText) -> dict[str, Any]:
        del file
        return {"mesh": self._mesh(panel)}

    def _mesh(self, panel: Any) -> str:
        """Return the room as the preset names it; where another was chosen since, in the shortest way."""
        text = self.group(panel).mesh
        return text if _seeds(text) == [panel.room_seed] else room_mesh(panel.room_seed)

    def take(self, panel: Any, entry: SceneEntry[Any], given: Mapping[str, Any], file: FileText) -> None:
        super().take(panel, entry, given, file)
        (panel.room_seed,) = room_seeds(entry.keys.mesh)

    def unnamed(self, panel: Any) -> str:
        return room_name(self._mesh(panel), panel.room_seed)

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        layout.prop(panel, "room_seed")


# --- the open scene ---


class _ThisScene(ShownSource):
    source = "blend"
    files = ("blend",)
    own_lens = True
    own_render = True
    distorts = True

    def has_path(self, panel: Any) -> bool:
        return not open_scene.follows(panel)

    def entry(self, panel: Any, file: FileText) -> dict[str, Any]:
        return open_scene.entry(panel, file)

    def take(self, panel: Any, entry: SceneEntry[Any], given: Mapping[str, Any], file: FileText) -> None:
        panel.compositing = entry.keys.compositor
        super().take(panel, entry, given, file)

    def shows(self, entry: SceneEntry[Any]) -> bool:
        """Tell whether a scene of a .blend is the one that is open."""
        scene, keys = bpy.context.scene, entry.keys
        file = Path(absolute(str(entry.preset.folder / keys.blend)))
        if file not in {path.resolve() for path in open_scene.known_files(scene)}:
            return False
        camera = scene.camera and scene.camera.name
        if keys.scene not in (None, scene.name) or keys.camera not in (None, camera):
            return False
        shown_frames, asked = open_scene.frame_range(scene), keys.frame_range
        return asked in (None, replace(shown_frames, step=scene.frame_step)) or (
            asked == replace(shown_frames, step=asked.step) and asked.step % scene.frame_step == 0
        )

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        layout.prop(panel, "compositing")
        layout.prop(self.group(panel), "depth_alpha", slider=True)
        air = self.group(panel).air
        layout.prop(air, "soften_sun")
        if air.soften_sun:
            layout.prop(air, "visibility_m")
            layout.prop(air, "path_m")
        layout.prop(air, "reflections")


# --- frames from elsewhere ---


NO_DEPTH_OR_POSES = "Plain images have no depth and no poses"


class _Footage(ShownSource):
    """Frames that the source gives, seen from its own path."""

    own_lens = True
    carries = False
    has_own_path = True


_DESCRIBED = [item.name for item in fields(SequenceSpec) if item.name != SequenceSpec.SHORTHAND]


class _Recording(_Footage):
    source = "sequence"
    files = ("sequence",)
    distorts = own_distortion = True

    def entry(self, panel: Any, file: FileText) -> dict[str, Any]:
        group = self.group(panel)
        known = ("sequence", "layout", "rate_hz")
        left = [item.name for item in fields(self.keys) if item.name not in known] if group.layout == "images" else []
        said = said_by(group, self.keys, file, leave=(*SHARED, *left))
        told = said.get("sequence", {})
        folder = file(group.sequence.folder) if group.sequence.folder else ""
        described = {name: value for name, value in told.items() if name != "folder"}
        place = {"folder": folder} if folder else {}  # a bag stands in place of it
        others = {name: value for name, value in said.items() if name != "sequence"}
        return {"sequence": place | described if described else folder} | others

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        group = self.group(panel)
        row = layout.row(align=True)
        row.prop(group.sequence, "folder")
        row.popover(panel=NOISYWORLD_PT_layouts.__name__, text="", icon="INFO")
        folder = absolute(group.sequence.folder)
        if folder and not Path(folder).is_dir():
            write(layout, bpy.context, "There is no such folder", "ERROR")
        layout.prop(group, "layout")
        if group.layout == "images":
            write(layout, bpy.context, f"{NO_DEPTH_OR_POSES}: colour alone is perturbed", "INFO")
            return
        described = [name for name in _DESCRIBED if getattr(group.sequence, f"use_{name}")]
        if described:
            write(layout, bpy.context, f"Its preset says where its files are: {', '.join(described)}", "INFO")
        elif folder and Path(folder).is_dir():
            names = layout_names(folder)
            unknown = ("No layout that is read; Plain Images takes PNG and JPEG files as they are", "ERROR")
            write(layout, bpy.context, *((f"Layout: {names}", "CHECKMARK") if names else unknown))
        column = layout.column(heading="Treatment", align=True)
        column.prop(group, "undistort")
        column.prop(group, "register")
        draw_keys(layout, group, self.keys, only=("depth_scale_per_m",))
        layout.prop(group, "void")

    def draw_path(self, layout: bpy.types.UILayout, panel: Any) -> None:
        group = self.group(panel)
        if group.layout == "images":
            layout.label(text="Plain images have no poses", icon="INFO")
        else:
            layout.prop(group, "poses")
        draw_keys(layout, group, self.keys, only=("rate_hz",))


class _Video(_Footage):
    source = "video"
    files = ("video", "depth")

    def entry(self, panel: Any, file: FileText) -> dict[str, Any]:
        group = self.group(panel)
        left = () if group.depth else ("depth", "depth_scale_per_m", "void")
        return {"video": file(group.video)} | said_by(group, self.keys, file, leave=(*SHARED, *left))

    def draw(self, layout: bpy.types.UILayout, panel: Any) -> None:
        group = self.group(panel)
        layout.prop(group, "video")
        layout.prop(group, "depth")
        if group.depth:
            layout.prop(group, "depth_scale_per_m")
            layout.prop(group, "void")

    def draw_path(self, layout: bpy.types.UILayout, panel: Any) -> None:
        del panel
        layout.label(text="A video has no poses", icon="INFO")


class _Other(_Footage):
    """A source by its keys alone."""

    has_own_path = False

    def __init__(self, name: str, *, previewed: bool) -> None:
        self.source = name  # pyright: ignore[reportAttributeAccessIssue]  one class for all of them
        self.previewed = previewed  # pyright: ignore[reportAttributeAccessIssue]  as above
        self.own_lens = not previewed  # pyright: ignore[reportAttributeAccessIssue]  a package's takes the panel's

    def has_path(self, panel: Any) -> bool:
        with_path = any(item.name == "trajectory" for item in fields(self.keys))
        return with_path and panel.scene.use_trajectory


PANEL_SOURCES: dict[str, ShownSource] = {
    "ROOM": _Room(),
    "FILE": _MeshFile(),
    "SCENE": _ThisScene(),
    "RECORDING": _Recording(),
    "VIDEO": _Video(),
    **{
        name: _Other(name, previewed=SOURCES.distribution(name) is not None)
        for name in SOURCES
        if SOURCES.distribution(name) is not None or name in ("replica", "blend")
    },
}
"""What the panel can show, by the values of its property `mesh_source`."""


def shown(panel: Any) -> ShownSource:
    """Return what the panel shows."""
    return PANEL_SOURCES[panel.mesh_source]


def shown_as(entry: SceneEntry[Any]) -> str:
    """Return the value of `mesh_source` that shows a preset's scene."""
    return next(name for name, item in PANEL_SOURCES.items() if item.source == entry.kind.name and item.shows(entry))
