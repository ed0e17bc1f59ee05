# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's buttons: each reads the properties, calls a function and reports."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

import bpy

from ..core.errors import NoisyWorldError, memory_errors
from ..core.labels import american, title
from ..core.perturbing.kinds import SEQUENCE_KINDS
from ..perturbations import registry
from . import footage, world
from .described import tell
from .document import OWN_FIELDS
from .offered import line_on
from .own_objects import own_object
from .properties import active_step, panel_of
from .step_list import add_own_step, may_move, move_entry, remove_entry, take_rate
from .wording import spoken

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import OperatorTypeFlagItems

    _Mixin = bpy.types.Operator  # what the polls below are mixed into
else:
    _Mixin = object

UNDOABLE: "set[OperatorTypeFlagItems]" = {"REGISTER", "UNDO"}
DONE, CANCELLED = {"FINISHED"}, {"CANCELLED"}
FILES = {"mesh": "mesh", "trajectory": "trajectory"}


def guarded(operator: bpy.types.Operator, work: Callable[[], str]) -> set[str]:
    """Do the work and report its result; a user's mistake becomes an error in the status bar, and cancels."""
    window = bpy.context.window
    if window is not None:
        window.cursor_set("WAIT")
    try:
        with memory_errors():
            message = work()
    except NoisyWorldError as error:
        operator.report({"ERROR"}, spoken(error.message))
        return CANCELLED
    finally:
        if window is not None:
            window.cursor_set("DEFAULT")
    if message:
        operator.report({"INFO"}, american(message))
    return DONE


class OnScene(_Mixin):
    """Poll: the scene belongs to this file."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Refuse linked scenes."""
        if world.is_editable(context.scene):
            return True
        cls.poll_message_set("The scene is linked from another file")
        return False


