# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of presets: those shipped, and the user's own in Blender's folder of presets."""

import re
from pathlib import Path

import bpy

from ..core.errors import InputError
from ..core.labels import title

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
