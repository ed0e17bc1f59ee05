# SPDX-License-Identifier: GPL-3.0-or-later
"""Photograph Blender for the docs, with the node groups and with the add-on in use: run by a Blender program on X.

    blender --factory-startup -P headless/pictures/screenshots.py -- docs [NAME ...]

Needs ImageMagick's `import`. Writes compositor.jpg: the embedded room in the viewport through a chain of three groups,
above the compositor that holds it; node_group.jpg: a group, opened; and of the add-on add_on_panel.jpg and
add_on_dataset.jpg, the sidebar's two tabs beside the room; add_on_paths.jpg, the planned and the deviated path;
add_on_preview.jpg, the perturbations live, half before and half after; add_on_nodes.jpg, the groups that the preview
made; and add_on_frame.jpg, a frame as it will be written, beside the sliders; add_on_body.jpg, a walker that carries
the camera, and what shakes it; add_on_pictures.jpg and add_on_shots.jpg, the lists of pictures and of shots; and
example.jpg, the file of `make example`. With names, which are "groups", "add_on", "body", "tracking", "shots" and
"example", only those.
"""

import itertools
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]
sys.path.append(str(ROOT / ".blender-env" / str(sys.implementation.cache_tag)))

import bpy
from mathutils import Euler

import noisy_world
from noisy_world.dataset.plan import make_plan
from noisy_world.nodes.datablocks import group_of, new_node, new_socket, new_tree, override, set_value
from noisy_world.nodes.node_trees import ensure_group
from noisy_world.panel import gallery, shots
from noisy_world.panel.properties import panel_of
from noisy_world.panel.views import use_standard_view
from noisy_world.perturbations import registry
from noisy_world.perturbations.groups import build_group
from noisy_world.perturbations.kinds import ColourPerturbation
from noisy_world.preset.keys import read_preset
from noisy_world.render.mesh_session import add_camera, add_mesh, key_trajectory, set_intrinsics
from noisy_world.rooms import kept_room

DEMO = ROOT / "presets" / "demo.yaml"
FRAME = 8
CHAIN = (("fog", 1), ("motion_blur", 3), ("gaussian_noise", 1))
OPENED = "fog_depth"
PREVIEWED = (("fog", 2), ("gaussian_noise", 1))
WALK = "scene.trajectory.handheld"
PATH = {f"{WALK}.frames": 160, f"{WALK}.speed_m_s": 1.0}
TRACKED_IN = "desync"
TRACKED: dict[str, Any] = {  # a path that turns enough for depth of another moment to matter
    "room_seed": 1, f"{WALK}.frames": 300, f"{WALK}.rate_hz": 20.0, f"{WALK}.speed_m_s": 0.5,
    "camera.width": 320, "camera.height": 240, "camera.fx": 277.0, "camera.fy": 277.0, "camera.cx": 159.5,
    "camera.cy": 119.5,
}  # fmt: skip
CARRIED = {
    f"{WALK}.frames": 160, f"{WALK}.speed_m_s": 0.8, "scene.trajectory.body.kind": "walker",
    "rig.imu.translation_m": (0.1, 0.0, 0.0),
}  # fmt: skip
SHOT_STEPS = (("rain_depth", 3), ("lens_drops", 2))
SHOTS = (("arrival", 1, 24, 1), ("lamps", 25, 48, 2), ("corner", 49, 72, 3))  # name, first and last frame, seed
EXAMPLE_PART = "1314x789+0+26"  # what is left of the outliner and above the timeline
TAB, DATASET = "Noisy World", "Noisy Dataset"
SETTLE_S = 1.5  # after a change, for Blender to draw; chosen for software GL


def main(folder: Path, names: Sequence[str]) -> None:
    """Run the steps one after another, with time between them for Blender to draw."""
    takes = {
        "groups": photograph_groups,
        "add_on": photograph_add_on,
        "body": photograph_body,
        "tracking": photograph_tracking,
        "shots": photograph_shots,
        "example": photograph_example,
    }
    steps = itertools.chain.from_iterable(takes[name](folder) for name in names or takes)

    def proceed() -> float | None:
        wait_s = next(steps, None)
        if wait_s is None:
            bpy.ops.wm.quit_blender()
        return wait_s

    bpy.app.timers.register(proceed, first_interval=SETTLE_S, persistent=True)


