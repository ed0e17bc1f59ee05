# SPDX-License-Identifier: GPL-3.0-or-later
"""What the page opens at a click: each run with its path, its errors and the frame where it went wrong."""

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.file_access import read_bytes
from .metrics import OVER_CLEAN
from .report_tables import ERROR, Results, cell_text, records
from .run_figures import POSITION_M, frame_errors, nearest, plane_of, thumbs, true_positions, worst_frame
from .study_results import ERRORS, TRUTH

POINTS = 100  # of a path, and of its errors: what a figure of a few hundred pixels can show; chosen
MOST_FRAME_BYTES = 700_000  # of all frames in the page; chosen, so that 400 runs stay below 3 MB


@dataclass(frozen=True)
class HeatMap:
    """A table of settings by systems whose cells open runs.

    settings, systems: names; shown: the systems' names with their marks. texts, colours: of each cell, by setting and
    system; a colour is "#rrggbb". about: what the colours say.
    """

    settings: Sequence[str]
    systems: Sequence[str]
    shown: Sequence[str]
    texts: Sequence[Sequence[str]]
    colours: Sequence[Sequence[str]]
    about: str


def opened_runs(results: Results) -> dict[str, Any]:
    """Return all runs of a study, as the page's script reads them: `runs`, `sequences` and `frames`.

    Paths are in millimetres along the two axes in which the true one extends most, at POINTS frames or fewer; an error
    is the largest of the frames between two of them, in metres, null where none of these has a pose. Frames are those
    of the worst runs first, until they take MOST_FRAME_BYTES.
    """
    sequences: dict[tuple[str, ...], int] = {}
    truths: list[dict[str, Any]] = []
    runs: list[dict[str, Any]] = []
    wanted: list[tuple[tuple[int, float], int, Path]] = []
    for run in records(results.runs):
        key = tuple(str(run[name]) for name in ("scene", "setting", "seed"))
        if key not in sequences:
            sequences[key] = len(truths)
            truths.append(_sequence(results, run))
        entry = _entry(run, sequences[key])
        if not results.of_record:
            entry |= _path_and_errors(results, run, truths[sequences[key]])
            if picture := _picture(results, run):
                number, place, entry["worst"] = picture
                entry["frame"] = number
                badness = (int(run["failed"]), float(np.nan_to_num(run.get(ERROR, 0.0))))
                wanted.append((badness, len(runs), place))
        runs.append(entry)
    frames = _frames(runs, sorted(wanted, key=lambda item: (-item[0][0], -item[0][1], item[1])))
    return {"runs": runs, "sequences": truths, "frames": frames}


def _entry(run: Mapping[str, Any], sequence: int) -> dict[str, Any]:
    ending = (run["failure"] or run["outcome"]) if run["failed"] else run["result"]
    ate_m = run.get(ERROR)
    known = isinstance(ate_m, float) and np.isfinite(ate_m) and not run["failed"]
    return {
        **{name: cell_text(run[name]) for name in ("system", "scene", "setting", "seed", "repeat")},
        "sequence": sequence,
        "ended": str(ending),
        "failed": bool(run["failed"]),
        "incomplete": bool(run["incomplete"]),
        "ate_m": _short(ate_m) if known else None,
        "over_clean": _short(run.get(OVER_CLEAN)),
        "tracked": _short(run.get("tracked_share")),
    }


def _sequence(results: Results, run: Mapping[str, Any]) -> dict[str, Any]:
    truth_m = None if results.of_record else true_positions(results.sequence_folder(run) / TRUTH, [])
    if truth_m is None or not len(truth_m):
        return {}
    axes = plane_of(truth_m)
    chosen = np.unique(np.linspace(0, len(truth_m) - 1, min(len(truth_m), POINTS)).round().astype(int))
    return {"axes": "".join("xyz"[axis] for axis in axes), "path": _millimetres(truth_m[chosen][:, list(axes)])}


def _path_and_errors(results: Results, run: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, Any]:
    errors = frame_errors(results.run_folder(run) / ERRORS, [])
    if errors is None or not truth:
        return {}
    axes = ["xyz".index(letter) for letter in truth["axes"]]
    positions_m = np.stack([errors[name] for name in POSITION_M], axis=1)[:, axes]
    parts = np.array_split(np.arange(len(positions_m)), min(len(positions_m), POINTS))
    largest_m = [_largest(errors["error_m"][part]) for part in parts]
    firsts = [part[0] for part in parts]
    times_s = errors["stamp_s"] - errors["stamp_s"][0]
    return {
        "path": _millimetres(positions_m[firsts]),
        "error_m": largest_m,
        "end_s": _short(float(times_s[-1])),
    }


def _largest(values: NDArray[np.float64]) -> float | None:
    known = values[np.isfinite(values)]
    return _short(float(known.max())) if len(known) else None


def _millimetres(positions_m: NDArray[np.float64]) -> list[int | None]:
    """(N, 2) metres -> x, y, x, y, ... in millimetres; null where there is none."""
    flat = positions_m.ravel()
    return [round(1e3 * value) if np.isfinite(value) else None for value in flat.tolist()]


def _short(value: Any) -> float | None:
    """Return a number to three digits, which is what a figure shows; None for none."""
    return float(f"{value:.3g}") if isinstance(value, float | int) and np.isfinite(value) else None


def _picture(results: Results, run: Mapping[str, Any]) -> tuple[int, Path, str] | None:
    """Return the frame nearest to where a run went wrong: its number, its file, and what happened there."""
    pictures = thumbs(results.sequence_folder(run))
    worst = worst_frame(results, run, []) if pictures else None
    if worst is None:
        return None
    number, place = nearest(pictures, worst[0])
    return number, place, worst[1]


def _frames(runs: list[dict[str, Any]], wanted: Sequence[tuple[Any, int, Path]]) -> list[str]:
    """Return the JPEGs as base64, and say in each run which is its own; those that have no room are left out."""
    frames: dict[Path, int] = {}
    texts: list[str] = []
    left = MOST_FRAME_BYTES
    for _, index, place in wanted:
        if place not in frames:
            data = read_bytes(place)
            if len(data) > left:
                continue
            left -= len(data)
            frames[place] = len(texts)
            texts.append(base64.b64encode(data).decode("ascii"))
        runs[index]["picture"] = frames[place]
    return texts


def packed(content: Mapping[str, Any]) -> str:
    """Return JSON, compressed and as base64: the page's script reads it, and nothing of it can be taken for an element.

    Equal contents give equal texts.
    """
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode("ascii")
