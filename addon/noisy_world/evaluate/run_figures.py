# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures of single runs: their paths, their errors over time, and frames where they went wrong."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import read_bytes, read_text
from .figures import COLOURS, GREY, NARROW_IN, Picture, drawing, fixed_layout, line_styles, shortened, svg_bytes
from .pose_errors import FrameErrors
from .report_tables import ERROR, REMEDY, Pick, Results, cell_text, picked_runs, picked_sequences, read_texts
from .study_results import ERRORS, FRAMES, THUMBS, TRUTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Errors over time, above what was done to each frame.


WIDTH_IN = 9.0
PLOT_IN, STRIP_IN, GAP_IN = 1.5, 0.17, 0.55
SMALLEST_M = 1e-5  # errors below are drawn here: the scale is logarithmic


@dataclass(frozen=True)
class TimePanel:
    """Runs on one sequence.

    title: what sequence. times_s: (N,), from its beginning. errors_m: (N,) by system, NaN where it was not tracked.
    strips: (N,) by name, what was done to each frame or measured of it, NaN where nothing is known.
    """

    title: str
    times_s: NDArray[np.float64]
    errors_m: Mapping[str, NDArray[np.float64]]
    strips: Mapping[str, NDArray[np.float64]]


def over_time(panels: Sequence[TimePanel]) -> Picture:
    """Draw the panels one below the other."""
    about = (
        "The error of the position of every frame over time, after alignment, on a logarithmic scale; a gap is where a "
        "system was not tracking. Lines at the bottom mark that too."
    )
    if any(panel.strips for panel in panels):
        about += (
            " Strips below show what varied of what was done to each frame and was measured of it, dark is small and "
            "bright is large; where only some frames were looked at, a value holds until the next."
        )
    wide, narrow = (_drawn(panels, width_in) for width_in in (WIDTH_IN, NARROW_IN))
    return Picture("over_time", "Errors over time", about, wide, narrow)


def _drawn(panels: Sequence[TimePanel], width_in: float) -> bytes:
    from matplotlib.lines import Line2D

    systems = line_styles(sorted({name for panel in panels for name in panel.errors_m}))
    heights = [PLOT_IN + STRIP_IN * len(panel.strips) + GAP_IN for panel in panels]
    with drawing(width_in, sum(heights) + 0.3) as figure:
        parts = figure.add_gridspec(len(panels), 1, height_ratios=heights)
        for index, panel in enumerate(panels):
            ratios = [PLOT_IN, *([STRIP_IN * len(panel.strips)] if panel.strips else [])]
            grid = parts[index].subgridspec(len(ratios), 1, height_ratios=ratios).subplots(sharex=True, squeeze=False)
            _errors(grid[0, 0], panel, systems)
            if panel.strips:
                grid[0, 0].tick_params(bottom=False)
                _strips(grid[1, 0], panel)
            grid[-1, 0].set_xlabel("time [s]")
        handles = [Line2D([], [], color=colour, label=shortened(name, 40)) for name, (colour, _) in systems.items()]
        figure.legend(handles=handles, loc="outside upper center", ncols=min(3, max(1, len(handles))))
        return svg_bytes(figure)


def _errors(axes: "Axes", panel: TimePanel, systems: dict[str, tuple[str, str]]) -> None:
    top = 1.0
    for index, (name, (colour, _)) in enumerate(systems.items()):
        if name not in panel.errors_m:
            continue
        error_m = np.maximum(panel.errors_m[name], SMALLEST_M)
        axes.plot(panel.times_s, error_m, color=colour, linewidth=1.0)
        # Below the curves, a line of the system's colour where it was lost.
        lost = np.where(np.isnan(error_m), 0.05 + 0.045 * index, np.nan)
        axes.plot(panel.times_s, lost, color=colour, linewidth=2.0, transform=axes.get_xaxis_transform())
        if np.isfinite(error_m).any():
            top = max(top, float(np.nanmax(error_m)))
    axes.set_yscale("log")
    axes.set_ylim(SMALLEST_M, top * 2)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    axes.set_ylabel("error [m]")
    axes.set_title(shortened(panel.title, 60), loc="left")
    axes.grid(visible=True, linewidth=0.3)


