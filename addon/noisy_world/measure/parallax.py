# SPDX-License-Identifier: GPL-3.0-or-later
"""What the parallax between a recording's frames says of its depth and its poses.

Features are followed from one frame to another. Depth and the poses of the two say where each has to be; free is a
factor on depth and, within the accuracy of poses, a rotation. The factor is 1 where depth is in metres and poses are
camera-to-world in OpenCV's axes. Where it is another in most pairs of frames, or where poses fit only if they are read
otherwise, that is said. What does not tell is passed over in silence: a camera that only turns, a wall without texture,
poses that fit in no way.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import Message, Part, PresetKey
from ..core.geometry import invert_pose
from ..core.trajectory import Axes, Direction, convert_convention
from .figure import Figure
from .footage import Float64, Points, RecordingView

# Chosen, as all below: of 60 real frames and of rooms these find made faults and nothing else.
PAIRS = 7
LEAST_PAIRS = 3  # that agree
MOST_FRAMES = 90  # between two frames of a pair
TRIES = 3  # of the second frame of a pair
FEATURES, LEAST_FEATURES = 250, 40
BACK_PX = 0.5  # how far from where it was a feature may be that is followed there and back
KEPT = 0.3  # share of the features that have to be found again
AIM = 0.05  # of the image's width: how far features should go from one frame to the other
GOOD = 0.015, 0.2  # likewise: how far they may
FLAT = 0.05  # relative difference of depth in 5 x 5 pixels, more of which is an edge
TURN_RAD = np.radians(0.5)  # the standard deviation of a rotation that poses may be wrong by
STEPS = 12  # of Gauss and Newton's method
TUKEY = 4.7  # standard deviations from which on a feature counts nothing (Tukey's, 95 % efficient)
LEAST_PX = 0.3  # standard deviation of where a feature is found
NEAREST = 0.05  # times its depth: a point does not come nearer
SEEN_PX = 3.0  # of parallax: less of it tells nothing
SURE = 0.1  # relative standard error of a factor that counts
AGREE = 0.3  # of natural logarithm: the spread of factors that agree
OFF = 1.2  # a factor that is said
ERRORS = 4.0  # likewise: by so many standard errors it is another than 1
LEAST_SPREAD = 0.1  # of natural logarithm: what calibration and stamps make factors of two pairs of frames differ by
BETTER = 0.6  # times the misfit as poses are read: so much less it has to be when they are read otherwise
FITS_PX = 2.5  # misfit that counts as none, where images are 640 pixels wide
COMMON_PER_M = (
    1.0,
    100.0,
    256.0,
    1000.0,
    4000.0,
    5000.0,
    6553.5,
    10000.0,
)  # steps a metre of depth images that there are
CLOSE = 0.1  # relative distance to one of them that is it

Reading: TypeAlias = tuple[Direction, Axes]
AS_READ: Reading = ("c2w", "opencv")
READINGS: tuple[Reading, ...] = tuple(product(("c2w", "w2c"), ("opencv", "opengl", "robot")))
_SPOKEN = {"w2c": "world-to-camera", "opengl": "in OpenGL's axes", "robot": "in a robot's axes"}


@dataclass(frozen=True)
class FollowedPair:
    """Features of one frame in another.

    rays, to: (N, 2) on the plane at 1, without the lens. depth_m: (N,) planar depth there in the first frame.
    frames: the two. moved: the median way over the image's width.
    """

    frames: tuple[int, int]
    rays: Float64
    depth_m: Float64
    to: Float64
    moved: float


@dataclass(frozen=True)
class Fit:
    """How a pair of frames fits a reading of its poses.

    inverse: 1 / the factor on depth, below 0 where what is seen would have to be behind the camera. error: its standard
    error. misfit_px: the median distance that is left. parallax_px: the median of what translation moves on the image.
    """

    frames: tuple[int, int]
    inverse: float
    error: float
    misfit_px: float
    parallax_px: float

    @property
    def tells(self) -> bool:
        """Whether the factor is known."""
        return self.inverse > 0 and self._seen

    @property
    def tells_behind(self) -> bool:
        """Whether what is seen would have to be behind the camera."""
        return self.inverse < 0 and self._seen

    @property
    def _seen(self) -> bool:
        return self.error < SURE * abs(self.inverse) and self.parallax_px > SEEN_PX


@dataclass(frozen=True)
class Parallax:
    """What parallax says. reading: of the poses that fits; None where none does. factor: how much farther all is.

    remark: what that says against depth's scale and the poses, in a sentence; "" where it says nothing.
    """

    reading: "Reading | None"
    factor: Figure
    remark: str = ""


FACTOR = "farther_than_depth_says"


def parallax(footage: RecordingView, depth_later: int = 0) -> Parallax:
    """Return what parallax between some pairs of frames says. depth_later: by how many frames depth is late.

    Raises InputError where an image that is looked at is damaged.
    """
    if not footage.has_depth:
        return Parallax(None, Figure.none(FACTOR, "there is no depth"))
    if footage.path.known.sum() < 2:
        return Parallax(None, Figure.none(FACTOR, "no poses are known"))
    fits = [_fits(pair, footage) for pair in _pairs(footage, depth_later)]
    reading = _reading(fits, FITS_PX * max(footage.whole_px / 640, 0.25))
    factor = None if reading is None else _factor(fits, reading)
    if reading is None or factor is None:
        why = "poses fit in no way, or the camera hardly moves" if fits else "features move between no two frames"
        return Parallax(None, Figure.none(FACTOR, why))
    figure = Figure(FACTOR, factor.value, *factor.interval, len(fits), "pairs of frames")
    off = abs(np.log(factor.value)) > max(np.log(OFF), ERRORS * factor.error)
    wrong = off or reading != AS_READ
    return Parallax(reading, figure, _said(footage, reading, factor.value if off else None) if wrong else "")


# --- following features ---


def _pairs(footage: RecordingView, depth_later: int) -> Iterator[FollowedPair]:
    """Yield pairs of frames with known poses, evenly over the recording, between which features move."""
    known = np.flatnonzero(footage.path.known)
    if len(known) < 2:
        return
    follower = _Follower(footage, depth_later)
    anchors = np.unique(np.linspace(0, len(known) - 1, PAIRS + 1).round().astype(int))[:-1].tolist()
    apart = max(1, min(4, len(known) // 4))
    for place in anchors:
        best: FollowedPair | None = None
        tried = set[int]()
        for _ in range(TRIES):
            other = min(place + apart, len(known) - 1)
            if other in tried or other == place:
                break
            tried.add(other)
            found = follower.follow(int(known[place]), int(known[other]))
            if found is None:  # too far, or nothing to follow
                apart = max(1, apart // 3)
                continue
            if best is None or abs(np.log(found.moved / AIM)) < abs(np.log(best.moved / AIM)):
                best = found
            wanted = round((other - place) * AIM / found.moved)
            apart = min(max(wanted, 1), MOST_FRAMES)
            if GOOD[0] < found.moved and 0.5 < wanted / (other - place) < 2:
                break
        if best is not None and GOOD[0] < best.moved < GOOD[1]:
            yield best


class _Follower:
    """Follows features between frames of a recording; each is read once."""

    def __init__(self, footage: RecordingView, depth_later: int) -> None:
        self._footage, self._later = footage, depth_later
        self._images: dict[int, NDArray[np.uint8]] = {}
        self._starts: dict[int, tuple[Points, Float64]] = {}

    def follow(self, one: int, other: int) -> FollowedPair | None:
        """Return the features of a frame in another; None where these are few."""
        points, depth_m = self._begin(one)
        if len(points) < LEAST_FEATURES:
            return None
        there, good = self._moved(one, other, points)
        back, again = self._moved(other, one, there)
        kept = good & again & (np.linalg.norm(back - points, axis=1) < BACK_PX)
        if kept.sum() < max(LEAST_FEATURES, KEPT * len(points)):
            return None
        moved = float(np.median(np.linalg.norm(there - points, axis=1)[kept])) / self._footage.camera.width_px
        rays, to = self._footage.plane(points[kept]), self._footage.plane(there[kept])
        seen = np.isfinite(rays).all(axis=1) & np.isfinite(to).all(axis=1)
        return FollowedPair((one, other), rays[seen], depth_m[kept][seen], to[seen], max(moved, 1e-6))

    def _grey(self, frame: int) -> NDArray[np.uint8]:
        if frame not in self._images:
            self._images[frame] = self._footage.look(frame).grey
        return self._images[frame]

    def _begin(self, frame: int) -> tuple[NDArray[np.float32], Float64]:
        """Return features (N, 2) of a frame and the depth (N,) there; none at edges of depth."""
        import cv2

        if frame not in self._starts:
            shown = min(max(frame + self._later, 0), len(self._footage) - 1)
            depth_m = self._footage.look(shown).depth_m
            assert depth_m is not None, "there is depth"
            square = np.ones((5, 5), np.uint8)
            lowest, highest = cv2.erode(depth_m, square), cv2.dilate(depth_m, square)
            mask = ((lowest > 0) & (highest < (1 + FLAT) * lowest)).astype(np.uint8)
            apart_px = max(self._footage.camera.width_px / 60, 3)
            found = cv2.goodFeaturesToTrack(self._grey(frame), FEATURES, 0.01, apart_px, mask=mask)
            points = np.zeros((0, 2), np.float32) if found is None else np.asarray(found, np.float32).reshape(-1, 2)
            at = points.round().astype(int)
            self._starts[frame] = points, depth_m[at[:, 1], at[:, 0]].astype(np.float64)
        return self._starts[frame]

    def _moved(
        self, one: int, other: int, points: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return where features (N, 2) of one image are in another, and which were found (Lucas and Kanade, 1981)."""
        import cv2

        images = self._grey(one), self._grey(other)
        there, good, _ = cv2.calcOpticalFlowPyrLK(*images, points, points.copy(), winSize=(15, 15), maxLevel=4)
        return np.asarray(there, np.float32), np.asarray(good).ravel() > 0


