# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera of a scene of one's own: sampled frame by frame, through its parents, constraints and drivers.

Nothing here changes what is open, but for the frame, which is given back.
"""

from collections.abc import Iterable
from operator import itemgetter

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.scenes.own_scene import CameraParameters, SampledCamera
from .typed import camera_of


def sampled_camera(scene: bpy.types.Scene, camera: bpy.types.Object | None, frames: Iterable[float]) -> SampledCamera:
    """Return a camera at some frames of a scene, which has to be a window's or have a view layer that is evaluated.

    camera: None for the scene's own, which markers may switch. Another one is made the scene's for each frame, as
    Blender evaluates what a view layer leaves out for the scene's camera and those of markers alone. The scene shows
    its own frame again in the end, and looks through its own camera.
    """
    asked = tuple(frames)
    before = (scene.frame_current, scene.frame_subframe, scene.camera)
    matrices, parameters = [], []
    try:
        for frame in asked:
            if camera is not None and scene.camera != camera:  # a marker may have switched it at the frame before
                scene.camera = camera
            show_frame(scene, frame)
            seen_by = camera or scene.camera
            assert seen_by is not None, "the scene has a camera"
            evaluated = seen_by.evaluated_get(_evaluated(scene))
            matrices.append(np.array(evaluated.matrix_world, dtype=np.float64))
            parameters.append(camera_parameters(scene, evaluated))
    finally:
        scene.frame_set(before[0], subframe=before[1])
        if scene.camera != before[2]:
            scene.camera = before[2]
    return SampledCamera(asked, np.array(matrices).reshape(-1, 4, 4), tuple(parameters))


def bound_cameras(scene: bpy.types.Scene) -> list[tuple[int, bpy.types.Object]]:
    """Return the cameras that the scene's markers bind, with the frames from which on, in their order.

    As in Blender, one that is not rendered binds nothing.
    """
    bound = ((marker.frame, marker.camera) for marker in scene.timeline_markers)
    return sorted(((at, item) for at, item in bound if item is not None and not item.hide_render), key=itemgetter(0))


def shots_at(scene: bpy.types.Scene, frames: Iterable[float]) -> NDArray[np.int64] | None:
    """Return the number of the bound camera that takes each frame (N,); None where markers bind fewer than two.

    Before the first marker the scene looks through its camera already, as in Blender.
    """
    bound = bound_cameras(scene)
    order = {item.name: number for number, item in enumerate(dict.fromkeys(item for _, item in bound))}
    if len(order) < 2:
        return None
    rows = np.searchsorted([frame for frame, _ in bound], list(frames), side="right") - 1
    return np.array([order[bound[max(row, 0)][1].name] for row in rows.tolist()], dtype=np.int64)


def show_frame(scene: bpy.types.Scene, frame: float) -> None:
    """Show a frame of a scene; between two whole ones, too."""
    whole = int(np.floor(frame))
    scene.frame_set(whole, subframe=float(frame) - whole)


def _evaluated(scene: bpy.types.Scene) -> bpy.types.Depsgraph:
    graph = scene.view_layers[0].depsgraph
    assert graph is not None
    return graph


@np.errstate(divide="ignore", invalid="ignore")
def camera_parameters(scene: bpy.types.Scene, camera: bpy.types.Object) -> CameraParameters:
    """Return how a camera sees in a scene's image, by Blender's own rule.

    The sensor's size is measured along the image's longer side, in units of square pixels, unless its fit says along
    which; an automatic fit takes the sensor's width along either. The shift is in units of that side.
    """
    data, render = camera_of(camera), scene.render
    width_px = render.resolution_x * render.resolution_percentage // 100
    height_px = render.resolution_y * render.resolution_percentage // 100
    # In numpy's numbers, as damaged files have zeros that no field takes; how much higher than wide a pixel is.
    aspect = float(np.float64(render.pixel_aspect_y) / render.pixel_aspect_x)
    wide = data.sensor_fit == "HORIZONTAL" or (data.sensor_fit == "AUTO" and width_px >= aspect * height_px)
    sensor_mm = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    side_px = width_px if wide else aspect * height_px
    fx_px = float(np.float64(data.lens * side_px) / sensor_mm)
    return CameraParameters(
        camera=camera.name,
        kind=data.type,
        width_px=width_px,
        height_px=height_px,
        fx_px=fx_px,
        fy_px=float(np.float64(fx_px) / aspect),
        cx_px=(width_px - 1) / 2 - data.shift_x * side_px,
        cy_px=(height_px - 1) / 2 + float(np.float64(data.shift_y * side_px) / aspect),
        near_m=data.clip_start,
        far_m=data.clip_end,
    )


def camera_alone(scene: bpy.types.Scene) -> None:
    """Take out of a scene what its cameras do not depend on, so that a frame is shown at once.

    A scene whose rigid bodies move keeps all, as they push each other.
    """
    if scene.rigidbody_world is not None:
        return
    for layer in scene.view_layers:
        root = layer.layer_collection
        assert root is not None
        for child in root.children:
            child.exclude = True
    for item in scene.collection.objects:
        if item.type != "CAMERA":
            item.hide_viewport = True
