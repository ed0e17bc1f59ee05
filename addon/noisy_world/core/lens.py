# SPDX-License-Identifier: GPL-3.0-or-later
"""A lens that distorts, from the image to the scene: the exact inverse of its model, and where that ends.

`Distortion.bent` goes from rays to the image, by OpenCV. The way back has no closed form: Newton's method in float64.
Radial-tangential: D. C. Brown 1966, A. E. Conrady 1919, with OpenCV's rational factor. Equidistant: J. Kannala and
S. Brandt 2006, as cv2.fisheye has it.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .geometry import Intrinsics
from .optics import Distortion

Float64: TypeAlias = NDArray[np.float64]

TURNS = 60  # of Newton's method at most; a lens that is regular over the image takes 4 to 8
EXACT = 1e-13  # of the image plane at 1: 1e-10 px at a focal length of 1000 px
WIDEST_DEG = 85.0  # from the optical axis, of planar depth and of rays (x, y, 1): at 90 degrees depth is 0
ALL_AROUND_DEG = 180.0  # from the optical axis: no ray goes farther round
STEPS = 48  # on the way from the axis to a pixel at which the lens is looked at; chosen


def straightened(lens: Distortion, x: Float64, y: Float64) -> tuple[Float64, Float64]:
    """Return the rays (x, y, 1) that pass the image plane at z = 1 at (x, y) after the lens; NaN where none is found.

    Of any shape, float64.
    """
    at_x, at_y = np.ravel(x).astype(np.float64), np.ravel(y).astype(np.float64)
    found = (_from_angle if lens.model == "equidistant" else _from_plane)(lens, at_x, at_y)
    return found[0].reshape(np.shape(x)), found[1].reshape(np.shape(y))


def directions(lens: Distortion, x: Float64, y: Float64) -> Float64:
    """Return the rays (..., 3) of length 1 that pass the image plane at z = 1 at (x, y) after an equidistant lens.

    They may lead sideways and back. NaN where none is found.
    """
    bent_rad = np.hypot(x, y)
    angle_rad = _angles(lens, np.ravel(bent_rad), ALL_AROUND_DEG).reshape(np.shape(x))
    factor = np.divide(np.sin(angle_rad), bent_rad, out=np.ones_like(bent_rad), where=bent_rad > 0)
    return np.stack([x * factor, y * factor, np.cos(angle_rad)], axis=-1)


def _from_angle(lens: Distortion, x: Float64, y: Float64) -> tuple[Float64, Float64]:
    bent_rad = np.hypot(x, y)
    angle_rad = _angles(lens, bent_rad, WIDEST_DEG)
    factor = np.tan(angle_rad) / np.where(bent_rad > 0, bent_rad, 1.0)
    factor[bent_rad == 0] = 1.0
    return x * factor, y * factor


def _angles(lens: Distortion, bent_rad: Float64, widest_deg: float) -> Float64:
    """Return the angles (N,) from the axis of rays that the lens bends to these; NaN where none below the widest is."""
    angle_rad = bent_rad.copy()
    with np.errstate(all="ignore"):
        for _ in range(TURNS):
            value, slope = _angle(lens, angle_rad)
            step = (value - bent_rad) / slope
            angle_rad -= step
            if not np.nanmax(np.abs(step), initial=0.0) > EXACT:
                break
        left = np.abs(_angle(lens, angle_rad)[0] - bent_rad)
        good = (left < 10 * EXACT) & (angle_rad >= 0) & (angle_rad < np.radians(widest_deg))
    return np.where(good, angle_rad, np.nan)


def _from_plane(lens: Distortion, x: Float64, y: Float64) -> tuple[Float64, Float64]:
    found_x, found_y = x.copy(), y.copy()
    with np.errstate(all="ignore"):
        for _ in range(TURNS):
            at_x, at_y, (xx, xy, yy) = _plane(lens, found_x, found_y)
            off_x, off_y = at_x - x, at_y - y
            across = xx * yy - xy * xy
            step_x, step_y = (yy * off_x - xy * off_y) / across, (xx * off_y - xy * off_x) / across
            found_x -= step_x
            found_y -= step_y
            if not np.nanmax(np.abs([step_x, step_y]), initial=0.0) > EXACT:
                break
        at_x, at_y, _ = _plane(lens, found_x, found_y)
        bad = ~(np.hypot(at_x - x, at_y - y) < 10 * EXACT)
        bad |= np.hypot(found_x, found_y) > np.tan(np.radians(WIDEST_DEG))
    found_x[bad] = found_y[bad] = np.nan
    return found_x, found_y


def _angle(lens: Distortion, angle_rad: Float64) -> tuple[Float64, Float64]:
    """Return the bent angle of angles from the axis, and how fast it grows."""
    k1, k2, k3, k4 = lens.coefficients
    square = angle_rad * angle_rad
    value = angle_rad * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
    return value, 1 + square * (3 * k1 + square * (5 * k2 + square * (7 * k3 + square * 9 * k4)))


def _plane(lens: Distortion, x: Float64, y: Float64) -> tuple[Float64, Float64, tuple[Float64, Float64, Float64]]:
    """Return where rays (x, y, 1) pass the image plane, and the derivatives dx/dx, dx/dy = dy/dx and dy/dy."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*lens.coefficients, *(0.0,) * (8 - len(lens.coefficients)))
    square = x * x + y * y
    above = 1 + square * (k1 + square * (k2 + square * k3))
    below = 1 + square * (k4 + square * (k5 + square * k6))
    radial = above / below
    slope_above = k1 + square * (2 * k2 + square * 3 * k3)
    slope = (slope_above - radial * (k4 + square * (2 * k5 + square * 3 * k6))) / below  # by the square
    at_x = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
    at_y = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
    xx = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    xy = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    yy = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    return at_x, at_y, (xx, xy, yy)


