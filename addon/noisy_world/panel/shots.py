# SPDX-License-Identifier: GPL-3.0-or-later
"""Shots of the open scene: a list in the tab, which Generate Shots makes one after another in the background."""

import json
import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..core.errors import Action, InputError, NoisyWorldError, offers
from ..core.schema import ConfigPath
from ..perturbations import registry
from ..preset.keys import Preset, check_document, read_preset
from . import open_scene
from .background import BackgroundRun, BackgroundSeries, SeriesTask
from .document import CLEAN, PANEL, perturb_of, setting_name, setting_of, show_setting, to_document
from .entries import RATE, own_rate_hz
from .fields import notify_once
from .generating import NoisyWorldGenerate, draw_progress, operators
from .open_scene import absolute, folder_of
from .operators import CANCELLED, DONE, UNDOABLE, OnScene, guarded
from .properties import OWN_LIST, PANEL_LIST, PRESET_LIST, active_shot, panel_of
from .runs import (
    Following,
    SceneRun,
    active_run,
    generator_command,
    keep_shots,
    shots_of,
    starting,
    summary,
    temporary_preset,
)
from .sections import DatasetSection
from .sidebar import write
from .step_list import is_keyed
from .wording import spoken

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import IconItems


# A shot as a preset's document: what Generate would make if the scene and the panel were as the shot says.


WHERE = "Shots"


def problem(shot: Any, text: str, remedy: str) -> InputError:
    """Return an error about a shot."""
    return InputError(WHERE, f"{shot.name or 'a shot'} {text}", remedy=remedy)


def chosen_shots(panel: Any) -> list[Any]:
    """Return the shots that are taken. Raises InputError where there are none, or two share a name or a folder."""
    shots = [shot for shot in panel.shots if shot.enabled]
    if not shots:
        raise InputError(WHERE, "none is there or switched on", remedy="add one")
    names: dict[str, Any] = {}
    folders: dict[Path, Any] = {}
    for shot in shots:
        if not shot.name.strip():
            raise problem(shot, "has no name", "give it one")
        if shot.name in names:
            raise problem(shot, "is the name of two shots", "rename one")
        folder = shot_folder(shot)
        if folder in folders:
            raise problem(shot, f"has the folder of {folders[folder].name}", "choose another under Output")
        names[shot.name] = folders[folder] = shot
    return shots


def shot_folder(shot: Any) -> Path:
    """Return the folder of a shot's dataset. Raises InputError where it names none."""
    return folder_of(shot.output_folder, f"{WHERE} > {shot.name} > Output")


def preset_of_shot(scene: bpy.types.Scene, shot: Any) -> Preset:
    """Return the checked preset of a shot, as Generate would write it for a scene and a panel that say what it says.

    Raises InputError naming the shot where its camera, frames or perturbations cannot be had.
    """
    panel = panel_of(scene)
    blend = open_scene.blend_file(scene)  # of the scene as it is: the timeline that follows is put back
    own = _own_settings(panel, shot)
    with _as_in(scene, shot):
        try:
            open_scene.check(scene)
            document = to_document(panel)  # with the severities that are keyed in the shot's frames
        except NoisyWorldError as error:
            raise InputError(f"{WHERE} > {shot.name}", error.message) from error
    step = scene.frame_step * panel.scene.trajectory.every
    frames = f"{shot.frame_start}:{shot.frame_end}" + (f":{step}" if step > 1 else "")
    document["scenes"][0] |= {"blend": str(blend), "camera": shot.camera.name, "frames": frames}
    document |= {"seed": shot.seed} | ({"settings": own} if own else {})
    return check_document(document, Path(PANEL))


@contextmanager
def _as_in(scene: bpy.types.Scene, shot: Any) -> Iterator[None]:
    """Let the scene have a shot's camera and frames, and put its own back."""
    if shot.camera is None or shot.camera.name not in scene.objects:
        raise problem(shot, "has no camera of this scene", "choose one")
    if shot.frame_end < shot.frame_start:
        raise problem(shot, f"ends at frame {shot.frame_end}, before it begins", "choose a later last frame")
    before = scene.camera, scene.frame_start, scene.frame_end
    try:
        scene.camera, scene.frame_start, scene.frame_end = shot.camera, shot.frame_start, shot.frame_end
        yield
    finally:
        scene.camera, scene.frame_start, scene.frame_end = before


