# SPDX-License-Identifier: GPL-3.0-or-later
"""Python environments that systems which need other packages are run in: where they lie."""

import os
import sys
from pathlib import Path

from ...core.shipped import checkout

FOLDER_VARIABLE = "NOISY_WORLD_ENVIRONMENTS"


def environments_folder() -> Path:
    """Return the folder that environments are made in: $NOISY_WORLD_ENVIRONMENTS, the checkout, or the user's data."""
    if beside := os.environ.get(FOLDER_VARIABLE):
        return Path(beside).expanduser().resolve()
    return checkout() or _data_folder()


def environment_folder(name: str) -> Path:
    """Return where an environment lies: slam is .venv-slam in the folder of environments.

    Without $NOISY_WORLD_ENVIRONMENTS, one in the working folder is taken too: an installed package may be used in a
    checkout.
    """
    named = f".venv-{name}"
    folder = environments_folder() / named
    if not os.environ.get(FOLDER_VARIABLE) and not folder.exists() and Path(named).exists():
        return Path(named).resolve()
    return folder


def environment_python(name: str) -> Path:
    """Return the Python of an environment, whether it is there or not."""
    inside = ("Scripts", "python.exe") if sys.platform == "win32" else ("bin", "python")
    return environment_folder(name).joinpath(*inside)


def _data_folder() -> Path:
    """Return the folder of this user's data, as the system has it."""
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "noisy-world"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "noisy-world"
    given = os.environ.get("XDG_DATA_HOME", "")
    # The XDG specification has relative paths ignored.
    root = Path(given) if Path(given).is_absolute() else Path.home() / ".local" / "share"
    return root / "noisy-world"
