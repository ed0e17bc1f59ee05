# SPDX-License-Identifier: GPL-3.0-or-later
"""Why a scene of one's own cannot become a dataset: what another process would render differently, or not at all."""

from collections.abc import Iterable, Iterator

import bpy

from ..core.messages import Action, either
from ..core.presets.preset import EngineName
from ..core.scenes.own_scene import Problem, SampledCamera
from .scene_files import SceneFiles

MOST_NAMED = 5  # of things that a message lists
ENGINES: dict[str, EngineName] = {"CYCLES": "cycles", "BLENDER_EEVEE": "eevee", "BLENDER_WORKBENCH": "workbench"}


def problems_of(scene: bpy.types.Scene, files: SceneFiles) -> Iterator[Problem]:
    """Yield what is wrong with a scene, whatever its camera."""
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
    for node in tree.nodes:
        if node.bl_idname == "GeometryNodeSimulationInput":
            return True
        inner = getattr(node, "node_tree", None)
        if inner is not None and _has_simulation(inner):
            return True
    return False
