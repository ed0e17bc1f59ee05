# SPDX-License-Identifier: GPL-3.0-or-later
"""What an add-on leaves behind in a Blender with a window: enable, disable, enable, reload all scripts, disable.

`steps` are for `driver.run`. The result holds what was there before, after enabling, after enabling again, after the
reloads and at the end.
"""

import gc
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import FrameType, FunctionType

import bpy

RELOADS = 2  # what stays behind, stays each time
SETTLE_S = 0.2
MODULE = "bl_ext.user_default.noisy_world"
SEEN: dict[str, dict] = {}


def steps() -> Iterator[float]:
    """Switch the add-on on and off, look at Blender between, and leave it on; yields the seconds to wait."""
    yield SETTLE_S
    SEEN["before"] = snapshot()
    yield from switch("enable")
    SEEN["enabled"] = snapshot()
    yield from switch("disable")
    SEEN["disabled"] = snapshot()
    yield from switch("enable")
    SEEN["enabled again"] = snapshot()
    for _ in range(RELOADS):
        bpy.ops.script.reload()
        yield SETTLE_S
    SEEN["reloaded"] = snapshot()
    yield from switch("disable")
    SEEN["after"] = snapshot()
    yield from switch("enable")


def switch(how: str) -> Iterator[float]:
    """Enable or disable the add-on, and let its timers run."""
    assert getattr(bpy.ops.preferences, f"addon_{how}")(module=MODULE) == {"FINISHED"}
    yield SETTLE_S


def snapshot() -> dict:
    """Return all that an add-on could leave behind; of functions, only its own: Blender's leave some themselves."""
    keymaps = bpy.context.window_manager.keyconfigs.addon.keymaps
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    drawn = {name: getattr(getattr(bpy.types, name), "draw", None) for name in dir(bpy.types)}
    owners = ("Scene", "Object", "Screen", "WindowManager", "WorkSpace", "Camera", "Mesh", "Preferences")
    return {
        "types": sorted(dir(bpy.types)),
        "properties": {name: sorted(getattr(bpy.types, name).bl_rna.properties.keys()) for name in owners},
        "handlers": {name: own_names(kept) for name, kept in lists.items() if isinstance(kept, list)},
        "timers": own_names(item for item in functions() if bpy.app.timers.is_registered(item)),
        "keymaps": {keymap.name: sorted(item.idname for item in keymap.keymap_items) for keymap in keymaps},
        "menus": {name: own_names(getattr(draw, "_draw_funcs", ())) for name, draw in drawn.items()},
        "asset libraries": [item.name for item in bpy.context.preferences.filepaths.asset_libraries],
        "called while drawing": called_while_drawing(),
    }


def own_names(found: Iterable[object]) -> list[str]:
    """Return the names of those of the functions that are the add-on's."""
    names = [f"{getattr(item, '__module__', '')}.{getattr(item, '__qualname__', '')}" for item in found]
    return sorted(name for name in names if name.startswith(MODULE))


def functions() -> list[FunctionType]:
    """Return every function in memory, those of former loadings too."""
    return [item for item in gc.get_objects() if isinstance(item, FunctionType)]


def called_while_drawing() -> dict[str, int]:
    """Count the add-on's functions that Blender calls when it draws its window once: draw handlers, panels, headers."""
    calls: Counter[str] = Counter()
    place = MODULE.rpartition(".")[2]

    def count(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and f"/{place}/" in frame.f_code.co_filename:
            calls[f"{Path(frame.f_code.co_filename).stem}.{frame.f_code.co_qualname}"] += 1

    (view,) = (area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")
    view.spaces.active.show_region_ui = True
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)  # regions that are new
        sys.setprofile(count)
        try:
            bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
        finally:
            sys.setprofile(None)
    return dict(calls)
