# SPDX-License-Identifier: GPL-3.0-or-later
"""A person at Blender's window: simulated mouse and keys, what lies under the mouse, waiting, photographs.

For scripts that a Blender program with --enable-event-simulate runs. Events go to the window that came last, a file
browser's for instance.
"""

from typing import TypeAlias
import json
import subprocess
import time
import traceback
from contextlib import suppress
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import bpy
import numpy as np

Steps: TypeAlias = Iterator[float | Callable[[], object]]
"""What is waited for: seconds, or something to become true."""

TIMEOUT_S = 120.0
SETTLE_S = 0.15  # between two timers Blender handles what was pressed, and draws
SMOOTH_S = 0.4  # how long a view takes to move, and somewhat more
ROW_PX = 18
STATE: dict = {"mouse": (800, 450), "found": False}


def run(steps: Steps, result: Path) -> None:
    """Take the steps one after another, write what came of them to a file and quit."""
    waiting: list = [None, 0.0]

    def proceed() -> float | None:
        condition, end_s = waiting
        try:
            if condition is not None and not condition():
                if time.monotonic() > end_s:
                    steps.throw(TimeoutError(f"not within {TIMEOUT_S:g} s"))
                return 0.05
            wait = next(steps)
        except StopIteration:
            return leave({"status": "done"})
        except BaseException:  # noqa: BLE001 - the test shows it
            photograph_now(result.with_name("failed.png"))
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


# --- places ---


def window() -> bpy.types.Window:
    """Return the window that came last."""
    return bpy.context.window_manager.windows[-1]


def view() -> bpy.types.Area:
    """Return the largest 3D view."""
    return max((a for a in window().screen.areas if a.type == "VIEW_3D"), key=lambda a: a.width * a.height)


def region(kind: str, area: bpy.types.Area | None = None) -> bpy.types.Region:
    """Return a region of an area, by default of the 3D view."""
    return next(item for item in (area or view()).regions if item.type == kind)


def middle(part: bpy.types.Region) -> tuple[int, int]:
    """Return a place that no sidebar of a region hides: a third from the left, half way up."""
    return part.x + part.width // 3, part.y + part.height // 2


# --- mouse and keys ---


def move(x: int, y: int) -> None:
    """Move the mouse."""
    STATE["mouse"] = (int(x), int(y))
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=int(x), y=int(y))


def press(kind: str, **modifiers: bool) -> None:
    """Press and release a key or a button of the mouse, where the mouse is."""
    x, y = STATE["mouse"]
    for value in ("PRESS", "RELEASE") if "WHEEL" not in kind else ("PRESS",):
        window().event_simulate(type=kind, value=value, x=x, y=y, **modifiers)


def go(x: int, y: int) -> Steps:
    """Move the mouse in steps, as a hand does, and let Blender see it."""
    for distance in (40, 2, 0):
        move(x - distance, y)
        yield SETTLE_S / 3


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
        yield 0.01


# --- finding buttons ---


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


def search(area: bpy.types.Area, kind: str, places: Iterable[tuple[int, int]], *wanted: str) -> Steps:
    """Move the mouse over places of an area's region until one of these is under it.

    A "$" at the end of what is wanted stands for the end of the name. Raises LookupError.
    """
    for x, y in places:
        move(x - 1, y)
        move(x, y)
        yield 0.02
        under = under_mouse(area, region(kind, area)) + "$"
        if any(word in under for word in wanted):
            return
    raise LookupError(f"{wanted}: not found")


def look_for(*wanted: str, share: float = 0.6) -> Steps:
    """Move the mouse down the sidebar, which scrolls, until one of these is under it."""
    part = region("UI")
    x = int(part.x + share * (part.width - 20))
    top, bottom = part.y + part.height - 6, part.y + 12  # the edge itself is for resizing
    start = min(top, STATE["mouse"][1] + 2 * ROW_PX) if STATE["found"] else top  # what comes next is mostly below
    for page in range(10):
        with suppress(LookupError):
            yield from search(view(), "UI", [(x, y) for y in range(start, bottom, -ROW_PX)], *wanted)
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
    yield from push(wanted, share=0.75)
    yield from replace_text(text)


