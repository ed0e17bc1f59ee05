# SPDX-License-Identifier: GPL-3.0-or-later
"""Lenses that distort: their models, the exact inverse, and images bent as a lens would have shown them.

A lens that distorts, from the image to the scene: the exact inverse of its model, and where that ends.

`Distortion.bent` goes from rays to the image, by OpenCV. The way back has no closed form: Newton's method in float64.
Radial-tangential: D. C. Brown 1966, A. E. Conrady 1919, with OpenCV's rational factor. Equidistant: J. Kannala and
S. Brandt 2006, as cv2.fisheye has it.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from .geometry import Intrinsics

# Cameras beyond one pinhole: lens distortion, and a depth camera of its own.
#
# Models, both as OpenCV and EuRoC's files have them: radial-tangential (Brown-Conrady: k1, k2, p1, p2 and, where there
# are more, k3, k4, k5, k6 of OpenCV's rational model) and equidistant (Kannala-Brandt: k1 to k4).


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


# A pinhole's images as a lens that distorts would have shown them: resampled along the exact rays of the lens.
#
# What is cast as rays needs none of this. It is for renderers that know pinholes alone, which render what is beside the
# image too, and for recordings, of which that is lost.


Float32: TypeAlias = NDArray[np.float32]

MARGIN_PX = 2  # beside the outermost rays: depth looks at the neighbours of a pixel's neighbours
SMOOTH = 1e-3  # of the inverse depth: neighbours that are bent less are one surface; chosen, 16 bits' steps are within


@dataclass(frozen=True)
class Bending:
    """Makes images of a lens of a pinhole's.

    pinhole: the camera of what is given. camera: that of what is made. where: the rows and columns (H, W), float64, of
    the pinhole's image at which its pixels' rays are; by default they are found.
    """

    pinhole: Intrinsics
    camera: Intrinsics
    lens: Distortion
    where: tuple[NDArray[np.float64], NDArray[np.float64]] | None = field(default=None, compare=False, repr=False)

    def part(self, rows: slice, columns: slice) -> "tuple[slice, slice, Bending]":
        """Return what of the pinhole's image a part of the lens's image needs, and what makes the one of the other.

        rows, columns: of the lens's image. Returns rows and columns of the pinhole's, and the bending from the one part
        to the other, each as an image of its own.
        """
        where = tuple(each[rows, columns] for each in self._where)
        sizes = self.pinhole.height_px, self.pinhole.width_px
        down, across = (
            slice(max(math.floor(at.min()) - MARGIN_PX, 0), min(math.floor(at.max()) + MARGIN_PX + 2, size))
            for at, size in zip(where, sizes, strict=True)
        )
        of = Bending(
            _cut(self.pinhole, down, across),
            _cut(self.camera, rows, columns),
            self.lens,
            (where[0] - down.start, where[1] - across.start),
        )
        return down, across, of

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

    def motion(self, motion_px: Float32) -> Float32:
        """Return motion on the image (H, W, 2), pixels right and down, of the nearest pixel's on the pinhole's image.

        NaN where the pinhole saw nothing, and where it leads beside the image of the lens.
        """
        pinhole = self.pinhole
        v, u = np.indices((pinhole.height_px, pinhole.width_px), dtype=np.float64)
        ways: list[NDArray[np.float64]] = []
        for at_u, at_v in ((u, v), (u + motion_px[..., 0], v + motion_px[..., 1])):
            x, y = (at_u - pinhole.cx_px) / pinhole.fx_px, (at_v - pinhole.cy_px) / pinhole.fy_px
            rays = np.stack([x, y, np.ones_like(x)], axis=-1)
            ways.append(np.stack(projected(rays, self.camera, self.lens), axis=-1))
        made = self.nearest((ways[1] - ways[0]).astype(np.float32))
        made[self._places[2]] = np.nan
        return made

    @cached_property
    def _where(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if self.where is not None:
            return self.where
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


def _cut(camera: Intrinsics, rows: slice, columns: slice) -> Intrinsics:
    """Return the camera of a part of an image."""
    return replace(
        camera,
        width_px=columns.stop - columns.start,
        height_px=rows.stop - rows.start,
        cx_px=camera.cx_px - columns.start,
        cy_px=camera.cy_px - rows.start,
    )


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
