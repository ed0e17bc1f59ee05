# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake Exposure: the scene's frames are metered in the background, and what a camera decides by them is keyed."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError
from ..core.schema import ConfigPath
from ..dataset.frame import Camera, CleanFrames, EarlierFrames, PlannedFrame
from ..dataset.identity import render_seed
from ..dataset.sequence import lay_out
from ..nodes.chain_scene import kept_by_user, own_compositing, shown_chain
from ..perturbations import registry
from ..perturbations.groups import group_name
from ..perturbations.kinds import ColourPerturbation, FrameContext
from ..perturbations.parsing import parse_steps
from ..perturbations.steps import DEFAULT_SEVERITY, Setting, Step
from ..render.own_stills import OwnStill, StillRequest, read_metered
from ..render.own_view import ToldGroup, bake, told_groups
from . import frame_preview as metered
from . import open_scene, preview, runs, source_views
from .document import identifiers_of, steps_of
from .frame_preview import forget_drawn, request_of, sequence_of
from .operators import CANCELLED, UNDOABLE, OnScene, guarded
from .properties import panel_of
from .runs import Following
from .sidebar import write
from .tree import value_of

SIZES = (
    ("SMALL", "Small", "Meter small renders: quick, and within some hundredths of a stop of what is written"),
    ("FULL", "Full Size", "Meter renders of full size, as the generator does: exactly what is written"),
)
METER_PX = {"SMALL": 128, "FULL": 2**16}  # of the longer side, at most; chosen: a meter has 32 fields along it
NOT_BAKED = "Stopped; the keys that were there stay"


class _Bake(Following, OnScene):
    """Meter the scene's frames in the background, then key what is decided by them."""

    bl_options = UNDOABLE
    size: bpy.props.EnumProperty(name="Size", items=SIZES, default="SMALL")  # pyright: ignore[reportInvalidTypeForm]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there is something to key and nothing is rendered yet."""
        if not super().poll(context):
            return False
        scene = context.scene
        if runs.active_still() is not None:
            cls.poll_message_set("A frame is being rendered: Esc stops that")
        elif scene.camera is None or scene.camera.type != "CAMERA":
            cls.poll_message_set("The scene has no camera")
        elif reason := cls.lacks(scene):
            cls.poll_message_set(reason)
        else:
            return True
        return False

    @classmethod
    def lacks(cls, scene: bpy.types.Scene) -> str:
        """Return why there is nothing to key; "" where there is."""
        raise NotImplementedError

    def asked(self, scene: bpy.types.Scene) -> StillRequest | None:
        """Return which frames are metered; None where nothing looks at any. Raises NoisyWorldError."""
        raise NotImplementedError

    def key(self, scene: bpy.types.Scene, lights: Mapping[int, NDArray[np.float32]]) -> str:
        """Key what is decided by what a meter saw of frames; return a sentence on it. Raises NoisyWorldError."""
        raise NotImplementedError

    def begin(self, scene: bpy.types.Scene) -> runs.SceneRun:
        """Start metering."""
        request = self.asked(scene)
        assert request is not None, "there is something to meter"
        return runs.start_still(scene, replace(request, meter_px=METER_PX[self.size]), stopped=NOT_BAKED)

    def take(self, run: runs.SceneRun) -> str:
        """Key what follows."""
        scene = next((item for item in bpy.data.scenes if item.session_uid == run.scene_uid), None)
        if scene is None:
            raise NoisyWorldError("the scene that was metered is gone")
        return self.key(scene, read_metered(run.folder))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Meter and key, for scripts."""
        return self._started(context, self.waited)

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Meter while the windows stay usable."""
        return self._started(context, self.followed)

    def _started(self, context: bpy.types.Context, then: Callable[[bpy.types.Context], set[str]]) -> set[str]:
        try:
            meters = self.asked(context.scene) is not None
        except NoisyWorldError as error:
            return guarded(self, _raising(error))
        if not meters:
            return guarded(self, lambda: self.key(context.scene, {}))
        return then(context) if self.started(context) else CANCELLED


