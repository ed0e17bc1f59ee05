# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures of single runs: their paths, their errors over time, and frames where they went wrong."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.regular_files import read_bytes, read_text
from .figures.drawing import Picture
from .figures.over_time import TimePanel, over_time
from .figures.paths import PathPanel, paths
from .picks import ERROR, Pick, picked_runs, picked_sequences
from .reading import REMEDY, Results, read_rows
from .tables import shown

STRIPS = ("orb_tracked", "psnr_db", "laplacian_variance", "image_noise", "depth_missing", "depth_noise_m", "speed_mps")
MOST_STRIPS = 5
MOST_FRAMES = 12

Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class FramePicture:
    """A picture of a frame, as JPEG, with what is to be said of it. name: of its file, without the ending."""

    name: str
    about: str
    jpeg: bytes


@dataclass(frozen=True)
class _Errors:
    """errors.csv of a run: (N,) each, and (N, 3) aligned positions; NaN where a frame has none."""

    stamps_s: Floats
    error_m: Floats
    position_m: Floats


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
    said: dict[Path, list[str]] = {}
    names: dict[Path, str] = {}
    for runs in picked_sequences(results)[1:]:
        pictures = _thumbs(results.sequence_folder(runs[0]))
        if not pictures:
            missing.append(f"{_name(runs[0])} has no pictures of its frames.")
            continue
        for run in runs:
            if worst := _worst(results, run, missing):
                number, path = _nearest(pictures, worst[0])
                names[path] = f"{_name(run)}, frame {number}"
                said.setdefault(path, []).append(f"{run['system']} {worst[1]}")
    return [
        FramePicture(f"frame_{number:02d}", f"{names[path]}: {'; '.join(said[path])}", read_bytes(path))
        for number, path in enumerate(list(said)[:MOST_FRAMES], start=1)
    ]


def _path(results: Results, pick: Pick, missing: list[str]) -> PathPanel | None:
    run = pick.run
    truth = _true_positions(results.sequence_folder(run) / "truth.txt", missing)
    if truth is None:
        return None
    errors = _errors(results.run_folder(run) / "errors.csv", missing)
    estimated, error_m = np.zeros((0, 3)), np.zeros(0)
    if errors is not None:
        known = np.isfinite(errors.error_m) & np.isfinite(errors.position_m).all(axis=1)
        estimated, error_m = errors.position_m[known], errors.error_m[known]
    ending = run["failure"] or run["outcome"]
    said = ending if run["failed"] else f"ATE {shown(run.get(ERROR), 3)} m"
    if run["incomplete"]:
        said += f", {run['tracked_share']:.0%} tracked"
    lines = (f"{run['system']}: {pick.why}", f"{run['scene']}/{run['setting']}", said)
    return PathPanel(lines, truth, estimated, error_m)


def _times(results: Results, runs: Sequence[Mapping[str, Any]], missing: list[str]) -> TimePanel | None:
    errors = {str(run["system"]): _errors(results.run_folder(run) / "errors.csv", missing) for run in runs}
    known = {name: value for name, value in errors.items() if value is not None}
    if not known:
        return None
    stamps_s = next(iter(known.values())).stamps_s
    curves = {name: value.error_m for name, value in known.items() if len(value.stamps_s) == len(stamps_s)}
    strips = _strips(results.sequence_folder(runs[0]) / "frames.csv", stamps_s, missing)
    return TimePanel(_name(runs[0]), stamps_s - stamps_s[0], curves, strips)


def _errors(path: Path, missing: list[str]) -> _Errors | None:
    columns = _columns(path, missing, ("stamp_s", "error_m", "x_m", "y_m", "z_m"))
    if columns is None:
        return None
    position_m = np.stack([columns[name] for name in ("x_m", "y_m", "z_m")], axis=1)
    return _Errors(columns["stamp_s"], columns["error_m"], position_m)