# --- perturbations ---


def kept_list(panel: Any) -> str:
    """Return what the panel does to a scene as a text that a shot can hold; "" where something of it is keyed."""
    if any(step.enabled and is_keyed(step) for step in panel.steps):
        return ""  # a curve belongs to the timeline
    return json.dumps({"name": setting_name(panel), "perturb": perturb_of(panel)}, ensure_ascii=False)


def _own_settings(panel: Any, shot: Any) -> list[dict[str, Any]]:
    """Return the settings of a shot that does not take the panel's list; [] where it does."""
    if shot.perturbations == PANEL_LIST:
        return []
    setting = _own(shot) if shot.perturbations == OWN_LIST else _preset_setting(shot)
    clean: list[dict[str, Any]] = [{"name": CLEAN}]
    return [*(clean if panel.use_clean else []), setting] if setting["perturb"] else clean


def _preset_setting(shot: Any) -> dict[str, Any]:
    """Return the setting that a shot takes from a preset, as a preset has it; one of a sweep is written out."""
    preset, chosen = _of_preset(shot)
    timed = [with_rate(panel_of(shot.id_data), step) for step in chosen["perturb"]]
    return {"backend": preset.spec.render.backend, **chosen, "perturb": timed}


def with_rate(panel: Any, step: dict[str, Any]) -> dict[str, Any]:
    """Return a preset's step with the rate of the scene's frames, where it counts time and gives no rate of its own."""
    ((name, values),) = step.items()
    kind, rate_hz = registry().get(name), own_rate_hz(panel)
    if kind is None or rate_hz is None or RATE in (values or {}) or not hasattr(kind.parameters, RATE):
        return step
    return {name: {**(values or {}), RATE: rate_hz}}


def _own(shot: Any) -> dict[str, Any]:
    if not shot.own_list:
        raise problem(shot, "has no list of its own yet", "press Keep List")
    return json.loads(shot.own_list)


def _of_preset(shot: Any) -> tuple[Preset, dict[str, Any]]:
    if not shot.preset:
        raise problem(shot, "names no preset", "choose one")
    preset = read_preset(Path(absolute(shot.preset)))
    return preset, setting_of(preset, shot.setting)


def show_shot(scene: bpy.types.Scene, shot: Any) -> str:
    """Set scene and panel as a shot says, so that previews show it; return what was done. Raises InputError."""
    panel = panel_of(scene)
    chosen = _shown_setting(shot)
    with _as_in(scene, shot):
        pass  # raises for what cannot be shown, before anything changes
    with notify_once():
        scene.camera, scene.frame_start, scene.frame_end = shot.camera, shot.frame_start, shot.frame_end
        panel.seed = shot.seed
        if chosen is not None:
            show_setting(panel, chosen, ConfigPath(PANEL, "settings.0"))
    if not shot.frame_start <= scene.frame_current <= shot.frame_end:
        scene.frame_set(shot.frame_start)
    took = "" if chosen is None else ", and its perturbations are in the list"
    return f"{shot.name}: camera, frames and seed are the shot's{took}"


def _shown_setting(shot: Any) -> dict[str, Any] | None:
    """Return the setting that a shot has of its own; None where it has the panel's list."""
    if shot.perturbations == PRESET_LIST:
        return _of_preset(shot)[1]
    return None if shot.perturbations == PANEL_LIST else _own(shot)


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
    if not open_scene.follows(panel):
        raise InputError(WHERE, NOT_HERE[0].lower() + NOT_HERE[1:])
    shots = [shot for shot in chosen_shots(panel) if replaced is None or shot.name in replaced]
    if not shots:
        raise InputError(WHERE, "none is to be replaced")
    said = open_scene.ensure(scene)
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
    names = {shot.name for shot in panel_of(scene).shots}
    number = next(k for k in range(1, len(names) + 2) if f"shot_{k}" not in names)
    shot = _new_shot(scene, f"shot_{number}")
    shot.camera, shot.frame_start, shot.frame_end = scene.camera, scene.frame_start, scene.frame_end
    return "" if shot.own_list else KEYED


KEYED = "Something of the list is keyed on the timeline, so the shot takes the panel's list"