# --- fitting ---


def _fits(pair: FollowedPair, footage: RecordingView) -> dict[Reading, Fit]:
    """Return how a pair fits each reading of the poses."""
    c2w, focal_px = footage.path.c2w, footage.focal_px / footage.scale
    found: dict[Reading, Fit] = {}
    for direction, axes in READINGS:
        one, other = convert_convention(c2w[list(pair.frames)], direction=direction, axes=axes)
        found[direction, axes] = _fit(pair, invert_pose(other) @ one, focal_px)
    return found


def _fit(pair: FollowedPair, other_from_one: Float64, focal_px: float) -> Fit:
    """Fit a factor and a small rotation by Gauss and Newton's method, with Tukey's weights.

    other_from_one: (4, 4), coordinates in the first frame's camera to those in the other's, by the poses.
    """
    points = np.concatenate([pair.rays, np.ones((len(pair.rays), 1))], axis=1) * pair.depth_m[:, None]
    turned, shift_m = points @ other_from_one[:3, :3].T, other_from_one[:3, 3]
    # What a step moves points by: of the inverse factor, and of the rotation about each axis.
    ways = np.stack([np.broadcast_to(shift_m, turned.shape), *(np.cross(axis, turned) for axis in np.eye(3))], axis=-1)
    prior = np.diag([1e-9, *[TURN_RAD**-2] * 3])
    found, distance_px, slopes, normal = np.zeros(4), np.zeros(0), np.zeros(0), np.eye(4)
    for step in range(STEPS):
        seen = turned + ways @ found
        z = np.maximum(seen[:, 2], NEAREST * pair.depth_m)[:, None]
        off_px = focal_px * (pair.to - seen[:, :2] / z)
        distance_px = np.linalg.norm(off_px, axis=1)
        spread_px = max(1.4826 * float(np.median(distance_px)), LEAST_PX)
        weight = np.clip(1 - (distance_px / (TUKEY * spread_px)) ** 2, 0, None) ** 2 if step > 1 else np.ones(len(z))
        slopes = focal_px * (ways[:, :2] - (seen[:, :2] / z)[..., None] * ways[:, 2:]) / z[..., None]
        weighted = slopes * (weight * 2 / spread_px**2)[:, None, None]
        normal = np.einsum("nki,nkj->ij", weighted, slopes) + prior
        found = found + np.linalg.solve(normal, np.einsum("nki,nk->i", weighted, off_px) - prior @ found)
    error = float(np.sqrt(np.linalg.inv(normal)[0, 0]))
    parallax_px = float(np.median(np.linalg.norm(slopes[..., 0], axis=1))) * abs(float(found[0]))
    return Fit(pair.frames, float(found[0]), error, float(np.median(distance_px)), parallax_px)


