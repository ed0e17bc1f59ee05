# SPDX-License-Identifier: GPL-3.0-or-later
"""What an artist does with the add-on, done in a Blender's window: run by a Blender program with simulated events.

    blender --enable-event-simulate -P tests/ui/window/drive.py -- FOLDER [ADD-ON'S FOLDER [PART ...]]

FOLDER holds mesh.ply, a small room, and trajectory.txt, five poses in it. Writes pictures, the preset, the dataset and
result.json there. The add-on is the extension that is installed and not enabled yet, of which leftovers.json tells what
it leaves behind; or the package in the other folder. Without names of parts, all are done.
"""

import json
import math
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import bpy
import driver as at
import leftovers
import numpy as np

FOLDER, *SOURCE = (Path(word) for word in sys.argv[sys.argv.index("--") + 1 :][:2])
PARTS = sys.argv[sys.argv.index("--") + 3 :]
FRAMES = 5
MOVED = 1.0  # of 255, in the mean: what another frame differs by at least
REMARKS: list[str] = []


def steps() -> at.Steps:
    """Go through the sidebar's two tabs."""
    bpy.ops.wm.read_homefile(use_splash=False)
    if SOURCE:
        register_source(SOURCE[0])
    else:
        yield from leftovers.steps()
        (FOLDER / "leftovers.json").write_text(json.dumps(leftovers.SEEN))
        print(leftovers.__doc__)  # what was said before is of that
    system = bpy.context.preferences.system
    system.use_region_overlap = False  # or the room is drawn again wherever the mouse goes
    system.viewport_aa = "OFF"
    yield lambda: hasattr(bpy.context.scene, "noisy_world")
    every = (try_it, empty, load, add_perturbations, preview, look_at_nodes, save, generate, track, this_scene)
    for part in [part for part in every if not PARTS or part.__name__ in PARTS]:
        start_s = time.monotonic()
        yield from part()
        remark(f"{part.__name__}: {time.monotonic() - start_s:.0f} s")


def register_source(folder: Path) -> None:
    """Use the add-on from a checkout, with the packages beside it."""
    sys.path[:0] = [str(folder)]
    sys.path.append(str(folder.parent / ".blender-env" / str(sys.implementation.cache_tag)))
    import noisy_world

    noisy_world.register()


def remark(text: str) -> None:
    """Keep a remark beside the pictures."""
    REMARKS.append(text)
    (FOLDER / "remarks.txt").write_text("\n".join([*REMARKS, ""]), encoding="utf-8")


def settings():
    """Return what the panel holds."""
    return bpy.context.scene.noisy_world


def photograph(name: str) -> at.Steps:
    """Take a picture of the window."""
    yield from at.photograph(FOLDER / f"{name}.png")


def try_it() -> at.Steps:
    """In an unused file open the sidebar, choose the tab and press Try It: fog drifts; then go back."""
    own, objects = bpy.context.scene, list(bpy.context.scene.objects)
    shading = at.view().spaces.active.shading.type
    yield from at.open_sidebar("Noisy World")
    yield from photograph("panel_top")
    began_s = time.process_time()
    yield from at.push("noisy_world.try_it")
    yield lambda: bpy.context.scene != own and bpy.context.scene.compositing_node_group is not None
    frame, first = bpy.context.scene.frame_current, at.look()
    yield lambda: bpy.context.scene.frame_current > frame and np.abs(at.look() - first).mean() > MOVED
    remark(f"fog moves {time.process_time() - began_s:.1f} processor seconds after Try It")
    yield from photograph("tried")
    yield from at.go(*at.middle(at.region("WINDOW")))
    at.press("SPACE")  # a place that is drawn all the time is seldom under the mouse when it is asked for
    yield lambda: not bpy.context.screen.is_animation_playing
    at.STATE["found"] = False
    yield from at.push("noisy_world.back")
    yield lambda: bpy.context.scene == own
    assert (list(own.objects), at.view().spaces.active.shading.type) == (objects, shading)
    assert not settings().steps


def empty() -> at.Steps:
    """Begin anew, with an empty scene, which is loaded into."""
    bpy.ops.wm.read_homefile(use_splash=False)
    yield at.SETTLE_S
    at.STATE["found"] = False
    yield from at.go(*at.middle(at.region("WINDOW")))
    at.press("A")
    at.press("DEL")
    yield lambda: not bpy.data.objects
    yield from at.open_sidebar("Noisy World")


