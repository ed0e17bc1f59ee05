# SPDX-License-Identifier: GPL-3.0-or-later
"""A run's error over the clean one of the same system in the same scene, and success by that.

A threshold in metres says whether a path is good enough for a task; it sees nothing of noise where a system errs by
millimetres. What noise did is seen beside the error without it, whatever a system's accuracy is.
"""

from .metric import Metric
from .success import LEAST_TRACKED

OVER_CLEAN = "ate_over_clean"
THRESHOLDS_OVER_CLEAN = (2.0, 5.0, 10.0)
"""Times the clean ATE below which a run counts as a success. Chosen: twice, and an order of magnitude."""


def success_over_clean_name(times: float) -> str:
    """Return the name of the metric of success below so many times the clean error."""
    return f"success_{times:g}x_clean"


def is_success_over_clean(over_clean: float | None, times: float) -> bool:
    """Tell whether a run is a success. over_clean: None for one that failed or is incomplete."""
    return over_clean is not None and over_clean < times


OVER_CLEAN_METRICS: dict[str, Metric] = {
    item.name: item
    for item in (
        Metric(
            OVER_CLEAN,
            "ATE over clean",
            "",
            "lower",
            "ate_rmse_m over that of the same system on the clean frames of the same scene and seed; none for a run "
            f"that failed or is incomplete (tracked less than {LEAST_TRACKED:g} of the frames), or whose clean run is.",
        ),
        *(
            Metric(
                success_over_clean_name(times),
                f"success at {times:g} \u00d7 clean",
                "",
                "higher",
                f"1 where {OVER_CLEAN} is below {times:g}; 0 for a run that failed or is incomplete (tracked less than "
                f"{LEAST_TRACKED:g} of the frames).",
            )
            for times in THRESHOLDS_OVER_CLEAN
        ),
    )
}
"""What is said of a run beside the clean ones of its study, by column."""
