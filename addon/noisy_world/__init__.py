# SPDX-License-Identifier: GPL-3.0-or-later
"""Noisy World: clean 3D scenes in, noisy RGB-D worlds out.

As a Blender extension it has nothing to register: scenes, trajectories and presets are used through the library and
through headless/generate.py.
"""


def register() -> None:
    """Register nothing."""


def unregister() -> None:
    """Unregister nothing."""
