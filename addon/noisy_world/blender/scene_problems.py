# SPDX-License-Identifier: GPL-3.0-or-later
"""Why a scene of one's own cannot become a dataset: what another process would render differently, or not at all."""

import math
from collections.abc import Iterable, Iterator

import bpy
import numpy as np

from ..core.messages import Action, either
from ..core.presets.frame_range import LAST_POSSIBLE
from ..core.scenes.own_scene import BlenderEngine, Problem, SampledCamera
from .scene_files import SceneFiles

MOST_NAMED = 5  # of things that a message lists
MOST_NESTED = 200  # chosen: node groups in node groups; Blender and Cycles follow them by recursion
ENGINES: dict[str, BlenderEngine] = {"CYCLES": "cycles", "BLENDER_EEVEE": "eevee", "BLENDER_WORKBENCH": "workbench"}


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
