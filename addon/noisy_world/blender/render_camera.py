# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera that looks at a scene of one's own: a copy of the artist's, put where the path says."""

from collections.abc import Mapping

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..core.geometry import Intrinsics, blender_from_opencv_c2w
from ..core.planning.source import RenderOptions
from .camera import SENSOR_WIDTH_MM, add_camera, place_camera, set_intrinsics
from .own_settings import free_of_animation
from .typed import camera_of

PLACED = ("lens", "sensor_width", "sensor_height", "sensor_fit", "shift_x", "shift_y", "clip_start", "clip_end", "type")


class RenderCamera:
    """A camera of a scene that sees with given intrinsics, and otherwise as an artist's camera does."""

    def __init__(
        self,
        scene: bpy.types.Scene,
        model: bpy.types.Object | None,
        intrinsics: Intrinsics,
        options: RenderOptions,
        *,
        lens_given: bool,
        sample_offset_px: float,
        sharp: bool,
        image_width_px: int | None = None,
    ) -> None:
        """Add the camera.

        model: the artist's camera; None for a plain one. lens_given: whether the intrinsics are the preset's, rather
        than the model's own. sharp: whether everything is in focus, as for depth. image_width_px: of the image, where
        the intrinsics are those of a pinhole that sees more than it, and the sensor is so much wider.
        """
        self._scene = scene
        self._model = model
        self.camera = add_camera(scene, "Noisy World camera")
        sensor_mm, blurred = SENSOR_WIDTH_MM, False
        if model is not None:
            own = camera_of(model)
            # The lens stays, as the blur out of focus depends on it; the sensor's width follows.
            wider = 1.0 if image_width_px is None else intrinsics.width_px / image_width_px
            sensor_mm = own.sensor_width * wider if lens_given else own.lens * intrinsics.width_px / intrinsics.fx_px
            self.camera.data = own.copy()
            free_of_animation(camera_of(self.camera), PLACED)
            blurred = own.dof is not None and own.dof.use_dof and not sharp
        set_intrinsics(
            scene,
            self.camera,
            intrinsics,
            near_m=options.near_m,
            far_m=options.far_m,
            sample_offset_px=sample_offset_px,
            sensor_width_mm=sensor_mm,
            blurred=blurred,
        )

    def place(self, c2w: NDArray[np.float64]) -> None:
        """Look from a pose (4, 4), camera-to-world with OpenCV axes, metres."""
        place_camera(self._scene, self.camera, c2w)
        self._be_scenes()

    def move(self, poses: Mapping[float, NDArray[np.float64]]) -> None:
        """Look from poses (4, 4) at frames of the scene, from one to the next."""
        self.camera.animation_data_clear()
        self.camera.rotation_mode = "QUATERNION"
        for frame, c2w in poses.items():
            matrix = Matrix(blender_from_opencv_c2w(c2w).tolist())
            self.camera.location, self.camera.rotation_quaternion = matrix.to_translation(), matrix.to_quaternion()
            for path in ("location", "rotation_quaternion"):
                self.camera.keyframe_insert(path, frame=frame)
        self._be_scenes()

    def follow(self, c2w: NDArray[np.float64]) -> None:
        """Look from a pose at the frame that the scene shows, and move as the artist's camera does around it."""
        assert self._model is not None
        layer = self._scene.view_layers[0]
        if self.camera.parent != self._model:
            self.camera.parent = self._model
            self.camera.matrix_parent_inverse = Matrix.Identity(4)
            layer.update()  # only from now on is a model evaluated that the view layer leaves out
        assert layer.depsgraph is not None
        under = np.array(self._model.evaluated_get(layer.depsgraph).matrix_world, dtype=np.float64)
        self.camera.matrix_basis = Matrix((np.linalg.inv(under) @ blender_from_opencv_c2w(c2w)).tolist())
        self._be_scenes()

    def _be_scenes(self) -> None:
        if self._scene.camera != self.camera:  # setting it, even to what it is, makes Cycles take the scene over again
            self._scene.camera = self.camera
