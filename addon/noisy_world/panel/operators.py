# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's buttons: each reads the properties, calls a function and reports."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import bpy

from ..core.errors import NoisyWorldError, american, memory_errors, title
from ..core.file_access import utf8_name
from ..nodes.datablocks import camera_of
from ..perturbations import registry
from ..perturbations.kinds import SEQUENCE_KINDS
from ..render.own_view import bound_cameras, has_several_cameras, key_motion, keyable
from . import loading
from .entries import add_own_step, take_rate
from .fields import tell
from .gallery import line_on
from .own_objects import own_object
from .properties import active_step, panel_of
from .step_list import may_move, move_entry, remove_entry
from .wording import spoken

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import OperatorTypeFlagItems

    _Mixin = bpy.types.Operator  # what the polls below are mixed into
else:
    _Mixin = object

UNDOABLE: "set[OperatorTypeFlagItems]" = {"REGISTER", "UNDO"}
DONE, CANCELLED = {"FINISHED"}, {"CANCELLED"}


def guarded(operator: bpy.types.Operator, work: Callable[[], str]) -> set[str]:
    """Do the work and report its result; a user's mistake becomes an error in the status bar, and cancels.

    What was changed before the error becomes a step of undo, too: Blender makes none where an operator cancels, and
    would crash on undoing to a state from which data that is gone by now was in use.
    """
    window = bpy.context.window
    if window is not None:
        window.cursor_set("WAIT")
    try:
        with memory_errors():
            message = work()
    except NoisyWorldError as error:
        operator.report({"ERROR"}, spoken(error.message))
        if "UNDO" in operator.bl_options:
            push_undo(operator.bl_label)
        return CANCELLED
    finally:
        if window is not None:
            window.cursor_set("DEFAULT")
    if message:
        operator.report({"INFO"}, american(message))
    return DONE


def push_undo(what: str) -> None:
    """Make a step of undo of what was changed, where there is a window that has steps."""
    push: Any = bpy.ops.ed.undo_push  # the stubs give its poll an argument
    if push.poll():
        push(message=what)


class OnScene(_Mixin):
    """Poll: the scene belongs to this file."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Refuse linked scenes."""
        if loading.is_editable(context.scene):
            return True
        cls.poll_message_set("The scene is linked from another file")
        return False


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
        shading.color_type, shading.light = color_type(context.scene), "FLAT"
        return DONE


def hides_colors(context: bpy.types.Context) -> bool:
    """Tell whether the 3D view in use is in Solid shading and shows other colors than our mesh's own."""
    space, wanted = context.space_data, color_type(context.scene)
    if wanted is None or space is None or space.type != "VIEW_3D" or space.shading.type != "SOLID":
        return False
    return (space.shading.color_type, space.shading.light) != (wanted, "FLAT")


def color_type(scene: bpy.types.Scene) -> Literal["TEXTURE", "VERTEX"] | None:
    """Return which of our mesh's colours a view shows unlit; None without a mesh."""
    mesh = own_object(scene, "mesh")
    return None if mesh is None else "TEXTURE" if loading.is_textured(mesh) else "VERTEX"


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
        once = isinstance(registry()[name], SEQUENCE_KINDS)
        if once and any(step.perturbation == name for step in panel.steps):
            self.report({"ERROR"}, f"{title(registry()[name].label)} is in the list already: it acts only once")
            return CANCELLED
        for line in add_own_step(panel, name):
            self.report({"INFO"}, line)
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


