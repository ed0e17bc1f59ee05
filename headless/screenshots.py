# SPDX-License-Identifier: GPL-3.0-or-later
"""Photograph Blender with the node groups in use, for the docs: run by a Blender program with a window, on X.

    blender --factory-startup -P headless/screenshots.py -- docs

Needs ImageMagick's `import`. Writes compositor.jpg: the embedded room in the viewport through a chain of three groups,
above the compositor that holds it; and node_group.jpg: a group, opened.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "addon"))
sys.path.append(str(ROOT / ".blender-env" / str(sys.implementation.cache_tag)))

import bpy

from noisy_world.blender.camera import add_camera, key_trajectory, set_intrinsics
from noisy_world.blender.nodes import ensure_group
from noisy_world.blender.scene import add_mesh
from noisy_world.core.groups import build_group, socket_name
from noisy_world.core.plan import load_trajectory, make_plan
from noisy_world.core.preset import read_preset
from noisy_world.core.scenes import load_mesh
from noisy_world.perturbations import registry

DEMO = ROOT / "presets" / "demo.yaml"
FRAME = 8
CHAIN = (("fog", 1), ("motion_blur", 3), ("gaussian_noise", 1))
OPENED = "fog_depth"
SETTLE_S = 1.5


def main(folder: Path) -> None:
    """Run the steps one after another, with time between them for Blender to draw."""
    steps = take_pictures(folder)

    def proceed() -> float | None:
        wait_s = next(steps, None)
        if wait_s is None:
            bpy.ops.wm.quit_blender()
        return wait_s

    bpy.app.timers.register(proceed, first_interval=SETTLE_S, persistent=True)


def take_pictures(folder: Path) -> Iterator[float]:
    """Prepare each picture, wait, take it; yields the seconds to wait."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_splash=False)
    yield SETTLE_S
    scene = prepare_scene()
    tree = compositor_tree(scene)
    view, editor = split_window()
    yield SETTLE_S
    show_camera(view)
    open_tree(editor, tree)
    yield SETTLE_S
    in_area(editor, bpy.ops.node.view_all)
    yield 45.0  # software GL compiles its shaders
    photograph(folder / "compositor.jpg")
    view.ui_type = "OUTLINER"
    open_tree(editor, ensure_group(build_group(registry()[OPENED])))
    in_area(editor, bpy.ops.screen.screen_full_area)
    yield SETTLE_S
    whole = max(window().screen.areas, key=lambda area: area.width * area.height)
    in_area(whole, bpy.ops.node.view_all)
    yield 4.0
    photograph(folder / "node_group.jpg", "1600x220+0+350")


def prepare_scene() -> bpy.types.Scene:
    """Put the demo's room and camera into the scene that the window shows."""
    plan = make_plan(read_preset(DEMO, ["settings=[{name: clean}]"]), None, registry())
    mesh = load_mesh(plan.renders[0].scene)
    scene = bpy.context.scene
    for item in list(scene.objects):
        bpy.data.objects.remove(item)
    scene.view_settings.view_transform = "Standard"
    scene.render.engine = "BLENDER_EEVEE"
    add_mesh(scene, mesh, "Room", decoding="shader")
    camera = add_camera(scene, "Camera")
    set_intrinsics(scene, camera, plan.camera, near_m=0.01, far_m=100.0, sample_offset_px=0.0)
    key_trajectory(scene, camera, load_trajectory(plan, plan.renders[0].scene, mesh).c2w)
    scene.camera = camera
    scene.frame_set(FRAME)
    return scene


def compositor_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """Chain the groups behind the render, as a person would drag them in."""
    tree = bpy.data.node_groups.new("Compositor", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    node = tree.nodes.new("CompositorNodeRLayers")
    node.location = (-330, 0)
    last = node.outputs["Image"]
    for place, (name, severity) in enumerate(CHAIN):
        perturbation = registry()[name]
        node = tree.nodes.new("CompositorNodeGroup")
        node.node_tree = ensure_group(build_group(perturbation))
        node.label = perturbation.label
        node.width = 230
        node.location = (290 * place, 60)
        for parameter in perturbation.severities:
            value = getattr(perturbation.at_severity(severity), parameter)
            node.inputs[socket_name(parameter)].default_value = value
        tree.links.new(last, node.inputs["Image"])
        last = node.outputs["Image"]
    end = tree.nodes.new("NodeGroupOutput")
    end.location = (290 * len(CHAIN), 0)
    tree.links.new(last, end.inputs["Image"])
    for node in tree.nodes:
        node.select = False
    scene.compositing_node_group = tree
    return tree


def window() -> bpy.types.Window:
    """Return Blender's window."""
    return bpy.context.window_manager.windows[0]


def split_window() -> tuple[bpy.types.Area, bpy.types.Area]:
    """Turn the 3D view into one above and a compositor below."""
    view = next(area for area in window().screen.areas if area.type == "VIEW_3D")
    before = set(window().screen.areas)
    in_area(view, lambda: bpy.ops.screen.area_split(direction="HORIZONTAL", factor=0.5))
    (new,) = set(window().screen.areas) - before
    lower, upper = sorted((view, new), key=lambda area: area.y)
    lower.ui_type = "CompositorNodeTree"
    return upper, lower


def show_camera(view: bpy.types.Area) -> None:
    """Look through the camera, with the compositor on."""
    space = view.spaces.active
    space.region_3d.view_perspective = "CAMERA"
    space.shading.type = "RENDERED"
    space.shading.use_compositor = "ALWAYS"
    space.overlay.show_overlays = False
    in_area(view, bpy.ops.view3d.view_center_camera)


def open_tree(editor: bpy.types.Area, tree: bpy.types.NodeTree) -> None:
    """Show a tree in a node editor."""
    space = editor.spaces.active
    space.pin = True
    space.node_tree = tree
    space.show_region_ui = False
    space.show_region_asset_shelf = False


def in_area(area: bpy.types.Area, operator: Callable[[], object]) -> None:
    """Run an operator as if the mouse were over an area."""
    region = next(item for item in area.regions if item.type == "WINDOW")
    with bpy.context.temp_override(window=window(), area=area, region=region):
        operator()


def photograph(path: Path, part: str = "1600x900+0+0") -> None:
    """Write what the display shows, or a part of it: width x height + left + top."""
    words = ["import", "-window", "root", "-crop", part, "+repage", "-quality", "85", str(path)]
    subprocess.run(words, check=True)
    print(f"wrote {path}")


if __name__ == "__main__":
    main(Path(sys.argv[sys.argv.index("--") + 1]).resolve())
