# SPDX-License-Identifier: GPL-3.0-or-later
"""Python environments beside the project, which systems that need other packages are run in."""

import os
from pathlib import Path

FOLDER_VARIABLE = "NOISY_WORLD_ENVIRONMENTS"
_CHECKOUT = Path(__file__).resolve().parents[4]


def environment_folder(name: str) -> Path:
    """Return where an environment lies: slam is .venv-slam in the checkout, or in $NOISY_WORLD_ENVIRONMENTS.

    An installed package has no checkout, so there it is the working folder that has to hold it.
    """
    beside = os.environ.get(FOLDER_VARIABLE)
    if beside:
        root = Path(beside).expanduser().resolve()
    else:
        root = _CHECKOUT if (_CHECKOUT / "Makefile").is_file() else Path.cwd()
    return root / f".venv-{name}"


def environment_python(name: str) -> Path:
    """Return the Python of an environment, whether it is there or not."""
    return environment_folder(name) / "bin" / "python"
