# SPDX-License-Identifier: GPL-3.0-or-later
"""Every metric of a map by its name, ours and those of installed packages, and how each is computed."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.geometry import nearest_rotation, pose, rotation_angle_rad
from ..core.packages import Door, Registry
from ..scenes.polygon_mesh import Mesh
from .metrics import Metric, check_described, checked_value
from .true_maps import (
    MARGIN_M,
    Culling,
    Origin,
    Points,
    SeenSurface,
    TrueMap,
    Views,
    rendered_views,
    seen_surface,
    spread,
    to_points,
    tree_of,
)

# Alignment of a map to the truth by iterative closest points (Besl and McKay 1992).


LARGEST_M = 0.1  # pairs that are farther apart are left out: the paper's code
ITERATIONS = 30  # Open3D's default, which the paper's code takes
_ENOUGH = 1e-6  # of the share of pairs and of their RMSE, both Open3D's defaults


@dataclass(frozen=True)
class Laid:
    """What ICP found: truth_from_map (4, 4), rigid, the share of the points that have a pair, and the pairs' RMSE."""

    truth_from_map: NDArray[np.float64]
    share: float
    rmse_m: float


def lay(points_m: Points, truth_m: Points) -> Laid:
    """Move points (N, 3) onto others (M, 3), each at least three; where too few have pairs, they stay."""
    tree = tree_of(truth_m)
    middle_m = truth_m.mean(axis=0)
    whole = np.eye(4)
    share, rmse_m = 0.0, np.inf
    for left in range(ITERATIONS, -1, -1):
        moved = points_m @ whole[:3, :3].T + whole[:3, 3]
        apart_m, which = to_points(moved, tree, largest_m=LARGEST_M)
        paired = np.isfinite(apart_m)
        before = share, rmse_m
        share = float(paired.mean())
        if paired.sum() < 3:
            return Laid(whole, share, np.nan)
        rmse_m = float(np.sqrt(np.mean(apart_m[paired] ** 2)))
        if not left or (abs(share - before[0]) < _ENOUGH and abs(rmse_m - before[1]) < _ENOUGH):
            break
        whole = _moving(moved[paired] - middle_m, truth_m[which[paired]] - middle_m, middle_m) @ whole
    return Laid(whole, share, rmse_m)


