# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras beyond one pinhole: lens distortion, and a depth camera of its own.

Models, both as OpenCV and EuRoC's files have them: radial-tangential (Brown-Conrady: k1, k2, p1, p2 and, where there
are more, k3, k4, k5, k6 of OpenCV's rational model) and equidistant (Kannala-Brandt: k1 to k4).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from .geometry import Intrinsics

DistortionModel: TypeAlias = Literal["radial-tangential", "equidistant"]
MODELS: tuple[str, ...] = get_args(DistortionModel)
# How many coefficients OpenCV takes: https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html, and of the fisheye module.
SHORTEST = 4  # coefficients: without the radial ones of a higher power
DISTORTION = "distortion"
DEPTH_CAMERA = "depth_camera"
OPTICS_KEYS = (DEPTH_CAMERA, DISTORTION)  # in files
COUNTS: dict[str, tuple[int, ...]] = {"radial-tangential": (4, 5, 8), "equidistant": (4,)}


@dataclass(frozen=True)
class Distortion:
    """A lens that distorts: its model and its coefficients, which are not all zero."""

    model: DistortionModel
    coefficients: tuple[float, ...]

    def content(self) -> dict[str, Any]:
        """Return it as plain JSON values."""
        return {"model": self.model, "coefficients": list(self.coefficients)}

    def named(self) -> dict[str, Any]:
        """Return its coefficients by OpenCV's names, and what COLMAP and Kalibr call its model where they have it."""
        angle = self.model == "equidistant"
        names = ("k1", "k2", "k3", "k4") if angle else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
        count = len(self.coefficients)
        colmap = "OPENCV_FISHEYE" if angle else "OPENCV" if count == SHORTEST else "FULL_OPENCV"
        kalibr = "equidistant" if angle else "radtan" if count == SHORTEST else None
        called = {"colmap": colmap, **({} if kalibr is None else {"kalibr": kalibr})}
        return {**dict(zip(names, self.coefficients, strict=False)), **called}

    def bent(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return where rays (x, y, 1) pass the image plane at z = 1 after the lens; of any shape."""
        import cv2

        points = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=-1).reshape(-1, 1, 3)
        values, still = np.array(self.coefficients), np.zeros(3)
        if self.model == "equidistant":
            found, _ = cv2.fisheye.projectPoints(points, still, still, np.eye(3), values)
        else:
            found, _ = cv2.projectPoints(points, still, still, np.eye(3), values)
        flat = np.asarray(found, np.float64).reshape(-1, 2)
        return flat[:, 0].reshape(x.shape), flat[:, 1].reshape(x.shape)


@dataclass(frozen=True)
class DepthCamera:
    """The camera of depth images that is not the colour's: its intrinsics, and where it sits beside the colour camera.

    rgb_from_depth: (4, 4) row by row: coordinates in the depth camera to those in the colour camera; None for the same
    place. shares_lens: whether its images are the colour's view in other pixels, through the same lens.
    """

    intrinsics: Intrinsics
    rgb_from_depth: tuple[tuple[float, ...], ...] | None = None
    shares_lens: bool = False

    @cached_property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) float64: rgb_from_depth."""
        return np.eye(4) if self.rgb_from_depth is None else np.array(self.rgb_from_depth, dtype=np.float64)

    def content(self) -> dict[str, Any]:
        """Return it as plain JSON values."""
        camera = self.intrinsics
        values = {"w": camera.width_px, "h": camera.height_px, "fx": float(camera.fx_px), "fy": float(camera.fy_px)}
        content: dict[str, Any] = values | {"cx": float(camera.cx_px), "cy": float(camera.cy_px)}
        if self.rgb_from_depth is not None:
            content["rgb_from_depth"] = [list(row) for row in self.rgb_from_depth]
        if self.shares_lens:
            content["shares_lens"] = True
        return content


@dataclass(frozen=True)
class Optics:
    """What there is beyond one pinhole. depth: None where colour and depth have one camera. distortion: of colour."""

    depth: DepthCamera | None = None
    distortion: Distortion | None = None

    @property
    def plain(self) -> bool:
        """Whether there is nothing beyond one pinhole."""
        return self.depth is None and self.distortion is None

    def content(self) -> dict[str, Any]:
        """Return what there is as plain JSON values, by name; {} where there is nothing."""
        found = zip(OPTICS_KEYS, (self.depth, self.distortion), strict=True)
        return {name: item.content() for name, item in found if item is not None}


PINHOLE = Optics()
"""One camera for colour and depth, without distortion."""


def distortion_of(model: DistortionModel, coefficients: tuple[float, ...]) -> Distortion | None:
    """Return a lens; None where all coefficients are zero. Raises ValueError for another number of coefficients."""
    if len(coefficients) not in COUNTS[model]:
        wanted = " or ".join(map(str, COUNTS[model]))
        raise ValueError(f"{len(coefficients)} coefficients, but {model} has {wanted}")
    return Distortion(model, coefficients) if any(coefficients) else None
