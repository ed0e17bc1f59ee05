# SPDX-License-Identifier: GPL-3.0-or-later
"""Every metric of a map by its name."""

from ..metrics.metric import Metric
from .icp import LARGEST_M
from .renders import MOST_RENDERS

_CM = "5 cm"
_KNAPITSCH = "Knapitsch et al., Tanks and Temples, 2017."

GEOMETRY = (
    Metric("accuracy_m", "accuracy", "m", "lower", "the mean distance from the map's surface to the true surface."),
    Metric("accuracy_median_m", "accuracy, median", "m", "lower", "the median of these distances."),
    Metric("completion_m", "completion", "m", "lower", "the mean distance from the true surface to the map's."),
    Metric("completion_median_m", "completion, median", "m", "lower", "the median of these distances."),
    Metric(
        "completion_ratio_5cm",
        f"completion ratio at {_CM}",
        "",
        "higher",
        f"the share of the true surface that is less than {_CM} from the map; 0 without a map.",
    ),
    Metric(
        "accuracy_ratio_5cm",
        f"accuracy ratio at {_CM}",
        "",
        "higher",
        f"the share of the map's surface that is less than {_CM} from the true one.",
    ),
    Metric(
        "f_score_5cm",
        f"F-score at {_CM}",
        "",
        "higher",
        f"the harmonic mean of both ratios: neither a map of one good wall nor a cloud gets far. {_KNAPITSCH}",
    ),
    Metric(
        "seen_share",
        "share seen, map",
        "",
        "",
        "the share of the map's area that true cameras saw, which is what was compared: low where much of it lies "
        "behind walls.",
    ),
    Metric("truth_seen_share", "share seen, truth", "", "", "the same of the true surface."),
)

RENDERS = (
    Metric(
        "depth_l1_m",
        "depth L1",
        "m",
        "lower",
        f"the mean difference of the map's and of the true depth, at {MOST_RENDERS} true poses at most, over the "
        "pixels where both see something.",
    ),
    Metric(
        "depth_share",
        "depth share",
        "",
        "higher",
        "the share of the pixels with a true depth in which the map is seen.",
    ),
    Metric(
        "psnr_db",
        "PSNR",
        "dB",
        "higher",
        "the peak signal-to-noise ratio of the map's renders against the true colours, the mean over images; what the "
        "map lacks is black.",
    ),
    Metric(
        "ssim",
        "SSIM",
        "",
        "higher",
        "the structural similarity of the same: a Gaussian window of 11 x 11 pixels, sigma 1.5, K1 = 0.01, K2 = 0.03, "
        "each channel by itself. Wang et al., IEEE TIP 2004.",
    ),
    Metric(
        "lpips",
        "LPIPS",
        "",
        "lower",
        "the distance of the same by a network whose weights the user gives. Zhang et al., CVPR 2018.",
    ),
)

_SAMPLES = "between points that were drawn on both surfaces, after ICP"

PAPER = (
    Metric("paper_accuracy_m", "accuracy (paper)", "m", "lower", f"the mean distance {_SAMPLES}: its code."),
    Metric("paper_completion_m", "completion (paper)", "m", "lower", f"the mean distance {_SAMPLES}: its code."),
    Metric(
        "paper_completion_ratio",
        "completion ratio (paper)",
        "",
        "higher",
        f"the share of distances {_SAMPLES}, below {_CM}: its code.",
    ),
    Metric("paper_accuracy_m2", "accuracy (paper's formula)", "m2", "lower", "the mean square, as its table says."),
    Metric("paper_completion_m2", "completion (paper's formula)", "m2", "lower", "the mean square, as its table says."),
    Metric(
        "paper_completion_ratio_squared",
        "completion ratio (paper's formula)",
        "",
        "higher",
        "the share of squares of at most 0.05, as its table says: distances up to 22 cm.",
    ),
    Metric(
        "paper_icp_shift_m",
        "ICP, shift",
        "m",
        "lower",
        f"how far ICP moved the map's middle; pairs farther apart than {LARGEST_M:g} m are left out.",
    ),
    Metric("paper_icp_turn_deg", "ICP, turn", "deg", "lower", "by which angle ICP turned the map."),
)
"""The paper's code takes plain distances, its table of definitions prints squares."""

MAP_METRICS: dict[str, Metric] = {item.name: item for item in (*GEOMETRY, *RENDERS, *PAPER)}
"""In the order in which they are shown; in tables their names begin with `map.`."""

MAP_PREFIX = "map."
