# SPDX-License-Identifier: GPL-3.0-or-later
"""Inspection of a .blend in a process of its own: what one of its scenes holds, as JSON on standard output.

Its request comes as JSON on standard input: file, limit_s (of a processor), scene, camera, frames (first, last, step),
path, lens_given, composited.
"""

import json
import sys
from typing import Any

import bpy
import numpy as np

from ..core.errors import InputError
from ..core.machine import allow_processor, limit_process
from ..core.messages import Action, Message, Remedy, either
from ..core.presets.frame_range import FrameRange
from ..core.scenes.own_scene import OwnScene, Problem, SampledCamera
from ..core.utf8_names import utf8_name
from .own_settings import lacks_denoiser, rendered_layer
from .scene_camera import bound_cameras, camera_alone, sampled_camera
from .scene_files import files_of
from .scene_objects import numbered_objects
from .scene_problems import ENGINES, camera_problems, problems_of, rate_hz
from .scratch_images import muted_output
from .typed import cycles as cycles_of

MARK = "@scene "
SCALE_TOLERANCE = 1e-6  # of Blender's single precision
SPACING_TOLD_M = 1e-5  # of float32 where the camera is; a note says what is coarser


def main() -> None:
    """Answer the request on standard input."""
    asked = json.loads(sys.stdin.read())
    limit_process(asked["limit_s"])
    with muted_output():
        answer = _answer(asked)
    sys.stdout.write(f"{MARK}{json.dumps(answer)}\n")
    sys.stdout.flush()


def _answer(asked: dict[str, Any]) -> dict[str, Any]:
    try:
        open_file(asked["file"])
    except RuntimeError as error:  # Blender reports in this way that it cannot read a file
        return {"unreadable": str(error).strip().splitlines()[-1].removeprefix("Error: ")}
    scene = bpy.context.scene if asked["scene"] is None else bpy.data.scenes.get(asked["scene"])
    if scene is None:
        return {"scenes": sorted(item.name for item in bpy.data.scenes)}
    show_scene(scene)
    chosen = None if asked["frames"] is None else FrameRange(*asked["frames"])
    found = inspect_scene(
        scene,
        asked["camera"],
        chosen,
        path=asked["path"],
        lens_given=asked["lens_given"],
        composited=asked["composited"],
        alone=True,
    )
    return {"found": found.content()}


def open_file(path: str) -> None:
    """Open a .blend without running what it holds. Raises RuntimeError where it is none.

    Raises InputError where a script has overridden the context's scene or view layer: Blender keeps them while it opens
    a file, which removes them, and ends.
    """
    if _is_overridden():
        problem = "cannot be opened while a script overrides the context's scene or view layer"
        raise InputError(path, problem, remedy="leave the with of temp_override first")
    with muted_output():
        bpy.ops.wm.open_mainfile(filepath=utf8_name(path), load_ui=False, use_scripts=False)


def _is_overridden() -> bool:
    """Tell whether the context does not follow its window: it is shown another view layer for a moment."""
    window = bpy.context.window
    if window is None:
        return False
    shown = window.view_layer
    probe = window.scene.view_layers.new("Noisy World probe")
    window.view_layer = probe
    found = bpy.context.view_layer != probe
    window.view_layer = shown
    window.scene.view_layers.remove(probe)
    return found


def show_scene(scene: bpy.types.Scene) -> None:
    """Make a scene the window's."""
    window = bpy.context.window_manager.windows[0]
    if window.scene != scene:
        window.scene = scene


