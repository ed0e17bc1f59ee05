# SPDX-License-Identifier: GPL-3.0-or-later
"""The presets that come with Noisy World."""

from pathlib import Path


def shipped_presets() -> dict[str, Path]:
    """Return the shipped presets by their names in `--list presets`, such as presets/demo.yaml."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package, package.parents[1]):  # installed, or in a checkout
        presets = folder / "presets"
        if presets.is_dir():
            return {path.relative_to(folder).as_posix(): path for path in sorted(presets.rglob("*.yaml"))}
    raise RuntimeError(f"no presets at {package} or above")