def photograph_groups(folder: Path) -> Iterator[float]:
    """Prepare each picture of the groups, wait, and take it; yields the seconds to wait."""
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
    yield from until_drawn()
    photograph(folder / "compositor.jpg")
    view.ui_type = "OUTLINER"
    open_tree(editor, ensure_group(build_group(coloured(OPENED))))
    in_area(editor, bpy.ops.screen.screen_full_area)
    yield SETTLE_S
    in_area(largest("NODE_EDITOR"), bpy.ops.node.view_all)
    yield 4.0
    photograph(folder / "node_group.jpg", "1600x220+0+350")


def photograph_example(folder: Path) -> Iterator[float]:
    """Open the example file, wait, and photograph its view and its nodes; yields the seconds to wait."""
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "out/example/street.blend"))
    yield LIMIT_S  # so long the picture stands still and is not the street's yet, on software GL
    yield from until_drawn()
    photograph(folder / "example.jpg", EXAMPLE_PART)


def photograph_add_on(folder: Path) -> Iterator[float]:
    """Prepare each picture of the add-on, wait, and take it; yields the seconds to wait."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_splash=False)
    noisy_world.register()
    yield SETTLE_S
    scene, view = bpy.context.scene, emptied_view()
    fill_panel(scene, view)
    yield from open_tab(view)
    yield from until_drawn()
    photograph(folder / "add_on_panel.jpg", part_of(view))
    yield from open_tab(view, DATASET)
    yield from until_drawn()
    photograph(folder / "add_on_dataset.jpg", part_of(view))
    yield from open_tab(view)
    look_from_above(view)
    yield from until_drawn()
    photograph(folder / "add_on_paths.jpg", part_of(view))
    panel_of(scene).preview = True
    panel_of(scene).preview_split = 0.5
    scene.frame_set(FRAME)
    yield SETTLE_S
    show_camera(view)
    yield from until_drawn()
    photograph(folder / "add_on_preview.jpg", part_of(view))
    shading_of(space_of(view)).type = "SOLID"
    view.ui_type = "CompositorNodeTree"
    yield SETTLE_S
    open_chain(view, scene.compositing_node_group)
    yield SETTLE_S
    yield from frame_selected(view)
    yield from until_drawn()
    photograph(folder / "add_on_nodes.jpg", part_of(view))
    view.ui_type, whole = "VIEW_3D", part_of(view)
    panel_of(scene).preview_split = 0.0
    yield SETTLE_S
    in_area(view, operators().preview_frame)  # beside what is left of the view
    yield from until_drawn()
    photograph(folder / "add_on_frame.jpg", whole)
    noisy_world.unregister()


def fill(panel: Any, values: Mapping[str, Any]) -> None:
    """Set properties of the panel by their paths."""
    for path, value in values.items():
        owner, _, name = path.rpartition(".")
        setattr(panel.path_resolve(owner) if owner else panel, name, value)


def emptied_view() -> bpy.types.Area:
    """Take Blender's own objects out of the scene; return the view that shows it."""
    for item in list(bpy.context.scene.objects):
        bpy.data.objects.remove(item)
    return largest("VIEW_3D")


