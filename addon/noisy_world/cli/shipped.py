# SPDX-License-Identifier: GPL-3.0-or-later
"""The presets that come with Noisy World."""

from pathlib import Path
from typing import TYPE_CHECKING

from ..core.near import nearest
from ..core.shipped import shipped
from .entry import say

if TYPE_CHECKING:
    from ..core.errors import InputError

ENDINGS = (".yaml", ".yml")


def shipped_presets() -> dict[str, Path]:
    """Return the shipped presets by their names in `--list presets`, such as presets/demo.yaml."""
    presets = shipped("presets")
    return {path.relative_to(presets.parent).as_posix(): path for path in sorted(presets.rglob("*.yaml"))}


def found_preset(path: Path) -> Path:
    """Return the preset's file: the one that is named or, where there is none, the shipped one of that name."""
    if path.exists() or (found := shipped_presets().get(path.as_posix())) is None:
        return path
    say(f"{path}: not in this folder; taking the one that comes with Noisy World, {found}")
    return found


def no_such_preset(path: Path) -> "InputError":
    """Return the error for a preset that is not there, with the one that is near it: in its folder, or shipped."""
    from ..core.errors import InputError

    beside = sorted(path.parent.iterdir()) if path.parent.is_dir() else []
    known = {Path(name).name: name for name in shipped_presets()}
    known |= {item.name: str(item) for item in beside if item.suffix in ENDINGS}
    near = nearest(path.name, known)
    listed = "'noisy-world list presets' names those that are shipped"
    return InputError(path, "no such preset", remedy=f"did you mean {known[near]!r}?" if near else listed)