class _OnFiles(OnScene):
    """Poll: the files that are needed are named."""

    needed: tuple[str, ...] = ()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a file where one is needed."""
        if not super().poll(context):
            return False
        panel = panel_of(context.scene)
        for what in cls.needed:
            if getattr(panel, f"{what}_source") == "FILE" and not getattr(panel, f"{what}_path"):
                cls.poll_message_set(f"Choose a {FILES[what]} file")
                return False
        return True


def _is_loadable(operator: Any, context: bpy.types.Context) -> bool:
    """Tell whether what the panel names can be loaded into this file; a recording cannot."""
    if footage.is_shown(panel_of(context.scene)):
        operator.poll_message_set("A recording has no mesh: Preview Frame shows its frames")
        return False
    return True


class NoisyWorldLoadScene(_OnFiles, bpy.types.Operator):
    """Load the mesh, in place of the one loaded before; everything else in the file stays"""

    bl_idname = "noisy_world.load_scene"
    bl_label = "Load Scene"
    bl_options = UNDOABLE
    needed = ("mesh",)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there is a mesh to load."""
        if not super().poll(context):
            return False
        if panel_of(context.scene).mesh_source == "SCENE":
            cls.poll_message_set("This scene is there already")
            return False
        return _is_loadable(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Load it."""

        def work() -> str:
            _, notes = world.load_scene(context.scene)
            return "; ".join((", ".join(world.summary(context.scene)), *notes))

        return guarded(self, work)


class NoisyWorldShowColors(OnScene, bpy.types.Operator):
    """Let this view show the mesh's own colors in Solid shading, unlit"""

    bl_idname = "noisy_world.show_colors"
    bl_label = "Show Mesh Colors"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether this is a view in Solid shading that shows other colors."""
        if not super().poll(context):
            return False
        if not hides_colors(context):
            cls.poll_message_set("This view shows the mesh's own colors already, or is not in Solid shading")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Show them."""
        shading = context.space_data.shading
        shading.color_type, shading.light = _color_type(context.scene), "FLAT"
        return DONE


def hides_colors(context: bpy.types.Context) -> bool:
    """Tell whether the 3D view in use is in Solid shading and shows other colors than our mesh's own."""
    space, wanted = context.space_data, _color_type(context.scene)
    if wanted is None or space is None or space.type != "VIEW_3D" or space.shading.type != "SOLID":
        return False
    return (space.shading.color_type, space.shading.light) != (wanted, "FLAT")


def _color_type(scene: bpy.types.Scene) -> Literal["TEXTURE", "VERTEX"] | None:
    mesh = own_object(scene, "mesh")
    return None if mesh is None else "TEXTURE" if world.is_textured(mesh) else "VERTEX"


class NoisyWorldLoadTrajectory(_OnFiles, bpy.types.Operator):
    """Load or make the trajectory, key our camera along it, deviated as given, and set the timeline's range and rate"""

    bl_idname = "noisy_world.load_trajectory"
    bl_label = "Load Trajectory"
    bl_options = UNDOABLE
    needed = ("trajectory", "mesh")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there is a path to load."""
        return super().poll(context) and _is_loadable(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Load it."""

        def work() -> str:
            count, notes = world.load_path(context.scene)
            return "; ".join((f"{count:,} poses", *notes))

        return guarded(self, work)


class NoisyWorldSetCamera(OnScene, bpy.types.Operator):
    """Give the scene a camera with these intrinsics, and the image its size"""

    bl_idname = "noisy_world.set_camera"
    bl_label = "Set Up Camera"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set it up."""
        world.set_camera(context.scene)
        return DONE


class NoisyWorldAddStep(OnScene, bpy.types.Operator):
    """Add this perturbation to the list, in the order of propagation"""

    bl_idname = "noisy_world.add_step"
    bl_label = "Add Perturbation"
    bl_options = UNDOABLE

    perturbation: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Perturbation", options={"SKIP_SAVE"}
    )

    @classmethod
    def description(cls, _: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Say what the perturbation does."""
        found = registry().get(properties.perturbation)
        return line_on(found) if found else cls.__doc__ or ""

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add it."""
        panel = panel_of(context.scene)
        name = self.perturbation
        if name not in registry():
            self.report({"ERROR"}, f"{name!r}: no such perturbation")
            return CANCELLED
        if name in OWN_FIELDS:
            self.report({"ERROR"}, f"{title(registry()[name].label)} has fields of its own in Deviation and Speed")
            return CANCELLED
        once = isinstance(registry()[name], SEQUENCE_KINDS)
        if once and any(step.perturbation == name for step in panel.steps):
            self.report({"ERROR"}, f"{title(registry()[name].label)} is in the list already: it acts only once")
            return CANCELLED
        add_own_step(panel, name)
        return DONE


class _OnStep(OnScene):
    """Poll: a perturbation is selected."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a selected perturbation."""
        if not super().poll(context):
            return False
        if active_step(panel_of(context.scene)) is None:
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
        panel = panel_of(context.scene)
        remove_entry(panel, panel.active_step)
        panel.active_step = max(0, min(panel.active_step, len(panel.steps) - 1))
        tell("steps")(panel, context)
        return DONE


class NoisyWorldTakeRate(_OnStep, bpy.types.Operator):
    """Let the selected perturbation count as many frames a second as the scene has"""

    bl_idname = "noisy_world.take_rate"
    bl_label = "Take the Scene's Frame Rate"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Take it."""
        panel = panel_of(context.scene)
        take_rate(panel, active_step(panel))
        tell("steps")(panel, context)
        return DONE


class _MoveStep(_OnStep):
    """Swap with a neighbour of the same name; the order of all others is that of propagation."""

    by = 0

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Keep to the propagation order."""
        if not super().poll(context):
            return False
        if not may_move(panel_of(context.scene), cls.by):
            cls.poll_message_set("The order is that of propagation; only perturbations of the same name can swap")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Move it."""
        panel = panel_of(context.scene)
        move_entry(panel, panel.active_step, panel.active_step + self.by)
        panel.active_step += self.by
        tell("steps")(panel, context)
        return DONE


class NoisyWorldMoveStepUp(_MoveStep, bpy.types.Operator):
    """Move the selected perturbation before the one of the same name"""

    bl_idname = "noisy_world.move_step_up"
    bl_label = "Move Up"
    bl_options = UNDOABLE
    by = -1


class NoisyWorldMoveStepDown(_MoveStep, bpy.types.Operator):
    """Move the selected perturbation after the one of the same name"""

    bl_idname = "noisy_world.move_step_down"
    bl_label = "Move Down"
    bl_options = UNDOABLE
    by = 1


CLASSES: tuple[Any, ...] = (
    NoisyWorldLoadScene,
    NoisyWorldShowColors,
    NoisyWorldLoadTrajectory,
    NoisyWorldSetCamera,
    NoisyWorldAddStep,
    NoisyWorldRemoveStep,
    NoisyWorldTakeRate,
    NoisyWorldMoveStepUp,
    NoisyWorldMoveStepDown,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
