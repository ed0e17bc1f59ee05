# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets: where they lie, those shipped and one's own where Blender keeps presets; and the section of the tab."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ..blender.typed import layout_of
from ..core.errors import InputError
from .described import title
from .document import open_preset, save_preset
from .operators import CANCELLED, DONE, UNDOABLE, OnScene, guarded
from .panels import Section
from .properties import panel_of

FOLDER = "presets/noisy_world"


def shipped_folder() -> Path:
    """Return the folder of the presets shipped: in the installed extension, or in a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "presets"
    return inside if inside.is_dir() else package.parents[1] / "presets"


def own_folder() -> Path:
    """Return the folder of one's own presets; it need not be there yet."""
    return Path(bpy.utils.user_resource("SCRIPTS", path=FOLDER))


def own_path(name: str) -> Path:
    """Return the file of one's own preset of a name. Raises InputError for a name that no file can have."""
    name = name.strip()
    if not re.fullmatch(r"[^\W.][\w .()-]*", name):
        raise InputError("Name", f"{name!r} cannot name a file", remedy="use letters, digits, spaces and dashes")
    return own_folder() / f"{name}.yaml"


def is_own(path: str) -> bool:
    """Tell whether a file lies among one's own presets."""
    return bool(path) and Path(path).parent == own_folder()


def listed(folder: Path) -> list[Path]:
    """Return the presets of a folder by name; none where there is no folder."""
    return sorted((path for path in folder.glob("*.yaml")), key=lambda path: path.stem.lower())


# --- operators ---


class NoisyWorldUsePreset(OnScene, bpy.types.Operator):
    """Take this preset into the panel"""

    bl_idname = "noisy_world.use_preset"
    bl_label = "Use Preset"
    bl_options = UNDOABLE

    filepath: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        subtype="FILE_PATH", options={"SKIP_SAVE"}
    )
    setting: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Setting", options={"SKIP_SAVE"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open it."""
        return guarded(self, lambda: _open(context, Path(self.filepath), self.setting))


def _open(context: bpy.types.Context, path: Path, setting: str = "") -> str:
    open_preset(panel_of(context.scene), path, setting)
    return ""


class NoisyWorldOpenPreset(OnScene, bpy.types.Operator, ImportHelper):
    """Open a preset's YAML file in the panel"""

    bl_idname = "noisy_world.open_preset"
    bl_label = "Open Preset"
    bl_options = UNDOABLE
    if TYPE_CHECKING:
        filepath: str  # ImportHelper's

    filename_ext = ".yaml"
    filter_glob: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        default="*.yaml;*.yml", options={"HIDDEN"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open it."""
        return guarded(self, lambda: _open(context, Path(self.filepath)))


class NoisyWorldSavePreset(OnScene, bpy.types.Operator, ExportHelper):
    """Save what the panel says as a preset's YAML file, which headless/generate.py runs"""

    bl_idname = "noisy_world.save_preset"
    bl_label = "Save Preset"
    bl_options = {"REGISTER"}

    filename_ext = ".yaml"
    filter_glob: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        default="*.yaml;*.yml", options={"HIDDEN"}
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Start from the preset in use, unless it is one that is shipped; or from a name that says what is in it."""
        panel = panel_of(context.scene)
        used = panel.preset_path
        beside = Path(bpy.data.filepath).parent
        if used and not Path(used).is_relative_to(shipped_folder()):
            self.filepath = used
        else:
            self.filepath = str(beside / f"{panel.scene_name}_{panel.setting_name}{self.filename_ext}")
        return {*super().invoke(context, event)}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Save it."""
        return guarded(self, lambda: _save(context, Path(self.filepath)))


def _save(context: bpy.types.Context, path: Path) -> str:
    save_preset(panel_of(context.scene), path)
    return f"saved {path}"


class NoisyWorldAddPreset(OnScene, bpy.types.Operator):
    """Keep what the panel says among your own presets"""

    bl_idname = "noisy_world.add_preset"
    bl_label = "Add Preset"
    bl_options = {"REGISTER"}

    name: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Name", description="Name of the preset", options={"SKIP_SAVE"}
    )

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Ask for a name."""
        return context.window_manager.invoke_props_dialog(self, title="Add Preset", confirm_text="Add")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Save it there."""

        def work() -> str:
            path = own_path(self.name)
            if path.exists():
                raise InputError(path, "there is a preset of this name", remedy="remove it first, or choose another")
            return _save(context, path)

        return guarded(self, work)


