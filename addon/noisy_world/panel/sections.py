# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's tab: its sections in the order of the work."""

from typing import TYPE_CHECKING, Any

import bpy
import bpy.utils.previews
import numpy as np
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError
from ..core.geometry import rotvec_from_rotation
from ..core.schema import ConfigPath
from ..core.trajectory import Trajectory
from ..layouts import LAYOUTS
from ..nodes.datablocks import layout_of
from ..perturbations import registry
from ..perturbations.execution import move
from ..perturbations.kinds import MotionPerturbation, Stage
from ..perturbations.new_steps import is_overlay
from ..perturbations.parsing import parse_steps
from ..perturbations.steps import steps_of_kind
from ..preset.keys import OutputSpec, PresetSpec, RenderSpec, RigSpec, SettingSpec
from ..preset.scene_keys import HandheldSpec, TrajectorySpec
from . import (
    bake_exposure,
    beginning,
    gallery,
    generating,
    loading,
    operators,
    preview,
    section_presets,
    source_views,
)
from . import drawn_paths as paths
from .document import APART, OF_FILES, PANEL, identifiers_of, values_of
from .entries import draw_step, other_rate
from .fields import CAMERA, DEVIATION, GENERATE, OUTPUT, PERTURBATIONS, RIG, SCENE, TRAJECTORY
from .gallery import BENCHMARK, PACKAGES, PHYSICAL, Offered, line_on, offered, short_label
from .own_objects import own_object
from .properties import active_step, own_step, panel_of, perturbation_of
from .sidebar import write
from .source_views import shown
from .step_list import may_move, without_effect
from .tree import draw_body, draw_distortion, draw_given, draw_imu, draw_keys, draw_lines

# A small picture of what a perturbation of motion does: how it moves and turns the camera in time, and how often.
#
# It perturbs a camera that stands still, by the step's own values and the panel's seed, as the generator would.


FAST, SLOW = (8.0, 4.0, 500.0), (60.0, 60.0, 50.0)
"""Seconds that are perturbed, seconds that are shown, and poses a second: rotors turn 200 times a second."""
SIZE_PX = 384
SCALE = 11.0  # of the picture in the panel; chosen: as wide as the tab
LEAST_HZ, MOST_HZ = 0.5, 250.0
BACK, INK, GRID = (30, 30, 30), (190, 190, 190), (64, 64, 64)
AXES = ((237, 90, 90), (115, 205, 90), (102, 153, 250))  # x, y and z, as Blender colours them
KEPT = 8  # pictures
_loaded: dict[str, Any] = {}


def draw_motion(layout: bpy.types.UILayout, panel: Any, step: Any) -> None:
    """Draw the picture of a step that moves the camera continuously; nothing for any other."""
    perturbation = perturbation_of(step)
    if not isinstance(perturbation, MotionPerturbation) or not perturbation.continuous:
        return
    try:
        icon = _icon(panel, step)
    except NoisyWorldError:  # beside the list stands what is wrong
        return
    if icon:
        layout.template_icon(icon_value=icon, scale=SCALE)