def inspect_scene(
    scene: bpy.types.Scene,
    camera_name: str | None,
    chosen: FrameRange | None,
    *,
    path: bool = True,
    lens_given: bool = False,
    composited: bool = False,
    alone: bool = False,
) -> OwnScene:
    """Return what the window's scene says of itself.

    camera_name: None for the scene's own. chosen: the frames; None for the scene's. path: whether the camera's path is
    asked for, and not only how it sees at the first frame. lens_given: whether the preset gives the intrinsics.
    composited: whether its own compositor is kept.
    alone: whether the file is open for this alone, so that what the camera does not depend on may be taken out.
    """
    files = files_of(scene)
    problems = list(problems_of(scene, files, composited=composited))
    render = scene.render
    frames = chosen or FrameRange(scene.frame_start, max(scene.frame_start, scene.frame_end), scene.frame_step)
    camera = None if camera_name is None else scene.objects.get(camera_name)
    sampled: SampledCamera | None = None
    if (problem := _camera_missing(scene, camera_name, camera, needed=path or not lens_given)) is not None:
        problems.append(problem)
    elif camera is not None or scene.camera is not None:
        if alone:
            camera_alone(scene)
        looked_at = frames.frames if path else frames.frames[:1]
        if alone:
            allow_processor(len(looked_at))
        sampled = sampled_camera(scene, camera, looked_at)
        problems += camera_problems(sampled, lens_given=lens_given)
    return OwnScene(
        scene=scene.name,
        engine=ENGINES.get(render.engine),
        engine_name=render.engine,
        samples=samples_of(scene),
        fps=rate_hz(scene),
        first=frames.first,
        last=frames.last,
        step=frames.step,
        camera=sampled,
        files=tuple(map(str, files.files)),
        problems=tuple(problems),
        notes=tuple(_notes(scene, sampled)),
        objects=numbered_objects(files.blocks),
    )


def samples_of(scene: bpy.types.Scene) -> dict[str, int]:
    """Return the samples that each engine takes for a pixel of a scene."""
    assert scene.eevee is not None
    assert scene.display is not None
    antialiasing = scene.display.render_aa
    return {
        "cycles": rendered_layer(scene).samples or cycles_of(scene).samples,
        "eevee": scene.eevee.taa_render_samples,
        "workbench": 1 if antialiasing in ("OFF", "FXAA") else int(antialiasing),
    }


def _camera_missing(
    scene: bpy.types.Scene, name: str | None, camera: bpy.types.Object | None, *, needed: bool
) -> Problem | None:
    cameras = sorted(item.name for item in scene.objects if item.type == "CAMERA")
    there = ", ".join(cameras) or "none"
    if name is not None and (camera is None or camera.type != "CAMERA"):
        what = "is no camera" if camera is not None else "is not there"
        return Problem("camera", f"{name!r} {what} in the scene {scene.name}", f"its cameras: {there}")
    if needed and name is None and scene.camera is None and not bound_cameras(scene):
        remedy = _name_one_of(there) if cameras else "add one to it"
        return Problem("blend", f"the scene {scene.name} has no camera of its own", remedy)
    if scene.camera is not None and scene.camera.type != "CAMERA" and name is None:
        return Problem("camera", f"{scene.camera.name} is no camera", _name_one_of(there))
    return None


def _name_one_of(cameras: str) -> Remedy:
    return either(Message(Action.NAME_CAMERA, f": {cameras}"))


def scale_note(scene: bpy.types.Scene) -> str:
    """Return what to know of a scene whose unit is no metre; "" of others. Renders and their depth count units."""
    metres = scene.unit_settings.scale_length
    if abs(metres - 1) < SCALE_TOLERANCE:
        return ""
    return (
        f"its unit is {metres:.4g} m (Unit Scale), and counts as 1 m here: path, depth and weather see all of it "
        f"{1 / metres:.4g} times as large; scale it by {metres:.4g}, and set Unit Scale to 1"
    )


def _notes(scene: bpy.types.Scene, sampled: SampledCamera | None) -> list[str]:
    notes = [note for note in (scale_note(scene),) if note]
    layers = [layer.name for layer in scene.view_layers if layer.use]
    if len(layers) > 1:
        notes.append(f"has {len(layers)} view layers; {layers[0]} is rendered (compositor: keep combines them)")
    if scene.render.engine == "CYCLES" and lacks_denoiser(scene):
        notes.append("is to be denoised, but this Blender is built without OpenImageDenoise: colours stay noisy")
    if scene.render.use_border:
        notes.append("has a render region; the whole frame is rendered")
    if scene.display_settings is not None and scene.display_settings.display_device != "sRGB":
        notes.append(f"is shown for a {scene.display_settings.display_device} display, so colours are encoded for that")
    if sampled is not None and len(sampled.matrices):
        far_m = float(np.abs(sampled.matrices[:, :3, 3]).max())
        spacing_m = float(np.spacing(np.float32(far_m)))
        if spacing_m > SPACING_TOLD_M:
            notes.append(
                f"its camera is up to {far_m:.3g} m from the origin, where Blender's numbers are {spacing_m:.1g} m "
                "apart, and depth is no better; move the scene to the origin for more"
            )
    return notes
