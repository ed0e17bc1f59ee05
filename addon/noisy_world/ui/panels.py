# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's tab: its sections in the order of the work."""

from typing import TYPE_CHECKING, Any

import bpy

from ..blender.typed import layout_of
from ..core.channels import CHANNELS
from ..core.datasets.layouts import LAYOUTS
from ..core.perturbing.kinds import Stage
from ..perturbations import registry
from . import (
    asset_library,
    bake_exposure,
    camera_link,
    footage,
    generate,
    header_presets,
    motion_plot,
    operators,
    paths,
    pictures,
    preview,
    real_cameras,
    tracking,
    view_depth,
    world,
)
from .described import CAMERA, DEVIATION, OUTPUT, PERTURBATIONS, SCENE, TRAJECTORY
from .document import NO_BODY
from .imu_fields import draw_imu
from .keyed import without_effect
from .lens_fields import draw_distortion
from .long_text import write
from .offered import BENCHMARK, PACKAGES, PHYSICAL, Offered, line_on, offered, short_label
from .own_objects import own_object
from .properties import active_step, panel_of, perturbation_of
from .shown_sources import shown
from .step_fields import draw_step
from .step_list import other_rate

TAB = "Noisy World"
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
            header_presets.draw_in_header(layout_of(self), self.presets)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Every scene has the tab."""
        return context.scene is not None

    def fields(self, context: bpy.types.Context) -> bpy.types.UILayout:
        """Return a layout of labelled values; linked scenes are shown and cannot be changed."""
        layout = layout_of(self)
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.enabled = world.is_editable(context.scene)
        return layout


class NOISYWORLD_PT_scene(PanelSection, bpy.types.Panel):
    """The mesh"""

    bl_label = SCENE
    presets = "SCENE"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        layout.prop(panel, "mesh_source")
        source = shown(panel)
        source.draw(layout, panel)
        layout.prop(panel, "scene_name")
        if not source.loads:
            return
        layout.operator("noisy_world.load_scene", icon="MESH_DATA")
        if message := world.summary(context.scene):
            layout.label(text=", ".join(message), icon="CHECKMARK")
            if operators.hides_colors(context):
                layout.operator("noisy_world.show_colors", icon="SHADING_TEXTURE")


class NOISYWORLD_PT_trajectory(PanelSection, bpy.types.Panel):
    """The path"""

    bl_label = TRAJECTORY
    presets = "PATH"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        if footage.is_shown(panel):
            shown(panel).draw_path(layout, panel)
            return
        layout.prop(panel, "trajectory_source", text="Path")
        if panel.trajectory_source == "FILE":
            layout.prop(panel, "trajectory_path")
            names = ("trajectory_format", "trajectory_pose", "trajectory_axes", "trajectory_rate_hz")
            names += ("trajectory_stamp_unit",)
        elif panel.trajectory_source == "CAMERA":
            names = ()
        else:
            names = ("handheld_frames", "handheld_rate_hz", "handheld_speed_m_s", "handheld_clearance_m")
        column = layout.column(align=True)
        if panel.trajectory_source != "CAMERA":
            names += ("body",) if panel.body == NO_BODY else ("body", "body_motion")
        for name in (*names, "every"):
            column.prop(panel, name)
        layout.operator("noisy_world.load_trajectory", icon="CON_FOLLOWPATH")
        if message := world.path_summary(context.scene):
            layout.label(text=message, icon="CHECKMARK")
        elif world.poses(context.scene):
            write(layout, context, "Another path was loaded: Load Trajectory takes this one", "INFO")


class NOISYWORLD_PT_deviation(PanelSection, bpy.types.Panel):
    """How far from the path the camera is, and how fast along it"""

    bl_label = DEVIATION
    bl_parent_id = "NOISYWORLD_PT_trajectory"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        if not footage.is_shown(panel) or panel.deviation_rotation or panel.deviation_translation_m:
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
            draw_distortion(layout, panel, rendered=False)
        if source.lens_field:
            layout.prop(panel, source.lens_field)
            if not source.gives_lens(panel):
                return
        real_cameras.draw_choice(layout)
        layout.operator("noisy_world.camera_from_file", text="From File", icon="FILE_FOLDER")
        for names in (("width_px", "height_px"), ("fx_px", "fy_px"), ("cx_px", "cy_px"), ("near_m", "far_m")):
            column = layout.column(align=True)
            for name in names:
                column.prop(panel, name)
        if source.distorts and not source.own_distortion:
            draw_distortion(layout, panel, rendered=source.loads)
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
        row.label(text=short_label(perturbation), icon=STAGE_LABELS[perturbation.stage][1])
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
        buttons.operator("noisy_world.remove_step", text="", icon="REMOVE")
        buttons.separator()
        buttons.operator("noisy_world.move_step_up", text="", icon="TRIA_UP")
        buttons.operator("noisy_world.move_step_down", text="", icon="TRIA_DOWN")
        pictures.draw_buttons(layout)
        if (step := active_step(panel)) is not None and step.perturbation in registry():
            write(layout, context, line_on(perturbation_of(step)), "INFO")
            view_depth.draw_beside(layout, context, step)
            draw_step(layout, step)
            motion_plot.draw_motion(layout, panel, step)
            if text := other_rate(panel, step):
                write(layout, context, text, "ERROR")
                layout.operator("noisy_world.take_rate", icon="TIME")
        layout.separator(factor=0.5)
        layout.prop(panel, "seed")
        if paths := without_effect(context.scene):
            write(layout, context, f"Keys and drivers without effect: {', '.join(paths)}; remove them", "ERROR")


class NOISYWORLD_PT_preview(PanelSection, bpy.types.Panel):
    """The perturbations, live"""

    bl_label = "Preview"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout = self.fields(context)
        layout.use_property_split = False
        preview.draw(layout, context)
        bake_exposure.draw(layout, context)
        camera_link.draw_camera_link(layout, context)
        asset_library.draw_library(layout, context)


class NOISYWORLD_PT_output(PanelSection, bpy.types.Panel):
    """How frames are rendered and written"""

    bl_label = OUTPUT
    presets = "OUTPUT"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, panel = self.fields(context), panel_of(context.scene)
        column = layout.column(align=True)
        source = shown(panel)
        if source.render_field:
            column.prop(panel, source.render_field)
        for name in ("engine", "samples") if source.gives_render(panel) else ():
            column.prop(panel, name)
        column.prop(panel, "backend")
        column = layout.column(align=True)
        column.prop(panel, "layout")
        row = column.row(align=True)
        row.enabled = len(LAYOUTS[panel.layout].images) > 1
        row.prop(panel, "image")
        column.prop(panel, "colour")
        column = layout.column(align=True)
        column.enabled = panel.use_depth
        column.prop(panel, "depth_scale_per_m")
        column.prop(panel, "depth_beyond")
        if source.carries:
            draw_imu(layout, panel)
        column = layout.column(heading="Write", align=True)
        for name in (*(f"use_{channel}" for channel in CHANNELS), "overview"):
            column.prop(panel, name)
        column.prop(panel, "use_clean")
        layout.prop(panel, "setting_name")
        layout.prop(panel, "output_folder")
        generate.draw(layout, context)


class NOISYWORLD_PT_evaluation(PanelSection, bpy.types.Panel):
    """What the perturbations do to SLAM"""

    bl_label = "Evaluation"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout = self.fields(context)
        layout.use_property_split = False
        tracking.draw_tracking(layout, context)


OFFERED = (PHYSICAL, BENCHMARK, PACKAGES)
OFFERED_MENUS = tuple(map(_offered_menu, OFFERED))
CLASSES: tuple[Any, ...] = (
    NOISYWORLD_UL_steps,
    NOISYWORLD_MT_add_step,
    *OFFERED_MENUS,
    NOISYWORLD_PT_scene,
    NOISYWORLD_PT_trajectory,
    NOISYWORLD_PT_deviation,
    NOISYWORLD_PT_camera,
    NOISYWORLD_PT_perturbations,
    NOISYWORLD_PT_preview,
    NOISYWORLD_PT_output,
    NOISYWORLD_PT_evaluation,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