def _new_shot(scene: bpy.types.Scene, name: str) -> Any:
    """Add a shot with the perturbations and the seed that the panel has now, and select it."""
    panel = panel_of(scene)
    kept = kept_list(panel)
    folders = {shot.output_folder for shot in panel.shots}
    shot = panel.shots.add()
    shot.name, shot.seed = name, panel.seed
    shot.perturbations, shot.own_list = (OWN_LIST, kept) if kept else (PANEL_LIST, "")
    beside = panel.output_folder.rstrip("/\\") or "//noisy_world"
    plain = re.sub(r"[^\w.-]+", "_", name)
    numbered = (f"{beside}_{plain}" + (f"_{k}" if k > 1 else "") for k in range(1, len(folders) + 2))
    shot.output_folder = next(folder for folder in numbered if folder not in folders)
    panel.active_shot = len(panel.shots) - 1
    return shot


class NoisyWorldShotsFromMarkers(OnScene, bpy.types.Operator):
    """Make a shot of each marker of the timeline, from it to the next one, seen by the camera that it binds; a shot \
of a marker's name gets its camera and frames, and keeps everything else"""

    bl_idname = "noisy_world.shots_from_markers"
    bl_label = "Shots from Markers"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a marker."""
        if not super().poll(context):
            return False
        if not len(context.scene.timeline_markers):
            cls.poll_message_set("The timeline has no markers: M over it sets one, Ctrl-B binds a camera to it")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Make them."""
        return guarded(self, lambda: shots_from_markers(context.scene))


def shots_from_markers(scene: bpy.types.Scene) -> str:
    """Make a shot of each marker inside the scene's frames, up to the next one; return what was done.

    Where markers bind cameras, these cut and others are labels. Raises InputError where none is inside.
    """
    first, last = scene.frame_start, scene.frame_end
    listed = sorted(scene.timeline_markers, key=lambda marker: marker.frame)
    cuts = [marker for marker in listed if marker.camera is not None] or listed
    starts = [max(marker.frame, first) for marker in cuts]
    ends = [*(frame - 1 for frame in starts[1:]), last]
    parts = [
        (marker, start, min(end, last)) for marker, start, end in zip(cuts, starts, ends, strict=True) if start <= end
    ]
    parts = [part for part in parts if part[1] <= last]
    if not parts:
        raise InputError(WHERE, f"no marker is at the scene's frames, {first} to {last}", remedy="move one there")
    known = {shot.name: shot for shot in panel_of(scene).shots}
    taken: set[str] = set()
    added, keyed = 0, False
    for marker, start, end in parts:
        name = _free_name(marker.name or f"frame_{marker.frame}", taken)
        taken.add(name)
        if name not in known:
            added += 1
            keyed = not _new_shot(scene, name).own_list
        shot = next(item for item in panel_of(scene).shots if item.name == name)
        shot.camera, shot.frame_start, shot.frame_end = marker.camera or scene.camera, start, end
    said = [f"{added} shots are added, {len(parts) - added} have the frames of their markers"]
    if parts[0][1] > first:
        said.append(f"frames {first} to {parts[0][1] - 1} stand before the first marker, so in no shot")
    return "; ".join(said) + (f". {KEYED}" if keyed else "")


def _free_name(name: str, taken: Collection[str]) -> str:
    """Return a name that is not taken: the same one, or with a number."""
    return next(text for k in range(1, len(taken) + 2) if (text := name if k == 1 else f"{name}_{k}") not in taken)


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


class NOISYWORLD_PT_shots(DatasetSection, bpy.types.Panel):
    """Parts of the scene that are made one after another, each a dataset of its own"""

    bl_label = "Shots"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only a scene of one's own has cameras to choose from."""
        return super().poll(context) and open_scene.follows(panel_of(context.scene))

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
        if len(context.scene.timeline_markers):
            layout.operator(NoisyWorldShotsFromMarkers.bl_idname, icon="MARKER_HLT")
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
    NoisyWorldShotsFromMarkers,
    NoisyWorldRemoveShot,
    NoisyWorldMoveShot,
    NoisyWorldKeepList,
    NoisyWorldShowShot,
    NOISYWORLD_UL_shots,
    NOISYWORLD_PT_shots,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
