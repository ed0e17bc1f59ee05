# SPDX-License-Identifier: GPL-3.0-or-later
"""How alike two images look to a network, such as LPIPS, whose weights the user gives as an ONNX file.

No weights come with Noisy World. OpenCV runs the network, so no other framework is needed.
"""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError

INPUTS = ("in0", "in1")  # as the lpips package names them
REMEDY = "export LPIPS with inputs in0 and in1, each (1, 3, H, W) in [-1, 1], RGB, and one number as output"


class Perceptual:
    """A network in an ONNX file: two images in, one number out."""

    def __init__(self, path: Path) -> None:
        """Load it. Raises InputError for a file that is missing or no network."""
        import cv2

        if not path.is_file():
            raise InputError(path, "is no file", remedy=REMEDY)
        self._path = path
        try:
            self._net = cv2.dnn.readNetFromONNX(str(path))
        except cv2.error as error:
            raise InputError(path, f"OpenCV cannot load it: {_said(error)}", remedy=REMEDY) from error

    def __call__(self, first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
        """Return the distance of two images (H, W, 3), RGB. Raises InputError where the network gives no number."""
        import cv2

        try:
            for name, image in zip(INPUTS, (first, second), strict=True):
                self._net.setInput(np.ascontiguousarray(_planes(image)), name)
            given = np.asarray(self._net.forward())
        except cv2.error as error:
            raise InputError(self._path, f"OpenCV cannot run it: {_said(error)}", remedy=REMEDY) from error
        if given.size != 1 or not math.isfinite(float(given.reshape(-1)[0])):
            raise InputError(self._path, f"gives {given.shape}, not one number", remedy=REMEDY)
        return float(given.reshape(-1)[0])


def _planes(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(H, W, 3) uint8 -> (1, 3, H, W) float32 in [-1, 1]."""
    return (image.astype(np.float32) / np.float32(127.5) - 1).transpose(2, 0, 1)[None]


def _said(error: Exception) -> str:
    """Return what OpenCV says, without where in its source."""
    return (getattr(error, "err", "") or str(error)).strip().splitlines()[-1][:200]