def _raising(error: NoisyWorldError) -> Callable[[], str]:
    def work() -> str:
        raise error

    return work


class BakeExposure(_Bake, bpy.types.Operator):
    """Meter this scene's frames in the background and key auto-exposure, white balance and flicker in the preview as \
they are written, lag and all. Press again when the scene's light has changed; Esc stops it"""

    bl_idname = "noisy_world.bake_exposure"
    bl_label = "Bake Exposure"

    @classmethod
    def lacks(cls, scene: bpy.types.Scene) -> str:
        """Ask for a step that decides by frames, and for a scene that is rendered."""
        if source_views.shows_footage(panel_of(scene)):
            return "A recording is metered when it is generated"
        return "" if decides(panel_of(scene)) else "No perturbation of the list decides frame by frame"

    def asked(self, scene: bpy.types.Scene) -> StillRequest | None:
        """Return all frames that the panel's sequence shows."""
        sequence, _ = sequence_of(scene)
        return request_of(scene, set(sequence.source_frames)) if sequence.setting.looks_back else None

    def key(self, scene: bpy.types.Scene, lights: Mapping[int, NDArray[np.float32]]) -> str:
        """Keep what was metered, by which the preview is keyed from now on."""
        if lights:
            metered.keep_light(scene, lights)
        forget_drawn(scene)
        panel, (sequence, _) = panel_of(scene), sequence_of(scene)
        if not panel.preview:
            return f"{_counted(lights)}: switch Preview on to see it"
        preview.touch(scene, ("preview",))
        preview.flush()
        chain = shown_chain(scene)
        left = [] if chain is None else kept_by_user(chain, sequence.setting.rgb)
        return f"{_counted(lights)}: the preview follows{_kept(left)}"


class BakeGroups(_Bake, bpy.types.Operator):
    """Meter this scene's frames in the background and key its own groups of auto-exposure, white balance and flicker, \
with the values that the tab's list has for them, else the defaults. Your own keys stay; Esc stops it"""

    bl_idname = "noisy_world.bake_groups"
    bl_label = "Bake Exposure of Groups"

    @classmethod
    def lacks(cls, scene: bpy.types.Scene) -> str:
        """Ask for a group that is told values frame by frame."""
        return (
            "" if groups_of(scene) else "The scene's compositor has no group of auto-exposure, white balance or flicker"
        )

    def asked(self, scene: bpy.types.Scene) -> StillRequest | None:
        """Return all frames of the scene, seen by its own camera."""
        if not _setting(scene, groups_of(scene))[0].looks_back:
            return None
        camera, seed = open_scene.intrinsics_of_scene(scene), render_seed(value_of(panel_of(scene), "seed"))
        stills = {
            frame: OwnStill(float(frame), None, True, camera, None, None, None, seed, False, 0.5)
            for frame in range(scene.frame_start, scene.frame_end + 1)
        }
        return StillRequest(scene.name, dict(stills))

    def key(self, scene: bpy.types.Scene, lights: Mapping[int, NDArray[np.float32]]) -> str:
        """Key the groups."""
        groups = groups_of(scene)
        setting, steps = _setting(scene, groups)
        frames = range(scene.frame_start, scene.frame_end + 1)
        stamps_s = np.arange(len(frames), dtype=np.float64) * (scene.render.fps_base / scene.render.fps)
        sequence = lay_out(setting, scene.name, len(frames), identifiers_of(panel_of(scene)))
        earlier = EarlierFrames(stamps_s, lambda source: lights[frames[source]])
        clean = CleanFrames(Camera(None, stamps_s, earlier=earlier))
        values: list[dict[str, list[float]]] = [{} for _ in groups]
        for frame in range(len(frames)):
            acting = PlannedFrame(sequence, frame, clean).colour.active
            told = {id(step): _told(step, own) for step, own, _ in acting}
            for made, step in zip(values, steps, strict=True):
                for name, value in told[id(step)].items():
                    made.setdefault(name, []).append(value)
        left = [name for group, made in zip(groups, values, strict=True) for name in bake(group, frames, made)]
        names = ", ".join(group.name for group in groups)
        return f"Keyed over {len(frames)} frames: {names}{_kept(left)}"