class NoisyWorldRemoveLine(OnScene, bpy.types.Operator):
    """Take this scene or setting out of what the panel says"""

    bl_idname = "noisy_world.remove_line"
    bl_label = "Remove from the Preset"
    bl_options = UNDOABLE

    of: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        options={"SKIP_SAVE", "HIDDEN"}
    )
    place: bpy.props.IntProperty(  # pyright: ignore[reportInvalidTypeForm]  as above
        options={"SKIP_SAVE", "HIDDEN"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Take it out; what is shown keeps its place among the others."""
        panel = panel_of(context.scene)
        shown_at = {"other_scenes": "scene_place", "other_settings": "setting_place"}[self.of]
        getattr(panel, self.of).remove(self.place)
        setattr(panel, shown_at, getattr(panel, shown_at) - (self.place < getattr(panel, shown_at)))
        panel.picked = ""
        tell("lines")(panel, context)
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
    NoisyWorldShowColors,
    NoisyWorldAddStep,
    NoisyWorldRemoveStep,
    NoisyWorldRemoveLine,
    NoisyWorldTakeRate,
    NoisyWorldMoveStepUp,
    NoisyWorldMoveStepDown,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)


# The button that keys how the camera moves in groups of weather in the scene's own compositor.


class NoisyWorldKeyCameraMotion(OnScene, bpy.types.Operator):
    """Key how the camera moves in this scene's own Noisy World groups, which draws streaks; press again when its path has changed"""  # noqa: E501 - a tooltip

    bl_idname = "noisy_world.key_camera_motion"
    bl_label = "Key Camera Motion"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a camera, and a group that draws streaks."""
        if not super().poll(context):
            return False
        if context.scene.camera is None:
            cls.poll_message_set("The scene has no camera")
            return False
        if not keyable(context.scene):
            cls.poll_message_set("The scene's compositor has no group that asks how the camera moves")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Key it."""

        def work() -> str:
            scene = context.scene
            if scene.camera is None or scene.camera.type != "CAMERA":
                raise NoisyWorldError("the scene's camera is no camera: choose one in Scene > Camera")
            bound = tuple(dict.fromkeys(item for _, item in bound_cameras(scene)))
            cameras = bound if has_several_cameras(scene) else (scene.camera,)
            for item in cameras:
                if camera_of(item).type != "PERSP":
                    raise NoisyWorldError(f"{item.name} is not perspective, as these groups expect: change its type")
            nodes = ", ".join(key_motion(scene))
            bound_by = ", which markers bind" if len(cameras) > 1 else ""
            return f"Keyed along {', '.join(item.name for item in cameras)}{bound_by}: {nodes}"

        return guarded(self, work)


def draw_camera_link(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the button in the tab where there is something to key."""
    if context.scene.camera is not None and keyable(context.scene):
        layout.operator(NoisyWorldKeyCameraMotion.bl_idname, icon="CON_CAMERASOLVER")


def _draw_in_menu(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw the entry in the node editor's menu Node, for groups from the asset shelf."""
    space = context.space_data
    if isinstance(space, bpy.types.SpaceNodeEditor) and space.tree_type == "CompositorNodeTree":
        assert menu.layout is not None
        menu.layout.separator()
        menu.layout.operator(NoisyWorldKeyCameraMotion.bl_idname, icon="CON_CAMERASOLVER")


_DRAWS: Any = _draw_in_menu  # the stubs give such functions no menu
_register_classes, _unregister_classes = bpy.utils.register_classes_factory((NoisyWorldKeyCameraMotion,))


def register_camera_link() -> None:
    """Register the button, in the tab and in the node editor's menu."""
    _register_classes()
    bpy.types.NODE_MT_node.append(_DRAWS)  # looked up anew: reloading scripts makes another class of it


def unregister_camera_link() -> None:
    """Unregister it."""
    bpy.types.NODE_MT_node.remove(_DRAWS)
    _unregister_classes()


# The node groups as one of Blender's asset libraries: a button adds or removes it; disabling the add-on removes it.


PACKAGE = (__package__ or "").rpartition(".")[0]  # bl_ext.<repository>.noisy_world, or noisy_world in a checkout
ASSETS = Path(__file__).resolve().parents[1] / "assets"
NAME = "Noisy World"


def is_built() -> bool:
    """Tell whether there is a library; a checkout has none before it is built."""
    return any(ASSETS.glob("*.blend"))


def libraries() -> bpy.types.AssetLibraryCollection:
    """Return the asset libraries in the preferences."""
    return bpy.context.preferences.filepaths.asset_libraries


def entry() -> bpy.types.UserAssetLibrary | None:
    """Return the library's entry in the preferences, also if a user added or renamed it."""
    return next((item for item in libraries() if item.path and Path(item.path).resolve() == ASSETS), None)


def _kept() -> Any | None:
    """Return the add-on's preferences; None if it is registered from a checkout."""
    found = bpy.context.preferences.addons.get(PACKAGE)
    return None if found is None else found.preferences


class NoisyWorldAddAssetLibrary(bpy.types.Operator):
    """Offer the perturbations' node groups in the compositor's Add menu and asset shelf"""

    bl_idname = "noisy_world.add_asset_library"
    bl_label = "Add Node Groups to Asset Libraries"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, _: bpy.types.Context) -> bool:
        """Tell whether there is something to add."""
        if not is_built():
            cls.poll_message_set("There is no asset library here: build it with make assets")
            return False
        if entry() is not None:
            cls.poll_message_set("The node groups are among the asset libraries already")
            return False
        return True

    def execute(self, _: bpy.types.Context) -> set[str]:
        """Add them."""
        # Blender's own operator reloads shelves and menus; the functions of the collection do not.
        bpy.ops.preferences.asset_library_add(directory=utf8_name(ASSETS))
        made = entry()
        if made is None:
            self.report({"ERROR"}, f"{ASSETS}: Blender did not take the asset library")
            return CANCELLED
        made.name = NAME
        self.report({"INFO"}, "The node groups are in the compositor's Add menu and asset shelf")
        return DONE


class NoisyWorldRemoveAssetLibrary(bpy.types.Operator):
    """Take the perturbations' node groups out of the asset libraries; groups in use stay"""

    bl_idname = "noisy_world.remove_asset_library"
    bl_label = "Remove Node Groups from Asset Libraries"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, _: bpy.types.Context) -> bool:
        """Tell whether there is something to remove."""
        if entry() is None:
            cls.poll_message_set("The node groups are not among the asset libraries")
            return False
        return True

    def execute(self, _: bpy.types.Context) -> set[str]:
        """Remove them."""
        while (found := entry()) is not None:
            bpy.ops.preferences.asset_library_remove(index=list(libraries()).index(found))
        return DONE


class NoisyWorldPreferences(bpy.types.AddonPreferences):
    """What holds for all files"""

    bl_idname = PACKAGE

    returns: bpy.props.BoolProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Asset Library Returns",
        description="Whether the asset library went with the add-on, and comes back with it",
        options={"HIDDEN"},
    )

    def draw(self, _: bpy.types.Context) -> None:
        """Draw the button."""
        draw_button(self.layout)


