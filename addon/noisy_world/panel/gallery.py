# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets and perturbations in lists and small pictures, and the files of presets."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import bpy.utils.previews

from ..core.errors import InputError, american, title
from ..core.file_access import utf8_name
from ..nodes.datablocks import layout_of
from ..perturbations import registry
from ..perturbations.kinds import Perturbation

# How the perturbations are offered: in two lists, the benchmark's and the physical ones, and in a sentence each.


@dataclass(frozen=True)
class Offered:
    """A list of perturbations. name: of its menu. said: what is in it, in a line."""

    name: str
    label: str
    said: str


PHYSICAL = Offered("physical", "Physical", "Of the scene's air and light, the lens, the sensors")
BENCHMARK = Offered("benchmark", "Benchmark", "The paper's and ImageNet-C's: laid over images, depth and path")
PACKAGES = Offered("packages", "Packages", "Of packages that are installed")


def list_of(perturbation: Perturbation) -> Offered:
    """Return the list that a perturbation is offered in."""
    if perturbation.distribution:
        return PACKAGES
    about = perturbation.about
    return BENCHMARK if about.of_paper or about.of_imagenet_c else PHYSICAL


def offered(chosen: Offered) -> list[Perturbation]:
    """Return what a list offers, in the order of propagation."""
    return [item for item in registry().values() if list_of(item) == chosen]


def line_on(perturbation: Perturbation) -> str:
    """Return which list a perturbation is of, what it does, and its physical twin, where it has one."""
    line = f"{list_of(perturbation).label}: {american(perturbation.sentence)}"
    twin = registry().get(perturbation.about.twin)
    return line if twin is None else f"{line}. Its physical twin is {title(twin.label)}"


def short_label(perturbation: Perturbation) -> str:
    """Return a perturbation's name for a list that shows its stage beside it."""
    label = perturbation.label.removeprefix("Depth: ").removeprefix("RGB-D ")
    return title(label[0].upper() + label[1:])


# The files of presets: those shipped, and the user's own in Blender's folder of presets.


OWN_PRESETS = "presets/noisy_world"


def shipped_folder() -> Path:
    """Return the folder of the presets shipped: in the installed extension, or in a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "presets"
    return inside if inside.is_dir() else package.parents[1] / "presets"


def own_folder() -> Path:
    """Return the folder of the user's own presets, which may not exist yet."""
    return Path(bpy.utils.user_resource("SCRIPTS", path=OWN_PRESETS))


def own_path(name: str) -> Path:
    """Return the file of the user's own preset of this name. Raises InputError for a name that no file can have."""
    name = name.strip()
    if not re.fullmatch(r"[^\W.][\w .()-]*", name):
        raise InputError("Name", f"{name!r} cannot name a file", remedy="use letters, digits, spaces and dashes")
    return own_folder() / f"{name}.yaml"


def is_own(path: str) -> bool:
    """Tell whether a file is one of the user's own presets."""
    return bool(path) and Path(path).parent == own_folder()


def listed(folder: Path) -> list[Path]:
    """Return the presets of a folder, sorted by name; [] where there is no folder."""
    return sorted((path for path in folder.glob("*.yaml")), key=lambda path: path.stem.lower())


def preset_label(path: Path) -> str:
    """Return a preset's name for a menu; shipped ones are named after their perturbations."""
    return title(path.stem) if path.is_relative_to(shipped_folder()) else path.stem


THUMBNAILS = Path(__file__).resolve().parent / "thumbnails"
"""NAME.jpg for shipped presets, perturbations/NAME.jpg for perturbations; drawn by headless/pictures/thumbnails.py."""

OWN_SUFFIXES = (".jpg", ".png")
COLUMNS, SCALE = 6, 4.0  # of a list; chosen: all of a list in a window of 900 pixels, at a picture's own size
WIDE = 46  # in units of the interface; chosen: no label is cut
_loaded: dict[str, Any] = {}  # the pictures that were shown, by file


