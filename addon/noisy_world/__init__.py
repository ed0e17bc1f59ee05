# SPDX-License-Identifier: GPL-3.0-or-later
"""Noisy World: clean 3D scenes in, noisy RGB-D worlds out.

As a Blender extension it adds a tab to the 3D view's sidebar. The library and the command `noisy-world`
(headless/generate.py) use the same scenes, trajectories and presets without the tab.
"""

from pathlib import Path


def register() -> None:
    """Show the tab.

    Raises ImportError where packages are missing, or an installed one brings perturbations that cannot be loaded.
    Blender shows a message that begins with "Add-on not loaded: " without a traceback.
    """
    from .core.errors import NoisyWorldError  # noqa: PLC0415
    from .core.requirements import install_remedy, missing_packages, missing_sentence  # noqa: PLC0415

    if missing := missing_packages():
        remedy = install_remedy(Path(__file__).parent)
        raise ImportError("Add-on not loaded: " + missing_sentence(missing, "this Blender's ", remedy))

    try:
        from . import ui
    except NoisyWorldError as error:
        raise ImportError(f"Add-on not loaded: {error}") from error

    ui.register()


def unregister() -> None:
    """Take the tab away."""
    from . import ui
    from .other_name import take_other_names  # noqa: PLC0415

    ui.unregister()
    take_other_names()