def _strips(path: Path, stamps_s: Floats, missing: list[str]) -> dict[str, Floats]:
    """Return what was done to each frame: severities, then the indicators of STRIPS; a value holds until the next."""
    columns = _columns(path, missing, ("stamp_s",))
    if columns is None or len(columns["stamp_s"]) != len(stamps_s):
        return {}
    severities = [name for name in columns if name.startswith("severity")]
    chosen = [*severities, *(name for name in STRIPS if name in columns)]
    found = {name: _held(columns[name]) for name in chosen}
    known = [(name, values) for name, values in found.items() if name in severities or _varies(values)]
    return dict(known[:MOST_STRIPS])


def _varies(values: Floats) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and bool(np.ptp(known) > 0.0)


def _held(values: Floats) -> Floats:
    """Return values in which a missing one is the last that was known."""
    places = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return values[places]


def _columns(path: Path, missing: list[str], needed: Sequence[str]) -> dict[str, Floats] | None:
    """Return a table's columns of numbers, NaN for empty cells; None where it is not there, and says so."""
    if not path.is_file():
        missing.append(f"{path.parent.name}/{path.name} of {'/'.join(path.parts[-6:-2])} is not there.")
        return None
    rows = read_rows(path)
    if not rows:
        return None
    columns = {}
    for name in rows[0]:
        try:
            columns[name] = np.array([float(row[name]) if row[name] else np.nan for row in rows])
        except (TypeError, ValueError):
            if name in needed:
                raise InputError(path, f"column {name!r} holds what is no number") from None
    for name in needed:
        if name not in columns:
            raise InputError(path, f"has no column {name!r}")
    if not np.isfinite(columns["stamp_s"]).all():
        raise InputError(path, "column 'stamp_s' holds what is no time")
    return columns


def _true_positions(path: Path, missing: list[str]) -> Floats | None:
    """Return (N, 3): the positions of a path in TUM's format."""
    if not path.is_file():
        missing.append(f"{'/'.join(path.parts[-5:])} is not there: the path is not drawn.")
        return None
    try:
        lines = [line.split() for line in read_text(path).splitlines() if line and line[0] != "#"]
    except (OSError, UnicodeError) as error:
        raise InputError(path, f"cannot be read: {error}", remedy=REMEDY) from error
    try:
        return np.array([[float(value) for value in line[1:4]] for line in lines]).reshape(-1, 3)
    except ValueError:
        raise InputError(path, "holds a line that is no pose in TUM's format") from None


def _worst(results: Results, run: Mapping[str, Any], missing: list[str]) -> tuple[int, str] | None:
    """Return the frame where a run was lost first, else where it erred most, and a phrase on that."""
    errors = _errors(results.run_folder(run) / "errors.csv", missing)
    if errors is None or not np.isfinite(errors.error_m).any():
        return None
    known = np.isfinite(errors.error_m)
    first = int(np.argmax(known))
    lost = np.flatnonzero(~known[first:])
    if len(lost):
        return first + int(lost[0]), f"is lost at frame {first + int(lost[0])}"
    index = int(np.nanargmax(errors.error_m))
    return index, f"is off by {shown(errors.error_m[index], 3)} m at frame {index}"


def _thumbs(folder: Path) -> list[tuple[int, Path]]:
    """Return the pictures of a sequence's frames, by the number that their names end with."""
    return sorted(_numbered(folder / "thumbs"))


def _nearest(pictures: Sequence[tuple[int, Path]], number: int) -> tuple[int, Path]:
    return min(pictures, key=lambda item: (abs(item[0] - number), item[0]))


def _numbered(folder: Path) -> Iterator[tuple[int, Path]]:
    for path in folder.glob("*.jpg"):
        if number := re.search(r"(\d+)$", path.stem):
            yield int(number[1]), path


def _name(run: Mapping[str, Any]) -> str:
    return f"{run['scene']}/{run['setting']}/seed-{run['seed']}"
