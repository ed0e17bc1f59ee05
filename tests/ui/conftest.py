# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on, or the part of it that its previews need, registered in a new file."""

import pytest


@pytest.fixture
def registered():
    """The panel's properties, without its buttons."""
    bpy = pytest.importorskip("bpy", reason="bpy is not installed")
    from noisy_world.ui import paths, preview, properties

    bpy.ops.wm.read_factory_settings(use_empty=True)
    for module in (properties, paths, preview):
        module.register()
    yield
    for module in (preview, paths, properties):
        module.unregister()


@pytest.fixture
def scene(registered):
    """An empty scene of ten small frames."""
    import bpy
    from preview_tools import IDENTIFIERS, SIZE

    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.compositor_precision = "FULL"
    scene.render.compositor_device = "CPU"
    scene.frame_start, scene.frame_end = 0, 9
    settings = scene.noisy_world
    settings.width_px = SIZE[0]
    settings.seed, settings.scene_name, settings.setting_name = IDENTIFIERS
    return scene


@pytest.fixture
def add_on():
    """The whole add-on in a new file."""
    bpy = pytest.importorskip("bpy", reason="bpy is not installed")
    import noisy_world

    bpy.ops.wm.read_factory_settings(use_empty=False)
    noisy_world.register()
    yield
    noisy_world.unregister()
