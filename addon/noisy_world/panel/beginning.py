# SPDX-License-Identifier: GPL-3.0-or-later
"""How one begins: Try It, what is loaded or dropped on a view, and the way back to the user's own scene.

What is loaded goes into a scene of Noisy World's own, unless the open one is empty or holds what was loaded before.
"""

from pathlib import Path
from typing import Any

import bpy

from ..nodes.datablocks import override
from ..scenes.mesh_formats import MESH_SUFFIXES
from . import loading, made_scene, open_scene, source_views
from .document import listed_motion, open_preset
from .gallery import shipped_folder
from .operators import DONE, UNDOABLE, OnScene, color_type, guarded
from .own_objects import own_object
from .properties import LOADED, panel_of
from .sidebar import write

TRIED = "try_it.yaml"
FILES = {"mesh": "mesh", "trajectory": "trajectory"}


class _OnFiles(OnScene):
    """Poll: the files that are needed are named. A button loads into a scene of our own where this one is in use."""

    needed: tuple[str, ...] = ()

    apart: bpy.props.BoolProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Scene of Its Own",
        description="Load into a scene of Noisy World's own, so that nothing of this scene is in the way",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a file where one is needed; a recording cannot be loaded into this file."""
        if not super().poll(context):
            return False
        panel = panel_of(context.scene)
        for what in cls.needed:
            path = panel.of_mesh.mesh if what == "mesh" else panel.scene.trajectory.file
            if getattr(panel, f"{what}_source") == "FILE" and not path:
                cls.poll_message_set(f"Choose a {FILES[what]} file")
                return False
        if source_views.shows_footage(panel):
            cls.poll_message_set("A recording has no mesh: Preview Frame shows its frames")
            return False
        return True

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Load where nothing else is in the way; scripts load into the scene that they are in."""
        self.apart = is_loaded(context.scene) and not made_scene.is_clear(context.scene)
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Load it."""

        def work() -> str:
            with made_scene.entered(context, apart=self.apart) as scene:
                return self.load(context, scene)

        return guarded(self, work)

    def load(self, context: bpy.types.Context, scene: bpy.types.Scene) -> str:
        """Load into a scene; return what was loaded."""
        raise NotImplementedError


def is_loaded(scene: bpy.types.Scene) -> bool:
    """Tell whether the panel names what is loaded into a file, rather than the open scene or footage."""
    return panel_of(scene).mesh_source in LOADED


class _LoadsMesh(_OnFiles):
    """Poll: there is a mesh to load."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Refuse the open scene, which is there."""
        if not super().poll(context):
            return False
        if panel_of(context.scene).mesh_source == "SCENE":
            cls.poll_message_set("This scene is there already")
            return False
        return True


class NoisyWorldLoadScene(_LoadsMesh, bpy.types.Operator):
    """Load the mesh, in place of the one loaded before; everything else in the file stays"""

    bl_idname = "noisy_world.load_scene"
    bl_label = "Load Scene"
    bl_options = UNDOABLE
    needed = ("mesh",)

    def load(self, context: bpy.types.Context, scene: bpy.types.Scene) -> str:
        """Load it."""
        del context
        _, notes = loading.load_scene(scene)
        return "; ".join((", ".join(loading.summary(scene)), *notes))


class NoisyWorldLoadTrajectory(_OnFiles, bpy.types.Operator):
    """Load or make the trajectory, key our camera along it, deviated as given, and set the timeline's range and rate"""

    bl_idname = "noisy_world.load_trajectory"
    bl_label = "Load Trajectory"
    bl_options = UNDOABLE
    needed = ("trajectory", "mesh")

    def load(self, context: bpy.types.Context, scene: bpy.types.Scene) -> str:
        """Load it."""
        del context
        count, notes = loading.load_path(scene)
        return "; ".join((f"{count:,} poses", *notes))


class NoisyWorldLoadAll(_LoadsMesh, bpy.types.Operator):
    """Load the scene and the path that the panel names, and look through the camera; the rest of the file stays"""

    bl_idname = "noisy_world.load_all"
    bl_label = "Load Scene and Path"
    bl_options = UNDOABLE
    needed = ("mesh", "trajectory")

    def load(self, context: bpy.types.Context, scene: bpy.types.Scene) -> str:
        """Load both."""
        return load_all(context, scene)


class NoisyWorldSetCamera(_OnFiles, bpy.types.Operator):
    """Give the scene a camera with these intrinsics, and the image its size"""

    bl_idname = "noisy_world.set_camera"
    bl_label = "Set Up Camera"
    bl_options = UNDOABLE

    def load(self, context: bpy.types.Context, scene: bpy.types.Scene) -> str:
        """Set it up."""
        del context
        loading.set_camera(scene)
        return ""


def load_all(context: bpy.types.Context, scene: bpy.types.Scene) -> str:
    """Load the panel's mesh and path into a scene, and let the view show them through the camera, in their colours."""
    mesh, notes = loading.load_scene(scene)
    count, more = loading.load_path(scene)
    for item in (mesh, scene.camera):
        if item is not None:
            item.select_set(False, view_layer=scene.view_layers[0])  # or they have outlines
    made_scene.show_unlit(scene, context, color_type(scene))
    made_scene.look_through_camera(context)
    return "; ".join((", ".join(loading.summary(scene)), f"{count:,} poses", *notes, *more))


# --- try it ---


