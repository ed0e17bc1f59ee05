# SPDX-License-Identifier: GPL-3.0-or-later
"""Shots of the open scene: a list in the tab, which Generate Shots makes one after another in the background."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import bpy

from ..core.errors import InputError
from ..core.messages import Action, offers
from . import scene_copy, this_scene
from .background_run import BackgroundRun
from .background_series import BackgroundSeries, SeriesTask
from .following import Following
from .generate import NoisyWorldGenerate, draw_progress, operators
from .long_text import write
from .operators import CANCELLED, DONE, UNDOABLE, OnScene, guarded
from .panels import PanelSection
from .properties import panel_of
from .runs import SceneRun, active_run, generator_command, keep_shots, shots_of, starting, summary, temporary_preset
from .shot_documents import WHERE, chosen_shots, kept_list, preset_of_shot, shot_folder, show_shot
from .shot_fields import OWN_LIST, PANEL_LIST, PRESET_LIST, active_shot
from .wording import spoken

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import IconItems

STOPPED = "Stopped; finished frames stay, and Generate Shots continues from there"
NOT_HERE = "Shots are of This Scene: choose it under Scene, and Scene Camera under Trajectory"
ICONS: "dict[str, IconItems]" = {"finished": "CHECKMARK", "failed": "ERROR", "stopped": "PAUSE"}
SHOWN_FAILURES = 4  # chosen: as many lines as the panel can show

# --- running ---


def start_shots(scene: bpy.types.Scene, *, replaced: Sequence[str] | None = None) -> SceneRun:
    """Start the generator on a scene's shots, one after another, as they and the panel are now.

    replaced: the names of the shots that alone are made, in place of the datasets in their folders. Raises
    NoisyWorldError where one of them cannot be made; nothing is started then.
    """
    panel = panel_of(scene)
    if not this_scene.follows(panel):
        raise InputError(WHERE, NOT_HERE[0].lower() + NOT_HERE[1:])
    shots = [shot for shot in chosen_shots(panel) if replaced is None or shot.name in replaced]
    if not shots:
        raise InputError(WHERE, "none is to be replaced")
    said = scene_copy.ensure(scene)
    presets = [preset_of_shot(scene, shot) for shot in shots]
    with starting("shots", "the generator") as folder:
        options = ("--progress", "json", *(["--overwrite"] if replaced is not None else []))
        tasks = []
        for k, (shot, preset) in enumerate(zip(shots, presets, strict=True)):
            file = temporary_preset(preset.document, folder, f"shot_{k}")
            command = generator_command(file, shot_folder(shot), *options)
            tasks.append(SeriesTask(shot.name, partial(BackgroundRun, command), partial(spoken, file=str(file))))
        series = BackgroundSeries(tasks)
    run = SceneRun(scene.session_uid, shot_folder(shots[0]), series, folder, STOPPED, said=said)
    keep_shots(run)
    return run


def series_of(scene: bpy.types.Scene) -> BackgroundSeries | None:
    """Return the last run of a scene's shots."""
    run = shots_of(scene)
    return run.background if run is not None and isinstance(run.background, BackgroundSeries) else None


def replaceable(scene: bpy.types.Scene) -> list[str]:
    """Return the shots that failed in the last run as another dataset is in their folder."""
    series = series_of(scene)
    ended = [] if series is None or series.active else series.ended
    return [end.task.name for end in ended if end.phase == "failed" and offers(end.text, Action.OVERWRITE)]


