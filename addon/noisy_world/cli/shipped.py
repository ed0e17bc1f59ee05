# SPDX-License-Identifier: GPL-3.0-or-later
"""The presets that come with Noisy World."""

from pathlib import Path

from .entry import say


def shipped_presets() -> dict[str, Path]:
    """Return the shipped presets by their names in `--list presets`, such as presets/demo.yaml."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package, package.parents[1]):  # installed, or in a checkout
        presets = folder / "presets"
        if presets.is_dir():
            return {path.relative_to(folder).as_posix(): path for path in sorted(presets.rglob("*.yaml"))}
    raise RuntimeError(f"no presets at {package} or above")


def found_preset(path: Path) -> Path:
    """Return the preset's file: the one that is named or, where there is none, the shipped one of that name."""
    if path.exists() or (shipped := shipped_presets().get(path.as_posix())) is None:
        return path
    say(f"{path}: not in this folder; taking the one that comes with Noisy World, {shipped}")
    return shipped
