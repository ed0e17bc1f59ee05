# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets in the headers of the panel's sections: each takes from a preset what its section shows, and no more."""

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
from bpy_extras.io_utils import ImportHelper

from ..blender.typed import layout_of
from ..core.datasets.camera_file import read_camera_file
from .apply_preset import Part, can_apply
from .described import notify_once
from .document import INTRINSICS
from .operators import UNDOABLE, OnScene, guarded
from .preset_files import listed, own_folder, preset_label, shipped_folder
from .properties import panel_of
from .typed_numbers import set_value

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
            set_value(panel, name, getattr(camera, name))
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