def _told(step: Step[ColourPerturbation], context: FrameContext) -> Mapping[str, float]:
    nodes = step.perturbation.nodes
    assert nodes is not None, "groups have them"
    assert nodes.by_frame is not None, "it is told values"
    return nodes.by_frame.of(step.parameters(step.severity), context)


def _counted(lights: Mapping[int, Any]) -> str:
    return f"Exposure of {len(lights)} frames is baked" if lights else "Flicker needs no metering"


def _kept(left: list[str]) -> str:
    return f"; left as you set them up: {', '.join(left)}" if left else ""


def decides(panel: Any) -> bool:
    """Tell whether a step of the panel's list decides frame by frame."""
    kinds = [registry().get(step.perturbation) for step in panel.steps if step.enabled]
    return any(isinstance(kind, ColourPerturbation) and kind.automatic is not None for kind in kinds)


def groups_of(scene: bpy.types.Scene) -> list[ToldGroup]:
    """Return the groups of the scene's own compositing that are told values frame by frame."""
    kinds = [kind for kind in registry().values() if isinstance(kind, ColourPerturbation)]
    told = {group_name(kind): kind for kind in kinds if kind.nodes is not None and kind.nodes.values}
    return told_groups(own_compositing(scene), told)


def _setting(scene: bpy.types.Scene, groups: list[ToldGroup]) -> tuple[Setting, list[Step[ColourPerturbation]]]:
    """Return the setting of groups, and the step of each: the tab's where it has one, else the default.

    Raises NoisyWorldError where a value of the tab is wrong.
    """
    listed = steps_of(panel_of(scene))
    shutters = Setting("", listed).exposure
    numbers: dict[str, int] = {}
    steps: list[Step[ColourPerturbation]] = []
    for group in groups:
        name = group.perturbation.name
        number = numbers[name] = numbers.get(name, -1) + 1
        own = [step for step in listed if step.perturbation.name == name and step.severity != 0 and step.levels is None]
        default = parse_steps([{name: {"severity": DEFAULT_SEVERITY}}], ConfigPath(name), registry())
        steps.append(replace(own[number] if number < len(own) else default[0], occurrence=number))
    in_order = sorted(steps, key=lambda step: step.perturbation.order)
    return Setting("groups", (*shutters, *in_order)), steps


# --- in the tab and the node editor ---


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the buttons in the tab where there is something to key."""
    scene = context.scene
    for operator, shown in ((BakeExposure, decides(panel_of(scene))), (BakeGroups, bool(groups_of(scene)))):
        if shown:
            row = layout.row(align=True)
            row.operator(operator.bl_idname, icon="CAMERA_DATA").size = "SMALL"
            row.operator(operator.bl_idname, text="", icon="FULLSCREEN_ENTER").size = "FULL"
    if panel_of(scene).preview and decides(panel_of(scene)) and metered.follows_grey(scene):
        write(layout, context, "Exposure follows mid-gray here; Bake Exposure shows it as it is written", "INFO")


def _draw_in_menu(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw the entry in the node editor's menu Node, for groups from the asset shelf."""
    space = context.space_data
    if isinstance(space, bpy.types.SpaceNodeEditor) and space.tree_type == "CompositorNodeTree":
        assert menu.layout is not None
        menu.layout.operator(BakeGroups.bl_idname, icon="CAMERA_DATA")


_DRAWS: Any = _draw_in_menu  # the stubs give such functions no menu
_register_classes, _unregister_classes = bpy.utils.register_classes_factory((BakeExposure, BakeGroups))


def register() -> None:
    """Register the buttons, in the tab and in the node editor's menu."""
    _register_classes()
    bpy.types.NODE_MT_node.append(_DRAWS)  # looked up anew: reloading scripts makes another class of it


def unregister() -> None:
    """Unregister them."""
    bpy.types.NODE_MT_node.remove(_DRAWS)
    _unregister_classes()
