# SPDX-License-Identifier: GPL-3.0-or-later
"""Write an example for Blender: a street at dusk with four of the node groups behind its render, ready to play.

    python headless/pictures/example.py [--out out/example/street.blend]

The file opens in any Blender 5.2, without the add-on. EEVEE shows it in the viewport; Cycles is set up as well.
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import bpy

from noisy_world.nodes.datablocks import muted_output, override
from pictures.lit_chain import CHAIN, show_behind_render
from pictures.street import FRAMES, build_street, intrinsics_of

SIZE_PX = (1200, 680)
NODES_SHARE = 0.45  # of the area that the 3D view had
ZOOM_STEPS = 11  # until the whole chain is seen


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="example.py", description="Write an example file for Blender.")
    parser.add_argument("--out", type=Path, default=ROOT / "out/example/street.blend", help="the file to write")
    options = parser.parse_args(arguments)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    write_example(options.out)
    print(f"wrote {options.out}: {options.out.stat().st_size / 1e6:.1f} MB")
    return 0


def write_example(path: Path, size_px: tuple[int, int] = SIZE_PX, frames: int = FRAMES) -> None:
    """Write the file. Replaces what is open."""
    with muted_output():
        bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene = bpy.context.scene
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes, *bpy.data.materials, *bpy.data.worlds])
    street = build_street(size_px, frames)
    tree = show_behind_render(scene, CHAIN, intrinsics_of(size_px), street.c2w)
    scene.render.engine = "BLENDER_EEVEE"
    scene.render.filepath = "//street_"
    scene.frame_set(0)
    arrange_window(tree)
    with muted_output():
        bpy.ops.wm.save_as_mainfile(filepath=str(path.resolve()), compress=True, copy=True)


def arrange_window(tree: bpy.types.NodeTree) -> None:
    """Show the camera's view with the compositor on, and the chain in the other half of the area."""
    window = bpy.context.window_manager.windows[0]
    areas = window.screen.areas
    view = next(area for area in areas if area.type == "VIEW_3D")
    before = set(areas)
    region = next(item for item in view.regions if item.type == "WINDOW")
    with override(window=window, area=view, region=region):
        bpy.ops.screen.area_split(direction="HORIZONTAL", factor=NODES_SHARE)
    (editor,) = set(areas) - before
    editor.ui_type = "CompositorNodeTree"
    space = editor.spaces.active
    assert isinstance(space, bpy.types.SpaceNodeEditor)
    space.node_tree = tree
    space.show_region_ui = space.show_region_asset_shelf = False
    nodes = next(item for item in editor.regions if item.type == "WINDOW")
    with override(window=window, area=editor, region=nodes):
        for _ in range(ZOOM_STEPS):
            bpy.ops.view2d.zoom_out()
    show_camera(view)


def show_camera(area: bpy.types.Area) -> None:
    """Look through the camera, lit and composited.

    Blender opens no file in rendered mode; the material preview with the scene's own lights shows the same.
    """
    space = area.spaces.active
    assert isinstance(space, bpy.types.SpaceView3D)
    assert space.shading is not None
    assert space.region_3d is not None
    space.region_3d.view_perspective = "CAMERA"
    space.shading.type = "MATERIAL"
    space.shading.use_scene_lights = space.shading.use_scene_world = True
    space.shading.use_compositor = "ALWAYS"
    space.overlay.show_overlays = False


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
