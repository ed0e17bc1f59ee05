# SPDX-License-Identifier: GPL-3.0-or-later
"""What an entry that is added to the list begins with: by the entries there are, and by how far the camera sees."""

from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from ..core.schema import ConfigPath, parse
from ..perturbations import registry
from ..perturbations.new_steps import new_step
from .properties import parameters_of, perturbation_of
from .tree import set_value, take, taking

RAYS = (16, 10)  # across and down: enough to tell a room from a street; chosen


def begin(panel: Any, index: int) -> tuple[str, ...]:
    """Let an entry that was just added begin as a new step does; return what is to be said about it."""
    item = panel.steps[index]
    perturbation = perturbation_of(item)
    others = [registry()[each.perturbation] for k, each in enumerate(panel.steps) if k != index]
    depth_m = None if perturbation.by_depth is None else seen_depth_m(panel.id_data)
    made = new_step(perturbation, others, depth_m)
    with taking():
        if made.severity is not None:
            set_value(item, "severity", made.severity)
        place = ConfigPath(perturbation.name)
        take(parameters_of(item), parse(perturbation.parameters, made.given, place), made.given)
    return made.says


def seen_depth_m(scene: bpy.types.Scene) -> NDArray[np.float32] | None:
    """Return the planar depth that some rays of the scene's camera meet, metres, 0 = void; None without a camera."""
    camera = scene.camera
    if camera is None or not isinstance(camera.data, bpy.types.Camera):
        return None
    seen_from = bpy.context.evaluated_depsgraph_get()
    corners = [np.array(corner) for corner in camera.data.view_frame(scene=scene)]
    right_top, right_low, left_low, left_top = corners
    pose = np.array(camera.evaluated_get(seen_from).matrix_world)
    depth_m = np.zeros(RAYS[::-1], np.float32)
    for row, down in enumerate((np.arange(RAYS[1]) + 0.5) / RAYS[1]):
        for column, across in enumerate((np.arange(RAYS[0]) + 0.5) / RAYS[0]):
            top, low = left_top + across * (right_top - left_top), left_low + across * (right_low - left_low)
            own = top + down * (low - top)
            toward = pose[:3, :3] @ own
            toward /= np.linalg.norm(toward)
            met, place, *_ = scene.ray_cast(seen_from, Vector(pose[:3, 3].tolist()), Vector(toward.tolist()))
            if met:
                depth_m[row, column] = -(np.linalg.inv(pose) @ [*place, 1.0])[2]
    return depth_m
