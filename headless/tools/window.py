# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's window, where a program in it has one: its areas, what they show, and a photograph of them."""

import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy

from noisy_world.blender.typed import override

LIMIT_S = 180.0  # for shaders to compile; chosen for software GL


def until_drawn() -> Iterator[float]:
    """Yield the seconds to wait until shaders are compiled and the picture no longer changes."""
    words = ["import", "-window", "root", "rgb:-"]
    shown, end_s = b"", time.monotonic() + LIMIT_S
    while time.monotonic() < end_s:
        yield 3.0
        now = subprocess.run(words, check=True, capture_output=True).stdout
        if now == shown and not bpy.app.is_job_running("SHADER_COMPILATION"):
            return
        shown = now


def window() -> bpy.types.Window:
    """Return Blender's window."""
    return bpy.context.window_manager.windows[0]


def space_of(view: bpy.types.Area) -> bpy.types.SpaceView3D:
    """Return what a 3D view shows, and how."""
    assert isinstance(view.spaces.active, bpy.types.SpaceView3D)
    return view.spaces.active


def shading_of(space: bpy.types.SpaceView3D) -> bpy.types.View3DShading:
    """Return how a 3D view is shaded."""
    assert space.shading is not None
    return space.shading


def editor_of(area: bpy.types.Area) -> bpy.types.SpaceNodeEditor:
    """Return what a node editor shows."""
    assert isinstance(area.spaces.active, bpy.types.SpaceNodeEditor)
    return area.spaces.active


def largest(kind: str) -> bpy.types.Area:
    """Return the largest area of a kind."""
    return max((area for area in window().screen.areas if area.type == kind), key=lambda area: area.width * area.height)


def part_of(area: bpy.types.Area) -> str:
    """Return the part of the display that an area takes, as `photograph` expects it."""
    return f"{area.width}x{area.height}+{area.x}+{window().height - area.y - area.height}"


def split_window() -> tuple[bpy.types.Area, bpy.types.Area]:
    """Split the 3D view into one above and a compositor below."""
    view = next(area for area in window().screen.areas if area.type == "VIEW_3D")
    before = set(window().screen.areas)
    in_area(view, lambda: bpy.ops.screen.area_split(direction="HORIZONTAL", factor=0.5))
    (new,) = set(window().screen.areas) - before
    lower, upper = sorted((view, new), key=lambda area: area.y)
    lower.ui_type = "CompositorNodeTree"
    return upper, lower


def show_camera(view: bpy.types.Area) -> None:
    """Look through the camera, with the compositor on."""
    space = space_of(view)
    assert space.region_3d is not None
    space.region_3d.view_perspective = "CAMERA"
    shading_of(space).type = "RENDERED"
    shading_of(space).use_compositor = "ALWAYS"
    space.overlay.show_overlays = False
    in_area(view, bpy.ops.view3d.view_center_camera)


def open_tree(editor: bpy.types.Area, tree: bpy.types.NodeTree) -> None:
    """Show a tree in a node editor."""
    space = editor_of(editor)
    space.pin = True
    space.node_tree = tree
    space.show_region_ui = False
    space.show_region_asset_shelf = False


def in_area(area: bpy.types.Area, operator: Callable[[], object]) -> None:
    """Run an operator as if the mouse were over an area."""
    region = next(item for item in area.regions if item.type == "WINDOW")
    with override(window=window(), area=area, region=region):
        operator()


def photograph(path: Path, part: str = "1600x900+0+0") -> None:
    """Write a picture of the display, or of a part of it: width x height + left + top."""
    words = ["import", "-window", "root", "-crop", part, "+repage", "-quality", "85", str(path)]
    subprocess.run(words, check=True)
    print(f"wrote {path}")
