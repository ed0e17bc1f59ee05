# SPDX-License-Identifier: GPL-3.0-or-later
"""The section of presets in the tab: those shipped, and the user's own in Blender's folder of presets."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ..core.errors import InputError, title
from ..core.file_access import with_home
from ..nodes.datablocks import layout_of
from ..perturbations.steps import Step
from . import beginning, gallery, made_scene
from .document import (
    add_perturbations,
    apply_part,
    device_parts,
    open_preset,
    save_preset,
    scene_name,
    setting_name,
    shows_loaded,
)
from .gallery import is_own, listed, own_folder, own_path, preset_label, shipped_folder
from .operators import CANCELLED, DONE, UNDOABLE, OnScene, guarded
from .properties import panel_of
from .section_presets import DEVICE_PARTS, use_device_file
from .sections import PanelSection

TAKEN: dict[str, str] = {
    "SCENE": "the mesh", "PATH": "the path", "CAMERA": "the camera", "OUTPUT": "how frames are rendered and written",
}  # fmt: skip
"""What is taken with each part of a preset, beside everything and its perturbations."""

# --- operators ---


def _part(default: str) -> Any:
    """Return the property that says what of a preset the panel takes."""
    return bpy.props.EnumProperty(
        name="Take",
        description="What of the preset the panel takes",
        items=[
            (
                "AUTO",
                "What It Is For",
                "Of a shipped preset of one perturbation just that, of any other everything",
            ),
            ("ALL", "Everything", "Replace scene, path, camera, perturbations and output"),
            ("PERTURBATIONS", "Only Perturbations", "Add its perturbations to the list, and change nothing else"),
            ("SCENE", "Only Scene", "Take its mesh and the scene's name, and change nothing else"),
            ("PATH", "Only Trajectory", "Take its path, and change nothing else"),
            ("CAMERA", "Only Camera", "Take its camera, and change nothing else"),
            ("OUTPUT", "Only Render and Output", "Take how frames are rendered and written, and change nothing else"),
        ],
        default=default,
        options={"SKIP_SAVE"},
    )


class NoisyWorldUsePreset(OnScene, bpy.types.Operator):
    """Replace scene, path, camera, perturbations and output by what this preset says"""

    bl_idname = "noisy_world.use_preset"
    bl_label = "Use Preset"
    bl_options = UNDOABLE

    filepath: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        subtype="FILE_PATH", options={"SKIP_SAVE"}
    )
    setting: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Setting", options={"SKIP_SAVE"}
    )
    part: _part("AUTO")  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations

    @classmethod
    def description(cls, _: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Say what an entry of a menu does."""
        if takes_perturbations(Path(properties.filepath), properties.part):
            return "Add this to the list of perturbations, or set it where it is there already; nothing else changes"
        if properties.part in TAKEN:
            return f"Take {TAKEN[properties.part]} from this preset; nothing else changes"
        return cls.__doc__ or ""

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open it."""
        return guarded(self, lambda: _open(context, Path(self.filepath), self.part, self.setting))


def takes_perturbations(path: Path, part: str) -> bool:
    """Tell whether only the perturbations of a preset's file are taken. part: as the operators have it."""
    single = path.resolve().is_relative_to((shipped_folder() / "perturbations").resolve())
    return part == "PERTURBATIONS" or (part == "AUTO" and single)


def _open(context: bpy.types.Context, path: Path, part: Any, setting: str = "") -> str:
    """Take a preset into the panel; return what was done."""
    panel, path = panel_of(context.scene), _in_home(path)
    if part in TAKEN:
        apply_part(panel, path, part)
        return f"{preset_label(path)}: {TAKEN[part]} from it; everything else is as it was"
    if not takes_perturbations(path, part):
        open_preset(panel, path, setting)
        return f"{preset_label(path)}: scene, path, camera, perturbations and output are the preset's"
    added, changed = add_perturbations(panel, path, setting)
    if not added and not changed:
        return f"{preset_label(path)}: nothing to add, as it has no perturbations"
    done = [
        f"{verb} {', '.join(map(_step_label, steps))}" for verb, steps in (("added", added), ("set", changed)) if steps
    ]
    text = "; ".join(done)
    return f"{text[0].upper()}{text[1:]}; scene, path, camera and other perturbations are as they were"


def _step_label(step: Step) -> str:
    label = title(step.perturbation.label)
    return label if step.severity is None else f"{label} (severity {step.severity:g})"


