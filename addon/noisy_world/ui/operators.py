# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel's buttons do: read the properties, call a function, report."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ..core.errors import InputError, NoisyWorldError
from ..perturbations import registry
from . import presets, world
from .document import add_step, may_move, open_preset, save_preset
from .properties import active_step, tell, title

UNDOABLE = {"REGISTER", "UNDO"}
DONE, CANCELLED = {"FINISHED"}, {"CANCELLED"}


def guarded(operator: bpy.types.Operator, work: Callable[[], str]) -> set[str]:
    """Do the work and report what it says; a user's mistake is an error in the status bar, and nothing finished."""
    window = bpy.context.window
    if window is not None:
        window.cursor_set("WAIT")
    try:
        told = work()
    except NoisyWorldError as error:
        operator.report({"ERROR"}, str(error))
        return CANCELLED
    finally:
        if window is not None:
            window.cursor_set("DEFAULT")
    if told:
        operator.report({"INFO"}, told)
    return DONE


class _OnScene:
    """Poll: a scene of this file's own."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Leave linked scenes alone."""
        if world.is_editable(context.scene):
            return True
        cls.poll_message_set("The scene is linked from another file")
        return False


class NoisyWorldLoadScene(_OnScene, bpy.types.Operator):
    """Load the mesh, in place of the one loaded before; everything else in the file stays"""

    bl_idname = "noisy_world.load_scene"
    bl_label = "Load Scene"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a file where one is needed."""
        if not super().poll(context):
            return False
        settings = context.scene.noisy_world
        if settings.mesh_source == "FILE" and not settings.mesh_path:
            cls.poll_message_set("Choose a PLY file")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Load it, and let a Solid view show its colours."""

        def work() -> str:
            _, notes = world.load_scene(context.scene)
            show_colours(context)
            return "; ".join((", ".join(world.summary(context.scene)), *notes))

        return guarded(self, work)


def show_colours(context: bpy.types.Context) -> None:
    """Let the 3D view that is in use show vertex colours, where it is in Solid shading."""
    space = context.space_data
    if space is not None and space.type == "VIEW_3D" and space.shading.type == "SOLID":
        space.shading.color_type = "VERTEX"


class NoisyWorldLoadTrajectory(_OnScene, bpy.types.Operator):
    """Load or make the trajectory, key the camera along it, deviated as given, and set the timeline's range"""

    bl_idname = "noisy_world.load_trajectory"
    bl_label = "Load Trajectory"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a file where one is needed."""
        if not super().poll(context):
            return False
        settings = context.scene.noisy_world
        if settings.trajectory_source == "FILE" and not settings.trajectory_path:
            cls.poll_message_set("Choose a trajectory file")
            return False
        if settings.mesh_source == "FILE" and not settings.mesh_path:
            cls.poll_message_set("Choose a PLY file")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Load it."""
        return guarded(self, lambda: f"{world.load_path(context.scene)} poses")


class NoisyWorldSetCamera(_OnScene, bpy.types.Operator):
    """Give the scene a camera with these intrinsics, and the image its size"""

    bl_idname = "noisy_world.set_camera"
    bl_label = "Set Up Camera"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set it up."""
        world.set_camera(context.scene)
        return DONE


class NoisyWorldAddStep(_OnScene, bpy.types.Operator):
    """Add this perturbation, in the place that the propagation order gives it"""

    bl_idname = "noisy_world.add_step"
    bl_label = "Add Perturbation"
    bl_options = UNDOABLE

    perturbation: bpy.props.StringProperty(name="Perturbation", options={"SKIP_SAVE"})

    @classmethod
    def description(cls, _: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Say what the perturbation does."""
        found = registry().get(properties.perturbation)
        text = (found.parameters.__doc__ or "").split("\n")[0].strip().rstrip(".") if found else ""
        return text or cls.__doc__ or ""

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add it."""
        settings = context.scene.noisy_world
        name = self.perturbation
        if name not in registry():
            self.report({"ERROR"}, f"{name!r}: no such perturbation")
            return CANCELLED
        once = registry()[name].category == "sync"
        if once and any(step.perturbation == name for step in settings.steps):
            self.report({"ERROR"}, f"{title(registry()[name].label)} is there already: it acts once on a sequence")
            return CANCELLED
        add_step(settings, name)
        return DONE


class _OnStep(_OnScene):
    """Poll: a perturbation is selected."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a selected perturbation."""
        if not super().poll(context):
            return False
        if active_step(context.scene.noisy_world) is None:
            cls.poll_message_set("No perturbation is selected")
            return False
        return True


