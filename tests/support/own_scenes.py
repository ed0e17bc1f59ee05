# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of one's own, small ones, and a caster of rays in float64 that knows none of the program."""

import math
from contextlib import closing, contextmanager

import bpy
import cv2
import numpy as np

from noisy_world.render.own_scene import OwnSceneFile, OwnSceneSession
from noisy_world.nodes.datablocks import muted_output
from noisy_world.render.scene_inspection import inspect_scene, open_file
from noisy_world.render.source import RenderOptions
from noisy_world.core.schema import ConfigPath
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import Trajectory
from noisy_world.sources.lit_scene import rigid_c2w

LAST = 6  # frame; the first is 1


def new_scene(samples=2):
    """A lit room's wall, a ball that moves, and a camera on a parent that moves and turns."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 48, 36
    scene.render.engine = "CYCLES"
    scene.render.fps = 25
    scene.cycles.samples = samples
    scene.frame_start, scene.frame_end = 1, LAST
    bpy.ops.mesh.primitive_plane_add(size=6, location=(0, 4, 0), rotation=(math.pi / 2, 0, 0))
    bpy.context.object.name = "Wall"
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.5, segments=16, ring_count=8, location=(-0.5, 2.5, 0))
    ball = bpy.context.object
    ball.name = "Ball"
    key(ball, "location", {1: (-0.5, 2.5, 0), LAST: (0.7, 2.5, 0)})
    bpy.ops.object.light_add(type="AREA", location=(0, 0, 2))
    bpy.context.object.data.energy = 200
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    rig = bpy.data.objects.new("Rig", None)
    scene.collection.objects.link(camera)
    scene.collection.objects.link(rig)
    scene.camera = camera
    camera.rotation_euler = (math.pi / 2, 0, 0)
    camera.location = (0.1, 0.2, 0.05)
    camera.data.shift_x = 0.05
    camera.parent = rig
    rig.scale = (2, 2, 2)
    key(rig, "location", {1: (0, 0, 0), LAST: (0.3, -0.2, 0.1)})
    key(rig, "rotation_euler", {1: (0, 0, 0), LAST: (0.05, 0.1, 0.2)})
    return scene


def key(item, path, values):
    """Key a property, with straight lines between."""
    for frame, value in values.items():
        setattr(item, path, value)
        item.keyframe_insert(path, frame=frame)
    for layer in item.animation_data.action.layers:
        for strip in layer.strips:
            for bag in strip.channelbags:
                for curve in bag.fcurves:
                    for point in curve.keyframe_points:
                        point.interpolation = "LINEAR"


def save(folder, name="hall"):
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.blend"
    with muted_output():
        bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    return path


@contextmanager
def opened(
    path,
    *,
    rgb=True,
    depth=True,
    others=(),
    stamps_s=None,
    depth_alpha=0.5,
    keep=False,
    through_glass=False,
    camera=None,
    sun_air=None,
    mirrors=False,
):
    """The session of a .blend along its own camera's path, or a named one's; also the path and the intrinsics.

    stamps_s: instead of the scene's frames, moments after the first one.
    """
    open_file(str(path))
    found = inspect_scene(bpy.context.scene, camera, None, alone=True)
    assert not found.problems
    sampled, parameters = found.camera, found.camera_parameters
    c2w, frames = rigid_c2w(sampled.matrices, ConfigPath("preset.yaml")), np.array(sampled.frames)
    if stamps_s is not None:
        c2w, frames = c2w[: len(stamps_s)], 1 + np.array(stamps_s) * found.fps
    paths = SensorPaths(Trajectory(c2w, (frames - frames[0]) / found.fps))
    options = RenderOptions(
        near_m=parameters.near_m,
        far_m=parameters.far_m,
        samples=found.samples["cycles"],
        seed=0,
        through_glass=through_glass,
        channels=frozenset({name for name, on in (("rgb", rgb), ("depth", depth)) if on}).union(others),
    )
    file = OwnSceneFile(
        path=path,
        scene=found.scene,
        frames=tuple(frames.tolist()),
        stamps_s=tuple(paths.rgb.stamps_s.tolist()),
        fps=found.fps,
        cameras=tuple(item.camera for item in sampled.parameters)[: len(frames)],
        follows=stamps_s is None,
        lens_given=False,
        sampled=False,
        keep_compositor=keep,
        depth_alpha=depth_alpha,
        sun_air=sun_air,
        mirrors=mirrors,
    )
    with closing(OwnSceneSession(file, paths, parameters.intrinsics, options)) as session:
        yield session, paths, parameters.intrinsics


def evaluated_triangles(frame, leave_out=()):
    """Triangles (N, 3, 3) of all meshes at a frame of the open scene, in float64 from their vertices on."""
    scene = bpy.context.scene
    whole = math.floor(frame)
    scene.frame_set(whole, subframe=frame - whole)
    found = []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        item = instance.object
        if item.type != "MESH" or item.name in leave_out:
            continue
        mesh = item.to_mesh()
        mesh.calc_loop_triangles()
        world = np.array(instance.matrix_world, dtype=np.float64)
        vertices = np.array([vertex.co for vertex in mesh.vertices], dtype=np.float64)
        vertices = vertices @ world[:3, :3].T + world[:3, 3]
        found.append(vertices[np.array([triangle.vertices for triangle in mesh.loop_triangles])])
    return np.concatenate(found)


def cast(triangles, c2w, camera):
    """Planar depth (H, W) of triangles by Moeller and Trumbore's test in float64; 0 where there is none."""
    rays = camera.ray_directions().reshape(-1, 3) @ c2w[:3, :3].T
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    away = c2w[:3, 3] - triangles[:, 0]
    nearest = np.full(len(rays), np.inf)
    turned = np.cross(away, first)
    for start in range(0, len(rays), 256):
        part = rays[start : start + 256, None]
        crossed = np.cross(part, second[None])
        with np.errstate(all="ignore"):
            scale = 1.0 / (first * crossed).sum(-1)
            u = (away * crossed).sum(-1) * scale
            v = (part * turned).sum(-1) * scale
            depth = (second * turned).sum(-1) * scale
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (depth > 1e-6)
        nearest[start : start + 256] = np.where(hit, depth, np.inf).min(1)
    image = nearest.reshape(camera.height_px, camera.width_px)
    return np.where(np.isfinite(image), image, 0.0)


def relative_errors(depth_m, true_m):
    """Relative errors of depth where it does not jump within a pixel."""
    smooth = cv2.dilate(true_m, np.ones((3, 3))) - cv2.erode(true_m, np.ones((3, 3))) < 0.2
    chosen = smooth & (true_m > 0)
    assert chosen.mean() > 0.5
    return np.abs(depth_m - true_m)[chosen] / true_m[chosen]