def load() -> at.Steps:
    """Load a room of six walls and a path, let the camera deviate from it, and look at both from above.

    On a processor, drawing the embedded room again and again takes minutes.
    """
    item = settings()
    item.mesh_source, item.of_mesh.mesh = "FILE", str(FOLDER / "mesh.ply")
    item.camera.width, item.camera.height, item.camera.fx, item.camera.fy = 800, 450, 400, 400
    item.camera.cx, item.camera.cy = 399.5, 224.5
    item.trajectory_source, item.scene.trajectory.file = "FILE", str(FOLDER / "trajectory.txt")
    yield from at.push("noisy_world.load_all")
    yield lambda: bpy.context.scene.camera is not None
    assert len(bpy.data.scenes) == 1
    assert bpy.context.scene.frame_end == FRAMES - 1, bpy.context.scene.frame_end
    item.deviation_rotation, item.deviation_translation_m = math.radians(3.0), 0.1
    yield from at.choose_shading("SOLID")
    yield from at.go(*at.middle(at.region("WINDOW")))
    at.press("NUMPAD_7")
    yield from at.still()
    at.press("HOME")
    yield from at.still()
    for _ in range(5):
        at.press("WHEELUPMOUSE")
    yield from at.still()
    yield from photograph("paths")


def add_perturbations() -> at.Steps:
    """Add weak fog and Gaussian noise from the menu."""
    for name, keys in (("fog", "BO"), ("gaussian_noise", "BN")):
        yield from at.look_for("NOISYWORLD_MT_add_step", "remove_step", share=0.9)
        if "remove_step" in at.under_mouse(at.view(), at.region("UI")):  # a menu's button has no name; it is above
            x, y = at.STATE["mouse"]
            yield from at.go(x, y + 21)
        at.press("LEFTMOUSE")
        yield 0.4
        if name == "fog":
            yield from photograph("menu")
        for key in keys:
            at.press(key)
            yield 0.4
        yield lambda name=name: name in [step.perturbation for step in settings().steps]
        yield from at.fill_in("].severity", "1")
        yield lambda: settings().steps[settings().active_step].severity == 1.0
    assert [step.perturbation for step in settings().steps] == ["motion_deviation", "fog", "gaussian_noise"]
    yield from photograph("perturbations")


def preview() -> at.Steps:
    """Look through the camera, with colours as they are written."""
    yield from at.push("noisy_world.preview$")
    assert settings().preview
    yield lambda: bpy.context.scene.compositing_node_group is not None
    yield from at.push("noisy_world.use_standard_view")
    yield lambda: bpy.context.scene.view_settings.view_transform == "Standard"
    yield from at.go(*at.middle(at.region("WINDOW")))
    at.press("NUMPAD_0")
    yield lambda: at.view().spaces.active.region_3d.view_perspective == "CAMERA"
    yield from at.choose_shading("RENDERED")
    yield from photograph("preview")
    yield from at.choose_shading("SOLID")


def look_at_nodes() -> at.Steps:
    """Turn the 3D view into a compositor, look at the preview's group and into it, and turn it back."""
    area = at.view()
    yield from at.go(*at.middle(at.region("WINDOW")))
    for _ in range(8):
        at.press("F3", shift=True)
        yield at.SETTLE_S
        if area.ui_type == "CompositorNodeTree":
            break
    canvas = at.region("WINDOW", area)
    yield from at.go(*at.middle(canvas))
    at.press("HOME")
    yield at.SMOOTH_S
    tree = bpy.context.scene.compositing_node_group
    (group,) = (node for node in tree.nodes if node.type == "GROUP")
    x, y = canvas.view2d.view_to_region(*(bpy.context.preferences.system.ui_scale * part for part in group.location))
    yield from at.click(canvas.x + x + 60, canvas.y + y - 8)  # its head
    yield lambda: tree.nodes.active == group
    yield from photograph("chain")
    for key in ("TAB", "HOME"):
        at.press(key)
        yield at.SMOOTH_S
    yield from photograph("nodes")
    at.press("F5", shift=True)
    yield lambda: area.type == "VIEW_3D"


def save() -> at.Steps:
    """Save the preset in Blender's file browser, and name the dataset's folder in the other tab."""
    at.STATE["found"] = False
    yield from at.push("noisy_world.save_preset", share=0.8)
    yield from at.save_as(FOLDER, "preset.yaml")
    yield (FOLDER / "preset.yaml").is_file
    yield from at.open_sidebar("Noisy Dataset")
    at.STATE["found"] = False
    yield from at.fill_in("noisy_world.output_folder", str(FOLDER / "dataset"))
    yield lambda: Path(settings().output_folder) == FOLDER / "dataset"


def generate() -> at.Steps:
    """Generate, stop with Esc, generate again to the end, and copy the command."""
    name = next(name for name in sys.modules if name.endswith("noisy_world.panel.generating"))
    generating = sys.modules[name]

    def phase() -> str:
        run = generating.run_of(bpy.context.scene)
        return run.background.phase if run else ""

    yield from at.push("noisy_world.generate(")
    yield lambda: phase() in ("running", "failed")
    yield 0.3
    yield from photograph("generating")
    assert not bpy.ops.noisy_world.generate.poll(), phase()
    at.press("ESC")
    yield lambda: phase() in ("stopping", "stopped", "finished")
    remark(f"Esc: {phase()}")
    yield lambda: phase() in ("stopped", "finished")
    assert phase() == "stopped", phase()
    yield from photograph("stopped")
    yield from at.push("noisy_world.generate(")
    yield lambda: phase() in ("finished", "failed")
    yield from at.look_for("noisy_world.copy_command", share=0.3)
    yield from photograph("generated")
    at.press("LEFTMOUSE")
    yield lambda: "generate.py" in bpy.context.window_manager.clipboard
    (FOLDER / "command.txt").write_text(bpy.context.window_manager.clipboard)
    remark(generating.summary(generating.run_of(bpy.context.scene)))
    assert phase() == "finished", REMARKS