def _moving(points: Points, onto: Points, middle_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rigid motion (4, 4) that brings points nearest to their pairs; both are relative to a middle."""
    centre, other = points.mean(axis=0), onto.mean(axis=0)
    rotation = nearest_rotation((onto - other).T @ (points - centre))
    return pose(rotation, middle_m + other - rotation @ (middle_m + centre))


# A map as the true cameras would see it, against what they see: depth and colour.


MOST_RENDERS = 50
HIGHEST_PSNR_DB = 100.0  # of equal images, whose PSNR has no bound; chosen

Colour: TypeAlias = NDArray[np.uint8]
Compare: TypeAlias = Callable[[Colour, Colour], float]
"""A number for two images (H, W, 3) uint8 RGB, such as LPIPS."""


@dataclass(frozen=True)
class Rendered:
    """What renders of a map and of the truth say; None for what nothing says. Means of colour are over images.

    depth_l1_m: the mean difference where both see something. depth_share: of the true pixels, where the map is seen.
    """

    depth_l1_m: float | None
    depth_share: float | None
    psnr_db: float | None
    ssim: float | None
    lpips: float | None


def compare_renders(mesh: Mesh, views: Views, *, lpips: Compare | None = None) -> Rendered:
    """Compare at most MOST_RENDERS renders of a mesh, evenly chosen, with the true ones; it lies as the truth does.

    Colour is compared over whole images, where the map has colours: void is black.
    """
    chosen = spread(len(views.c2w), MOST_RENDERS)
    error_m, both, true_pixels = 0.0, 0, 0
    of_colour: dict[str, list[float]] = {"psnr_db": [], "ssim": [], "lpips": []}
    with rendered_views(mesh, views.camera, views.c2w) as mapped:
        for index in chosen:
            true, seen = views.view(index), mapped.view(index)
            there = true.depth_m > 0
            common = there & (seen.depth_m > 0)
            error_m += float(np.abs(true.depth_m - seen.depth_m)[common].sum(dtype=np.float64))
            both, true_pixels = both + int(common.sum()), true_pixels + int(there.sum())
            if true.rgb is not None and seen.rgb is not None:
                of_colour["psnr_db"].append(psnr_db(true.rgb, seen.rgb))
                of_colour["ssim"].append(ssim(true.rgb, seen.rgb))
                if lpips is not None:
                    of_colour["lpips"].append(lpips(true.rgb, seen.rgb))
    means = {name: float(np.mean(numbers)) if numbers else None for name, numbers in of_colour.items()}
    return Rendered(error_m / both if both else None, both / true_pixels if true_pixels else None, **means)


def psnr_db(true: Colour, seen: Colour) -> float:
    """Return the peak signal-to-noise ratio of images (H, W, 3), over all channels; peak 255."""
    import cv2

    return min(float(cv2.PSNR(true, seen, 255.0)), HIGHEST_PSNR_DB)


def ssim(true: Colour, seen: Colour) -> float:
    """Return the structural similarity of images (H, W, 3), the mean over channels and pixels.

    Wang et al. 2004: a Gaussian window of 11 x 11 with sigma 1.5, K1 = 0.01, K2 = 0.03, a range of 255; at the border
    the image is mirrored (cv2.quality).
    """
    import cv2

    return float(np.mean(cv2.quality.QualitySSIM.create(true).compute(seen)[:3]))


# A map that lies in the true world, beside the truth: what every metric of a map is computed from.


ICP_SAMPLES = 20_000
FEWEST_POINTS = 3  # that can be laid over others

Distances: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class PaperDistances:
    """Distances (N,) and (M,) between points drawn on the map and on the truth, after ICP: the paper's code.

    shift_m, turn_deg: by how much ICP moved the map's middle, and turned it.
    """

    accuracy_m: Distances
    completion_m: Distances
    shift_m: float
    turn_deg: float


@dataclass(frozen=True, eq=False)
class ComparedMap:
    """A map and the truth; what is derived of both is computed once, when a metric asks for it.

    map: None where there is none. lpips: how alike two images are, where it is given.
    """

    map: Mesh | None
    truth: TrueMap
    lpips: Compare | None = None

    @cached_property
    def part(self) -> SeenSurface | None:
        """The part of the map that true cameras saw; None where nothing of it was, and without a map."""
        truth = self.truth
        if self.map is None:
            return None
        return seen_surface(self.map, truth.seen, MARGIN_M, truth.sample_count, "map", truth.seed)

    @cached_property
    def accuracy_m(self) -> Distances | None:
        """(N,) from points on the map's surface to the true surface; None where one of both is missing."""
        if self.part is None or self.truth.part is None:
            return None
        return self.truth.part.surface.distances_m(self.part.samples.points_m)

    @cached_property
    def completion_m(self) -> Distances | None:
        """(N,) from points on the true surface to the map's; None where one of both is missing."""
        if self.part is None or self.truth.part is None:
            return None
        return self.part.surface.distances_m(self.truth.points_m)

    @cached_property
    def paper(self) -> PaperDistances | None:
        """Distances after ICP; None where there are too few points for it."""
        if self.part is None or self.truth.part is None:
            return None
        points_m, truth_m = self.part.samples.points_m, self.truth.points_m
        if min(len(points_m), len(truth_m)) < FEWEST_POINTS:
            return None
        by = lay(points_m[:ICP_SAMPLES], truth_m).truth_from_map
        moved_m = points_m @ by[:3, :3].T + by[:3, 3]
        middle_m = points_m.mean(axis=0)
        return PaperDistances(
            to_points(moved_m, tree_of(truth_m))[0],
            to_points(truth_m, tree_of(moved_m))[0],
            float(np.linalg.norm(by[:3, :3] @ middle_m + by[:3, 3] - middle_m)),
            float(np.degrees(rotation_angle_rad(np.eye(3), by[:3, :3]))),
        )

    @cached_property
    def rendered(self) -> Rendered | None:
        """What true cameras see of the map and of the truth; None without a surface."""
        if self.map is None or not len(self.map.face_starts):
            return None
        return compare_renders(self.map, self.truth.views, lpips=self.lpips)


NEAR_ENOUGH_M = 0.05
"""At most so far from the map a point of the truth is complete: the paper's 5 cm."""
Group: TypeAlias = Literal["geometry", "renders", "paper"]
"""What a metric asks for: surfaces alone, renders of both, or the paper's ICP; the last two only where wanted."""


@dataclass(frozen=True)
class MapMetric(Metric):
    """A metric of a map that lies in the true world; a column of a study's tables.

    compute: what was compared -> a finite number, or None where it has no value.

    Raises ValueError for a name that is none, another `better`, and a label or meaning that is empty.
    """

    compute: Callable[[ComparedMap], float | None]
    group: Group = "geometry"

    def __post_init__(self) -> None:
        check_described(self)


def _of(distances: Distances | None, compute: Callable[[Distances], np.floating | float]) -> float | None:
    return None if distances is None else float(compute(distances))


def _near(distances: Distances | None) -> float | None:
    return _of(distances, lambda distances_m: (distances_m < NEAR_ENOUGH_M).mean())


def _complete(compared: ComparedMap) -> float | None:
    """Return the share of the truth that is near the map: 0 without one."""
    return 0.0 if compared.part is None and compared.truth.part is not None else _near(compared.completion_m)


def _f_score(compared: ComparedMap) -> float | None:
    precision, recall = _near(compared.accuracy_m), _complete(compared)
    if precision is None or recall is None:
        return recall
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _seen(compute: Callable[[Rendered], float | None]) -> Callable[[ComparedMap], float | None]:
    return lambda compared: None if compared.rendered is None else compute(compared.rendered)


def _paper(compute: Callable[[PaperDistances], np.floating | float]) -> Callable[[ComparedMap], float | None]:
    return lambda compared: None if compared.paper is None else float(compute(compared.paper))


_CM = "5 cm"
_KNAPITSCH = "Knapitsch et al., Tanks and Temples, 2017."
_SAMPLES = "between points that were drawn on both surfaces, after ICP"

_METRICS = (
    MapMetric(
        "accuracy_m",
        "accuracy",
        "m",
        "lower",
        "the mean distance from the map's surface to the true surface.",
        lambda compared: _of(compared.accuracy_m, np.mean),
        misleads="a map of one good wall is accurate",
    ),
    MapMetric(
        "accuracy_median_m",
        "accuracy, median",
        "m",
        "lower",
        "the median of these distances.",
        lambda compared: _of(compared.accuracy_m, np.median),
        misleads="a map of one good wall is accurate",
    ),
    MapMetric(
        "completion_m",
        "completion",
        "m",
        "lower",
        "the mean distance from the true surface to the map's.",
        lambda compared: _of(compared.completion_m, np.mean),
        misleads="a cloud is complete",
    ),
    MapMetric(
        "completion_median_m",
        "completion, median",
        "m",
        "lower",
        "the median of these distances.",
        lambda compared: _of(compared.completion_m, np.median),
        misleads="a cloud is complete",
    ),
    MapMetric(
        "completion_ratio_5cm",
        f"completion ratio at {_CM}",
        "",
        "higher",
        f"the share of the true surface that is less than {_CM} from the map; 0 without a map.",
        _complete,
        misleads="with clean depth every map is near 1",
    ),
    MapMetric(
        "accuracy_ratio_5cm",
        f"accuracy ratio at {_CM}",
        "",
        "higher",
        f"the share of the map's surface that is less than {_CM} from the true one.",
        lambda compared: _near(compared.accuracy_m),
        misleads="with clean depth every map is near 1",
    ),
    MapMetric(
        "f_score_5cm",
        f"F-score at {_CM}",
        "",
        "higher",
        f"the harmonic mean of both ratios: neither a map of one good wall nor a cloud gets far. {_KNAPITSCH}",
        _f_score,
    ),
    MapMetric(
        "seen_share",
        "share seen, map",
        "",
        "",
        "the share of the map's area that true cameras saw, which is what was compared: low where much of it lies "
        "behind walls.",
        lambda compared: compared.part and compared.part.share,
    ),
    MapMetric(
        "truth_seen_share",
        "share seen, truth",
        "",
        "",
        "the same of the true surface.",
        lambda compared: compared.truth.part and compared.truth.part.share,
    ),
    MapMetric(
        "depth_l1_m",
        "depth L1",
        "m",
        "lower",
        f"the mean difference of the map's and of the true depth, at {MOST_RENDERS} true poses at most, over the "
        "pixels where both see something.",
        _seen(lambda rendered: rendered.depth_l1_m),
        "renders",
        misleads="holes cost nothing in it, so read the share too; edges rule it",
    ),
    MapMetric(
        "depth_share",
        "depth share",
        "",
        "higher",
        "the share of the pixels with a true depth in which the map is seen.",
        _seen(lambda rendered: rendered.depth_share),
        "renders",
    ),
    MapMetric(
        "psnr_db",
        "PSNR",
        "dB",
        "higher",
        "the peak signal-to-noise ratio of the map's renders against the true colours, the mean over images; what the "
        "map lacks is black.",
        _seen(lambda rendered: rendered.psnr_db),
        "renders",
        misleads="voxels blur: 2 cm give 21 dB with everything true",
    ),
    MapMetric(
        "ssim",
        "SSIM",
        "",
        "higher",
        "the structural similarity of the same: a Gaussian window of 11 x 11 pixels, sigma 1.5, K1 = 0.01, K2 = 0.03, "
        "each channel by itself. Wang et al., IEEE TIP 2004.",
        _seen(lambda rendered: rendered.ssim),
        "renders",
        misleads="voxels blur",
    ),
    MapMetric(
        "lpips",
        "LPIPS",
        "",
        "lower",
        "the distance of the same by a network whose weights the user gives. Zhang et al., CVPR 2018.",
        _seen(lambda rendered: rendered.lpips),
        "renders",
    ),
    MapMetric(
        "paper_accuracy_m",
        "accuracy (paper)",
        "m",
        "lower",
        f"the mean distance {_SAMPLES}: its code.",
        _paper(lambda distances: distances.accuracy_m.mean()),
        "paper",
    ),
    MapMetric(
        "paper_completion_m",
        "completion (paper)",
        "m",
        "lower",
        f"the mean distance {_SAMPLES}: its code.",
        _paper(lambda distances: distances.completion_m.mean()),
        "paper",
    ),
    MapMetric(
        "paper_completion_ratio",
        "completion ratio (paper)",
        "",
        "higher",
        f"the share of distances {_SAMPLES}, below {_CM}: its code.",
        _paper(lambda distances: (distances.completion_m < NEAR_ENOUGH_M).mean()),
        "paper",
    ),
    MapMetric(
        "paper_accuracy_m2",
        "accuracy (paper's formula)",
        "m2",
        "lower",
        "the mean square, as its table says.",
        _paper(lambda distances: (distances.accuracy_m**2).mean()),
        "paper",
    ),
    MapMetric(
        "paper_completion_m2",
        "completion (paper's formula)",
        "m2",
        "lower",
        "the mean square, as its table says.",
        _paper(lambda distances: (distances.completion_m**2).mean()),
        "paper",
    ),
    MapMetric(
        "paper_completion_ratio_squared",
        "completion ratio (paper's formula)",
        "",
        "higher",
        "the share of squares of at most 0.05, as its table says: distances up to 22 cm.",
        _paper(lambda distances: (distances.completion_m**2 <= NEAR_ENOUGH_M).mean()),
        "paper",
    ),
    MapMetric(
        "paper_icp_shift_m",
        "ICP, shift",
        "m",
        "lower",
        f"how far ICP moved the map's middle; pairs farther apart than {LARGEST_M:g} m are left out.",
        _paper(lambda distances: distances.shift_m),
        "paper",
    ),
    MapMetric(
        "paper_icp_turn_deg",
        "ICP, turn",
        "deg",
        "lower",
        "by which angle ICP turned the map.",
        _paper(lambda distances: distances.turn_deg),
        "paper",
    ),
)
"""Those of the paper: its code takes plain distances, its table of definitions prints squares."""

DOOR = Door("noisy_world.map_metrics", "metric", "METRIC", (MapMetric,))

MAP_METRICS = Registry(DOOR, __package__, listed=_METRICS)
"""In the order in which they are shown, then those of installed packages; in tables their names begin with `map.`."""

MAP_PREFIX = "map."


# How alike two images look to a network, such as LPIPS, whose weights the user gives as an ONNX file.
#
# No weights come with Noisy World. OpenCV runs the network, so no other framework is needed.


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
            raise InputError(path, f"OpenCV cannot load it: {_reason(error)}", remedy=REMEDY) from error

    def __call__(self, first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
        """Return the distance of two images (H, W, 3), RGB. Raises InputError where the network gives no number."""
        import cv2

        try:
            for name, image in zip(INPUTS, (first, second), strict=True):
                self._net.setInput(np.ascontiguousarray(_planes(image)), name)
            given = np.asarray(self._net.forward())
        except cv2.error as error:
            raise InputError(self._path, f"OpenCV cannot run it: {_reason(error)}", remedy=REMEDY) from error
        if given.size != 1 or not math.isfinite(float(given.reshape(-1)[0])):
            raise InputError(self._path, f"gives {given.shape}, not one number", remedy=REMEDY)
        return float(given.reshape(-1)[0])


def _planes(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(H, W, 3) uint8 -> (1, 3, H, W) float32 in [-1, 1]."""
    return (image.astype(np.float32) / np.float32(127.5) - 1).transpose(2, 0, 1)[None]


def _reason(error: Exception) -> str:
    """Return what OpenCV says, without where in its source."""
    return (getattr(error, "err", "") or str(error)).strip().splitlines()[-1][:200]


# The numbers of a map: how far it is from the truth, how much of the truth it holds, and how it looks.


Values: TypeAlias = dict[str, float | None]


@dataclass(frozen=True)
class MapScore:
    """What is said of a map. values: by the names of MAP_METRICS, None where a metric has no value.

    culling: which parts were compared. truth: what it was held against. samples: points on each of both.
    """

    values: Values
    culling: Culling
    truth: Origin
    samples: int


def score_map(
    mesh: Mesh | None,
    truth: TrueMap,
    *,
    truth_from_map: ArrayLike | None = None,
    paper: bool = True,
    renders: bool = True,
    lpips: Compare | None = None,
) -> MapScore:
    """Hold a map against the truth.

    mesh: None where there is none. truth_from_map: (4, 4), with a scale or without one: the alignment of the
    trajectory that the map was made along; None where the map lies in the true world already. paper: also the numbers
    as the paper's code makes them. renders: also those of renders. lpips: how alike two images are, where it is given.
    Raises ValueError for a transformation that is none.
    """
    if mesh is not None and truth_from_map is not None:
        mesh = moved(mesh, np.asarray(truth_from_map, dtype=np.float64))
    compared = ComparedMap(mesh, truth, lpips)
    wanted = {"geometry", *(["renders"] if renders else []), *(["paper"] if paper else [])}
    values = {
        name: checked_value(metric, metric.compute(compared), MAP_METRICS)
        for name, metric in MAP_METRICS.items()
        if metric.group in wanted
    }
    return MapScore(values, truth.seen.culling, truth.origin, truth.sample_count)


def moved(mesh: Mesh, by: NDArray[np.float64]) -> Mesh:
    """Return a mesh in other axes, (4, 4). Raises ValueError where that is no finite affine transformation."""
    if by.shape != (4, 4) or not np.isfinite(by).all() or np.any(by[3] != (0, 0, 0, 1)):
        raise ValueError("a map is moved by a finite (4, 4) matrix whose last row is 0 0 0 1")
    return replace(mesh, vertices_m=mesh.vertices_m @ by[:3, :3].T + by[:3, 3])
