# SPDX-License-Identifier: GPL-3.0-or-later
"""Inspection of a .blend in a process of its own: what one of its scenes holds, as JSON on standard output.

Its request comes as JSON on standard input: file, limit_s (of a processor), scene, camera, frames (first, last, step),
path, lens_given, composited, softened.
"""

import json
import math
import sys
from collections.abc import Iterable, Iterator
from typing import Any

import bpy
import numpy as np

from ..core.errors import Action, InputError, Message, Remedy, either
from ..core.file_access import utf8_name
from ..core.machine import allow_processor, limit_process
from ..nodes.datablocks import cycles as cycles_of
from ..nodes.datablocks import muted_output
from ..preset.names import LAST_POSSIBLE, FrameRange
from ..scenes.blend_scene import OwnScene, Problem, SampledCamera
from .engines import NAMES_IN_BLENDER
from .own_view import bound_cameras, camera_alone, lacks_denoiser, numbered_objects, rendered_layer, sampled_camera
from .scene_dependencies import SceneFiles, files_of
from .sun_lamps import not_softened

# Why a scene of one's own cannot become a dataset: what another process would render differently, or not at all.


MOST_NAMED = 5  # of things that a message lists
MOST_NESTED = 200  # chosen: node groups in node groups; Blender and Cycles follow them by recursion


def problems_of(scene: bpy.types.Scene, files: SceneFiles, *, composited: bool = False) -> Iterator[Problem]:
    """Yield what is wrong with a scene, whatever its camera. composited: whether its own compositor is kept."""
    if files.unfit:
        yield Problem("blend", f"refers to what is not read: {_listed(files.unfit)}", "mend these paths or files")
    if not (math.isfinite(rate := rate_hz(scene)) and rate > 0):
        yield Problem("blend", f"has a frame rate of {rate:g} a second", "set it in its output properties")
    if scene.frame_step < 1 or max(map(abs, (scene.frame_start, scene.frame_end))) > LAST_POSSIBLE:
        problem = f"has frames {scene.frame_start} to {scene.frame_end} by {scene.frame_step}, which none can show"
        yield Problem("blend", problem, "set its frame range")
    if composited and (problem := uncomposed(scene.compositing_node_group)):
        yield Problem("compositor", f"is keep, but the scene {scene.name} {problem}", "leave the key out, or mend it")
    if deepest := _deepest_nesting(files.blocks):
        yield Problem("blend", f"nests node groups more than {MOST_NESTED} deep, in {deepest}", "flatten them")
    if files.missing:
        yield Problem("blend", f"misses {_listed(files.missing)}", "put them there, or pack them into the .blend")
    if scripted := sorted(set(_scripted_drivers(files.blocks))):
        problem = f"has drivers that run Python or are broken, and scripts are never run: {_listed(scripted)}"
        yield Problem("blend", problem, "mend them, bake them to keyframes, or mute them")
    if unbaked := sorted(set(_unbaked(scene, files.blocks))):
        problem = f"has simulations that are not baked, and frames are made in any order: {_listed(unbaked)}"
        yield Problem("blend", problem, "bake them, and save the file")
    if scene.render.use_multiview:
        yield Problem("blend", "renders in stereo", "turn Stereoscopy off in its output properties")
    styles = [layer.name for layer in scene.view_layers if layer.use and layer.freestyle_settings.mode == "SCRIPT"]
    if scene.render.use_freestyle and styles:
        yield Problem("blend", "draws lines by Freestyle's scripts, and scripts are never run", "turn Freestyle off")


def camera_problems(sampled: SampledCamera, *, lens_given: bool) -> Iterator[Problem]:
    """Yield what is wrong with a camera that was sampled. lens_given: whether the preset gives the intrinsics."""
    first = sampled.parameters[0]
    for parameters in () if lens_given else sampled.parameters:
        size_px, lens = (parameters.width_px, parameters.height_px), (parameters.fx_px, parameters.fy_px)
        if min(size_px) < 1:
            yield Problem("blend", f"renders images of {size_px[0]} x {size_px[1]} pixels", "raise its resolution")
            return
        if not (np.isfinite(parameters.seen).all() and min(lens) > 0):
            problem = f"{parameters.camera} has a lens that no pinhole has (fx {lens[0]:g}, fy {lens[1]:g} px)"
            yield Problem("camera", problem, either(Action.GIVE_CAMERA, Action.OTHER_CAMERA))
            return
    for parameters in sampled.parameters:
        if parameters.kind != "PERSP":
            kinds = {"ORTHO": "orthographic", "PANO": "panoramic"}
            problem = f"{parameters.camera} is {kinds.get(parameters.kind, 'a camera of a script')}, not perspective"
            yield Problem("camera", problem, either(Action.OTHER_CAMERA, "change its type"))
            return
    if lens_given:
        return
    for frame, parameters in zip(sampled.frames, sampled.parameters, strict=True):
        if parameters.seen != first.seen:
            who = (
                "lens or clipping changes"
                if parameters.camera == first.camera
                else f"{parameters.camera} sees otherwise"
            )
            message = f"{first.camera}'s " if parameters.camera == first.camera else ""
            numbers = f"fx {first.fx_px:.6g} at frame {sampled.frames[0]:g}, {parameters.fx_px:.6g} at frame {frame:g}"
            problem = f"{message}{who} along the path ({numbers}), and a sequence has one camera"
            yield Problem("camera", problem, either(Action.GIVE_CAMERA, Action.OTHER_FRAMES))
            return


def _listed(names: Iterable[str]) -> str:
    names = list(names)
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more


