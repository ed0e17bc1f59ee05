# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel shows of each source: an object each, which is all that presets, sections and runs ask."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, ClassVar

import bpy

from ..core.home import path_in
from ..core.planning.scene import SceneEntry, SourceKind
from ..core.scenes.embedded import is_embedded, room_mesh, room_name, room_seeds
from ..sources.recording import RecordingKeys
from . import footage, scene_copy, this_scene
from .lens_fields import distortion_of, take_distortion
from .long_text import write
from .output_place import absolute
from .source_fields import FIELDS, PACKAGED, field_names, keys_class
from .typed_numbers import property_name, set_value, value_of

ConfigPath = Callable[[str], str]
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
    def entry(self, panel: Any, place: ConfigPath) -> dict[str, Any]:
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

    def entry(self, panel: Any, place: ConfigPath) -> dict[str, Any]:
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

    def entry(self, panel: Any, place: ConfigPath) -> dict[str, Any]:
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

    def entry(self, panel: Any, place: ConfigPath) -> dict[str, Any]:
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

    def entry(self, panel: Any, place: ConfigPath) -> dict[str, Any]:
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
        row.popover(panel=footage.NOISYWORLD_PT_layouts.__name__, text="", icon="INFO")
        folder = absolute(panel.sequence_path)
        if folder and not Path(folder).is_dir():
            write(layout, bpy.context, "There is no such folder", "ERROR")
        layout.prop(panel, "recorded_layout")
        if panel.recorded_layout == "images":
            write(layout, bpy.context, f"{NO_DEPTH_OR_POSES}: colour alone is perturbed", "INFO")
            return
        if folder and Path(folder).is_dir():
            names = footage.layout_names(folder)
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

    def entry(self, panel: Any, place: ConfigPath) -> dict[str, Any]:
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

    def entry(self, panel: Any, place: ConfigPath) -> dict[str, Any]:
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