@dataclass(frozen=True, eq=False)
class LensRays:
    """The rays (right, down, 1) through the centres of an image's pixels, behind a lens.

    right, down: (H, W) float64. radius: of the widest of all rays through the image, on the plane at 1. forward:
    (H, W) float64, where some rays are beyond 85 degrees from the axis: then all have the length 1, this is their part
    along the axis, and radius is the widest angle, radians.
    """

    right: Float64
    down: Float64
    radius: float
    forward: Float64 | None = None

    @property
    def is_deep(self) -> NDArray[np.bool_]:
        """(H, W): whether a pixel has a planar depth, which ends at 85 degrees from the axis."""
        if self.forward is None:
            return np.full(self.right.shape, True)
        return self.forward > np.cos(np.radians(WIDEST_DEG))

    def beside(
        self, row: NDArray[np.intp], column: NDArray[np.intp], right_px: Float64, down_px: Float64
    ) -> tuple[Float64, ...]:
        """Return (N, S) each: how much further right, down and, if that is not 1, forward rays go beside N pixels.

        They pass S places beside each. The lens is taken to be straight within a pixel: what is left is some 1e-4 px.
        """
        found: list[Float64] = []
        for plane in (self.right, self.down, *([] if self.forward is None else [self.forward])):
            by_row, by_column = (_slope(plane, axis, row, column)[:, None] for axis in (0, 1))
            found.append(by_column * right_px + by_row * down_px)
        return tuple(found)


def _slope(plane: Float64, axis: int, row: NDArray[np.intp], column: NDArray[np.intp]) -> Float64:
    """Return (N,) how much a plane grows from pixel to pixel, by the neighbours on both sides where there are two."""
    last = plane.shape[axis] - 1
    place = (row, column)[axis]
    before, after = np.maximum(place - 1, 0), np.minimum(place + 1, last)
    ends = [plane[(at, column) if axis == 0 else (row, at)] for at in (before, after)]
    return (ends[1] - ends[0]) / np.maximum(after - before, 1)


@lru_cache(maxsize=4)
def lens_rays(camera: Intrinsics, lens: Distortion) -> LensRays:
    """Return the rays through an image's pixels, exact to 1e-9 px. camera: after the lens.

    Raises ValueError where the lens has no ray for a pixel.
    """
    rays = camera.ray_directions()
    right, down = straightened(lens, rays[..., 0], rays[..., 1])
    if not np.isfinite(right).all() or not np.isfinite(down).all():
        if lens.model == "equidistant":
            return _all_around(camera, lens)
        raise ValueError(f"{lens} folds over within {camera}")
    border_x, border_y = straightened(lens, *_border(camera))
    radius = float(np.nanmax(np.hypot(border_x, border_y)))
    right.setflags(write=False)
    down.setflags(write=False)
    return LensRays(right, down, max(radius, float(np.nanmax(np.hypot(right, down)))))


