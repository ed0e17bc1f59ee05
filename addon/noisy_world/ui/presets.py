# SPDX-License-Identifier: GPL-3.0-or-later
"""Where presets lie: those shipped, and one's own where Blender keeps presets."""

import re
from pathlib import Path

import bpy

from ..core.errors import InputError

FOLDER = "presets/noisy_world"


def shipped_folder() -> Path:
    """Return the folder of the presets shipped: in the installed extension, or in a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "presets"
    return inside if inside.is_dir() else package.parents[1] / "presets"


def own_folder() -> Path:
    """Return the folder of one's own presets; it need not be there yet."""
    return Path(bpy.utils.user_resource("SCRIPTS", path=FOLDER))


def own_path(name: str) -> Path:
    """Return the file of one's own preset of a name. Raises InputError for a name that no file can have."""
    name = name.strip()
    if not re.fullmatch(r"[^\W.][\w .()-]*", name):
        raise InputError("Name", f"{name!r} cannot name a file", remedy="use letters, digits, spaces and dashes")
    return own_folder() / f"{name}.yaml"


def is_own(path: str) -> bool:
    """Tell whether a file lies among one's own presets."""
    return bool(path) and Path(path).parent == own_folder()


def listed(folder: Path) -> list[Path]:
    """Return the presets of a folder by name; none where there is no folder."""
    return sorted((path for path in folder.glob("*.yaml")), key=lambda path: path.stem.lower())
