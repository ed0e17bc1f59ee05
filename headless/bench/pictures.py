# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's plot: the time of a frame against the errors of colour and depth; a line joins the best trade-offs."""

from collections.abc import Sequence
from pathlib import Path

from .results import Results

MARKS = {"cycles": "o", "eevee": "s", "workbench": "^", "embree": "D"}


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return the points that no other beats in both coordinates (less is better), by rising first coordinate."""
    best = float("inf")
    front = []
    for index in sorted(range(len(points)), key=lambda k: points[k]):
        if points[index][1] < best:
            best = points[index][1]
            front.append(index)
    return front


def draw(results: Results, path: Path) -> None:
    """Draw and save."""
    import matplotlib as mpl  # noqa: PLC0415 - slow, and needed only at the end

    mpl.use("Agg")
    from matplotlib import pyplot  # noqa: PLC0415
    from matplotlib.lines import Line2D  # noqa: PLC0415

    figure, (colour, depth) = pyplot.subplots(1, 2, figsize=(11, 4.6), constrained_layout=True)
    colour_error = [255 * 10 ** (-row.rgb["psnr_db"] / 20) for row in results.rows]
    depth_error = [max(shape["max"] for shape in row.analytic.values()) for row in results.rows]
    panels = (
        (colour, colour_error, "colour: RMS difference from 256 samples, of 255"),
        (depth, depth_error, "depth: largest relative error off edges"),
    )
    for axes, error, label in panels:
        times_s = [row.frame_s.median for row in results.rows]
        for row, time_s, value in zip(results.rows, times_s, error, strict=True):
            half = time_s * row.frame_s.relative / 2
            axes.errorbar(time_s, value, xerr=half, fmt=MARKS[row.engine], color=f"C{list(MARKS).index(row.engine)}")
            axes.annotate(f"{row.samples}", (time_s, value), textcoords="offset points", xytext=(6, 4), fontsize=8)
        front = pareto_front(list(zip(times_s, error, strict=True)))
        axes.plot([times_s[k] for k in front], [error[k] for k in front], "k--", linewidth=0.8, zorder=0)
        axes.set(xscale="log", yscale="log", xlabel="seconds a frame, colour and depth on disk", ylabel=label)
        axes.grid(visible=True, which="both", linewidth=0.3)
    colour.yaxis.set_minor_formatter("{x:g}")
    colour.yaxis.set_major_formatter("{x:g}")
    for item in results.others:
        colour.axvline(item["frame_s"]["median"], color="grey", linewidth=0.8, linestyle=":")
        colour.text(
            item["frame_s"]["median"],
            0.02,
            f" {item['name']}",
            rotation=90,
            fontsize=7,
            color="grey",
            transform=colour.get_xaxis_transform(),
        )
    handles = [
        Line2D([], [], marker=mark, linestyle="", color=f"C{k}", label=engine)
        for k, (engine, mark) in enumerate(MARKS.items())
    ]
    handles.append(Line2D([], [], linestyle="--", color="k", linewidth=0.8, label="best trade-offs"))
    depth.legend(handles=handles, fontsize=8, title="number: samples")
    machine = results.machine
    figure.suptitle(
        f"Room of 1.6 million triangles, 1200 x 680; {machine['processor']}, {machine['threads']} threads; "
        f"Noisy World {machine['noisy_world']}, Blender {machine['blender']}",
        fontsize=9,
    )
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
