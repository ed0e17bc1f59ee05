# SPDX-License-Identifier: GPL-3.0-or-later
"""Which metric a column of a study's tables holds."""

from collections.abc import Mapping

from .maps.names import MAP_METRICS, MAP_PREFIX
from .metrics import METRICS, PAPER_METRICS, PAPER_PREFIX, Metric
from .metrics.over_clean import OVER_CLEAN_METRICS

OF_PREFIX: dict[str, Mapping[str, Metric]] = {PAPER_PREFIX: PAPER_METRICS, MAP_PREFIX: MAP_METRICS}


def metric_of(column: str) -> Metric | None:
    """Return the metric of a table's column, `ate_rmse_m`, `paper.sr` or `map.accuracy_m`; None for another column."""
    for prefix, metrics in OF_PREFIX.items():
        if column.startswith(prefix):
            return metrics.get(column.removeprefix(prefix))
    return METRICS.get(column) or OVER_CLEAN_METRICS.get(column)