# --- what that says ---


def _reading(fits: list[dict[Reading, Fit]], fits_px: float) -> Reading | None:
    """Return the reading of the poses that holds; None where that cannot be told. fits_px: a misfit that is none."""
    if len(fits) < LEAST_PAIRS:
        return None
    misfit_px = {
        reading: float(np.exp(np.mean([np.log(fit[reading].misfit_px + 0.1) for fit in fits]))) for reading in READINGS
    }
    holding = [reading for reading in READINGS if _factor(fits, reading) is not None]
    best = min(holding, key=lambda reading: misfit_px[reading], default=None)
    if best is None:
        return None
    # Of readings that fit alike, as where the camera goes straight on, the one that is used is right.
    if AS_READ in holding and misfit_px[AS_READ] * BETTER <= misfit_px[best]:
        return AS_READ
    sound = misfit_px[best] < fits_px and misfit_px[best] < BETTER * misfit_px[AS_READ]
    return best if sound or best == AS_READ else None


@dataclass(frozen=True)
class Factor:
    """How much farther all is than depth says, and the standard error of its natural logarithm."""

    value: float
    error: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 % of it."""
        return self.value * float(np.exp(-2 * self.error)), self.value * float(np.exp(2 * self.error))


def _apart(pairs: list[tuple[int, int]]) -> int:
    """Return how many pairs of frames lie beside each other: those that overlap see the same error."""
    count, end = 0, -1
    for one, other in sorted(pairs, key=lambda pair: pair[1]):
        if one >= end:
            count, end = count + 1, other
    return count


def _factor(fits: list[dict[Reading, Fit]], reading: Reading) -> Factor | None:
    """Return the factor on depth by a reading of the poses; None where pairs do not agree on it.

    It is the median over the pairs, in which each counts by its parallax.
    """
    told = [fit[reading] for fit in fits if fit[reading].tells]
    behind = sum(fit[reading].tells_behind for fit in fits)
    if len(told) < max(LEAST_PAIRS, len(fits) / 2) or behind * 4 > len(told):
        return None
    factors = np.array([1 / fit.inverse for fit in told])
    order = np.argsort(factors)
    share = np.cumsum(np.array([fit.parallax_px for fit in told])[order])
    middle = float(factors[order][np.searchsorted(share, share[-1] / 2)])
    spread = 1.4826 * float(np.median(np.abs(np.log(factors / middle))))
    error = 1.2533 * max(spread, LEAST_SPREAD) / _apart([fit.frames for fit in told]) ** 0.5
    return Factor(middle, error) if spread < AGREE else None


def _said(footage: RecordingView, reading: Reading, factor: float | None) -> str:
    """Return what is wrong, in a sentence. factor: on depth; None where it is right."""
    parts: list[Part] = []
    if reading != AS_READ:
        path = footage.poses_path
        named = "poses" if path is None else f"poses of {path.name}"
        words = " and ".join(_SPOKEN[word] for word in reading if word in _SPOKEN)
        parts.append(
            f"parallax between frames says that {named} are {words}: they fit the images so, and not as they are read, "
            "camera-to-world in OpenCV's axes (x right, y down, z forward); convert them"
        )
    if factor is not None:
        so = "; it also" if parts else "parallax between frames"
        scale_per_m = footage.depth_scale_per_m
        if scale_per_m is None:
            parts.append(f"{so} says that all is {factor:.3g} times as far as depth has it (within 10 %)")
            return Message(*parts)
        right_per_m = scale_per_m / factor
        nearest = min(COMMON_PER_M, key=lambda common: abs(np.log(common / right_per_m)))
        wanted = nearest if abs(np.log(nearest / right_per_m)) < CLOSE else float(f"{right_per_m:.3g}")
        parts.append(
            f"{so} says that all is {factor:.3g} times as far as depth of {scale_per_m:g} steps a metre has it "
            "(within 10 %): "
        )
        parts += [
            PresetKey("scenes.depth_scale_per_m", f"{wanted:g}"),
            " would be right, or the poses are not in metres",
        ]
    return Message(*parts)