def track() -> at.Steps:
    """Run SLAM on what was generated, hide one of the paths, undo and redo, and remove them."""
    name = next(name for name in sys.modules if name.endswith("noisy_world.panel.generating"))
    tracking, drawn = sys.modules[name], sys.modules[name.replace("generating", "drawn_paths")]

    def phase() -> str:
        run = tracking.tracking_of(bpy.context.scene)
        return run.background.phase if run else ""

    def shown() -> list[str]:
        return [item.name for item in drawn.shown(bpy.context.scene)]

    yield from at.push("noisy_world.track(")
    yield lambda: phase() in ("finished", "failed")
    assert phase() == "finished", tracking.summary(tracking.tracking_of(bpy.context.scene))
    yield lambda: len(shown()) == 2
    yield from at.look_for("noisy_world.track_remove")
    yield from photograph("tracked")
    at.press("LEFTMOUSE")
    yield lambda: not shown()
    yield from at.go(*at.middle(at.region("WINDOW")))
    at.press("Z", ctrl=True)
    yield lambda: len(shown()) == 2


def this_scene() -> at.Steps:
    """Make an artist's scene, never saved, and generate it, seen by its own camera and deviated."""
    bpy.ops.wm.read_homefile(use_splash=False, use_empty=False)
    yield at.SETTLE_S
    make_hall(bpy.context.scene)
    at.STATE["found"] = False
    yield from at.open_sidebar("Noisy World")
    item = settings()
    item.mesh_source = "SCENE"
    assert item.trajectory_source == "CAMERA"
    item.scene.name, item.output.image, item.output_folder = "hall", "png", str(FOLDER / "own")
    for name in ("fog_depth", "motion_blur"):
        bpy.ops.noisy_world.add_step(perturbation=name)
    item.deviation_translation_m = 0.05
    yield from at.push("noisy_world.load_trajectory")
    yield lambda: "Noisy World Camera" in bpy.data.objects
    assert bpy.context.scene.camera.name == "Mine"
    bpy.context.scene.frame_set(3)
    yield from at.push("noisy_world.preview_frame")
    yield lambda: "Noisy World Color" in bpy.data.images
    picture = bpy.data.images["Noisy World Color"]
    pixels = np.empty(picture.size[0] * picture.size[1] * 4, np.float32)
    picture.pixels.foreach_get(pixels)
    np.save(FOLDER / "own_preview.npy", pixels.reshape(picture.size[1], picture.size[0], 4)[::-1, :, :3])
    yield from photograph("this_scene")
    assert bpy.ops.noisy_world.save_preset(filepath=str(FOLDER / "own.yaml")) == {"FINISHED"}
    assert (FOLDER / "own.blend").is_file()  # the copy of a file that was never saved
    name = next(name for name in sys.modules if name.endswith("noisy_world.panel.generating"))
    generating = sys.modules[name]
    yield from at.open_sidebar("Noisy Dataset")
    at.STATE["found"] = False
    yield from at.push("noisy_world.generate(")
    yield lambda: generating.run_of(bpy.context.scene).background.phase in ("finished", "failed")
    remark(generating.summary(generating.run_of(bpy.context.scene)))
    assert generating.run_of(bpy.context.scene).background.phase == "finished", REMARKS


def make_hall(scene: bpy.types.Scene) -> None:
    """Put a textured floor, a cube that moves and a camera on a turning parent into the startup file's scene."""
    bpy.ops.mesh.primitive_plane_add(size=8)
    floor, cube = bpy.context.object, bpy.data.objects["Cube"]
    texture = bpy.data.images.new("Grid", 64, 64)
    texture.generated_type = "UV_GRID"
    texture.pack()
    material = bpy.data.materials.new("Floor")
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = texture
    material.node_tree.links.new(node.outputs[0], material.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    floor.data.materials.append(material)
    rig = bpy.data.objects.new("Rig", None)
    scene.collection.objects.link(rig)
    camera = bpy.data.objects["Camera"]
    camera.name, camera.parent = "Mine", rig
    for frame, x, turn in ((1, 0.0, 0.0), (5, 1.0, 0.4)):
        cube.location, rig.rotation_euler.z = (x, 0, 1), turn
        cube.keyframe_insert("location", frame=frame)
        rig.keyframe_insert("rotation_euler", frame=frame)
    scene.render.engine, scene.cycles.samples = "CYCLES", 4
    scene.frame_start, scene.frame_end = 1, 5
    scene.render.resolution_x, scene.render.resolution_y = 160, 90


at.run(steps(), FOLDER / "result.json")