def _strips(axes: "Axes", panel: TimePanel) -> None:
    """Draw a row of colours for each strip, from its least to its largest value, which stand beside it."""
    times_s, count = panel.times_s, len(panel.strips)
    end_s = float(times_s[-1] + (times_s[-1] - times_s[0]) / max(1, len(times_s) - 1)) if len(times_s) > 1 else 1.0
    rows = np.full((count, len(times_s)), np.nan)
    for row, values in enumerate(panel.strips.values()):
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        rows[row] = (values - low) / (high - low if high > low else 1.0)
        label = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        place = 1.0 - (row + 0.5) / count
        axes.text(1.005, place, label, transform=axes.transAxes, va="center", fontsize=6)
    extent = (float(times_s[0]), end_s, float(count), 0.0)
    axes.imshow(rows, aspect="auto", interpolation="nearest", cmap="viridis", vmin=0.0, vmax=1.0, extent=extent)
    for row in range(1, count):
        axes.axhline(row, color="white", linewidth=3.0)
    axes.set_yticks(np.arange(count) + 0.5, [shortened(name, 24) for name in panel.strips], fontsize=6)
    axes.tick_params(axis="y", length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)


# Paths from above: the true one in grey, the estimated one aligned to it and coloured by its error.


SIZE_IN = 2.3  # of a panel
ACROSS, ACROSS_NARROW = 4, 2


@dataclass(frozen=True)
class PathPanel:
    """The path of one run. true_m: (N, 3), all frames. estimated_m: (M, 3), aligned, M >= 0; error_m: (M,).

    lines: of text above it.
    """

    lines: tuple[str, ...]
    true_m: NDArray[np.float64]
    estimated_m: NDArray[np.float64]
    error_m: NDArray[np.float64]


def paths(panels: Sequence[PathPanel]) -> Picture:
    """Draw a panel for each path; all share one scale of colours, which is logarithmic."""
    about = (
        "Paths seen from above: the true one in grey, its beginning as a dot, and the estimated positions after "
        "alignment, coloured by their error."
    )
    wide, narrow = (_draw_paths(panels, most_across) for most_across in (ACROSS, ACROSS_NARROW))
    return Picture("paths", "Paths and their errors", about, wide, narrow)


def _draw_paths(panels: Sequence[PathPanel], most_across: int) -> bytes:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    errors = np.concatenate([panel.error_m for panel in panels]) if panels else np.zeros(0)
    errors = errors[np.isfinite(errors) & (errors > 0)]
    low, high = decades(errors)
    norm = LogNorm(low, high, clip=True)
    rows = max(1, math.ceil(len(panels) / most_across))
    across = max(1, math.ceil(len(panels) / rows))
    with drawing(max(NARROW_IN, SIZE_IN * across + 0.8), (SIZE_IN + 0.25) * rows + 0.3) as figure:
        grid = figure.subplots(rows, across, squeeze=False)
        for axes, panel in zip(grid.flat, panels, strict=False):
            axes.plot(panel.true_m[:, 0], panel.true_m[:, 1], color=GREY, linewidth=2.5, alpha=0.5)
            axes.plot(*panel.true_m[0, :2], marker="o", markersize=4, color=GREY)
            if len(panel.estimated_m):
                axes.scatter(
                    panel.estimated_m[:, 0],
                    panel.estimated_m[:, 1],
                    c=np.maximum(panel.error_m, low),
                    s=3,
                    cmap="plasma",
                    norm=norm,
                    linewidths=0,
                    rasterized=len(panel.estimated_m) > 2000,
                )
            axes.set_title("\n".join(shortened(line, 36) for line in panel.lines), fontsize=6.5)
            axes.set_aspect("equal", adjustable="datalim")
            axes.tick_params(labelsize=6)
            axes.locator_params(nbins=4)
        for axes in list(grid.flat)[len(panels) :]:
            axes.set_visible(False)
        figure.supxlabel("world x [m]", fontsize=7)
        figure.supylabel("world y [m]", fontsize=7)
        bar = figure.colorbar(ScalarMappable(norm, "plasma"), ax=grid, fraction=0.03, pad=0.01)
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.set_label("error of position [m]")
        return svg_bytes(figure)


def decades(errors: NDArray[np.float64]) -> tuple[float, float]:
    """Return whole powers of ten around the errors, at least one decade apart and at most five."""
    if not len(errors):
        return 0.001, 1.0
    high = 10.0 ** math.ceil(math.log10(float(errors.max())))
    low = 10.0 ** math.floor(math.log10(float(np.quantile(errors, 0.02))))
    return max(min(low, high / 10), high / 1e5), high


STRIPS = ("orb_tracked", "psnr_db", "laplacian_variance", "image_noise", "depth_missing", "depth_noise_m", "speed_mps")
MOST_STRIPS = 5
MOST_FRAMES = 12
POSITION_M = ("x_m", "y_m", "z_m")

