# SPDX-License-Identifier: GPL-3.0-or-later
"""A person at Blender's window: simulated mouse and keys, what lies under the mouse, waiting, photographs.

For scripts that a Blender program with --enable-event-simulate runs.
"""

import json
import subprocess
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy

type Steps = Iterator[float | Callable[[], object]]
"""What is waited for: seconds, or something to become true."""

TIMEOUT_S = 60.0
SETTLE_S = 0.15


def run(steps: Steps, result: Path) -> None:
    """Take the steps one after another, write what came of them to a file and quit."""
    waiting: list = [None, 0.0]

    def proceed() -> float | None:
        condition, end_s = waiting
        try:
            if condition is not None and not condition():
                if time.monotonic() > end_s:
                    steps.throw(TimeoutError(f"{condition.__name__}: not within {TIMEOUT_S:g} s"))
                return 0.05
            wait = next(steps)
        except StopIteration:
            return leave({"status": "done"})
        except BaseException:  # noqa: BLE001 - the test shows it
            return leave({"status": "failed", "error": traceback.format_exc()})
        if callable(wait):
            waiting[:] = [wait, time.monotonic() + TIMEOUT_S]
            return 0.05
        waiting[0] = None
        return wait

    def leave(content: dict) -> None:
        result.write_text(json.dumps(content))
        bpy.ops.wm.quit_blender()

    bpy.app.timers.register(proceed, first_interval=1.0, persistent=True)


def window() -> bpy.types.Window:
    """Return Blender's window."""
    return bpy.context.window_manager.windows[0]


def view() -> bpy.types.Area:
    """Return the largest 3D view."""
    return max((a for a in window().screen.areas if a.type == "VIEW_3D"), key=lambda a: a.width * a.height)


def region(kind: str, area: bpy.types.Area | None = None) -> bpy.types.Region:
    """Return a region of an area, by default of the 3D view."""
    return next(item for item in (area or view()).regions if item.type == kind)


def move(x: int, y: int) -> None:
    """Move the mouse."""
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=int(x), y=int(y))


def press(kind: str, **modifiers: bool) -> None:
    """Press and release a key or a button of the mouse, where the mouse is."""
    x, y = STATE["mouse"]
    for value in ("PRESS", "RELEASE") if "WHEEL" not in kind else ("PRESS",):
        window().event_simulate(type=kind, value=value, x=x, y=y, **modifiers)


STATE: dict = {"mouse": (800, 450), "found": False}


def go(x: int, y: int) -> Steps:
    """Move the mouse in two steps, as a hand does, and let Blender see it."""
    STATE["mouse"] = (int(x), int(y))
    move(x - 2, y)
    move(x, y)
    yield SETTLE_S


def click(x: int, y: int) -> Steps:
    """Click there."""
    yield from go(x, y)
    press("LEFTMOUSE")
    yield SETTLE_S


def type_text(text: str) -> Steps:
    """Type letters."""
    names = {" ": "SPACE", ".": "PERIOD", "-": "MINUS", "_": "MINUS", "/": "SLASH"}
    digits = ("ZERO", "ONE", "TWO", "THREE", "FOUR", "FIVE", "SIX", "SEVEN", "EIGHT", "NINE")
    x, y = STATE["mouse"]
    for letter in text:
        kind = digits[int(letter)] if letter.isdigit() else names.get(letter, letter.upper())
        window().event_simulate(type=kind, value="PRESS", unicode=letter, x=x, y=y)
        window().event_simulate(type=kind, value="RELEASE", x=x, y=y)
        yield 0.02


def under_mouse(area: bpy.types.Area, part: bpy.types.Region) -> str:
    """Say what lies under the mouse: an operator as Python writes it, a property's path, or nothing."""
    with bpy.context.temp_override(window=window(), area=area, region=part):
        manager = bpy.context.window_manager
        manager.clipboard = ""
        if bpy.ops.ui.copy_python_command_button.poll():
            bpy.ops.ui.copy_python_command_button()
            if manager.clipboard:
                return manager.clipboard
        if bpy.ops.ui.copy_data_path_button.poll():
            bpy.ops.ui.copy_data_path_button(full_path=True)
        return manager.clipboard


def look_for(*wanted: str, share: float = 0.6) -> Steps:
    """Move the mouse down the sidebar, which scrolls, until one of these is under it."""
    part = region("UI")
    x = int(part.x + share * (part.width - 20))
    top, bottom = part.y + part.height - 6, part.y
    start = min(top, STATE["mouse"][1] + 24) if STATE["found"] else top  # the next thing is mostly below the last
    yield from go(x, start)
    for page in range(10):
        for y in range(start, bottom, -12):
            STATE["mouse"] = (x, y)
            move(x - 1, y)
            move(x, y)
            yield 0.02
            if any(word in under_mouse(view(), part) for word in wanted):
                STATE["found"] = True
                return
        start = top
        # After a page or two below, from the top, whatever was passed by.
        yield from scroll("WHEELUPMOUSE", 60) if page == 2 else scroll("WHEELDOWNMOUSE", 12)
    raise LookupError(f"{wanted}: no such button in the sidebar")


def scroll(kind: str, count: int) -> Steps:
    """Turn the wheel over the sidebar."""
    part = region("UI")
    yield from go(part.x + part.width - 30, part.y + 20)
    for _ in range(count):
        press(kind)
    yield SETTLE_S


def push(wanted: str, share: float = 0.6) -> Steps:
    """Click on a button of the sidebar."""
    yield from look_for(wanted, share=share)
    press("LEFTMOUSE")
    yield SETTLE_S


def fill_in(wanted: str, text: str) -> Steps:
    """Type a value into a field of the sidebar."""
    yield from look_for(wanted, share=0.75)
    press("RET")
    yield SETTLE_S
    press("A", ctrl=True)
    yield from type_text(text)
    press("RET")
    yield SETTLE_S


def photograph(path: Path, part: str = "") -> Steps:
    """Write what the display shows."""
    yield 0.4
    words = ["import", "-window", "root", *(["-crop", part, "+repage"] if part else []), str(path)]
    subprocess.run(words, check=True)


def open_sidebar(tab: str) -> Steps:
    """Press N in the 3D view, and click on a tab."""
    whole = region("WINDOW")
    yield from go(whole.x + whole.width // 3, whole.y + whole.height // 2)
    if not view().spaces.active.show_region_ui:
        press("N")
    yield lambda: region("UI").width > 1
    side = region("UI")
    for y in range(side.y + side.height - 25, side.y, -25):  # down the tabs at the right edge
        if region("UI").active_panel_category == tab:
            break
        yield from click(side.x + side.width - 10, y)
    assert region("UI").active_panel_category == tab, f"{region('UI').active_panel_category!r} is no {tab!r}"
