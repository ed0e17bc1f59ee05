# SPDX-License-Identifier: GPL-3.0-or-later
"""Real cameras to choose from, each with a picture of what it sees of one room: its lens, or its electronics too."""

from pathlib import Path
from typing import Any

import bpy
import bpy.utils.previews
from bpy.utils.previews import ImagePreviewCollection

from ..blender.typed import layout_of
from ..core.camera_devices import CAMERA_DEVICES
from ..core.errors import InputError
from ..core.labels import american
from ..core.perturbing.device_steps import DEVICE
from ..core.perturbing.kinds import ExposurePerturbation
from ..core.perturbing.reading import parse_steps
from ..core.presets.device_camera import with_device
from ..core.presets.preset import CameraSpec
from ..core.schema import ConfigPath, parse
from ..core.utf8_names import utf8_name
from ..perturbations import registry
from .described import EMBREE, notify_once, tell
from .document import CAMERA, INTRINSICS, PANEL
from .lens_fields import take_distortion
from .operators import UNDOABLE, OnScene, guarded
from .properties import panel_of
from .shown_sources import shown
from .step_list import put_step
from .typed_numbers import set_value

PICTURES = Path(__file__).parent / "cameras"  # drawn by headless/pictures/docs_pictures.py cameras
SCALE = 5.0  # of a picture, in the interface's units
_loaded: list[ImagePreviewCollection] = []  # while registered


class NoisyWorldUseCamera(OnScene, bpy.types.Operator):
    """Fill in this camera's size, intrinsics and distortion, and add its shutter, shading and noise to the list"""

    bl_idname = "noisy_world.use_camera"
    bl_label = "Use Camera"
    bl_options = UNDOABLE

    device: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Camera", options={"SKIP_SAVE"}
    )
    electronics: bpy.props.BoolProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Electronics",
        description="Add its shutter, shading and noise to the list of perturbations, too",
        default=True,
    )

    @classmethod
    def description(cls, _: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Say what the camera is."""
        device = CAMERA_DEVICES.get(properties.device)
        if device is None:
            return cls.__doc__ or ""
        lens = "Fill in its size, intrinsics and distortion"
        done = f"{lens}, and add its shutter, shading and noise" if properties.electronics else lens
        return american(f"{device.meaning[:1].upper()}{device.meaning[1:]}. {done}")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Fill it in."""
        return guarded(self, lambda: use_camera(panel_of(context.scene), self.device, electronics=self.electronics))


def use_camera(panel: Any, name: str, *, electronics: bool) -> str:
    """Fill in a camera, and with its electronics add its steps; return what was done.

    What reads rows one by one is left out where the engine does not cast such rays, and said. Raises InputError.
    """
    place = ConfigPath(PANEL, "camera")
    camera = parse(CameraSpec, with_device({"camera": {"device": name}}, ConfigPath(PANEL))["camera"], place)
    source = shown(panel)
    if not source.gives_lens(panel):
        raise InputError(PANEL, "this scene's own camera is used", where="camera", remedy="choose to give one here")
    steps = parse_steps([{DEVICE: name}], place, registry()) if electronics else ()
    rolls = panel.engine == EMBREE
    left = [step for step in steps if isinstance(step.perturbation, ExposurePerturbation) and not rolls]
    with notify_once():
        for field in INTRINSICS:
            set_value(panel, field, getattr(camera, CAMERA[field]))
        if source.distorts and not source.own_distortion:
            take_distortion(panel, camera.distortion)
        for step in steps:
            if step not in left:
                put_step(panel, step)
        tell("steps")(panel, bpy.context)
    said = f"{CAMERA_DEVICES[name].label}: {camera.width} x {camera.height}, fx {camera.fx:g}, fy {camera.fy:g}"
    return f"{said}; rows are read one by one with Embree alone, so that was left out" if left else said


class NOISYWORLD_PT_cameras(bpy.types.Panel):
    """Choose a camera that can be bought, by what it sees of one room"""

    bl_label = "Real Cameras"
    bl_space_type = "VIEW_3D"
    bl_region_type = "HEADER"
    bl_ui_units_x = 16

    def draw(self, _: bpy.types.Context) -> None:
        """Draw a picture and two buttons for each."""
        grid = layout_of(self).grid_flow(row_major=True, columns=2, even_columns=True, even_rows=True)
        for name, device in CAMERA_DEVICES.items():
            column = grid.column(align=True)
            column.template_icon(picture_of(name), scale=SCALE)
            row = column.row(align=True)
            whole = row.operator(NoisyWorldUseCamera.bl_idname, text=american(device.label))
            whole.device, whole.electronics = name, True
            lens = row.operator(NoisyWorldUseCamera.bl_idname, text="", icon="CAMERA_DATA")
            lens.device, lens.electronics = name, False


def picture_of(name: str) -> int:
    """Return Blender's number of a camera's picture; 0, which draws none, before registration."""
    return _loaded[0][name].icon_id if _loaded else 0


def draw_choice(layout: bpy.types.UILayout) -> None:
    """Draw what opens the pictures."""
    layout.popover(panel=NOISYWORLD_PT_cameras.__name__, text="Real Cameras", icon="OUTLINER_DATA_CAMERA")


CAMERA_CLASSES: tuple[Any, ...] = (NoisyWorldUseCamera, NOISYWORLD_PT_cameras)
_register, _unregister = bpy.utils.register_classes_factory(CAMERA_CLASSES)


def register_real_cameras() -> None:
    """Load the pictures, and register the classes."""
    pictures = bpy.utils.previews.new()
    for name in CAMERA_DEVICES:
        pictures.load(name, utf8_name(PICTURES / f"{name}.jpg"), "IMAGE")
    _loaded.append(pictures)
    _register()


def unregister_real_cameras() -> None:
    """Take it all back."""
    _unregister()
    bpy.utils.previews.remove(_loaded.pop())
