# SPDX-License-Identifier: GPL-3.0-or-later
"""What the sequences of a dataset are like: images, depth and motion of each setting, and distributions of depth."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ...recipes.opened import OpenedSequence
from .columns import Columns, table_of
from .indicators import AGAINST_CLEAN, IMAGES
from .intervals import mean_interval
from .motion import MOTION, motion_of
from .run_table import SETTING
from .spread import means_of_scenes

if TYPE_CHECKING:
    from pandas import DataFrame

DEPTH = ("depth_missing", "depth_median_m", "depth_noise_m", "depth_error_m")
PICTURES = tuple(name for name in (*IMAGES, *AGAINST_CLEAN) if name not in DEPTH)
COLUMNS = [
    *SETTING,
    "indicator",
    "n",
    "n_scenes",
    "mean",
    "low",
    "high",
    "minimum",
    "maximum",
    "low_frames",
    "high_frames",
]

DEPTH_BIN_M = 0.25
FARTHEST_M = 10.0


def sequences_tables(sequences: Columns) -> dict[str, "DataFrame"]:
    """Return the tables images, depth and motion: each indicator of each setting, over its sequences.

    mean, low, high: of the scenes' means, with the interval over scenes at large; minimum, maximum: of the sequences'
    means; low_frames, high_frames: means of the sequences' 5 % and 95 % quantiles of frames.
    """
    parts = {"images": PICTURES, "depth": DEPTH, "motion": MOTION}
    return {
        part: _table(sequences, [name for name in names if f"{name}_mean" in sequences])
        for part, names in parts.items()
    }


def _table(sequences: Columns, names: list[str]) -> "DataFrame":
    rows: list[dict[str, Any]] = []
    for key, group in sequences.groups(SETTING):
        for name in names:
            known = group.where(np.isfinite(group[f"{name}_mean"]))
            values, of_scenes = known[f"{name}_mean"], means_of_scenes(known, f"{name}_mean")
            row: dict[str, Any] = {**dict(zip(SETTING, key, strict=True)), "indicator": name, "n": len(known)}
            if not len(values):
                continue
            row |= {"n_scenes": len(of_scenes), "mean": float(np.mean(of_scenes))}
            row["low"], row["high"] = mean_interval(of_scenes)
            row |= {"minimum": float(values.min()), "maximum": float(values.max())}
            for end in ("low", "high"):
                column = f"{name}_{end}"
                row[f"{end}_frames"] = float(known[column].mean()) if column in known else float("nan")
            rows.append(row)
    return table_of(rows, COLUMNS)


def depth_distribution(sequence: OpenedSequence, *, every: int = 10) -> "DataFrame":
    """Return how a sequence's depth is distributed: the share of the pixels that have depth in each bin, and how many.

    Bins of 25 cm up to 10 m; the last is what lies beyond, its to_m infinite. Columns: from_m, to_m, share, pixels.
    every: of the frames. The share of pixels without depth is the indicator depth_missing. Raises ValueError for every
    < 1.
    """
    from pandas import DataFrame

    if every < 1:
        raise ValueError(f"every is 1 or more, not {every}")
    edges = np.append(np.arange(0.0, FARTHEST_M + DEPTH_BIN_M / 2.0, DEPTH_BIN_M), np.inf)
    counts = np.zeros(len(edges) - 1, dtype=np.int64)
    for frame in list(sequence)[::every]:
        depth_m = frame.depth_m
        places = (depth_m[depth_m > 0.0] / DEPTH_BIN_M).astype(np.int64)
        counts += np.bincount(np.minimum(places, len(counts) - 1), minlength=len(counts))
    shares = counts / counts.sum() if counts.sum() else np.full(len(counts), np.nan)
    return DataFrame({"from_m": edges[:-1], "to_m": edges[1:], "share": shares, "pixels": counts})


def motion_distribution(sequence: OpenedSequence) -> "DataFrame":
    """Return quantiles of a sequence's motion over its frames: columns quantile and those of motion_of."""
    from pandas import DataFrame

    frames = list(sequence)
    columns = motion_of(np.stack([frame.c2w for frame in frames]), [frame.stamp_s for frame in frames])
    quantiles = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
    found: dict[str, Any] = {"quantile": quantiles}
    for name, values in columns.items():
        known = values[np.isfinite(values)]
        found[name] = np.quantile(known, quantiles) if known.size else np.full(len(quantiles), np.nan)
    return DataFrame(found)
