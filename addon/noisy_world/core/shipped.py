# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that come with Noisy World and lie beside its code: in the package, or at the top of a checkout."""

from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
"""The folder of the package noisy_world."""


def shipped(name: str) -> Path:
    """Return a file or folder that is shipped, such as presets."""
    for folder in (PACKAGE, PACKAGE.parents[1]):  # installed, or in a checkout
        if (folder / name).exists():
            return folder / name
    raise RuntimeError(f"no {name} at {PACKAGE} or above")


def checkout() -> Path | None:
    """Return the checkout that this package is run from; None where it was installed."""
    top = PACKAGE.parents[1]
    return top if (top / "pyproject.toml").is_file() and (top / "blender_manifest.toml").is_file() else None
