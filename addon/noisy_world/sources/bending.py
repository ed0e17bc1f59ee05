# SPDX-License-Identifier: GPL-3.0-or-later
"""A pinhole's images as a lens that distorts would have shown them: resampled along the exact rays of the lens.

What is cast as rays needs none of this. It is for renderers that know pinholes alone, which render what is beside the
image too, and for recordings, of which that is lost.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from ..core.lens import lens_rays
from ..core.messages import Message, PresetKey
from ..core.optics import Distortion
from ..core.planning.source import RenderedFrame, RenderOptions
from ..core.presets.distortion import DistortionSpec, sound_lens
from ..core.schema import ConfigPath
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths

Float32: TypeAlias = NDArray[np.float32]

MARGIN_PX = 2  # beside the outermost rays: depth looks at the neighbours of a pixel's neighbours
MOST_TIMES = 16.0  # as many pixels as the image has may be rendered for it; chosen
SMOOTH = 1e-3  # of the inverse depth: neighbours that are bent less are one surface; chosen, 16 bits' steps are within


@dataclass(frozen=True)
class Bending:
    """Makes images of a lens of a pinhole's. pinhole: the camera of what is given. camera: that of what is made."""

    pinhole: Intrinsics
    camera: Intrinsics
    lens: Distortion

    def rgb(self, rgb: NDArray[Any]) -> NDArray[Any]:
        """Return colour (H, W, 3) of the type given: four neighbours interpolated. Black where the pinhole saw nothing.

        What the pinhole saw ends half a pixel beyond its outer pixels' centres.
        """
        row, column, beside = self._places
        part_v, part_u = (part.astype(np.float32)[..., None] for part in self._parts)
        values = rgb.astype(np.float32)
        upper = values[row, column] * (1 - part_u) + values[row, column + 1] * part_u
        lower = values[row + 1, column] * (1 - part_u) + values[row + 1, column + 1] * part_u
        made = upper * (1 - part_v) + lower * part_v
        made[beside] = 0
        return (np.rint(made) if np.issubdtype(rgb.dtype, np.integer) else made).astype(rgb.dtype)

    def depth_m(self, depth_m: Float32) -> Float32:
        """Return planar depth (H, W), metres, 0 = void and where the pinhole saw nothing.

        On a plane the inverse of planar depth is linear over the image, so it is interpolated where four neighbours are
        of one smooth surface, exactly so on a plane. Elsewhere a pixel has the depth of the nearest one.
        """
        row, column, _ = self._places
        part_v, part_u = self._parts
        seen = depth_m > 0
        inverse = np.divide(1.0, depth_m, out=np.zeros(depth_m.shape), where=seen)
        smooth = seen & _straight(inverse, 0) & _straight(inverse, 1)
        corners = [(row + down, column + right) for down in (0, 1) for right in (0, 1)]
        values = [inverse[corner] for corner in corners]
        same = np.logical_and.reduce([smooth[corner] for corner in corners])
        same &= np.abs(values[0] - values[1] - values[2] + values[3]) <= SMOOTH * values[0]
        upper = values[0] * (1 - part_u) + values[1] * part_u
        lower = values[2] * (1 - part_u) + values[3] * part_u
        between = upper * (1 - part_v) + lower * part_v
        made = self.nearest(depth_m)
        np.divide(1.0, between, out=made, where=same & ~self._places[2], casting="same_kind")
        return made

    def nearest(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return an image (H, W) or (H, W, C) of each pixel's nearest one; 0 where the pinhole saw nothing."""
        row, column, beside = self._places
        part_v, part_u = self._parts
        made = image[row + (part_v >= 0.5), column + (part_u >= 0.5)]
        made[beside] = 0
        return made

    @cached_property
    def _where(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        rays, pinhole = lens_rays(self.camera, self.lens), self.pinhole
        return rays.down * pinhole.fy_px + pinhole.cy_px, rays.right * pinhole.fx_px + pinhole.cx_px

    @cached_property
    def _places(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
        """The upper left of the four pixels around each ray, and whether it is beside the pinhole's image."""
        sizes = self.pinhole.height_px, self.pinhole.width_px
        beside = np.logical_or.reduce(
            [~((at >= -0.5) & (at < size - 0.5)) for at, size in zip(self._where, sizes, strict=True)]
        )
        row, column = (
            np.clip(np.floor(at), 0, size - 2).astype(np.intp) for at, size in zip(self._where, sizes, strict=True)
        )
        return row, column, beside

    @cached_property
    def _parts(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """How far between the four pixels a ray is, down and right, from 0 to 1."""
        row, column, _ = self._places
        v, u = self._where
        return np.clip(v - row, 0.0, 1.0), np.clip(u - column, 0.0, 1.0)


def _straight(inverse: NDArray[np.float64], axis: int) -> NDArray[np.bool_]:
    """Tell of each pixel whether it and its neighbours along an axis are of one smooth surface."""
    if inverse.shape[axis] < 3:
        return np.full(inverse.shape, False)
    bend = np.abs(np.diff(inverse, n=2, axis=axis))
    ends = [(1, 1) if along == axis else (0, 0) for along in range(2)]
    return np.pad(bend, ends, mode="edge") <= SMOOTH * inverse


def overscanned(camera: Intrinsics, lens: Distortion) -> Intrinsics:
    """Return the pinhole of equal focal lengths that sees all that a lens brings into the image of a camera."""
    rays = lens_rays(camera, lens)
    u, v = rays.right * camera.fx_px, rays.down * camera.fy_px
    left, top = math.floor(u.min()) - MARGIN_PX, math.floor(v.min()) - MARGIN_PX
    width, height = math.ceil(u.max()) + MARGIN_PX - left + 1, math.ceil(v.max()) + MARGIN_PX - top + 1
    return Intrinsics(width, height, camera.fx_px, camera.fy_px, float(-left), float(-top))


def lens_of(spec: DistortionSpec, camera: Intrinsics, place: ConfigPath, *, cast: bool) -> Distortion:
    """Return the lens that a mesh is seen through. cast: whether rays are cast through it, rather than a pinhole bent.

    Raises InputError where it folds over within the image, or a pinhole would take too long to render.
    """
    lens = sound_lens(spec, camera, place)
    if cast:
        return lens
    pinhole = overscanned(camera, lens)
    times = pinhole.width_px * pinhole.height_px / (camera.width_px * camera.height_px)
    if times > MOST_TIMES:
        size = f"{pinhole.width_px} x {pinhole.height_px} px, {times:.0f} times the image"
        raise place.error(f"needs a pinhole's {size}", Message("use ", PresetKey("render.engine", "embree")))
    return lens


def surfaces_bent(frame: RenderedFrame, bending: Bending, *, own_depth: bool = False) -> RenderedFrame:
    """Return a frame whose colour is bent already with all else bent too, but depth of a camera of its own."""
    behind_m = frame.behind_glass_m
    return replace(
        frame,
        depth_m=frame.depth_m if own_depth or frame.depth_m is None else bending.depth_m(frame.depth_m),
        others={name: bending.nearest(image) for name, image in frame.others.items()},
        behind_glass_m=None if behind_m is None else bending.depth_m(behind_m),
    )


@dataclass
class BentSession:
    """A session of a renderer that knows pinholes alone, whose frames are bent as a lens does.

    session: of the pinhole of `bending`. own_depth: whether depth is of a camera of its own. origin_m: (3,) float64,
    around which it is rendered. notes: what a user should know about how it is rendered.
    """

    session: Any
    bending: Bending
    own_depth: bool = False
    origin_m: NDArray[np.float64] = field(init=False)
    notes: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        pinhole = self.bending.pinhole
        size = f"{pinhole.width_px} x {pinhole.height_px}"
        said = f"rendered as a pinhole's {size} px, and bent as the lens does: interpolated"
        self.origin_m, self.notes = self.session.origin_m, (*self.session.notes, said)

    def serves(self, paths: SensorPaths, options: RenderOptions) -> bool:
        """Tell whether frames along other paths, with other options, would be those of a session of their own."""
        return self.session.serves(paths, options)

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Render a frame, and bend it."""
        frame = self.session.frame(request)
        coloured = replace(frame, rgb=None if frame.rgb is None else self.bending.rgb(frame.rgb))
        return surfaces_bent(coloured, self.bending, own_depth=self.own_depth)

    def __enter__(self) -> "BentSession":
        self.session.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.session.__exit__(*error)