def photograph_body(folder: Path) -> Iterator[float]:
    """Load a walker's path with an IMU and a vibration, and photograph both; yields the seconds to wait."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_splash=False)
    noisy_world.register()
    yield SETTLE_S
    scene, view = bpy.context.scene, emptied_view()
    panel = panel_of(scene)
    fill(panel, CARRIED)
    in_area(view, operators().load_scene)
    in_area(view, operators().load_trajectory)
    operators().add_step(perturbation="vibration")
    scene.frame_set(60)
    yield from open_tab(view)
    look_from_above(view, distance_m=3.5)
    space_of(view).overlay.show_extras = False  # the camera's own symbol stands in the way
    yield from until_drawn()
    photograph(folder / "add_on_body.jpg", part_of(view))
    noisy_world.unregister()


def photograph_tracking(folder: Path) -> Iterator[float]:
    """Generate a dataset, run the embedded system on it, and photograph what it found; yields the seconds to wait."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_splash=False)
    noisy_world.register()
    yield SETTLE_S
    scene, view = bpy.context.scene, emptied_view()
    panel = panel_of(scene)
    with tempfile.TemporaryDirectory() as out:
        fill(panel, TRACKED)
        panel.output_folder = out
        in_area(view, operators().load_scene)
        in_area(view, operators().load_trajectory)
        operators().add_step(perturbation=TRACKED_IN)
        operators().generate("EXEC_DEFAULT")
        operators().track("EXEC_DEFAULT")
        yield from open_tab(view, DATASET)
        look_from_above(view, distance_m=4.5)
        space_of(view).overlay.show_extras = False  # the camera and its path's beginning stand in the way
        yield from until_drawn()
        # What the run has to say names folders of this machine.
        photograph(folder / "add_on_tracking.jpg", part_of(view, beside=sidebar(view).width))
    noisy_world.unregister()


def photograph_shots(folder: Path) -> Iterator[float]:
    """Photograph a list of pictures, and a list of shots in the example's street; yields the seconds to wait."""
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "out/example/street.blend"))
    shots.NOISYWORLD_PT_shots.bl_options = set()  # open from the beginning
    noisy_world.register()
    yield SETTLE_S
    scene, view = bpy.context.scene, largest("VIEW_3D")
    in_area(view, bpy.ops.screen.screen_full_area)
    yield SETTLE_S
    view, panel = largest("VIEW_3D"), panel_of(scene)
    panel.mesh_source = "SCENE"
    for name, severity in SHOT_STEPS:
        operators().add_step(perturbation=name)
        panel.steps[panel.active_step].severity = severity
    for name, first, last, seed in SHOTS:
        operators().add_shot()
        shot = panel.shots[-1]
        shot.name, shot.frame_start, shot.frame_end, shot.seed = name, first, last, seed
        shot.output_folder = f"//{name}"
    yield from open_tab(view, DATASET)
    show_camera(view)
    shading = shading_of(space_of(view))
    shading.type, shading.use_compositor, shading.light, shading.color_type = "SOLID", "DISABLED", "STUDIO", "MATERIAL"
    yield from until_drawn()
    photograph(folder / "add_on_shots.jpg", part_of(view))
    with override(window=window(), area=view, region=sidebar(view)):
        bpy.ops.wm.call_panel(name=gallery.POPOVERS["physical"], keep_open=True)
    yield from until_drawn()
    photograph(folder / "add_on_pictures.jpg", "1000x590+0+310")  # where it opens, with the mouse in the corner
    noisy_world.unregister()


def fill_panel(scene: bpy.types.Scene, view: bpy.types.Area) -> None:
    """Load the room and a deviated path, and add perturbations, by the buttons of the panel."""
    panel = panel_of(scene)
    fill(panel, PATH)
    in_area(view, operators().load_all)
    panel.deviation_rotation = math.radians(2.0)
    panel.deviation_translation_m = 0.04
    for name, severity in PREVIEWED:
        operators().add_step(perturbation=name)
        panel.steps[panel.active_step].severity = severity
    use_standard_view(scene)
    for item in scene.objects:
        item.select_set(False)  # no outlines


def open_tab(view: bpy.types.Area, tab: Any = TAB) -> Iterator[float]:
    """Show a tab of the sidebar beside the view, not over it; yields the seconds to wait. tab: the stubs know none."""
    bpy.context.preferences.system.use_region_overlap = False
    space_of(view).show_region_ui = True
    shading_of(space_of(view)).light, shading_of(space_of(view)).color_type = "FLAT", "VERTEX"
    window().cursor_warp(0, 0)  # no tooltips
    yield SETTLE_S
    sidebar(view).active_panel_category = tab
    yield SETTLE_S


def sidebar(area: bpy.types.Area) -> bpy.types.Region:
    """Return an area's sidebar."""
    return next(region for region in area.regions if region.type == "UI")


