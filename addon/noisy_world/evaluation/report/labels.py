# SPDX-License-Identifier: GPL-3.0-or-later
"""What columns mean: headings, units and sentences for the metrics of runs and for what the tables share."""

from ..analysis.run_results import RESULT
from ..maps.names import MAP_PREFIX
from ..measured import metric_of
from ..metrics.success import IS_INCOMPLETE
from .tables import Column

SHARED = {
    column.name: column
    for column in (
        Column("scene", "scene"),
        Column("setting", "setting", meaning="what was done to the sequence, by the preset's name"),
        Column("perturbation", "perturbation"),
        Column("mode", "mode", meaning="static: one severity; dynamic: drawn anew for each frame"),
        Column("severity", "severity", meaning="1 to 5; none where parameters take its place"),
        Column("seed", "seed"),
        Column("system", "system"),
        Column("repeat", "repeat"),
        Column("outcome", "outcome", meaning="how the system's process ended"),
        Column("failure", "failure", meaning="why the estimate has no score"),
        Column(RESULT, "result", meaning=f"complete, incomplete ({IS_INCOMPLETE}) or failed"),
        Column("runs", "runs", meaning="all of them, failed and incomplete ones too"),
        Column("n", "n"),
        Column("failed", "failed", better="lower", meaning="runs that gave no estimate, or one that cannot be scored"),
        Column("incomplete", "incomplete", better="lower", meaning=f"runs that {IS_INCOMPLETE}"),
        Column("frames", "frames"),
        Column("seconds", "time", "s", meaning="on the wall"),
        Column("processor_s", "processor time", "s"),
        Column("peak_memory_bytes", "peak memory", "bytes"),
    )
}


def column_of(name: str) -> Column:
    """Return how a column of a table is shown; one that nobody described has its name for a heading."""
    if name in SHARED:
        return SHARED[name]
    metric = metric_of(name)
    if metric is None:
        return Column(name, name)
    label = f"map {metric.label}" if name.startswith(MAP_PREFIX) else metric.label
    return Column(name, label, metric.unit, metric.better, metric.meaning)
