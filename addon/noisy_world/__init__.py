# SPDX-License-Identifier: GPL-3.0-or-later
"""Noisy World: clean 3D scenes in, noisy RGB-D worlds out.

As a Blender extension it adds a tab to the 3D view's sidebar; scenes, trajectories and presets are used through the
library and through headless/generate.py as well, and none of them needs the tab.
"""


def register() -> None:
    """Show the tab."""
    from . import ui

    ui.register()


def unregister() -> None:
    """Take the tab away."""
    from . import ui

    ui.unregister()