def _scripted_drivers(blocks: Iterable[bpy.types.ID]) -> Iterator[str]:
    for block in blocks:
        for owner in (block, getattr(block, "node_tree", None), getattr(block, "shape_keys", None)):
            data = getattr(owner, "animation_data", None)
            for curve in () if data is None else data.drivers:
                driver = curve.driver
                scripted = driver.type == "SCRIPTED" and not driver.is_simple_expression
                if not curve.mute and (scripted or not driver.is_valid):
                    yield f"{block.name} {curve.data_path}"


def _unbaked(scene: bpy.types.Scene, blocks: Iterable[bpy.types.ID]) -> Iterator[str]:
    if _moves_bodies(scene.rigidbody_world):
        yield "rigid bodies"
    for block in blocks:
        if not isinstance(block, bpy.types.Object):
            continue
        for modifier in block.modifiers:
            if modifier.show_render and _simulates(modifier):
                yield f"{block.name} {modifier.name}"
        for system in block.particle_systems:
            settings = system.settings
            assert settings is not None
            moves = settings.type == "EMITTER" and settings.physics_type != "NO"
            if (moves or (settings.type == "HAIR" and system.use_hair_dynamics)) and not system.point_cache.is_baked:
                yield f"{block.name} {system.name}"


def _moves_bodies(world: bpy.types.RigidBodyWorld | None) -> bool:
    """Tell whether rigid bodies move, and are not baked."""
    if world is None or not world.enabled or world.collection is None or world.point_cache is None:
        return False
    return len(world.collection.all_objects) > 0 and not world.point_cache.is_baked


def _simulates(modifier: bpy.types.Modifier) -> bool:
    """Tell whether a modifier simulates, and is not baked."""
    match modifier:
        case bpy.types.ClothModifier() | bpy.types.SoftBodyModifier():
            return not modifier.point_cache.is_baked
        case bpy.types.DynamicPaintModifier():
            canvas = modifier.canvas_settings
            return canvas is not None and any(
                surface.surface_format != "IMAGE" and not surface.point_cache.is_baked
                for surface in canvas.canvas_surfaces
            )
        case bpy.types.FluidModifier():
            domain = modifier.domain_settings
            return domain is not None and not domain.has_cache_baked_data
        case bpy.types.NodesModifier():
            return modifier.node_group is not None and _has_simulation(modifier.node_group) and not _baked(modifier)
    return False


def _baked(modifier: bpy.types.NodesModifier) -> bool:
    """Tell whether the bakes of a modifier's simulations are on disk or packed."""
    on_disk = [bake for bake in modifier.bakes if bake.bake_mode == "ANIMATION"]
    folders = [bpy.path.abspath(modifier.bake_directory)]
    return bool(on_disk) and any(bake.bake_target == "PACKED" or any(folders) for bake in on_disk)


def _has_simulation(tree: bpy.types.NodeTree) -> bool:
    found = {tree: None}
    for each in (waiting := [tree]):
        if any(node.bl_idname == "GeometryNodeSimulationInput" for node in each.nodes):
            return True
        new = [inner for inner in _groups_in(each) if inner not in found]
        found |= dict.fromkeys(new)
        waiting += new
    return False


def _groups_in(tree: bpy.types.NodeTree) -> list[bpy.types.NodeTree]:
    inner = (getattr(node, "node_tree", None) for node in tree.nodes)
    return list(dict.fromkeys(each for each in inner if each is not None))


def _deepest_nesting(blocks: Iterable[bpy.types.ID]) -> str:
    """Return a node group that nests others more deeply than is followed; "" where none does."""
    depths: dict[bpy.types.NodeTree, int] = {}
    for block in blocks:
        if not isinstance(block, bpy.types.NodeTree):
            continue
        waiting = [block]
        while waiting:
            tree = waiting[-1]
            inner = _groups_in(tree)
            if new := [each for each in inner if each not in depths and each not in waiting]:
                waiting.append(new[0])
                continue
            depths[tree] = 1 + max((depths.get(each, 0) for each in inner), default=0)
            waiting.pop()
    return next((tree.name for tree, depth in depths.items() if depth > MOST_NESTED), "")


def rate_hz(scene: bpy.types.Scene) -> float:
    """Return the frames a second of a scene; infinite where a damaged file divides them by 0."""
    render = scene.render
    return render.fps / render.fps_base if render.fps_base else math.inf


def uncomposed(tree: bpy.types.NodeTree | None) -> str:
    """Return what a scene's compositor lacks to give an image; "" for nothing."""
    if tree is None:
        return "has no compositor"
    ends = [node for node in tree.nodes if isinstance(node, bpy.types.NodeGroupOutput)]
    if not any(socket.is_linked for node in ends for socket in node.inputs):
        return f"has a compositor, {tree.name}, that gives no image: nothing leads to its Group Output"
    return ""


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
        softened=asked["softened"],
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
    softened: bool = False,
    alone: bool = False,
) -> OwnScene:
    """Return what the window's scene says of itself.

    camera_name: None for the scene's own. chosen: the frames; None for the scene's. path: whether the camera's path is
    asked for, and not only how it sees at the first frame. lens_given: whether the preset gives the intrinsics.
    composited: whether its own compositor is kept. softened: whether its sun lamps are.
    alone: whether the file is open for this alone, so that what the camera does not depend on may be taken out.
    """
    files = files_of(scene)
    problems = list(problems_of(scene, files, composited=composited))
    if softened and (problem := not_softened(scene, files.blocks)):
        problems.append(problem)
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
        engine=NAMES_IN_BLENDER.get(render.engine),
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