def draw_button(layout: bpy.types.UILayout) -> None:
    """Draw the button that adds the library or, where it is there, removes it."""
    kind: Any = NoisyWorldAddAssetLibrary if entry() is None else NoisyWorldRemoveAssetLibrary
    layout.operator(kind.bl_idname, icon="ASSET_MANAGER")


def draw_library(layout: bpy.types.UILayout, _: bpy.types.Context) -> None:
    """Draw the button in the tab, until the library is added."""
    if is_built() and entry() is None:
        layout.operator(NoisyWorldAddAssetLibrary.bl_idname, text="Add Groups to Asset Browser", icon="ASSET_MANAGER")


LIBRARY_CLASSES = (NoisyWorldAddAssetLibrary, NoisyWorldRemoveAssetLibrary, NoisyWorldPreferences)
_asset_library_register_classes, _asset_library_unregister_classes = bpy.utils.register_classes_factory(LIBRARY_CLASSES)


def register_asset_library() -> None:
    """Register the buttons, and add the library again if it was removed with the add-on, as in an update."""
    _asset_library_register_classes()
    if (kept := _kept()) is not None and kept.returns:
        kept.returns = False
        if entry() is None:
            libraries().new(name=NAME, directory=utf8_name(ASSETS))


def unregister_asset_library() -> None:
    """Unregister everything, and remove the library that was added, since its folder may be deleted next."""
    found = entry()
    if found is not None and found.name.startswith(NAME):  # not an entry that a user added by hand
        if (kept := _kept()) is not None:
            kept.returns = True
        libraries().remove(found)
    _asset_library_unregister_classes()