class NoisyWorldGenerateShots(Following, bpy.types.Operator):
    """Make a dataset of each shot, one after another, in a Blender in the background; Esc stops them"""

    bl_idname = "noisy_world.generate_shots"
    bl_label = "Generate Shots"
    bl_options = {"REGISTER"}

    replace: bpy.props.BoolProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Replace Datasets",
        description="Make only the shots that another dataset stood in the way of, in place of it",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether a run may start: only one runs at a time."""
        return NoisyWorldGenerate.poll.__func__(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Generate and wait for the end, for scripts."""
        return self.waited(context) if self.started(context) else CANCELLED

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Generate while the windows stay usable."""
        return self.followed(context) if self.started(context) else CANCELLED

    def begin(self, scene: bpy.types.Scene) -> SceneRun:
        """Start the generator."""
        return start_shots(scene, replaced=replaceable(scene) if self.replace else None)

    def take(self, run: SceneRun) -> str:
        """Say what was made."""
        return run.background.result


class NoisyWorldReplaceShots(bpy.types.Operator):
    """Delete the datasets that stood in the way of shots in the last run, and make those shots"""

    bl_idname = "noisy_world.replace_shots"
    bl_label = "Replace Dataset"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there are any."""
        return NoisyWorldGenerateShots.poll.__func__(cls, context) and bool(replaceable(context.scene))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask first."""
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, _: bpy.types.Context) -> set[str]:
        """Make them."""
        how = "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT"
        return CANCELLED if operators().generate_shots(how, replace=True) == CANCELLED else DONE


# --- the list ---


class NoisyWorldAddShot(OnScene, bpy.types.Operator):
    """Add a shot of the scene's camera and frames, with the perturbations and the seed that the panel has now"""

    bl_idname = "noisy_world.add_shot"
    bl_label = "Add Shot"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add it."""
        return guarded(self, lambda: add_shot(context.scene))


def add_shot(scene: bpy.types.Scene) -> str:
    """Add a shot that is what the scene and the panel are now; return what there is to say."""
    panel = panel_of(scene)
    names = {shot.name for shot in panel.shots}
    number = next(k for k in range(1, len(names) + 2) if f"shot_{k}" not in names)
    kept = kept_list(panel)
    shot = panel.shots.add()
    shot.name, shot.camera = f"shot_{number}", scene.camera
    shot.frame_start, shot.frame_end = scene.frame_start, scene.frame_end
    shot.perturbations, shot.own_list = (OWN_LIST, kept) if kept else (PANEL_LIST, "")
    shot.seed = panel.seed
    beside = panel.output_folder.rstrip("/\\") or "//noisy_world"
    shot.output_folder = f"{beside}_{shot.name}"
    panel.active_shot = len(panel.shots) - 1
    return "" if kept else "A severity is keyed on the timeline, so the shot takes the panel's list"


class _OnShot(OnScene):
    """Poll: a shot is selected."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for one."""
        return super().poll(context) and active_shot(panel_of(context.scene)) is not None


class NoisyWorldRemoveShot(_OnShot, bpy.types.Operator):
    """Remove the selected shot from the list; its dataset stays"""

    bl_idname = "noisy_world.remove_shot"
    bl_label = "Remove Shot"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove it."""
        panel = panel_of(context.scene)
        panel.shots.remove(panel.active_shot)
        panel.active_shot = max(0, min(panel.active_shot, len(panel.shots) - 1))
        return DONE


class NoisyWorldMoveShot(_OnShot, bpy.types.Operator):
    """Take the selected shot sooner or later"""

    bl_idname = "noisy_world.move_shot"
    bl_label = "Move Shot"
    bl_options = UNDOABLE

    by: bpy.props.IntProperty(name="By", options={"SKIP_SAVE"})  # pyright: ignore[reportInvalidTypeForm]  as above

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Move it."""
        panel = panel_of(context.scene)
        there = panel.active_shot + self.by
        if not 0 <= there < len(panel.shots):
            return CANCELLED
        panel.shots.move(panel.active_shot, there)
        panel.active_shot = there
        return DONE


