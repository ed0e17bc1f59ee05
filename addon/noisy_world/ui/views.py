# SPDX-License-Identifier: GPL-3.0-or-later
"""The 3D views that show a scene: their compositor switched on and given back, and how long their pictures take."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import bpy

from .properties import panel_of

FORMER = "noisy_world_former_compositor"
SHADED = ("MATERIAL", "RENDERED")

_took_s: dict[int, float] = {}  # by scene: the last picture through the compositor
_began_s: dict[int, float] = {}  # by region
_handles: list[Any] = []
_on_mismatch: list[Callable[[bpy.types.Scene], None]] = []


def sync_views() -> None:
    """Switch the compositor on in the 3D views of windows that show a scene in preview; give back what others had.

    What a view had is kept in its screen, which undo leaves alone as it does the view.
    """
    for window in bpy.context.window_manager.windows:
        if panel_of(window.scene).preview:
            switch_on(window.screen)
        else:
            give_back(window.screen)


def give_back_all() -> None:
    """Give back what the views of all screens had."""
    for screen in bpy.data.screens:
        give_back(screen)


def switch_on(screen: bpy.types.Screen) -> None:
    """Show the compositing in a screen's 3D views, once: whoever switches it off by hand is left alone."""
    if FORMER in screen:
        return
    screen[FORMER] = {place: space.shading.use_compositor for place, space in _views(screen)}
    for _, space in _views(screen):
        space.shading.use_compositor = "ALWAYS"


def give_back(screen: bpy.types.Screen) -> None:
    """Give a screen's 3D views back what they had."""
    former = screen.pop(FORMER, None)
    if former is None:
        return
    for place, space in _views(screen):
        # A view that came since was split off one that is switched on.
        space.shading.use_compositor = former.get(place, "DISABLED")


def redraw_sidebars() -> None:
    """Have the tab drawn anew: what it says of the preview came after the slider had moved."""
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


def is_shaded(space: bpy.types.Space | None) -> bool:
    """Tell whether a view is shaded in a way that composites."""
    return isinstance(space, bpy.types.SpaceView3D) and space.shading.type in SHADED


def seconds_taken(scene: bpy.types.Scene) -> float:
    """Return how long the last picture of a scene took in a view that composites; 0 where none does now."""
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
        # The window has come to show another scene or workspace; while it is drawn nothing may be changed.
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
    """Measure what views take. on_mismatch: is told a scene whose view has to be switched on or back."""
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