class NoisyWorldRemovePreset(OnScene, bpy.types.Operator):
    """Delete the preset in use from your own presets"""

    bl_idname = "noisy_world.remove_preset"
    bl_label = "Remove Preset"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Leave the shipped ones alone, and files elsewhere."""
        if not super().poll(context):
            return False
        if not is_own(panel_of(context.scene).preset_path):
            cls.poll_message_set("The preset in use is none of your own")
            return False
        return True

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask whether it is meant."""
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Delete it."""
        panel = panel_of(context.scene)
        try:
            Path(panel.preset_path).unlink(missing_ok=True)
        except OSError as error:
            self.report({"ERROR"}, f"{panel.preset_path}: cannot be deleted: {error.strerror}")
            return CANCELLED
        panel.preset_path = ""
        return DONE


# --- the section, and its menus ---


class NOISYWORLD_MT_presets(bpy.types.Menu):
    """The presets shipped, and one's own"""

    bl_label = "Presets"

    def draw(self, _: bpy.types.Context) -> None:
        """Draw them: one's own first."""
        own = listed(own_folder())
        list_presets(layout_of(self), own)
        if own:
            layout_of(self).separator()
        list_presets(layout_of(self), listed(shipped_folder()))
        layout_of(self).menu("NOISYWORLD_MT_single_presets")


class NOISYWORLD_MT_single_presets(bpy.types.Menu):
    """A preset for each perturbation"""

    bl_label = "Single Perturbations"

    def draw(self, _: bpy.types.Context) -> None:
        """Draw them."""
        list_presets(layout_of(self), listed(shipped_folder() / "perturbations"))


def list_presets(layout: bpy.types.UILayout, paths: list[Path]) -> None:
    """Draw an entry for each preset."""
    for path in paths:
        layout.operator("noisy_world.use_preset", text=preset_label(path)).filepath = str(path)


def preset_label(path: Path) -> str:
    """Return a preset's name as a menu shows it: shipped ones are called as perturbations are."""
    return title(path.stem) if path.is_relative_to(shipped_folder()) else path.stem


class NOISYWORLD_MT_settings(bpy.types.Menu):
    """The settings of the preset in use; the panel shows one of them"""

    bl_label = "Settings of the Preset"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw them."""
        panel = panel_of(context.scene)
        for name in panel.preset_settings.split("\n"):
            entry = layout_of(self).operator("noisy_world.use_preset", text=name)
            entry.filepath, entry.setting = panel.preset_path, name


class NOISYWORLD_PT_preset(Section, bpy.types.Panel):
    """The panel as a file"""

    bl_label = "Preset"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        row = layout.row(align=True)
        label = preset_label(Path(panel.preset_path)) if panel.preset_path else "Presets"
        row.menu("NOISYWORLD_MT_presets", text=label)
        row.operator("noisy_world.add_preset", text="", icon="ADD")
        row.operator("noisy_world.remove_preset", text="", icon="REMOVE")
        if panel.preset_path and panel.preset_settings.count("\n") > 0:
            layout.menu("NOISYWORLD_MT_settings", text=f"Setting: {panel.setting_name}")
        row = layout.row(align=True)
        row.operator("noisy_world.open_preset", text="Open", icon="FILE_FOLDER")
        row.operator("noisy_world.save_preset", text="Save", icon="FILE_TICK")


CLASSES: tuple[Any, ...] = (
    NoisyWorldUsePreset,
    NoisyWorldOpenPreset,
    NoisyWorldSavePreset,
    NoisyWorldAddPreset,
    NoisyWorldRemovePreset,
    NOISYWORLD_MT_presets,
    NOISYWORLD_MT_single_presets,
    NOISYWORLD_MT_settings,
    NOISYWORLD_PT_preset,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