class NoisyWorldTryIt(OnScene, bpy.types.Operator):
    """Show drifting fog in the embedded room, in a scene of its own and as it is written; your scene stays as it is"""

    bl_idname = "noisy_world.try_it"
    bl_label = "Try It"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set it up, and play it."""

        def work() -> str:
            with made_scene.entered(context) as scene:
                open_preset(panel_of(scene), shipped_folder() / TRIED)
                load_all(context, scene)
            panel_of(scene).preview = True
            play(context)
            return "Fog in the embedded room, in a scene of its own; Space stops and plays it"

        return guarded(self, work)


def play(context: bpy.types.Context) -> None:
    """Play the scene in the view, where there is a window that shows it."""
    area = made_scene.view_of(context)
    if bpy.app.background or area is None or context.screen is None or context.screen.is_animation_playing:
        return
    with override(window=context.window, area=area):
        bpy.ops.screen.animation_play()


class NoisyWorldBack(OnScene, bpy.types.Operator):
    """Show your own scene again, in the view as it was; Noisy World's stays in the file"""

    bl_idname = "noisy_world.back"
    bl_label = "Back to Your Scene"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there is one to go back to."""
        if not super().poll(context):
            return False
        if made_scene.origin_of(context.scene) is None:
            cls.poll_message_set("This scene is your own, or the one that it was made from is gone")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Go back."""
        if context.screen is not None and context.screen.is_animation_playing:
            bpy.ops.screen.animation_cancel(restore_frame=False)
        made_scene.leave(context)
        return DONE


def is_unused(scene: bpy.types.Scene) -> bool:
    """Tell whether nothing was done yet with a scene's panel, so that it is offered to be tried."""
    panel = panel_of(scene)
    made = own_object(scene, "mesh") is not None or own_object(scene, "camera") is not None
    return not (made or len(panel.steps) or panel.preset_path or made_scene.is_apart(scene))


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw Try It in a file in which nothing was done yet, and the way back from a scene of ours."""
    if is_unused(context.scene):
        row = layout.row()
        row.scale_y = 1.6
        row.operator(NoisyWorldTryIt.bl_idname, icon="PLAY")
    elif (origin := made_scene.origin_of(context.scene)) is not None:
        layout.operator(NoisyWorldBack.bl_idname, text=f"Back to {origin.name}", icon="LOOP_BACK")


def draw_missing(layout: bpy.types.UILayout, context: bpy.types.Context) -> bool:
    """Draw what loads the panel's scene and path where they are not loaded, and tell whether they are not."""
    scene = context.scene
    if open_scene.is_shown(panel_of(scene)):
        return _draw_missing_path(layout, context)
    if not is_loaded(scene):
        return False
    mesh = own_object(scene, "mesh")
    if mesh is not None and loading.is_from_panel(scene, mesh) and loading.has_current_path(scene):
        return False
    if own_object(scene, "camera") is not None or mesh is not None:
        write(layout, context, "The panel names another scene or path than is loaded", "INFO")
    layout.operator(NoisyWorldLoadAll.bl_idname, icon="IMPORT")
    return True


def _draw_missing_path(layout: bpy.types.UILayout, context: bpy.types.Context) -> bool:
    """Draw what loads the path of the open scene where a perturbation moves the camera along it."""
    if not listed_motion(panel_of(context.scene)) or loading.has_current_path(context.scene):
        return False
    write(layout, context, "The path that the list moves is not loaded, or another by now", "INFO")
    layout.operator(NoisyWorldLoadTrajectory.bl_idname, icon="CON_FOLLOWPATH")
    return True


# --- dropped files ---


class NoisyWorldDropMesh(OnScene, bpy.types.Operator):
    """Load a mesh into a scene of its own, with a path through it, to perturb what is seen of it"""

    bl_idname = "noisy_world.drop_mesh"
    bl_label = "Load Dropped Mesh"
    bl_options = UNDOABLE

    filepath: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        subtype="FILE_PATH", options={"SKIP_SAVE"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Load it."""

        def work() -> str:
            with made_scene.entered(context, apart=not made_scene.is_clear(context.scene)) as scene:
                panel = panel_of(scene)
                panel.mesh_source, panel.of_mesh.mesh = "FILE", self.filepath
                panel.scene.name = Path(self.filepath).stem
                return load_all(context, scene)

        return guarded(self, work)


def dropped(name: str, label: str, operator: str, suffixes: tuple[str, ...]) -> type:
    """Make what lets Blender offer an operator for files of these suffixes that are dropped on a 3D view."""

    def poll_drop(cls: Any, context: bpy.types.Context) -> bool:
        del cls
        return context.area is not None and context.area.type == "VIEW_3D" and loading.is_editable(context.scene)

    members = {
        "bl_idname": name, "bl_label": label, "bl_import_operator": operator, "bl_file_extensions": ";".join(suffixes),
        "poll_drop": classmethod(poll_drop), "__module__": __name__, "__doc__": label,
    }  # fmt: skip
    return type(name, (bpy.types.FileHandler,), members)


CLASSES: tuple[Any, ...] = (
    NoisyWorldLoadScene,
    NoisyWorldLoadTrajectory,
    NoisyWorldLoadAll,
    NoisyWorldSetCamera,
    NoisyWorldTryIt,
    NoisyWorldBack,
    NoisyWorldDropMesh,
    dropped("NOISYWORLD_FH_mesh", "Noisy World Mesh", NoisyWorldDropMesh.bl_idname, MESH_SUFFIXES),
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