def picture_of_preset(path: Path) -> int:
    """Return the icon of a preset's picture, 0 where it has none. One's own stands beside the file, by its name."""
    if path.is_relative_to(shipped_folder()):
        return _icon(THUMBNAILS / path.relative_to(shipped_folder()).with_suffix(".jpg"))
    beside = (path.with_suffix(suffix) for suffix in OWN_SUFFIXES)
    return next((icon for file in beside if (icon := _icon(file))), 0)


def picture_of(perturbation: Perturbation) -> int:
    """Return the icon of a perturbation's picture, 0 where it has none."""
    return _icon(THUMBNAILS / "perturbations" / f"{perturbation.name}.jpg")


def _icon(file: Path) -> int:
    if not file.is_file():
        return 0
    if "pictures" not in _loaded:
        _loaded["pictures"] = bpy.utils.previews.new()
    pictures = _loaded["pictures"]
    key = f"{file}:{file.stat().st_mtime_ns}"
    picture = pictures[key] if key in pictures else pictures.load(key, utf8_name(file), "IMAGE")
    return picture.icon_id


def _grid(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    return layout.grid_flow(row_major=True, columns=COLUMNS, even_columns=True, even_rows=False)


def _shown(grid: bpy.types.UILayout, icon: int) -> bpy.types.UILayout:
    """Return a place in a grid, with a picture or as much space."""
    column = grid.column(align=True)
    if icon:
        column.template_icon(icon_value=icon, scale=SCALE)
    else:
        column.separator(factor=SCALE * 3.3)  # chosen: as high as a picture
    return column


def _draw_list(chosen: Offered, layout: bpy.types.UILayout) -> None:
    """Draw a list of perturbations, each with a button that adds it."""
    layout.label(text=chosen.said)
    grid = _grid(layout)
    for perturbation in offered(chosen):
        place = _shown(grid, picture_of(perturbation))
        label = short_label(perturbation).removeprefix("Depth Sensor: ")
        place.operator("noisy_world.add_step", text=label).perturbation = perturbation.name


def _draw_presets(layout: bpy.types.UILayout) -> None:
    """Draw the presets that replace everything, each with a button that opens it; one's own first."""
    layout.label(text="Replace Everything", icon="FILE_REFRESH")
    layout.operator_context = "EXEC_DEFAULT"
    grid = _grid(layout)
    for path in [*listed(own_folder()), *listed(shipped_folder())]:
        place = _shown(grid, picture_of_preset(path))
        entry = place.operator("noisy_world.use_preset", text=preset_label(path))
        entry.filepath, entry.part = str(path), "ALL"


def _popover(name: str, label: str, said: str, content: Callable[[bpy.types.UILayout], None]) -> type:
    def draw(self: bpy.types.Panel, _: bpy.types.Context) -> None:
        content(layout_of(self))

    members = {
        "bl_label": label, "bl_space_type": "VIEW_3D", "bl_region_type": "HEADER", "bl_ui_units_x": WIDE, "draw": draw,
        "__module__": __name__, "__doc__": said,
    }  # fmt: skip
    return type(name, (bpy.types.Panel,), members)


POPOVERS = {chosen.name: f"NOISYWORLD_PT_pictures_{chosen.name}" for chosen in (PHYSICAL, BENCHMARK)}
PRESETS = "NOISYWORLD_PT_pictures_presets"


def draw_buttons(layout: bpy.types.UILayout) -> None:
    """Draw what opens the two lists of perturbations."""
    row = layout.row(align=True)
    for chosen in (PHYSICAL, BENCHMARK):
        row.popover(panel=POPOVERS[chosen.name], text=chosen.label, icon="IMGDISPLAY")


LISTS = tuple(
    _popover(
        POPOVERS[chosen.name], chosen.label, f"{chosen.said}: pictures to choose from", partial(_draw_list, chosen)
    )
    for chosen in (PHYSICAL, BENCHMARK)
)
CLASSES: tuple[Any, ...] = (
    *LISTS,
    _popover(PRESETS, "Presets", "Presets that replace everything: pictures to choose from", _draw_presets),
)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    """Register the lists; pictures are read when they are shown."""
    _register_classes()


def unregister() -> None:
    """Unregister the lists, and let the pictures go."""
    _unregister_classes()
    if "pictures" in _loaded:
        bpy.utils.previews.remove(_loaded.pop("pictures"))
