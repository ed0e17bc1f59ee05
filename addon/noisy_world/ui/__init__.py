# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on's windows: a thin layer over the functions that the generator calls."""

from collections.abc import Callable
from contextlib import ExitStack


def _parts() -> list[tuple[Callable[[], None], Callable[[], None]]]:
    """Return what registers and unregisters each part, in the order of the panels in the tab."""
    from . import (
        asset_library,
        bake_exposure,
        camera_link,
        excluded,
        first_look,
        footage,
        generate,
        header_presets,
        motion_plot,
        older_files,
        operators,
        panels,
        paths,
        pictures,
        presets,
        preview,
        properties,
        real_cameras,
        scene_copy,
        shots,
        tracking,
        world,
    )

    return [
        (properties.register, properties.unregister),
        (older_files.register_older_files, older_files.unregister_older_files),
        (footage.register, footage.unregister),
        (scene_copy.register, scene_copy.unregister),
        (world.register, world.unregister),
        (excluded.register, excluded.unregister),
        (operators.register, operators.unregister),
        (paths.register, paths.unregister),
        (preview.register, preview.unregister),
        (generate.register, generate.unregister),
        (tracking.register_tracking, tracking.unregister_tracking),
        (asset_library.register_asset_library, asset_library.unregister_asset_library),
        (camera_link.register_camera_link, camera_link.unregister_camera_link),
        (bake_exposure.register, bake_exposure.unregister),
        (header_presets.register, header_presets.unregister),
        (pictures.register, pictures.unregister),
        (motion_plot.register_motion_plot, motion_plot.unregister_motion_plot),
        (real_cameras.register_real_cameras, real_cameras.unregister_real_cameras),
        (panels.register, panels.unregister),
        (shots.register, shots.unregister),
        (presets.register, presets.unregister),
        (first_look.register_first_look, first_look.unregister_first_look),
    ]


def register() -> None:
    """Register everything, or nothing where something fails."""
    with ExitStack() as registered:
        for add, remove in _parts():
            add()
            registered.callback(remove)
        registered.pop_all()  # without an error, nothing is unregistered again


def unregister() -> None:
    """Unregister everything, in reverse order."""
    for _, remove in reversed(_parts()):
        remove()
