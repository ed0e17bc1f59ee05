# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour as a scene of one's own is shown: view transform, look, exposure and curves, as Blender applies them."""

from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.datasets.image_reading import read_pixels
from ..core.errors import StorageError
from ..core.utf8_names import utf8_name
from .scratch_images import muted_output
from .typed import set_pixels

VIEW_VALUES = ("view_transform", "look", "exposure", "gamma", "use_curve_mapping", "use_white_balance")
WHITE_VALUES = ("white_balance_temperature", "white_balance_tint")


class ShownColour:
    """Encodes linear light for a scene's display, by saving it as an image of 16 bits.

    Blender has no other way to do that without a window. 16 bits are 1/257 of a step of 8 bits apart, so an image that
    is rounded to 8 bits afterwards differs from Blender's own at ties alone.
    """

    def __init__(self, scene: bpy.types.Scene, size_px: tuple[int, int], folder: Path) -> None:
        """Prepare. size_px: width, height. folder: where the file is written."""
        self._scene = scene
        self._path = folder / "colour.png"
        self._writer = scene.copy()  # a scene's view settings cannot be copied by themselves
        for child in list(self._writer.collection.children):
            self._writer.collection.children.unlink(child)
        for item in list(self._writer.collection.objects):
            self._writer.collection.objects.unlink(item)
        settings = self._writer.render.image_settings
        settings.media_type = "IMAGE"
        settings.file_format = "PNG"
        settings.color_mode = "RGB"
        settings.color_depth = "16"
        settings.compression = 0
        settings.color_management = "FOLLOW_SCENE"
        self._image = bpy.data.images.new("Noisy World colour", *size_px, alpha=True, float_buffer=True)
        self._image.alpha_mode = "PREMUL"

    def encode(self, rgba: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return linear light (H, W, 4), its colour multiplied by alpha, as display values (H, W, 3) in [0, 1].

        Raises StorageError where the scratch file could not be written.
        """
        import cv2  # needed only for rendering

        if self._scene.animation_data is not None:  # exposure, for instance, may be keyed
            self._follow()
        set_pixels(self._image, np.ascontiguousarray(rgba[::-1]))
        self._path.unlink(missing_ok=True)
        try:
            with muted_output():
                self._image.save_render(utf8_name(self._path), scene=self._writer)
        except RuntimeError as error:
            raise StorageError(f"Blender could not write its scratch file: {error}", file=self._path) from error
        bgr = read_pixels(self._path, cv2.IMREAD_UNCHANGED)
        if bgr is None or bgr.dtype != np.uint16:
            raise StorageError("Blender's scratch file is cut short or damaged", file=self._path)
        return np.ascontiguousarray(bgr[..., ::-1]).astype(np.float32) / np.float32(65535)

    def _follow(self) -> None:
        shown, own = self._scene.view_settings, self._writer.view_settings
        assert shown is not None
        assert own is not None
        for name in (*VIEW_VALUES, *WHITE_VALUES):
            if getattr(own, name) != getattr(shown, name):
                setattr(own, name, getattr(shown, name))
