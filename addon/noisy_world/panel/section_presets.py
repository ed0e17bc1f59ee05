# SPDX-License-Identifier: GPL-3.0-or-later
"""What a section takes from elsewhere: its part of a preset, a camera's file, a real camera."""

from collections.abc import Collection
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
import bpy.utils.previews
from bpy.utils.previews import ImagePreviewCollection
from bpy_extras.io_utils import ImportHelper

from ..core.errors import InputError, american
from ..core.file_access import utf8_name
from ..core.schema import ConfigPath, parse
from ..layouts.cam_params import read_camera_file
from ..nodes.datablocks import layout_of
from ..perturbations import registry
from ..perturbations.kinds import ExposurePerturbation
from ..perturbations.parsing import DEVICE, parse_steps
from ..preset.camera_devices import CAMERA_DEVICES, with_device
from ..preset.keys import CameraSpec
from .document import INTRINSICS, PANEL, DevicePart, Part, can_apply, take_device
from .entries import in_order, put_entry
from .fields import EMBREE, notify_once, tell
from .gallery import listed, own_folder, preset_label, shipped_folder
from .operators import UNDOABLE, OnScene, guarded
from .properties import panel_of
from .source_views import shown
from .tree import set_value, take, taking

LABELS: dict[str, str] = {
    "SCENE": "Scene", "PATH": "Trajectory", "CAMERA": "Camera", "PERTURBATIONS": "Perturbation",
    "OUTPUT": "Render and Output",
}  # fmt: skip


class NoisyWorldCameraFromFile(OnScene, bpy.types.Operator, ImportHelper):
    """Fill in the camera from a JSON file: cam_params.json, intrinsics.json of Open3D, or transforms.json"""

    bl_idname = "noisy_world.camera_from_file"
    bl_label = "Camera from File"
    bl_options = UNDOABLE
    if TYPE_CHECKING:
        filepath: str  # ImportHelper's

    filename_ext = ".json"
    filter_glob: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        default="*.json", options={"HIDDEN"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Fill it in."""
        return guarded(self, lambda: take_camera(panel_of(context.scene), Path(self.filepath)))


def take_camera(panel: Any, path: Path) -> str:
    """Fill the panel's camera in from a file, and say what it is. Raises InputError; the panel is then unchanged."""
    camera = read_camera_file(path)
    with notify_once():
        for name in INTRINSICS:
            set_value(panel.camera, name, getattr(camera, f"{name}_px"))
    return f"{camera.width_px} x {camera.height_px}, fx {camera.fx_px:g}, fy {camera.fy_px:g}, from {path.name}"


def takeable(part: str) -> list[Path]:
    """Return the presets that a section can take its part from: the user's own first."""
    if part == "PERTURBATIONS":
        return [*listed(own_folder()), *listed(shipped_folder() / "perturbations")]
    found = [*listed(own_folder()), *listed(shipped_folder())]
    return [path for path in found if _can_take(path, path.stat().st_mtime_ns, part)]


@lru_cache(maxsize=256)
def _can_take(path: Path, _changed_ns: int, part: Part) -> bool:
    return can_apply(path, part)


def _popover(part: str) -> type:
    """Make the list that a section's header opens."""

    def draw(self: bpy.types.Panel, _: bpy.types.Context) -> None:
        layout = layout_of(self)
        layout.label(text=self.bl_label)
        layout.operator_context = "EXEC_DEFAULT"
        column = layout.column(align=True)
        column.emboss = "PULLDOWN_MENU"
        for path in takeable(part):
            entry = column.operator("noisy_world.use_preset", text=preset_label(path))
            entry.filepath, entry.part = str(path), part
        layout.operator_context = "INVOKE_DEFAULT"
        if part == "CAMERA":
            layout.operator(NoisyWorldCameraFromFile.bl_idname, text="From File", icon="FILE_FOLDER")
        layout.operator("noisy_world.add_preset", text="Add Preset", icon="ADD")

    members = {
        "bl_label": f"{LABELS[part]} Presets", "bl_space_type": "VIEW_3D", "bl_region_type": "HEADER", "draw": draw,
        "__module__": __name__, "__doc__": "Take this section alone from a preset; all else stays as it is",
    }  # fmt: skip
    return type(popover_name(part), (bpy.types.Panel,), members)


def popover_name(part: str) -> str:
    """Return the name of a section's list."""
    return f"NOISYWORLD_PT_presets_{part.lower()}"


def draw_in_header(layout: bpy.types.UILayout, part: str) -> None:
    """Draw the button that opens a section's list, as Blender's own panels have it."""
    row = layout.row()
    row.emboss = "NONE"
    row.popover(panel=popover_name(part), text="", icon="PRESET")


CLASSES: tuple[Any, ...] = (NoisyWorldCameraFromFile, *map(_popover, LABELS))
register, unregister = bpy.utils.register_classes_factory(CLASSES)


# Real cameras to choose from, each with a picture of what it sees of one room: its lens, or its electronics too.


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
    if source.own_lens and not panel.use_camera:
        raise InputError(PANEL, "this scene's own camera is used", where="camera", remedy="choose to give one here")
    steps = parse_steps([{DEVICE: name}], place, registry()) if electronics else ()
    rolls = panel.render.engine == EMBREE
    left = [step for step in steps if isinstance(step.perturbation, ExposurePerturbation) and not rolls]
    with notify_once():
        given = with_device({"camera": {"device": name}}, ConfigPath(PANEL))["camera"]
        with taking():
            take(panel.camera, camera, given, leave=("near_m", "far_m"))
            panel.use_camera = True
        for step, (kind, values) in zip(steps, in_order([{DEVICE: name}] if electronics else [], place), strict=True):
            if step not in left:
                put_entry(panel, kind, values, step.occurrence)
        tell("steps")(panel, bpy.context)
    said = f"{CAMERA_DEVICES[name].label}: {camera.width} x {camera.height}, fx {camera.fx:g}, fy {camera.fy:g}"
    return f"{said}; rows are read one by one with Embree alone, so that was left out" if left else said


class NoisyWorldUseDeviceFile(OnScene, bpy.types.Operator, ImportHelper):
    """Take a measured device from the file that noisy-world measure --device writes: camera and lens, depth sensor, noise of color"""  # noqa: E501 - a tooltip

    bl_idname = "noisy_world.use_device_file"
    bl_label = "Measured Device"
    bl_options = UNDOABLE
    if TYPE_CHECKING:
        filepath: str  # ImportHelper's

    filename_ext = ".yaml"
    filter_glob: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        default="*.yaml;*.yml", options={"HIDDEN"}
    )
    parts: bpy.props.EnumProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Take",
        description="What of the device the panel takes",
        items=[
            ("CAMERA", "Camera", "Its size, intrinsics and distortion"),
            ("DEPTH", "Depth Sensor", "How it measures depth, which is then every setting's"),
            ("NOISE", "Noise", "Its noise of color, as perturbations in the list"),
        ],
        default={"CAMERA", "DEPTH", "NOISE"},
        options={"ENUM_FLAG", "SKIP_SAVE"},
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Take it."""
        return guarded(self, lambda: use_device_file(panel_of(context.scene), Path(self.filepath), self.parts))


DEVICE_PARTS: dict[DevicePart, str] = {"CAMERA": "camera", "DEPTH": "depth sensor", "NOISE": "noise of color"}


def use_device_file(panel: Any, path: Path, parts: Collection[DevicePart]) -> str:
    """Take a measured device's file into the panel, as far as what it shows has use for it; say what was taken."""
    source = shown(panel)
    kept = source.own_lens and not panel.use_camera
    unused: set[DevicePart] = {"CAMERA"} if kept else set()
    unused |= set() if source.carries else {"DEPTH"}
    taken = take_device(panel, path, set(parts) - unused)
    return f"{path.name}: took its {', '.join(DEVICE_PARTS[part] for part in taken)}"


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
    return _loaded[0][name].icon_id if _loaded and name in _loaded[0] else 0