class NoisyWorldDropPreset(OnScene, bpy.types.Operator):
    """Open a preset that was dropped, and load its scene into one of Noisy World's own; or take a measured device"""

    bl_idname = "noisy_world.drop_preset"
    bl_label = "Open Dropped Preset"
    bl_options = UNDOABLE

    filepath: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        subtype="FILE_PATH", options={"SKIP_SAVE"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Take the file for what is in it."""
        return guarded(self, lambda: _drop(context, Path(self.filepath)))


def _drop(context: bpy.types.Context, path: Path) -> str:
    panel = panel_of(context.scene)
    if device_parts(path):
        return use_device_file(panel, path, DEVICE_PARTS)
    if takes_perturbations(path, "AUTO") or not shows_loaded(path):
        return _open(context, path, "AUTO")
    with made_scene.entered(context, apart=not made_scene.is_clear(context.scene)) as scene:
        open_preset(panel_of(scene), path)
        beginning.load_all(context, scene)
    panel_of(scene).preview = True
    return f"{preset_label(path)}: loaded, with its perturbations in the preview"


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
    part: _part("AUTO")  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open it."""
        return guarded(self, lambda: _open(context, Path(self.filepath), self.part))


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
        """Suggest the file of the preset in use unless that is shipped, else a name that describes the content."""
        panel = panel_of(context.scene)
        used = panel.preset_path
        beside = Path(bpy.data.filepath).parent
        if used and not Path(used).is_relative_to(shipped_folder()):
            self.filepath = used
        else:
            self.filepath = str(beside / f"{scene_name(panel)}_{setting_name(panel)}{self.filename_ext}")
        return {*super().invoke(context, event)}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Save it."""
        return guarded(self, lambda: _save(context, Path(self.filepath)))


def _save(context: bpy.types.Context, path: Path) -> str:
    path = _in_home(path)
    said = save_preset(panel_of(context.scene), path)
    return f"saved {path}" + (f"; {said}" if said else "")


def _in_home(path: Path) -> Path:
    """Return a file's path with ~ replaced. Raises InputError where there is no such user."""
    try:
        return with_home(str(path))
    except LookupError as error:
        raise InputError(path, str(error)) from error


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
        """Refuse shipped presets and files elsewhere."""
        if not super().poll(context):
            return False
        if not is_own(panel_of(context.scene).preset_path):
            cls.poll_message_set("The preset in use is none of your own")
            return False
        return True

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for confirmation."""
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
        """Draw those that replace everything, the user's own first, and then those that add perturbations."""
        layout, own = layout_of(self), listed(own_folder())
        layout.label(text="Replace Everything", icon="FILE_REFRESH")
        list_presets(layout, own, "ALL")
        list_presets(layout, listed(shipped_folder()), "ALL")
        layout.separator()
        layout.label(text="Add to the List", icon="ADD")
        layout.menu("NOISYWORLD_MT_single_presets")
        if own:
            layout.menu("NOISYWORLD_MT_own_perturbations")


class NOISYWORLD_MT_single_presets(bpy.types.Menu):
    """A preset for each perturbation: it is added to the list, and nothing else changes"""

    bl_label = "Single Perturbations"

    def draw(self, _: bpy.types.Context) -> None:
        """Draw them."""
        list_presets(layout_of(self), listed(shipped_folder() / "perturbations"), "PERTURBATIONS")


class NOISYWORLD_MT_own_perturbations(bpy.types.Menu):
    """The perturbations of one's own presets: they are added to the list, and nothing else changes"""

    bl_label = "Perturbations of Own Presets"

    def draw(self, _: bpy.types.Context) -> None:
        """Draw them."""
        list_presets(layout_of(self), listed(own_folder()), "PERTURBATIONS")


def list_presets(layout: bpy.types.UILayout, paths: list[Path], part: str) -> None:
    """Draw an entry for each preset. part: what of it is taken."""
    for path in paths:
        entry = layout.operator("noisy_world.use_preset", text=preset_label(path))
        entry.filepath, entry.part = str(path), part


class NOISYWORLD_MT_settings(bpy.types.Menu):
    """The settings of the preset in use; the panel shows one of them"""

    bl_label = "Settings of the Preset"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw them."""
        panel = panel_of(context.scene)
        for name in panel.preset_settings.split("\n"):
            entry = layout_of(self).operator("noisy_world.use_preset", text=name)
            entry.filepath, entry.setting, entry.part = panel.preset_path, name, "ALL"


class NOISYWORLD_PT_preset(PanelSection, bpy.types.Panel):
    """The panel as a file"""

    bl_label = "Preset"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        beginning.draw(layout, context)
        row = layout.row(align=True)
        label = preset_label(Path(panel.preset_path)) if panel.preset_path else "Presets"
        row.menu("NOISYWORLD_MT_presets", text=label)
        row.popover(panel=gallery.PRESETS, text="", icon="IMGDISPLAY")
        row.operator("noisy_world.add_preset", text="", icon="ADD")
        if is_own(panel.preset_path):
            row.operator("noisy_world.remove_preset", text="", icon="REMOVE")
        if panel.preset_path and panel.preset_settings.count("\n") > 0:
            layout.menu("NOISYWORLD_MT_settings", text=f"Setting: {setting_name(panel)}")
        row = layout.row(align=True)
        row.operator("noisy_world.open_preset", text="Open", icon="FILE_FOLDER")
        row.operator("noisy_world.save_preset", text="Save", icon="FILE_TICK")


CLASSES: tuple[Any, ...] = (
    NoisyWorldUsePreset,
    NoisyWorldDropPreset,
    beginning.dropped("NOISYWORLD_FH_preset", "Noisy World Preset", NoisyWorldDropPreset.bl_idname, (".yaml", ".yml")),
    NoisyWorldOpenPreset,
    NoisyWorldSavePreset,
    NoisyWorldAddPreset,
    NoisyWorldRemovePreset,
    NOISYWORLD_MT_presets,
    NOISYWORLD_MT_single_presets,
    NOISYWORLD_MT_own_perturbations,
    NOISYWORLD_MT_settings,
    NOISYWORLD_PT_preset,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
