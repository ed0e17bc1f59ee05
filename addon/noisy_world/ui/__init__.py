# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on's windows: a thin layer over the functions that the generator calls."""

import importlib
from contextlib import ExitStack
from types import ModuleType

MODULES = (
    "properties", "older_files", "footage", "scene_copy", "world", "excluded", "operators", "paths", "preview",
    "generate", "tracking", "asset_library", "camera_link", "bake_exposure", "header_presets", "pictures",
    "motion_plot", "real_cameras", "panels", "shots", "presets", "first_look",
)  # fmt: skip
"""In the order of registration, which is also the order of the panels in the tab."""


def modules() -> list[ModuleType]:
    """Return the modules that register something, in order."""
    return [importlib.import_module(f"{__name__}.{name}") for name in MODULES]


def register() -> None:
    """Register everything, or nothing where something fails."""
    with ExitStack() as registered:
        for module in modules():
            module.register()
            registered.callback(module.unregister)
        registered.pop_all()  # without an error, nothing is unregistered again


def unregister() -> None:
    """Unregister everything, in reverse order."""
    for module in reversed(modules()):
        module.unregister()