class NoisyWorldKeepList(_OnShot, bpy.types.Operator):
    """Let the selected shot keep the list of perturbations and the deviation as the panel has them now"""

    bl_idname = "noisy_world.keep_list"
    bl_label = "Keep List"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Keep it."""

        def work() -> str:
            panel = panel_of(context.scene)
            shot, kept = active_shot(panel), kept_list(panel)
            assert shot is not None, "poll"
            if not kept:
                raise InputError(WHERE, "a severity is keyed on the timeline", remedy="choose Perturb By: Panel")
            shot.own_list, shot.perturbations = kept, OWN_LIST
            return f"{shot.name} keeps the panel's list"

        return guarded(self, work)


class NoisyWorldShowShot(_OnShot, bpy.types.Operator):
    """Set the scene's camera and frames, the seed and the list of perturbations as the shot has them, to preview it"""

    bl_idname = "noisy_world.show_shot"
    bl_label = "Show Shot"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Show it."""
        return guarded(self, lambda: show_shot(context.scene, active_shot(panel_of(context.scene))))


class NOISYWORLD_UL_shots(bpy.types.UIList):
    """The shots in the order in which they are taken"""

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        _data: Any,
        item: Any,
        _icon: int,
        _active_data: Any,
        _active_name: str,
        _index: int = 0,
    ) -> None:
        """Draw an entry: what became of it, its name and its frames."""
        series = series_of(context.scene)
        ended = {} if series is None else {end.task.name: end.phase for end in series.ended}
        row = layout.row(align=True)
        row.active = item.enabled
        row.prop(item, "name", text="", emboss=False, icon=ICONS.get(ended.get(item.name, ""), "OUTLINER_DATA_CAMERA"))
        part = row.row(align=True)
        part.alignment = "RIGHT"
        part.label(text=f"{item.frame_start} to {item.frame_end}")
        layout.prop(item, "enabled", text="")


class NOISYWORLD_PT_shots(PanelSection, bpy.types.Panel):
    """Parts of the scene that are made one after another, each a dataset of its own"""

    bl_label = "Shots"
    bl_parent_id = "NOISYWORLD_PT_output"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only a scene of one's own has cameras to choose from."""
        return super().poll(context) and this_scene.follows(panel_of(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the list, the selected shot and the button."""
        layout, panel = self.fields(context), panel_of(context.scene)
        row = layout.row()
        row.template_list("NOISYWORLD_UL_shots", "", panel, "shots", panel, "active_shot", rows=4, maxrows=8)
        buttons = row.column(align=True)
        buttons.operator(NoisyWorldAddShot.bl_idname, text="", icon="ADD")
        buttons.operator(NoisyWorldRemoveShot.bl_idname, text="", icon="REMOVE")
        buttons.separator()
        buttons.operator(NoisyWorldMoveShot.bl_idname, text="", icon="TRIA_UP").by = -1
        buttons.operator(NoisyWorldMoveShot.bl_idname, text="", icon="TRIA_DOWN").by = 1
        if (shot := active_shot(panel)) is not None:
            _draw_shot(layout, shot)
        _draw_run(layout, context)


def _draw_shot(layout: bpy.types.UILayout, shot: Any) -> None:
    column = layout.column(align=True)
    for name in ("camera", "frame_start", "frame_end", "perturbations"):
        column.prop(shot, name)
    if shot.perturbations == PRESET_LIST:
        column.prop(shot, "preset")
        column.prop(shot, "setting")
    elif shot.perturbations == OWN_LIST:
        column.operator(NoisyWorldKeepList.bl_idname, icon="PINNED")
    column.prop(shot, "seed")
    column.prop(shot, "output_folder")
    layout.operator(NoisyWorldShowShot.bl_idname, icon="HIDE_OFF")


def _draw_run(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the button or the bar, and what became of the last run."""
    run, own = active_run(), shots_of(context.scene)
    if run is None:
        row = layout.row()
        row.scale_y = 1.4
        row.operator(NoisyWorldGenerateShots.bl_idname, icon="RENDER_ANIMATION")
    elif run is own:
        draw_progress(layout, run)
    series = series_of(context.scene)
    if own is None or series is None:
        return
    for end in [end for end in series.ended if end.phase == "failed"][:SHOWN_FAILURES]:
        write(layout, context, end.line, "ERROR")
    if not series.active:
        write(layout, context, ended_line(own, series), ICONS.get(series.phase, "INFO"))
        if replaceable(context.scene):
            layout.operator(NoisyWorldReplaceShots.bl_idname, icon="TRASH")
    if own.said:
        write(layout, context, own.said[:1].upper() + own.said[1:], "FILE_BLEND")


def ended_line(run: SceneRun, series: BackgroundSeries) -> str:
    """Return what became of all shots in a line."""
    if series.phase == "stopped":
        return summary(run)
    made = sum(end.phase == "finished" for end in series.ended)
    return f"{made} of {len(series.ended)} shots are made"


CLASSES: tuple[Any, ...] = (
    NoisyWorldGenerateShots,
    NoisyWorldReplaceShots,
    NoisyWorldAddShot,
    NoisyWorldRemoveShot,
    NoisyWorldMoveShot,
    NoisyWorldKeepList,
    NoisyWorldShowShot,
    NOISYWORLD_UL_shots,
    NOISYWORLD_PT_shots,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
