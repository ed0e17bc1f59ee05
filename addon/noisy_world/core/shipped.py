# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that come with Noisy World and lie beside its code: in the package, or at the top of a checkout."""

import re
from pathlib import Path

from .regular_files import read_text

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


def package_version() -> str:
    """Return this package's version from blender_manifest.toml, its only source: in the package or a folder above."""
    for folder in (PACKAGE, *PACKAGE.parents[:2]):
        manifest = folder / "blender_manifest.toml"
        if manifest.is_file():
            found = re.search(r'^version\s*=\s*"([^"]+)"', read_text(manifest), re.MULTILINE)
            if found:
                return found[1]
    raise RuntimeError(f"no blender_manifest.toml with a version at {PACKAGE} or above")
