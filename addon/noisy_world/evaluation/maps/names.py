# SPDX-License-Identifier: GPL-3.0-or-later
"""Every metric of a map by its name, ours and those of installed packages, and how each is computed."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from ...core.installed import Door, Registry
from ..metrics.metric import Metric, check_described
from .compared import ComparedMap, Distances, PaperDistances
from .icp import LARGEST_M
from .renders import MOST_RENDERS, Rendered

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
    return _of(distances, lambda found: (found < NEAR_ENOUGH_M).mean())


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
    ),
    MapMetric(
        "accuracy_median_m",
        "accuracy, median",
        "m",
        "lower",
        "the median of these distances.",
        lambda compared: _of(compared.accuracy_m, np.median),
    ),
    MapMetric(
        "completion_m",
        "completion",
        "m",
        "lower",
        "the mean distance from the true surface to the map's.",
        lambda compared: _of(compared.completion_m, np.mean),
    ),
    MapMetric(
        "completion_median_m",
        "completion, median",
        "m",
        "lower",
        "the median of these distances.",
        lambda compared: _of(compared.completion_m, np.median),
    ),
    MapMetric(
        "completion_ratio_5cm",
        f"completion ratio at {_CM}",
        "",
        "higher",
        f"the share of the true surface that is less than {_CM} from the map; 0 without a map.",
        _complete,
    ),
    MapMetric(
        "accuracy_ratio_5cm",
        f"accuracy ratio at {_CM}",
        "",
        "higher",
        f"the share of the map's surface that is less than {_CM} from the true one.",
        lambda compared: _near(compared.accuracy_m),
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
        _paper(lambda found: found.accuracy_m.mean()),
        "paper",
    ),
    MapMetric(
        "paper_completion_m",
        "completion (paper)",
        "m",
        "lower",
        f"the mean distance {_SAMPLES}: its code.",
        _paper(lambda found: found.completion_m.mean()),
        "paper",
    ),
    MapMetric(
        "paper_completion_ratio",
        "completion ratio (paper)",
        "",
        "higher",
        f"the share of distances {_SAMPLES}, below {_CM}: its code.",
        _paper(lambda found: (found.completion_m < NEAR_ENOUGH_M).mean()),
        "paper",
    ),
    MapMetric(
        "paper_accuracy_m2",
        "accuracy (paper's formula)",
        "m2",
        "lower",
        "the mean square, as its table says.",
        _paper(lambda found: (found.accuracy_m**2).mean()),
        "paper",
    ),
    MapMetric(
        "paper_completion_m2",
        "completion (paper's formula)",
        "m2",
        "lower",
        "the mean square, as its table says.",
        _paper(lambda found: (found.completion_m**2).mean()),
        "paper",
    ),
    MapMetric(
        "paper_completion_ratio_squared",
        "completion ratio (paper's formula)",
        "",
        "higher",
        "the share of squares of at most 0.05, as its table says: distances up to 22 cm.",
        _paper(lambda found: (found.completion_m**2 <= NEAR_ENOUGH_M).mean()),
        "paper",
    ),
    MapMetric(
        "paper_icp_shift_m",
        "ICP, shift",
        "m",
        "lower",
        f"how far ICP moved the map's middle; pairs farther apart than {LARGEST_M:g} m are left out.",
        _paper(lambda found: found.shift_m),
        "paper",
    ),
    MapMetric(
        "paper_icp_turn_deg",
        "ICP, turn",
        "deg",
        "lower",
        "by which angle ICP turned the map.",
        _paper(lambda found: found.turn_deg),
        "paper",
    ),
)
"""Those of the paper: its code takes plain distances, its table of definitions prints squares."""

DOOR = Door("noisy_world.map_metrics", "metric", "METRIC", (MapMetric,))

MAP_METRICS = Registry(DOOR, lambda: _METRICS)
"""In the order in which they are shown, then those of installed packages; in tables their names begin with `map.`."""

MAP_PREFIX = "map."