def replace_text(text: str) -> Steps:
    """Type over what is in the field that is being edited."""
    yield SETTLE_S
    press("A", ctrl=True)
    yield from type_text(text)
    press("RET")
    yield SETTLE_S


def choose(wanted: str, key: str) -> Steps:
    """Choose from a drop-down of the sidebar by an entry's underlined letter."""
    yield from push(wanted, share=0.75)
    yield 0.4
    press(key)
    yield 0.4


def still() -> Steps:
    """Wait until the 3D view, which moves smoothly, stands still."""
    before = None
    yield SETTLE_S
    while before != (now := [list(row) for row in view().spaces.active.region_3d.view_matrix]):
        before = now
        yield SETTLE_S


def choose_shading(kind: str) -> Steps:
    """Choose from the pie that Z opens in the 3D view; its directions have the numbers of a keyboard's block."""
    yield from go(*middle(region("WINDOW")))
    press("Z")
    yield 2 * SETTLE_S
    press({"RENDERED": "EIGHT", "SOLID": "SIX"}[kind])
    yield lambda: view().spaces.active.shading.type == kind


def open_sidebar(tab: str) -> Steps:
    """Press N in the 3D view, and click on a tab."""
    yield from go(*middle(region("WINDOW")))
    if not view().spaces.active.show_region_ui:
        press("N")
    yield lambda: region("UI").width > 1
    side = region("UI")
    for y in range(side.y + side.height - 25, side.y, -25):  # down the tabs at the right edge
        if region("UI").active_panel_category == tab:
            break
        yield from click(side.x + side.width - 10, y)
    assert region("UI").active_panel_category == tab, f"{region('UI').active_panel_category!r} is no {tab!r}"


def save_as(folder: Path, name: str) -> Steps:
    """Save in the file browser that has opened in a window of its own."""
    yield lambda: window().screen.areas[0].type == "FILE_BROWSER"
    browser = window().screen.areas[0]
    yield lambda: browser.spaces.active.params is not None and region("EXECUTE", browser).width > 1
    yield SMOOTH_S
    lower, upper = region("EXECUTE", browser), region("UI", browser)
    # The field for the name says nothing of itself; it begins at the left.
    yield from go(lower.x + 100, lower.y + lower.height // 2 + 60)
    yield from go(lower.x + 100, lower.y + lower.height // 2)
    yield 0.5
    press("LEFTMOUSE")
    yield from replace_text(name)
    yield lambda: browser.spaces.active.params.filename == name
    yield from search(browser, "UI", along(upper), "params.directory")
    press("LEFTMOUSE")
    yield from replace_text(str(folder))
    yield lambda: Path(browser.spaces.active.params.directory.decode()) == folder
    assert browser.spaces.active.params.filename == name
    # The field for the folder keeps the keyboard until there is a click beside it.
    yield from click(*middle(region("TOOL_PROPS", browser)))
    yield from search(browser, "EXECUTE", along(lower), "file.execute")
    press("LEFTMOUSE")
    yield lambda: window().screen.areas[0].type != "FILE_BROWSER"


def along(part: bpy.types.Region) -> list[tuple[int, int]]:
    """Return places along a region's middle, from left to right."""
    return [(x, part.y + part.height // 2) for x in range(part.x + ROW_PX // 2, part.x + part.width, ROW_PX)]


# --- what is seen ---


def photograph_now(path: Path) -> None:
    """Write what the display shows."""
    subprocess.run(["import", "-window", "root", str(path)], check=True)


def photograph(path: Path) -> Steps:
    """Write what the display shows, after it was drawn."""
    yield 2 * SETTLE_S
    photograph_now(path)


def look() -> np.ndarray:
    """Return what the middle of the 3D view shows (120, 200, 3), in 255ths."""
    part = region("WINDOW")
    width, height = 200, 120
    x, y = middle(part)
    crop = f"{width}x{height}+{x - width // 2}+{bpy.context.window_manager.windows[0].height - y - height // 2}"
    words = ["import", "-window", "root", "-crop", crop, "+repage", "-depth", "8", "rgb:-"]
    seen = subprocess.run(words, check=True, capture_output=True).stdout
    return np.frombuffer(seen, dtype=np.uint8).reshape(height, width, 3).astype(np.float64)