Floats: TypeAlias = NDArray[np.float64]
Columns: TypeAlias = dict[str, Floats]


@dataclass(frozen=True)
class FramePicture:
    """A picture of a frame, as JPEG, with what is to be said of it. name: of its file, without the ending."""

    name: str
    about: str
    jpeg: bytes


def path_picture(results: Results, missing: list[str]) -> Picture | None:
    """Draw the paths of the picked runs. missing: gets a sentence for what is not there."""
    panels = [panel for pick in picked_runs(results) if (panel := _path(results, pick, missing))]
    return paths(panels) if panels else None


def time_picture(results: Results, missing: list[str]) -> Picture | None:
    """Draw the errors over time of the picked sequences."""
    panels = [panel for runs in picked_sequences(results) if (panel := _times(results, runs, missing))]
    return over_time(panels) if panels else None


def worst_frames(results: Results, missing: list[str]) -> list[FramePicture]:
    """Return pictures of frames, nearest to where systems were lost first or erred most, of the picked sequences."""
    captions: dict[Path, list[str]] = {}
    names: dict[Path, str] = {}
    for runs in picked_sequences(results)[1:]:
        pictures = thumbs(results.sequence_folder(runs[0]))
        if not pictures:
            missing.append(f"{_name(runs[0])} has no pictures of its frames.")
            continue
        for run in runs:
            if worst := worst_frame(results, run, missing):
                number, path = nearest(pictures, worst[0])
                names[path] = f"{_name(run)}, frame {number}"
                captions.setdefault(path, []).append(f"{run['system']} {worst[1]}")
    return [
        FramePicture(f"frame_{number:02d}", f"{names[path]}: {'; '.join(captions[path])}", read_bytes(path))
        for number, path in enumerate(list(captions)[:MOST_FRAMES], start=1)
    ]


def _path(results: Results, pick: Pick, missing: list[str]) -> PathPanel | None:
    run = pick.run
    truth = true_positions(results.sequence_folder(run) / TRUTH, missing)
    if truth is None:
        return None
    errors = frame_errors(results.run_folder(run) / ERRORS, missing)
    estimated, error_m = np.zeros((0, 3)), np.zeros(0)
    if errors is not None:
        positions_m = np.stack([errors[name] for name in POSITION_M], axis=1)
        known = np.isfinite(errors["error_m"]) & np.isfinite(positions_m).all(axis=1)
        estimated, error_m = positions_m[known], errors["error_m"][known]
    ending = run["failure"] or run["outcome"]
    title = ending if run["failed"] else f"ATE {cell_text(run.get(ERROR), 3)} m"
    if run["incomplete"]:
        title += f", {run['tracked_share']:.0%} tracked"
    lines = (f"{run['system']}: {pick.why}", f"{run['scene']}/{run['setting']}", title)
    return PathPanel(lines, truth, estimated, error_m)


def _times(results: Results, runs: Sequence[Mapping[str, Any]], missing: list[str]) -> TimePanel | None:
    errors = {str(run["system"]): frame_errors(results.run_folder(run) / ERRORS, missing) for run in runs}
    known = {name: value for name, value in errors.items() if value is not None}
    if not known:
        return None
    stamps_s = next(iter(known.values()))["stamp_s"]
    curves = {name: value["error_m"] for name, value in known.items() if len(value["stamp_s"]) == len(stamps_s)}
    strips = _strip_values(results.sequence_folder(runs[0]) / FRAMES, stamps_s, missing)
    return TimePanel(_name(runs[0]), stamps_s - stamps_s[0], curves, strips)


def frame_errors(path: Path, missing: list[str]) -> Columns | None:
    """Return errors.csv of a run, as `frame_errors_text` writes it."""
    return _columns(path, missing, ("stamp_s", "error_m", *POSITION_M))


def _strip_values(path: Path, stamps_s: Floats, missing: list[str]) -> dict[str, Floats]:
    """Return what varies over frames: severities, then the indicators of STRIPS; a value holds until the next."""
    columns = _columns(path, missing, ("stamp_s",))
    if columns is None or len(columns["stamp_s"]) != len(stamps_s):
        return {}
    severities = [name for name in columns if name.startswith("severity")]
    chosen = [*severities, *(name for name in STRIPS if name in columns)]
    strips = {name: _held(columns[name]) for name in chosen}
    return dict([item for item in strips.items() if _varies(item[1])][:MOST_STRIPS])