def look_from_above(view: bpy.types.Area, *, distance_m: float = 6.5) -> None:
    """Look into the room from above, through its ceiling and walls."""
    space = space_of(view)
    space.overlay.show_overlays = True
    shading_of(space).type = "SOLID"
    shading_of(space).show_backface_culling = True
    turned = space.region_3d
    assert turned is not None
    turned.view_perspective = "PERSP"
    turned.view_rotation = Euler((math.radians(38), 0.0, math.radians(25))).to_quaternion()
    turned.view_location = (-0.4, -0.2, 1.3)
    turned.view_distance = distance_m


def open_chain(editor: bpy.types.Area, tree: bpy.types.NodeTree) -> None:
    """Open the preview's group and select the groups of the perturbations in it."""
    open_tree(editor, tree)
    (node,) = (node for node in tree.nodes if isinstance(node, bpy.types.CompositorNodeGroup))
    editor_of(editor).path.append(group_of(node), node=node)
    for inner in group_of(node).nodes:
        inner.select = inner.type == "GROUP"


def frame_selected(editor: bpy.types.Area) -> Iterator[float]:
    """Zoom to the selected nodes with some margin, and deselect them; yields the seconds to wait."""
    in_area(editor, bpy.ops.node.view_selected)
    yield SETTLE_S
    for _ in range(3):
        in_area(editor, bpy.ops.view2d.zoom_out)
    tree = editor_of(editor).edit_tree
    assert tree is not None
    for node in tree.nodes:
        node.select = False


def prepare_scene() -> bpy.types.Scene:
    """Put the demo's room and camera into the scene that the window shows."""
    plan = make_plan(read_preset(DEMO, ["settings=[{name: clean}]"]))
    mesh = kept_room()
    scene = bpy.context.scene
    for item in list(scene.objects):
        bpy.data.objects.remove(item)
    use_standard_view(scene)
    scene.render.engine = "BLENDER_EEVEE"
    add_mesh(scene, mesh, "Room", decoding="shader")
    camera = add_camera(scene, "Camera")
    set_intrinsics(scene, camera, plan.renders[0].camera, near_m=0.01, far_m=100.0, sample_offset_px=0.0)
    key_trajectory(scene, camera, plan.scenes[0].source.trajectory().c2w)
    scene.camera = camera
    scene.frame_set(FRAME)
    return scene


def compositor_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """Chain the groups behind the render, as if they had been dragged in."""
    tree = new_tree("Compositor")
    new_socket(tree, "Image", "NodeSocketColor", output=True)
    node = tree.nodes.new("CompositorNodeRLayers")
    node.location = (-330, 0)
    last = node.outputs["Image"]
    for place, (name, severity) in enumerate(CHAIN):
        perturbation = coloured(name)
        node = new_node(tree, bpy.types.CompositorNodeGroup)
        node.node_tree = ensure_group(build_group(perturbation))
        node.width = group_of(node).default_group_node_width
        node.location = (290 * place, 60)
        set_value(node.inputs["Severity"], severity)
        tree.links.new(last, node.inputs["Image"])
        last = node.outputs["Image"]
    end = tree.nodes.new("NodeGroupOutput")
    end.location = (290 * len(CHAIN), 0)
    tree.links.new(last, end.inputs["Image"])
    for node in tree.nodes:
        node.select = False
    scene.compositing_node_group = tree
    return tree


def operators() -> Any:
    """Return the add-on's operators."""
    return bpy.ops.noisy_world  # pyright: ignore[reportAttributeAccessIssue]  there once the add-on is registered


def coloured(name: str) -> ColourPerturbation:
    """Return a perturbation of colour."""
    perturbation = registry()[name]
    assert isinstance(perturbation, ColourPerturbation)
    return perturbation


# --- blender's window, where a program in it has one: its areas, what they show, and a photograph of them ---


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


def part_of(area: bpy.types.Area, *, beside: int = 0) -> str:
    """Return the part of the display that an area takes, as `photograph` expects it. beside: without so much of it at
    the right, in pixels.
    """
    return f"{area.width - beside}x{area.height}+{area.x}+{window().height - area.y - area.height}"


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


if __name__ == "__main__":
    FOLDER, *NAMES = sys.argv[sys.argv.index("--") + 1 :]
    main(Path(FOLDER).resolve(), NAMES)
