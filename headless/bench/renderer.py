# SPDX-License-Identifier: GPL-3.0-or-later
"""One preset's renderer in its own process, which carries out the report's orders.

    python headless/bench/renderer.py PRESET.yaml OUT [--all-on]

Reads JSON lines {"do": ..., ...} and answers each with a line `@{...}`. Several such processes wait side by side, and
the report lets them work in turns, so that other load on the machine slows all alike.
"""

import json
import sys
import time
from functools import cache, partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "tests/support")]

FARTHEST_M = 10.0  # what 16-bit depth holds at Replica's scale; the hard cases go beyond
LIBRARIES = ("numpy", "yaml", "cv2", "OpenEXR", "tqdm", "bpy")


def main(preset_path: str, out: str, *flags: str) -> None:
    """Load the preset's first scene and answer."""
    from noisy_world.dataset.dataset_folder import Dataset  # the start is measured
    from noisy_world.dataset.plan import make_plan
    from noisy_world.dataset.rendering import source_paths
    from noisy_world.preset.keys import read_preset

    plan = make_plan(read_preset(Path(preset_path)))
    render = plan.renders[0]
    imported_s = time.perf_counter()
    load_renderer(in_blender=plan.preset.spec.render.in_blender)
    from noisy_world.core.machine import StageTimer
    from noisy_world.dataset.dataset_folder import CompletedImages, FinishedImages
    from noisy_world.dataset.making import FrameWriter
    from noisy_world.dataset.rendering import render_options
    from noisy_world.sources.rendered_mesh import forget_rooms_and_meshes as forget_meshes
    from noisy_world.sources.rendered_mesh import load_mesh
    from noisy_world.sources.renderers import open_session

    blender_s = time.perf_counter() - imported_s
    from noisy_world.dataset.frame import CleanFrame, PlannedFrame, cameras_of

    paths = source_paths(plan, render)
    options = render_options(plan, render, threads=1 if "--one-thread" in flags else 0)
    dataset = Dataset(Path(out), plan.format)
    dataset.open({"bench": preset_path, "sequences": {}}, lambda _: None, overwrite=True)
    with open_session(load_mesh(Path(render.scene.source.location)), "bench", paths, render.camera, options) as session:
        if "--all-on" in flags:
            switch_everything_on()
        forget_meshes()
        loaded_s = time.perf_counter()

        def work(frames: list[int]) -> dict[str, float]:
            """Render and write; return seconds a frame, and those of all processors together."""
            start_s, start_core_s = time.perf_counter(), time.process_time()
            with FrameWriter(
                dataset, render, FinishedImages([CompletedImages(dataset, render)]), StageTimer()
            ) as writer:
                for frame in frames:
                    shown = frame % len(paths)
                    clean = CleanFrame(shown, session.frame(paths.request(shown)))
                    writer.submit(clean, partial(PlannedFrame, clean=cameras_of(render, paths).of_one(clean)))
                writer.drain()
            timer = {"frame_s": time.perf_counter() - start_s, "core_s": time.process_time() - start_core_s}
            return {name: value / len(frames) for name, value in timer.items()}

        first_s = work([0])["frame_s"]
        answer(
            blender_s=blender_s,
            loading_s=loaded_s - imported_s - blender_s,
            first_frame_s=first_s,
            **(inventory() if plan.preset.spec.render.in_blender else memory()),
        )
        for line in sys.stdin:
            order = json.loads(line)
            if order["do"] == "time":
                answer(**work(order["frames"]), **memory())
            elif order["do"] == "rays":
                answer(**bare_rays(render.scene.source, session.origin_m, render.camera, paths, order["frames"]))
            elif order["do"] == "memory":
                answer(**memory())
            elif order["do"] == "frames":
                answer(**save_frames(session, paths, order["frames"], Path(order["to"])))
            elif order["do"] == "analytic":
                answer(**analytic_errors(options))


def load_renderer(*, in_blender: bool) -> None:
    """Import what renders, which is measured apart."""
    if in_blender:
        import noisy_world.render.mesh_session
    else:
        import noisy_world.render.ray_session  # noqa: F401


def bare_rays(source: Any, origin_m: Any, camera: Any, paths: Any, frames: list[int]) -> dict[str, float]:
    """Return the seconds of a processor that embreex takes for a frame's rays: what they meet, and all about it.

    Rays are made before the time is taken.
    """
    import numpy as np

    triangles = triangles_of(source.location, tuple(origin_m))
    spent_s = {"core_s": 0.0, "output_core_s": 0.0}
    for frame in frames:
        c2w = paths.request(frame % len(paths)).rgb_c2w
        directions = (camera.ray_directions() @ c2w[:3, :3].T).reshape(-1, 3).astype(np.float32)
        origins_m = np.full_like(directions, c2w[:3, 3] - origin_m)
        for name, output in (("core_s", False), ("output_core_s", True)):
            start_s = time.process_time()
            triangles.scene.run(origins_m, directions, output=output)
            spent_s[name] += time.process_time() - start_s
    return {name: value / len(frames) for name, value in spent_s.items()}


