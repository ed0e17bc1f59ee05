# SPDX-License-Identifier: GPL-3.0-or-later
"""The 3D views that show a scene: switching their compositor on and back, and measuring how long they take to draw."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import bpy

from .properties import panel_of

FORMER = "noisy_world_former_compositor"
SHADED = ("MATERIAL", "RENDERED")

_took_s: dict[int, float] = {}  # by scene: how long the last picture through the compositor took
_began_s: dict[int, float] = {}  # by region
_handles: list[Any] = []
_on_mismatch: list[Callable[[bpy.types.Scene], None]] = []


def sync_views() -> None:
    """Switch the compositor on in the 3D views of windows that show a scene in preview; restore it in the others.

    A view's former state is stored in its screen, since undo changes neither.
    """
    for window in bpy.context.window_manager.windows:
        if panel_of(window.scene).preview:
            switch_on(window.screen)
        else:
            give_back(window.screen)


def give_back_all() -> None:
    """Restore the former state of the views of all screens."""
    for screen in bpy.data.screens:
        give_back(screen)


def switch_on(screen: bpy.types.Screen) -> None:
    """Show the compositing in a screen's 3D views, only once: a user may then switch it off by hand."""
    if FORMER in screen:
        return
    screen[FORMER] = {view: space.shading.use_compositor for view, space in _views(screen)}
    for _, space in _views(screen):
        space.shading.use_compositor = "ALWAYS"


def give_back(screen: bpy.types.Screen) -> None:
    """Restore the former state of a screen's 3D views."""
    former = screen.pop(FORMER, None)
    if former is None:
        return
    for view, space in _views(screen):
        # A view without a stored state is newer: it was split off one that was switched on.
        space.shading.use_compositor = former.get(view, "DISABLED")


def redraw_sidebars() -> None:
    """Redraw the tab, as its text on the preview may change after the slider has moved."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


def _views(screen: bpy.types.Screen) -> Iterator[tuple[str, bpy.types.SpaceView3D]]:
    for number, area in enumerate(screen.areas):
        for space in area.spaces:
            if isinstance(space, bpy.types.SpaceView3D):
                yield str(number), space


def shading_of(space: bpy.types.SpaceView3D) -> bpy.types.View3DShading:
    """Return how a view is shaded."""
    assert space.shading is not None
    return space.shading


def is_shaded(space: bpy.types.Space | None) -> bool:
    """Tell whether a view's shading shows the compositor's result."""
    return isinstance(space, bpy.types.SpaceView3D) and space.shading.type in SHADED


def seconds_taken(scene: bpy.types.Scene) -> float:
    """Return how long the last picture of a scene took in a view that composites; 0 if no view does now."""
    shown = any(
        is_shaded(area.spaces.active)
        for window in bpy.context.window_manager.windows
        if window.scene == scene
        for area in window.screen.areas
    )
    return _took_s.get(scene.session_uid, 0.0) if shown else 0.0


# --- how long a picture takes ---


def _begin() -> None:
    context = bpy.context
    if panel_of(context.scene).preview != (FORMER in context.screen):
        # The window shows another scene or workspace than before. Nothing may be changed while drawing.
        for listener in _on_mismatch:
            listener(context.scene)
    if is_shaded(context.space_data) and context.space_data.shading.use_compositor == "ALWAYS":
        _began_s[context.region.as_pointer()] = time.perf_counter()


def _end() -> None:
    context = bpy.context
    began_s = _began_s.pop(context.region.as_pointer(), None)
    if began_s is not None:
        _took_s[context.scene.session_uid] = time.perf_counter() - began_s


def register(on_mismatch: Callable[[bpy.types.Scene], None]) -> None:
    """Start measuring views. on_mismatch: called with a scene whose view has to be switched on or back."""
    _on_mismatch.append(on_mismatch)
    view = bpy.types.SpaceView3D
    _handles.append(view.draw_handler_add(_begin, (), "WINDOW", "PRE_VIEW"))
    _handles.append(view.draw_handler_add(_end, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    """Stop measuring."""
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    _on_mismatch.clear()
    _took_s.clear()
    _began_s.clear()