class NoisyWorldRemoveStep(_OnStep, bpy.types.Operator):
    """Remove the selected perturbation"""

    bl_idname = "noisy_world.remove_step"
    bl_label = "Remove Perturbation"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove it."""
        settings = context.scene.noisy_world
        settings.steps.remove(settings.active_step)
        settings.active_step = max(0, min(settings.active_step, len(settings.steps) - 1))
        tell("steps")(settings, context)
        return DONE


class _MoveStep(_OnStep):
    """Change places with a neighbour of the same name: all else is ordered by how an image comes about."""

    by = 0

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Keep to the propagation order."""
        if not super().poll(context):
            return False
        if not may_move(context.scene.noisy_world, cls.by):
            cls.poll_message_set("The order is that in which an image comes about; only equals may change places")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Move it."""
        settings = context.scene.noisy_world
        settings.steps.move(settings.active_step, settings.active_step + self.by)
        settings.active_step += self.by
        tell("steps")(settings, context)
        return DONE


class NoisyWorldMoveStepUp(_MoveStep, bpy.types.Operator):
    """Move the selected perturbation before its equal"""

    bl_idname = "noisy_world.move_step_up"
    bl_label = "Move Up"
    bl_options = UNDOABLE
    by = -1


class NoisyWorldMoveStepDown(_MoveStep, bpy.types.Operator):
    """Move the selected perturbation behind its equal"""

    bl_idname = "noisy_world.move_step_down"
    bl_label = "Move Down"
    bl_options = UNDOABLE
    by = 1


# --- presets ---


class NoisyWorldUsePreset(_OnScene, bpy.types.Operator):
    """Take this preset into the panel"""

    bl_idname = "noisy_world.use_preset"
    bl_label = "Use Preset"
    bl_options = UNDOABLE

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    setting: bpy.props.StringProperty(name="Setting", options={"SKIP_SAVE"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open it."""
        return guarded(self, lambda: _open(context, Path(self.filepath), self.setting))


def _open(context: bpy.types.Context, path: Path, setting: str = "") -> str:
    open_preset(context.scene.noisy_world, path, setting)
    return ""


class NoisyWorldOpenPreset(_OnScene, bpy.types.Operator, ImportHelper):
    """Open a preset's YAML file in the panel"""

    bl_idname = "noisy_world.open_preset"
    bl_label = "Open Preset"
    bl_options = UNDOABLE

    filename_ext = ".yaml"
    filter_glob: bpy.props.StringProperty(default="*.yaml;*.yml", options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open it."""
        return guarded(self, lambda: _open(context, Path(self.filepath)))


class NoisyWorldSavePreset(_OnScene, bpy.types.Operator, ExportHelper):
    """Save what the panel says as a preset's YAML file, which headless/generate.py runs"""

    bl_idname = "noisy_world.save_preset"
    bl_label = "Save Preset"
    bl_options = {"REGISTER"}

    filename_ext = ".yaml"
    filter_glob: bpy.props.StringProperty(default="*.yaml;*.yml", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Start from the preset in use, unless it is one that is shipped."""
        used = context.scene.noisy_world.preset_path
        if used and not Path(used).is_relative_to(presets.shipped_folder()):
            self.filepath = used
        return super().invoke(context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Save it."""
        return guarded(self, lambda: _save(context, Path(self.filepath)))


def _save(context: bpy.types.Context, path: Path) -> str:
    save_preset(context.scene.noisy_world, path)
    return f"saved {path}"


class NoisyWorldAddPreset(_OnScene, bpy.types.Operator):
    """Keep what the panel says among your own presets"""

    bl_idname = "noisy_world.add_preset"
    bl_label = "Add Preset"
    bl_options = {"REGISTER"}

    name: bpy.props.StringProperty(name="Name", description="Name of the preset", options={"SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Ask for a name."""
        return context.window_manager.invoke_props_dialog(self, title="Add Preset", confirm_text="Add")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Save it there."""

        def work() -> str:
            path = presets.own_path(self.name)
            if path.exists():
                raise InputError(path, "there is a preset of this name", remedy="remove it first, or choose another")
            return _save(context, path)

        return guarded(self, work)


class NoisyWorldRemovePreset(_OnScene, bpy.types.Operator):
    """Delete the preset in use from your own presets"""

    bl_idname = "noisy_world.remove_preset"
    bl_label = "Remove Preset"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Leave the shipped ones alone, and files elsewhere."""
        if not super().poll(context):
            return False
        if not presets.is_own(context.scene.noisy_world.preset_path):
            cls.poll_message_set("The preset in use is none of your own")
            return False
        return True

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask whether it is meant."""
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Delete it."""
        settings = context.scene.noisy_world
        try:
            Path(settings.preset_path).unlink(missing_ok=True)
        except OSError as error:
            self.report({"ERROR"}, f"{settings.preset_path}: cannot be deleted: {error.strerror}")
            return CANCELLED
        settings.preset_path = ""
        return DONE


CLASSES: tuple[Any, ...] = (
    NoisyWorldLoadScene,
    NoisyWorldLoadTrajectory,
    NoisyWorldSetCamera,
    NoisyWorldAddStep,
    NoisyWorldRemoveStep,
    NoisyWorldMoveStepUp,
    NoisyWorldMoveStepDown,
    NoisyWorldUsePreset,
    NoisyWorldOpenPreset,
    NoisyWorldSavePreset,
    NoisyWorldAddPreset,
    NoisyWorldRemovePreset,
)


def register() -> None:
    """Register the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Take them away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