@cache
def triangles_of(mesh_path: str, origin_m: tuple[float, ...]) -> Any:
    """Return a mesh in embreex."""
    from noisy_world.render.embree import TracedTriangles
    from noisy_world.render.triangles import triangle_corners
    from noisy_world.sources.rendered_mesh import load_mesh

    read = load_mesh(Path(mesh_path))
    vertices_m = (read.vertices_m - origin_m).astype("float32")
    return TracedTriangles(vertices_m, read.corner_vertices[triangle_corners(read, vertices_m)])


def answer(**content: Any) -> None:
    """Send an answer to the report."""
    print("@" + json.dumps(content), flush=True)


def memory() -> dict[str, float]:
    """Return resident memory now and at its peak, bytes."""
    from noisy_world.core.machine import peak_memory_bytes

    pages = int(Path("/proc/self/statm").read_text().split()[1]) if Path("/proc/self/statm").exists() else 0
    return {"peak_bytes": peak_memory_bytes() or 0, "resident_bytes": pages * 4096}


def inventory() -> dict[str, Any]:
    """Return what the scene needs of Blender and what this process has imported."""
    import bpy

    from noisy_world.nodes.datablocks import cycles

    scene = bpy.context.scene
    layer = scene.view_layers[0]
    passes = [name.removeprefix("use_pass_") for name in dir(layer) if name.startswith("use_pass_")]
    lights = [item for item in scene.objects if item.type == "LIGHT"]
    samplers = [material for material in bpy.data.materials if cycles(material).emission_sampling != "NONE"]
    return {
        "passes": [name for name in passes if getattr(layer, f"use_pass_{name}") and "cryptomatte" not in name],
        "lights": len(lights) + len(samplers),
        "bounces": cycles(scene).max_bounces,
        "libraries": [name for name in LIBRARIES if name in sys.modules],
        **memory(),
    }


def switch_everything_on() -> None:
    """Give the scene what a general-purpose set-up has: every geometry pass, a lamp, emission as light, bounces."""
    import bpy

    from noisy_world.nodes.datablocks import cycles

    scene = bpy.context.scene
    layer = scene.view_layers[0]
    for name in (
        "combined",
        "z",
        "normal",
        "position",
        "uv",
        "object_index",
        "material_index",
        "emit",
        "diffuse_color",
    ):
        setattr(layer, f"use_pass_{name}", True)
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SUN"))
    scene.collection.objects.link(lamp)
    for material in bpy.data.materials:
        cycles(material).emission_sampling = "AUTO"
    cycles(scene).max_bounces = 12
    cycles(scene).transparent_max_bounces = 8
    cycles(scene).use_light_tree = True


def save_frames(session: Any, paths: Any, frames: list[int], folder: Path) -> dict[str, Any]:
    """Save frames as float arrays, for the errors; return their files, and rays a pixel where the renderer chose."""
    import numpy as np

    files, rays_per_px = [], []
    for frame in frames:
        done = session.frame(paths.request(frame))
        path = folder / f"{frame}.npz"
        np.savez(path, rgb=done.rgb, depth_m=done.depth_m)
        files.append(str(path))
        if done.colour_rays is not None and done.rgb is not None:
            rays_per_px.append(done.colour_rays / done.rgb[..., 0].size)
    return {"files": files, "rays_per_px": float(np.mean(rays_per_px)) if rays_per_px else None}


def analytic_errors(options: Any) -> dict[str, dict[str, float]]:
    """Render surfaces of known depth; return their relative errors, off edges (largest, 99 %) and at them."""
    import numpy as np

    from analytic import CAMERAS, box_depth, box_mesh, look_at, plane_depth, plane_mesh, sphere_depth, sphere_mesh
    from noisy_world.core.frame_request import SensorPaths
    from noisy_world.core.trajectory import evenly_stamped
    from noisy_world.sources.renderers import open_session

    camera = CAMERAS["fx above fy"]
    eye = look_at([0.2, -0.1, 0.3], [1.0, 0.4, 0.2])
    normal = np.array([-2.0, 0.5, 0.4]) / np.linalg.norm([-2.0, 0.5, 0.4])
    point, centre = np.array([2.0, 0.3, 0.1]), np.array([3.0, 0.8, 0.2])
    low, high = np.array([-1.5, -2.0, -1.0]), np.array([3.5, 2.5, 1.5])
    plane_m = plane_depth(camera, eye, point, normal)
    scenes = {
        "plane": (plane_mesh(point, normal, 20.0), plane_m, plane_m < FARTHEST_M),
        "sphere": (sphere_mesh(centre, 1.0, 2000), *sphere_depth(camera, eye, centre, 1.0)),
        "box": (box_mesh(low, high), *box_depth(camera, eye, low, high)),
    }
    errors = {}
    still = SensorPaths(evenly_stamped(eye[None]))
    for name, (mesh, true_m, sure) in scenes.items():
        with open_session(mesh, name, still, camera, options) as session:
            depth_m = session.frame(still.request(0)).depth_m
        assert depth_m is not None
        both = np.isfinite(true_m) & (depth_m > 0)
        error = np.abs(np.where(both, depth_m, 1.0) / np.where(both, true_m, 1.0) - 1)
        off, at = error[sure & both], error[~sure & both]
        errors[name] = {
            "max": float(off.max()),
            "p99": float(np.quantile(off, 0.99)),
            "edge_max": float(at.max()) if at.size else 0.0,
            "missed": int((sure & ~both).sum()),
        }
    return errors


if __name__ == "__main__":
    main(*sys.argv[1:])