def draw_choice(layout: bpy.types.UILayout) -> None:
    """Draw what opens the pictures, and what takes a file: of a camera, or of a measured device."""
    layout.popover(panel=NOISYWORLD_PT_cameras.__name__, text="Real Cameras", icon="OUTLINER_DATA_CAMERA")
    column = layout.column(align=True)
    column.operator(NoisyWorldCameraFromFile.bl_idname, text="From File", icon="FILE_FOLDER")
    draw_device_file(column, {"CAMERA", "DEPTH", "NOISE"})


def draw_device_file(layout: bpy.types.UILayout, parts: set[str]) -> None:
    """Draw the button that takes a measured device's file. parts: what of it, unless the user says otherwise."""
    layout.operator(NoisyWorldUseDeviceFile.bl_idname, icon="FILE_FOLDER").parts = parts


CAMERA_CLASSES: tuple[Any, ...] = (NoisyWorldUseCamera, NoisyWorldUseDeviceFile, NOISYWORLD_PT_cameras)
_register, _unregister = bpy.utils.register_classes_factory(CAMERA_CLASSES)


def register_real_cameras() -> None:
    """Load the pictures, and register the classes."""
    pictures = bpy.utils.previews.new()
    for name in CAMERA_DEVICES:
        if not (PICTURES / f"{name}.jpg").is_file():  # a package's camera
            continue
        pictures.load(name, utf8_name(PICTURES / f"{name}.jpg"), "IMAGE")
    _loaded.append(pictures)
    _register()


def unregister_real_cameras() -> None:
    """Take it all back."""
    _unregister()
    bpy.utils.previews.remove(_loaded.pop())
