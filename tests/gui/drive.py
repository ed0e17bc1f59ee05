# SPDX-License-Identifier: GPL-3.0-or-later
"""What an artist does with the add-on, done in a Blender's window: run by a Blender program with simulated events.

    blender --enable-event-simulate -P tests/gui/drive.py -- FOLDER [ADD-ON'S FOLDER]

Writes pictures, the preset, the dataset and result.json to FOLDER. The add-on is the extension that is installed, or
the package in the other folder.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import bpy
import driver as at

FOLDER, *SOURCE = (Path(word) for word in sys.argv[sys.argv.index("--") + 1 :])
FRAMES = 5
SIZE = {"width_px": 160, "height_px": 96, "fx_px": 80.0, "fy_px": 80.0, "cx_px": 79.5, "cy_px": 47.5}


def steps() -> at.Steps:
    """Go through the sidebar from top to bottom."""
    if SOURCE:
        register_source(SOURCE[0])
    bpy.ops.wm.read_homefile(use_splash=False)
    yield lambda: hasattr(bpy.context.scene, "noisy_world")
    yield 1.0
    whole = at.region("WINDOW")
    yield from at.go(whole.x + whole.width // 2, whole.y + whole.height // 2)
    at.press("A")
    at.press("DEL")
    yield lambda: not bpy.data.objects
    yield from at.open_sidebar("Noisy World")
    yield from photograph("panel_top")
    yield from make_scene()
    yield from add_perturbations()
    yield from preview()
    yield from save()
    yield from generate()


def register_source(folder: Path) -> None:
    """Use the add-on from a checkout, with the packages beside it."""
    sys.path[:0] = [str(folder)]
    sys.path.append(str(folder.parent / ".blender-env" / str(sys.implementation.cache_tag)))
    import noisy_world

    noisy_world.register()


def settings():
    """Return what the panel holds."""
    return bpy.context.scene.noisy_world


def photograph(name: str) -> at.Steps:
    """Take a picture of the window."""
    yield from at.photograph(FOLDER / f"{name}.png")


def make_scene() -> at.Steps:
    """Load the room, a path through it, and let the camera deviate from it."""
    # The section is closed at first, and what opens it has no name under the mouse.
    for name, value in SIZE.items():
        setattr(settings(), name, value)
    settings().image = "png"
    settings().output_folder = str(FOLDER / "dataset")
    yield from at.push("noisy_world.load_scene")
    yield lambda: any(item.type == "MESH" for item in bpy.data.objects)
    yield from at.fill_in("noisy_world.handheld_frames", str(FRAMES))
    assert settings().handheld_frames == FRAMES, settings().handheld_frames
    yield from at.push("noisy_world.load_trajectory")
    yield lambda: bpy.context.scene.camera is not None
    assert bpy.context.scene.frame_end == FRAMES - 1, bpy.context.scene.frame_end
    yield from at.fill_in("noisy_world.deviation_rotation_deg", "3")
    assert settings().deviation_rotation_deg == 3.0, settings().deviation_rotation_deg
    yield from at.fill_in("noisy_world.deviation_translation_m", "0.1")
    whole = at.region("WINDOW")
    yield from at.go(whole.x + whole.width // 3, whole.y + whole.height // 2)
    at.press("HOME")
    yield 2.0
    yield from photograph("paths")


def add_perturbations() -> at.Steps:
    """Add fog and Gaussian noise from the menu."""
    for name, keys in (("fog", "EF"), ("gaussian_noise", "SG")):
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
            yield 0.3
        if name not in [step.perturbation for step in settings().steps]:
            at.press("ESC")
            at.press("ESC")
            yield 0.3
            REMARKS.append(f"{name}: the menu's keys did not add it")
            bpy.ops.noisy_world.add_step("INVOKE_DEFAULT", perturbation=name)
        assert name in [step.perturbation for step in settings().steps]
    yield from photograph("perturbations")


def preview() -> at.Steps:
    """Look through the camera, live."""
    yield from at.push("noisy_world.preview")
    assert settings().preview
    yield lambda: bpy.context.scene.compositing_node_group is not None
    whole = at.region("WINDOW")
    yield from at.go(whole.x + whole.width // 3, whole.y + whole.height // 2)
    at.press("NUMPAD_0")
    yield 0.5
    shading = at.view().spaces.active.shading
    shading.type = "RENDERED"
    yield 40.0  # software GL compiles its shaders, and nothing tells when it has
    yield from photograph("preview")
    shading.type = "SOLID"


def save() -> at.Steps:
    """Save the preset: in the file browser events do not reach the name."""
    bpy.ops.noisy_world.save_preset(filepath=str(FOLDER / "preset.yaml"))
    yield (FOLDER / "preset.yaml").is_file


def generate() -> at.Steps:
    """Generate, stop with Esc, generate again to the end."""
    name = next(name for name in sys.modules if name.endswith("noisy_world.ui.generate"))
    generating = sys.modules[name]

    def phase() -> str:
        run = generating.run_of(bpy.context.scene)
        return run.background.phase if run else ""

    def at_work() -> bool:
        return phase() in ("running", "failed")

    yield from at.push("noisy_world.generate(")
    yield at_work
    yield 0.3
    yield from photograph("generating")
    assert not bpy.ops.noisy_world.generate.poll(), phase()
    at.press("ESC")
    yield lambda: phase() in ("stopping", "stopped", "finished")
    REMARKS.append(f"Esc: {phase()}")
    yield lambda: phase() in ("stopped", "finished")
    assert phase() == "stopped", phase()
    yield from photograph("stopped")
    yield from at.push("noisy_world.generate(")
    yield lambda: phase() in ("finished", "failed")
    yield from at.look_for("noisy_world.copy_command")
    yield from photograph("generated")
    at.press("LEFTMOUSE")
    yield 0.3
    (FOLDER / "command.txt").write_text(bpy.context.window_manager.clipboard)
    REMARKS.append(generating.summary(generating.run_of(bpy.context.scene)))
    (FOLDER / "remarks.txt").write_text("\n".join(REMARKS), encoding="utf-8")
    assert phase() == "finished", REMARKS


REMARKS: list[str] = []

at.run(steps(), FOLDER / "result.json")