def _all_around(camera: Intrinsics, lens: Distortion) -> LensRays:
    rays = camera.ray_directions()
    found = directions(lens, rays[..., 0], rays[..., 1])
    if not np.isfinite(found).all():
        raise ValueError(f"{lens} folds over within {camera}")
    found.setflags(write=False)
    border = np.arccos(np.clip(directions(lens, *_border(camera))[..., 2], -1.0, 1.0))
    widest_rad = max(float(np.nanmax(border)), float(np.arccos(found[..., 2].min())))
    return LensRays(found[..., 0], found[..., 1], widest_rad, found[..., 2])


def projected(points: Float64, camera: Intrinsics, lens: Distortion | None) -> tuple[Float64, Float64]:
    """Return the pixels u and v (...) of points (..., 3), OpenCV axes, before the camera, or where its lens sees them.

    NaN for those that are beside the image of a lens: there its model may lead back into it.
    """
    if lens is not None and (rays := lens_rays(camera, lens)).forward is not None:
        aside = np.hypot(points[..., 0], points[..., 1])
        angle_rad = np.arctan2(aside, points[..., 2])
        bent_rad = np.where(angle_rad <= rays.radius, _angle(lens, angle_rad)[0], np.nan)
        factor = np.divide(bent_rad, aside, out=np.where(np.isnan(bent_rad), np.nan, 1.0), where=aside > 0)
        x, y = points[..., 0] * factor, points[..., 1] * factor
        return x * camera.fx_px + camera.cx_px, y * camera.fy_px + camera.cy_px
    x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    if lens is not None:
        beside = ~(np.hypot(x, y) <= lens_rays(camera, lens).radius)
        x, y = lens.bent(np.where(beside, 0.0, x), np.where(beside, 0.0, y))
        x, y = np.where(beside, np.nan, x), np.where(beside, np.nan, y)
    return x * camera.fx_px + camera.cx_px, y * camera.fy_px + camera.cy_px


def lens_problem(camera: Intrinsics, lens: Distortion, *, all_around: bool = False) -> str:
    """Return why no image can be made of a lens, "" where it can: it is regular from the axis to each pixel's edge.

    all_around: whether its rays may lead sideways and back, which those of an equidistant one can.
    """
    x, y = _border(camera)
    across = np.linspace(-0.5, camera.width_px - 0.5, 17)
    down = np.linspace(-0.5, camera.height_px - 0.5, 17)
    inner_x, inner_y = np.meshgrid((across - camera.cx_px) / camera.fx_px, (down - camera.cy_px) / camera.fy_px)
    size = f"the image of {camera.width_px} x {camera.height_px} px"
    x, y = np.append(x, inner_x.ravel()), np.append(y, inner_y.ravel())
    share = (np.arange(STEPS) + 1.0)[:, None] / STEPS
    if all_around and lens.model == "equidistant":
        angle_rad = _angles(lens, np.hypot(x, y), ALL_AROUND_DEG)
        if not np.isfinite(angle_rad).all():
            return f"folds over or sees beyond {ALL_AROUND_DEG:g} degrees from its axis within {size}"
        sound = _angle(lens, share * angle_rad)[1] > 0
        return "" if sound.all() else f"folds over within {size}: two rays would meet in one pixel"
    right, low = straightened(lens, x, y)
    if not np.isfinite(right).all() or not np.isfinite(low).all():
        return f"folds over or sees beyond {WIDEST_DEG:g} degrees from its axis within {size}"
    if lens.model == "equidistant":
        sound = _angle(lens, share * np.arctan(np.hypot(right, low)))[1] > 0
    else:
        _, _, (xx, xy, yy) = _plane(lens, share * right, share * low)
        sound = (xx * yy - xy * xy > 0) & (xx + yy > 0)
    return "" if sound.all() else f"folds over within {size}: two rays would meet in one pixel"


def _border(camera: Intrinsics) -> tuple[Float64, Float64]:
    """Return places around the image, on the outer edges of its pixels, on the plane at 1."""
    u, v = (np.linspace(-0.5, size - 0.5, 513) for size in (camera.width_px, camera.height_px))
    at_u = np.concatenate([u, u, np.full(513, u[0]), np.full(513, u[-1])])
    at_v = np.concatenate([np.full(513, v[0]), np.full(513, v[-1]), v, v])
    return (at_u - camera.cx_px) / camera.fx_px, (at_v - camera.cy_px) / camera.fy_px
