# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on's windows: a thin layer over the functions that the generator calls."""

from collections.abc import Callable
from contextlib import ExitStack


def _parts() -> list[tuple[Callable[[], None], Callable[[], None]]]:
    """Return what registers and unregisters each part, in the order of the panels in the tab."""
    from . import (
        add_menu,
        bake_exposure,
        beginning,
        drawn_paths,
        exclusions,
        gallery,
        generating,
        loading,
        older_files,
        open_scene,
        operators,
        presets,
        preview,
        properties,
        section_presets,
        sections,
        shots,
        source_views,
    )

    return [
        (properties.register, properties.unregister),
        (older_files.register, older_files.unregister),
        (source_views.register, source_views.unregister),
        (open_scene.register, open_scene.unregister),
        (loading.register, loading.unregister),
        (exclusions.register, exclusions.unregister),
        (operators.register, operators.unregister),
        (beginning.register, beginning.unregister),
        (drawn_paths.register, drawn_paths.unregister),
        (preview.register, preview.unregister),
        (generating.register, generating.unregister),
        (generating.register_tracking, generating.unregister_tracking),
        (operators.register_asset_library, operators.unregister_asset_library),
        (operators.register_camera_link, operators.unregister_camera_link),
        (add_menu.register, add_menu.unregister),
        (bake_exposure.register, bake_exposure.unregister),
        (section_presets.register, section_presets.unregister),
        (gallery.register, gallery.unregister),
        (sections.register_motion_plot, sections.unregister_motion_plot),
        (section_presets.register_real_cameras, section_presets.unregister_real_cameras),
        (presets.register, presets.unregister),
        (sections.register, sections.unregister),
        (shots.register, shots.unregister),
        (sections.register_evaluation, sections.unregister_evaluation),
        (exclusions.register_first_look, exclusions.unregister_first_look),
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