def signals(panel: Any, step: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far a step moves, m, and turns, deg, a camera that stands still: (N, 3) each, as `window_of` says.

    Along and about the camera's x right, y down, z ahead. Raises NoisyWorldError where its values are wrong.
    """
    given = [{step.perturbation: values_of(step)}]
    steps = steps_of_kind(parse_steps(given, ConfigPath(PANEL, "motion"), registry()), MotionPerturbation)
    seconds, _, rate_hz = window_of(step.perturbation)
    count = int(seconds * rate_hz)
    still = Trajectory(np.tile(np.eye(4), (count, 1, 1)), np.arange(count) / rate_hz)
    c2w = move(steps, still, identifiers_of(panel)).c2w
    return c2w[:, :3, 3], np.degrees(rotvec_from_rotation(c2w[:, :3, :3]))


def window_of(perturbation: str) -> tuple[float, float, float]:
    """Return the seconds that are perturbed, those that are shown, and poses a second."""
    return FAST if perturbation == "vibration" else SLOW


def power(values: NDArray[np.float64], rate_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies (F,) in Hz and the power spectral density (F, 3) of signals (N, 3), by a Hann window."""
    window = np.hanning(len(values))[:, None]
    spectrum = np.abs(np.fft.rfft((values - values.mean(axis=0)) * window, axis=0)) ** 2
    return np.fft.rfftfreq(len(values), 1 / rate_hz), 2 * spectrum / (rate_hz * np.sum(window**2))


def picture(
    moved_m: NDArray[np.float64], turned_deg: NDArray[np.float64], shown_s: float, rate_hz: float
) -> NDArray[np.uint8]:
    """Return a picture (SIZE_PX, SIZE_PX, 3), uint8: translation and rotation in time, and their spectra."""
    import cv2

    made = np.full((SIZE_PX, SIZE_PX, 3), BACK, np.uint8)
    half, third = SIZE_PX // 2, SIZE_PX // 3
    shown = int(shown_s * rate_hz)
    along = np.linspace(0, SIZE_PX - 1, shown)
    for row, (values, unit) in enumerate(((1000 * moved_m, "mm"), (turned_deg, "deg"))):
        most = max(float(np.abs(values[:shown]).max()), 1e-9)
        middle = third * row + third // 2
        cv2.line(made, (0, middle), (SIZE_PX, middle), GRID, 1)
        for axis, colour in enumerate(AXES):
            _line(made, along, middle - 0.42 * third * values[:shown, axis] / most, colour)
        _text(made, f"{unit}, to {most:.3g}, {shown_s:g} s", third * row + 14)
    top, low = 2 * third, SIZE_PX - 4
    for half_at, values in ((0, moved_m), (half, turned_deg)):
        hz, density = power(values, rate_hz)
        kept = (hz >= LEAST_HZ) & (hz <= MOST_HZ)
        at = half_at + 4 + (half - 8) * np.log(hz[kept] / LEAST_HZ) / np.log(MOST_HZ / LEAST_HZ)
        for decade in (1, 10, 100):
            x = int(half_at + 4 + (half - 8) * np.log(decade / LEAST_HZ) / np.log(MOST_HZ / LEAST_HZ))
            cv2.line(made, (x, top + 18), (x, low), GRID, 1)
            _text(made, f"{decade}", low - 2, x + 3)
        level = np.log10(np.maximum(density[kept], density[kept].max() * 1e-6 + 1e-30))
        level = (level - level.min()) / max(float(np.ptp(level)), 1e-9)
        for axis, colour in enumerate(AXES):
            _line(made, at, low - (low - top - 20) * level[:, axis], colour)
        _text(made, "moves, Hz" if half_at == 0 else "turns, Hz", top + 14, half_at + 4)
    return made


def _line(made: NDArray[np.uint8], x: NDArray[np.float64], y: NDArray[np.float64], colour: tuple[int, ...]) -> None:
    import cv2

    points = np.column_stack([x, y]).round().astype(np.int32)
    cv2.polylines(made, [points], isClosed=False, color=colour, thickness=1)


def _text(made: NDArray[np.uint8], text: str, bottom: int, left: int = 4) -> None:
    import cv2

    cv2.putText(made, text, (left, bottom), cv2.FONT_HERSHEY_SIMPLEX, 0.42, INK, 1)


def _icon(panel: Any, step: Any) -> int:
    """Return the icon of a step's picture, which is made again only where its values have changed."""
    key = repr((step.perturbation, values_of(step), identifiers_of(panel)))
    if "pictures" not in _loaded:
        _loaded["pictures"] = bpy.utils.previews.new()
    pictures = _loaded["pictures"]
    if key not in pictures:
        made = picture(*signals(panel, step), *window_of(step.perturbation)[1:])
        if len(pictures) >= KEPT:
            pictures.clear()
        entry: Any = pictures.new(key)  # the stubs take no tuples and arrays
        entry.image_size = (SIZE_PX, SIZE_PX)
        opaque = np.ones((SIZE_PX, SIZE_PX, 4), np.float32)
        opaque[..., :3] = made[::-1] / np.float32(255)
        entry.image_pixels_float.foreach_set(opaque.ravel())
    return pictures[key].icon_id


def register_motion_plot() -> None:
    """Pictures are made when they are shown."""


def unregister_motion_plot() -> None:
    """Let the pictures go."""
    if "pictures" in _loaded:
        bpy.utils.previews.remove(_loaded.pop("pictures"))


TAB, DATASET_TAB = "Noisy World", "Noisy Dataset"
"""The tab of what one looks at, and that of what becomes a dataset."""

WALK = ("frames", "rate_hz", "speed_m_s", "clearance_m")
OUTPUT_DRAWN = (
    *("layout", "image", "colour", "depth_range", "depth_scale_per_m", "depth_beyond", "modalities", "overview"),
)
"""The keys of paths made here and of the output that are drawn whether the preset gives them or not."""
STAGE_LABELS: "dict[Stage, tuple[str, IconItems]]" = {
    "motion": ("Motion", "CON_FOLLOWPATH"),
    "exposure": ("Exposure", "MOD_TIME"),
    "environment": ("Environment", "WORLD"),
    "lens": ("Lens", "CAMERA_DATA"),
    "sensor": ("Sensor", "TEXTURE"),
    "post": ("Post-Processing", "IMAGE_DATA"),
    "depth": ("Depth", "IMAGE_ZDEPTH"),
    "pairing": ("Synchronization", "TIME"),
}


if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import IconItems

    _Mixin = bpy.types.Panel  # what Section is mixed into
else:
    _Mixin = object


class PanelSection(_Mixin):
    """A section of the tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = TAB
    presets = ""  # what of a preset the list in its header takes

    def draw_header_preset(self, _: bpy.types.Context) -> None:
        """Draw what opens that list."""
        if self.presets:
            section_presets.draw_in_header(layout_of(self), self.presets)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Every scene has the tab."""
        return context.scene is not None

    def fields(self, context: bpy.types.Context) -> bpy.types.UILayout:
        """Return a layout of labelled values; linked scenes are shown and cannot be changed."""
        layout = layout_of(self)
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.enabled = loading.is_editable(context.scene)
        return layout


class DatasetSection(PanelSection):
    """A section of the tab of what becomes a dataset."""

    bl_category = DATASET_TAB


class NOISYWORLD_PT_scene(PanelSection, bpy.types.Panel):
    """The mesh"""

    bl_label = SCENE
    bl_options = {"DEFAULT_CLOSED"}
    presets = "SCENE"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        layout.prop(panel, "mesh_source")
        source = shown(panel)
        source.draw(layout, panel)
        layout.prop(panel.scene, "name")
        draw_lines(layout, panel, "other_scenes")
        if not source.loads:
            return
        layout.operator("noisy_world.load_scene", icon="MESH_DATA")
        if message := loading.summary(context.scene):
            layout.label(text=", ".join(message), icon="CHECKMARK")
            if operators.hides_colors(context):
                layout.operator("noisy_world.show_colors", icon="SHADING_TEXTURE")


class NOISYWORLD_PT_trajectory(PanelSection, bpy.types.Panel):
    """The path"""

    bl_label = TRAJECTORY
    bl_options = {"DEFAULT_CLOSED"}
    presets = "PATH"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        if source_views.shows_footage(panel):
            shown(panel).draw_path(layout, panel)
            return
        layout.prop(panel, "trajectory_source", text="Path")
        path = panel.scene.trajectory
        column = layout.column(align=True)
        if panel.trajectory_source == "FILE":
            layout.prop(path, "file")
            for name in OF_FILES[1:]:
                column.prop(path, name)
        elif panel.trajectory_source == "HANDHELD":
            for name in WALK:
                column.prop(path.handheld, name)
            draw_given(column, path.handheld, HandheldSpec, leave=WALK)
        if panel.trajectory_source != "CAMERA":
            draw_body(column, path)
            draw_given(column, path, TrajectorySpec, leave=(*OF_FILES, "handheld", "body", "every"))
        column.prop(path, "every")
        layout.operator("noisy_world.load_trajectory", icon="CON_FOLLOWPATH")
        if message := loading.path_summary(context.scene):
            layout.label(text=message, icon="CHECKMARK")
        elif loading.poses(context.scene):
            write(layout, context, "Another path was loaded: Load Trajectory takes this one", "INFO")


class NOISYWORLD_PT_deviation(PanelSection, bpy.types.Panel):
    """How far from the path the camera is, and how fast along it"""

    bl_label = DEVIATION
    bl_parent_id = "NOISYWORLD_PT_trajectory"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        if not source_views.shows_footage(panel) or own_step(panel, "motion_deviation") is not None:
            column = layout.column(align=True)
            column.prop(panel, "deviation_rotation")
            column.prop(panel, "deviation_translation_m")
        layout.prop(panel, "speed_factor")
        paths.draw(layout, context)


class NOISYWORLD_PT_camera(PanelSection, bpy.types.Panel):
    """The intrinsics"""

    bl_label = CAMERA
    presets = "CAMERA"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        source = shown(panel)
        if source.own_distortion:
            draw_distortion(layout, source.group(panel), rendered=False)
        if source.own_lens:
            layout.prop(panel, "use_camera", text="Give Intrinsics")
            if not panel.use_camera:
                return
        section_presets.draw_choice(layout)
        for names in (("width", "height"), ("fx", "fy"), ("cx", "cy"), ("near_m", "far_m")):
            column = layout.column(align=True)
            for name in names:
                column.prop(panel.camera, name)
        if source.distorts and not source.own_distortion:
            draw_distortion(layout, panel.camera, rendered=source.loads)
        if source.loads and own_object(context.scene, "camera") is None:
            layout.operator("noisy_world.set_camera", icon="CAMERA_DATA")


# --- perturbations ---


class NOISYWORLD_UL_steps(bpy.types.UIList):
    """The perturbations in the order of propagation: motion, color, depth, pairing"""

    def draw_item(
        self,
        _context: bpy.types.Context,
        layout: bpy.types.UILayout,
        _data: Any,
        item: Any,
        _icon: int,
        _active_data: Any,
        _active_name: str,
        _index: int = 0,
    ) -> None:
        """Draw an entry."""
        perturbation = registry().get(item.perturbation)
        if perturbation is None:
            layout.label(text=item.perturbation, icon="ERROR")
            return
        row = layout.row(align=True)
        row.active = item.enabled
        said = f"{short_label(perturbation)} (overlay)" if is_overlay(perturbation) else short_label(perturbation)
        row.label(text=said, icon=STAGE_LABELS[perturbation.stage][1])
        if perturbation.severities and item.use_severity:
            part = row.row(align=True)
            part.alignment = "RIGHT"
            part.label(text=f"{item.severity:.2g}")
        layout.prop(item, "enabled", text="")


class NOISYWORLD_MT_add_step(bpy.types.Menu):
    """All perturbations, in two lists: physical, and the benchmark's"""

    bl_label = "Add Perturbation"

    def draw(self, _: bpy.types.Context) -> None:
        """Draw a menu for each list that has some, and what is in it."""
        layout = layout_of(self)
        for chosen in OFFERED:
            if offered(chosen):
                layout.menu(f"NOISYWORLD_MT_add_{chosen.name}", text=chosen.label)


def _offered_menu(chosen: Offered) -> type:
    """Make the menu of a list."""

    def draw(self: bpy.types.Menu, _: bpy.types.Context) -> None:
        layout = layout_of(self)
        layout.label(text=chosen.said)
        stage = ""
        for perturbation in offered(chosen):
            if perturbation.stage != stage:
                stage = perturbation.stage
                label, icon = STAGE_LABELS[perturbation.stage]
                layout.separator()
                layout.label(text=label, icon=icon)
            label = short_label(perturbation)
            layout.operator("noisy_world.add_step", text=label).perturbation = perturbation.name

    members = {"bl_label": chosen.label, "draw": draw, "__module__": __name__, "__doc__": chosen.said}
    return type(f"NOISYWORLD_MT_add_{chosen.name}", (bpy.types.Menu,), members)


class NOISYWORLD_PT_perturbations(PanelSection, bpy.types.Panel):
    """What is done to the sequence"""

    bl_label = PERTURBATIONS
    presets = "PERTURBATIONS"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the list and what is selected."""
        layout, panel = self.fields(context), panel_of(context.scene)
        row = layout.row()
        row.template_list("NOISYWORLD_UL_steps", "", panel, "steps", panel, "active_step", rows=4, maxrows=8)
        buttons = row.column(align=True)
        buttons.menu("NOISYWORLD_MT_add_step", text="", icon="ADD")
        if len(panel.steps):
            buttons.operator("noisy_world.remove_step", text="", icon="REMOVE")
        if may_move(panel, -1) or may_move(panel, 1):
            buttons.separator()
            buttons.operator("noisy_world.move_step_up", text="", icon="TRIA_UP")
            buttons.operator("noisy_world.move_step_down", text="", icon="TRIA_DOWN")
        gallery.draw_buttons(layout)
        if (step := active_step(panel)) is not None and step.perturbation in registry():
            write(layout, context, line_on(perturbation_of(step)), "INFO")
            draw_step(layout, step)
            draw_motion(layout, panel, step)
            if text := other_rate(panel, step):
                write(layout, context, text, "ERROR")
                layout.operator("noisy_world.take_rate", icon="TIME")
        if paths := without_effect(context.scene):
            write(layout, context, f"Keys and drivers without effect: {', '.join(paths)}; remove them", "ERROR")


class NOISYWORLD_PT_preview(PanelSection, bpy.types.Panel):
    """The perturbations, live"""

    bl_label = "Preview"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout = self.fields(context)
        layout.use_property_split = False
        loaded = not beginning.draw_missing(layout, context)
        preview.draw(layout, context, loaded=loaded)
        bake_exposure.draw(layout, context)
        operators.draw_camera_link(layout, context)
        operators.draw_library(layout, context)


class NOISYWORLD_PT_generate(DatasetSection, bpy.types.Panel):
    """The dataset of what the other tab shows: where it goes, and what makes it"""

    bl_label = GENERATE

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        column = layout.column(align=True)
        column.prop(panel.setting, "name")
        column.prop(panel, "seed")
        column.prop(panel, "output_folder")
        layout.prop(panel, "use_clean")
        generating.draw(layout, context)


class NOISYWORLD_PT_output(DatasetSection, bpy.types.Panel):
    """How frames are rendered and written"""

    bl_label = OUTPUT
    bl_options = {"DEFAULT_CLOSED"}
    presets = "OUTPUT"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        source, render, output = shown(panel), panel.render, panel.output
        column = layout.column(align=True)
        column.prop(output, "layout")
        if len(LAYOUTS[output.layout].images) > 1:
            column.prop(output, "image")
        column.prop(output, "colour")
        column = layout.column(align=True)
        column.prop(output, "modalities")
        draw_given(column, output, OutputSpec, leave=OUTPUT_DRAWN)
        if "depth" in output.modalities:
            column = layout.column(align=True)
            column.prop(output, "depth_range")
            if output.depth_range == "layout" or output.use_depth_scale_per_m:
                column.prop(output, "depth_scale_per_m")
            column.prop(output, "depth_beyond")
        column = layout.column(align=True)
        if source.own_render:
            draw_keys(column, render, RenderSpec, only=("engine", "samples"), ticked=True)
        elif not source_views.shows_footage(panel):
            draw_keys(column, render, RenderSpec, only=("engine", "samples"))
        column.prop(render, "backend")
        draw_given(column, render, RenderSpec, leave=("engine", "samples", "backend"))
        layout.prop(output, "overview")
        draw_given(layout, panel, PresetSpec, leave=("seed", "camera", "rig", "render", "output", *APART))
        draw_given(layout, panel.setting, SettingSpec, leave=("name", "perturb", "sweep", "include"))
        draw_lines(layout, panel, "other_settings")


class NOISYWORLD_PT_rig(DatasetSection, bpy.types.Panel):
    """The sensors that the camera's carrier has beside it"""

    bl_label = RIG
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Not for footage, whose sensors are those that took it."""
        return super().poll(context) and shown(panel_of(context.scene)).carries

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        section_presets.draw_device_file(layout, {"DEPTH"})
        draw_given(layout, panel.rig, RigSpec, leave=("imu",))
        draw_imu(layout, panel.rig)


class NOISYWORLD_PT_evaluation(DatasetSection, bpy.types.Panel):
    """What the perturbations do to SLAM"""

    bl_label = "Evaluation"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only where there is a dataset to evaluate."""
        return super().poll(context) and generating.is_made(panel_of(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout = self.fields(context)
        layout.use_property_split = False
        generating.draw_tracking(layout, context)


OFFERED = (PHYSICAL, BENCHMARK, PACKAGES)
OFFERED_MENUS = tuple(map(_offered_menu, OFFERED))
LISTS: tuple[Any, ...] = (NOISYWORLD_UL_steps, NOISYWORLD_MT_add_step, *OFFERED_MENUS)
LOOKED_AT: tuple[Any, ...] = (
    NOISYWORLD_PT_perturbations,
    NOISYWORLD_PT_preview,
    NOISYWORLD_PT_scene,
    NOISYWORLD_PT_trajectory,
    NOISYWORLD_PT_deviation,
    NOISYWORLD_PT_camera,
)
DATASET: tuple[Any, ...] = (NOISYWORLD_PT_generate, NOISYWORLD_PT_output, NOISYWORLD_PT_rig)
"""The sections of each tab in their order, but for what comes from modules above this one."""

CLASSES = (*LISTS, *LOOKED_AT, *DATASET, NOISYWORLD_PT_evaluation)
register, unregister = bpy.utils.register_classes_factory((*LISTS, *LOOKED_AT, *DATASET))
register_evaluation, unregister_evaluation = bpy.utils.register_classes_factory((NOISYWORLD_PT_evaluation,))