def _varies(values: Floats) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and bool(np.ptp(known) > 0.0)


def _held(values: Floats) -> Floats:
    """Return values in which a missing one is the last that was known."""
    places = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return values[places]


def _columns(path: Path, missing: list[str], needed: Sequence[str]) -> Columns | None:
    """Return a table's columns of numbers, NaN for empty cells; None where it is not there, and says so."""
    if not path.is_file():
        missing.append(f"{path.parent.name}/{path.name} of {'/'.join(path.parts[-6:-2])} is not there.")
        return None
    table = read_texts(path)
    if table.empty:
        return None
    columns = {}
    for name in table.columns:
        try:
            columns[name] = table[name].replace("", "nan").to_numpy(dtype=np.float64)
        except ValueError:
            if name in needed:
                raise InputError(path, f"column {name!r} holds what is no number") from None
    for name in needed:
        if name not in columns:
            raise InputError(path, f"has no column {name!r}")
    if not np.isfinite(columns["stamp_s"]).all():
        raise InputError(path, "column 'stamp_s' holds what is no time")
    return columns


def true_positions(path: Path, missing: list[str]) -> Floats | None:
    """Return (N, 3): the positions of a path in TUM's format."""
    if not path.is_file():
        missing.append(f"{'/'.join(path.parts[-5:])} is not there: the path is not drawn.")
        return None
    try:
        return np.loadtxt(StringIO(read_text(path)), usecols=(1, 2, 3), ndmin=2)
    except (OSError, UnicodeError) as error:
        raise InputError(path, f"cannot be read: {error}", remedy=REMEDY) from error
    except ValueError:
        raise InputError(path, "holds a line that is no pose in TUM's format") from None


def worst_frame(results: Results, run: Mapping[str, Any], missing: list[str]) -> tuple[int, str] | None:
    """Return the frame where a run was lost first, else where it erred most, and a phrase on that."""
    errors = frame_errors(results.run_folder(run) / ERRORS, missing)
    if errors is None or not np.isfinite(errors["error_m"]).any():
        return None
    known = np.isfinite(errors["error_m"])
    first = int(np.argmax(known))
    lost = np.flatnonzero(~known[first:])
    if len(lost):
        return first + int(lost[0]), f"is lost at frame {first + int(lost[0])}"
    index = int(np.nanargmax(errors["error_m"]))
    return index, f"is off by {cell_text(errors['error_m'][index], 3)} m at frame {index}"


def thumbs(folder: Path) -> list[tuple[int, Path]]:
    """Return the pictures of a sequence's frames, by the number that their names end with."""
    return sorted(_numbered(folder / THUMBS))


def nearest(pictures: Sequence[tuple[int, Path]], number: int) -> tuple[int, Path]:
    """Return the picture whose frame is nearest to a frame."""
    return min(pictures, key=lambda item: (abs(item[0] - number), item[0]))


def _numbered(folder: Path) -> Iterator[tuple[int, Path]]:
    for path in folder.glob("*.jpg"):
        if number := re.search(r"(\d+)$", path.stem):
            yield int(number[1]), path


def _name(run: Mapping[str, Any]) -> str:
    return f"{run['scene']}/{run['setting']}/seed-{run['seed']}"


# One scored trajectory: its path over the true one, coloured by the error, and the error over time.


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
    _draw_path(figure, over, scored)
    _draw_errors(below, scored.errors)


def plane_of(positions_m: NDArray[np.float64]) -> tuple[int, int]:
    """(N, 3) -> the two axes in which a path extends most, in order: worlds differ in which axis points up."""
    least = int(np.argmin(np.ptp(positions_m, axis=0)[::-1]))  # of equal ones, the last is looked along
    first, second = (axis for axis in range(3) if axis != 2 - least)
    return first, second


def _draw_path(figure: "Figure", axes: "Axes", scored: ScoredPath) -> None:
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


def _draw_errors(axes: "Axes", errors: FrameErrors) -> None:
    times_s = errors.stamp_s - errors.stamp_s[0]
    axes.plot(times_s, errors.error_m, color=COLOURS[0], marker=".", markersize=2.5, linewidth=1.0)
    lost = times_s[~errors.tracked]
    axes.plot(lost, np.zeros(len(lost)), "|", color=INK, markersize=7, transform=axes.get_xaxis_transform())
    axes.set_xlim(0.0, max(float(times_s[-1]), 1e-3))
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("error [m]")
    axes.grid(visible=True, linewidth=0.3)
