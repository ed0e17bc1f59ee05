# SPDX-License-Identifier: GPL-3.0-or-later
"""One scored trajectory: its path over the true one, coloured by the error, and the error over time."""

from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...metrics.frame_errors import FrameErrors
from .drawing import COLOURS, GREY, drawing, fixed_layout
from .paths import decades

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PLOT_WIDTH_IN, PLOT_HEIGHT_IN = 6.4, 7.2
DPI = 150.0
# By the ending of the file; no date and no program's name, so that equal scores give equal bytes.
METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
INK = "black"  # no colour of the errors


@dataclass(frozen=True, eq=False)
class ScoredPath:
    """What is drawn. true_m: (N, 3) positions of all frames; errors: of the same frames. title: what is said above."""

    true_m: NDArray[np.float64]
    errors: FrameErrors
    title: str


def scored_path_bytes(scored: ScoredPath, ending: str) -> bytes:
    """Return the figure as a file. ending: of METADATA."""
    with drawing(PLOT_WIDTH_IN, PLOT_HEIGHT_IN) as figure:
        draw_scored_path(figure, scored)
        fixed_layout(figure)
        target = BytesIO()
        figure.savefig(target, format=ending, dpi=DPI, metadata=METADATA[ending])
        return target.getvalue()


def draw_scored_path(figure: "Figure", scored: ScoredPath) -> None:
    """Draw the path, seen along the axis in which it extends least, and below it the error of each frame."""
    over, below = figure.subplots(2, 1, height_ratios=(5, 2))
    figure.suptitle(scored.title, fontsize=9.0)
    _path(figure, over, scored)
    _errors(below, scored.errors)


def plane_of(positions_m: NDArray[np.float64]) -> tuple[int, int]:
    """(N, 3) -> the two axes in which a path extends most, in order: worlds differ in which axis points up."""
    least = int(np.argmin(np.ptp(positions_m, axis=0)[::-1]))  # of equal ones, the last is looked along
    first, second = (axis for axis in range(3) if axis != 2 - least)
    return first, second


def _path(figure: "Figure", axes: "Axes", scored: ScoredPath) -> None:
    from matplotlib.colors import LogNorm

    true_m, errors = scored.true_m, scored.errors
    first, second = plane_of(true_m)
    axes.plot(true_m[:, first], true_m[:, second], color=GREY, linewidth=2.5, alpha=0.5, label="true path")
    axes.plot(*true_m[0, [first, second]], "o", markersize=5, color=GREY, label="its beginning")
    lost = ~errors.tracked
    if lost.any():
        place = true_m[lost]
        axes.plot(place[:, first], place[:, second], "x", markersize=4, color=INK, label="frame without a pose")
    known = np.isfinite(errors.error_m)
    if known.any():
        error_m = errors.error_m[known]
        low, high = decades(error_m[error_m > 0.0])
        estimated_m = errors.position_m[known]
        points = axes.scatter(
            estimated_m[:, first],
            estimated_m[:, second],
            c=error_m,
            s=8,
            cmap="plasma",
            norm=LogNorm(low, high, clip=True),
            linewidths=0,
            zorder=3,
            label="estimate",
        )
        bar = figure.colorbar(points, ax=axes, fraction=0.04, pad=0.02)
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.set_label("error of position [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"world {'xyz'[first]} [m]")
    axes.set_ylabel(f"world {'xyz'[second]} [m]")
    axes.legend(loc="best", fontsize=7.0)


def _errors(axes: "Axes", errors: FrameErrors) -> None:
    times_s = errors.stamp_s - errors.stamp_s[0]
    axes.plot(times_s, errors.error_m, color=COLOURS[0], marker=".", markersize=2.5, linewidth=1.0)
    lost = times_s[~errors.tracked]
    axes.plot(lost, np.zeros(len(lost)), "|", color=INK, markersize=7, transform=axes.get_xaxis_transform())
    axes.set_xlim(0.0, max(float(times_s[-1]), 1e-3))
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("error [m]")
    axes.grid(visible=True, linewidth=0.3)
