# SPDX-License-Identifier: GPL-3.0-or-later
"""What is kept of a sequence after its runs: the true path, indicators, and a few thumbnails."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from ...core.trajectories.stamped_poses import tum_text
from ...recipes.opened import Frame
from ..analysis.indicators import indicators_of
from ..metrics.frame_errors import FrameErrors
from .cases import Case
from .origin import CaseSequence
from .results import FRAMES, INDICATORS, THUMBS, TRUTH, ResultsFolder

THUMB_PX = 240  # the width of each of the two images beside each other
EVENLY = 3  # pictures along the sequence, beside the worst frames


def describe(results: ResultsFolder, case: Case, sequence: CaseSequence) -> None:
    """Write what stays of a sequence, if it is not there; the indicators last."""
    if results.is_described(case):
        return
    folder = results.of_case(case)
    numbers = list(sequence.opened.frames)
    show(results, case, sequence, _evenly(len(numbers)))
    results.write(folder / TRUTH, tum_text(sequence.truth))
    found = indicators_of(sequence.opened, sequence.clean)
    results.write(folder / FRAMES, _frames_text({**found.per_frame, **severities(sequence.opened)}))
    results.write_json(folder / INDICATORS, {**_plain(found.values), "frames": len(numbers)})


def show(results: ResultsFolder, case: Case, sequence: CaseSequence, places: Iterable[int]) -> None:
    """Write small pictures of frames, by their places in the sequence, where they are not there."""
    numbers = list(sequence.opened.frames)
    for place in places:
        path = results.of_case(case) / THUMBS / f"{numbers[place]:06d}.jpg"
        if not path.is_file():
            results.write_bytes(path, _thumb(sequence, numbers[place]))


def severities(frames: Iterable[Frame]) -> dict[str, NDArray[np.float64]]:
    """Return the severity of each frame (N,) by perturbation, as severity_NAME; NaN where it was not perturbed so."""
    done = [[step for kind in ("rgb", "depth") for step in frame.done.get(kind, ())] for frame in frames]
    found: dict[str, NDArray[np.float64]] = {}
    for place, steps in enumerate(done):
        for step in steps:
            column = found.setdefault(f"severity_{step['name']}", np.full(len(done), np.nan))
            column[place] = step.get("severity", np.nan)
    return {name: column for name, column in found.items() if np.isfinite(column).any()}


def worst_frames(errors: FrameErrors) -> list[int]:
    """Return the rows of the frame with the largest error, and of the first frame that is lost after a tracked one."""
    found = [int(np.nanargmax(errors.error_m))] if np.isfinite(errors.error_m).any() else []
    begun = np.maximum.accumulate(errors.tracked) if len(errors) else errors.tracked
    lost = np.flatnonzero(begun & ~errors.tracked)
    return [*found, *lost[:1].tolist()]


def _evenly(count: int) -> list[int]:
    return sorted({(2 * part + 1) * count // (2 * EVENLY) for part in range(EVENLY)}) if count else []


def _frames_text(columns: Mapping[str, NDArray[np.float64]]) -> str:
    """Return columns as CSV: a row for each frame, an empty cell where a number is missing."""
    whole = {"index": 0}
    cells = [[_cell(number, whole.get(name)) for number in values.tolist()] for name, values in columns.items()]
    lines = [",".join(columns), *(",".join(row) for row in zip(*cells, strict=True))]
    return "".join(f"{line}\n" for line in lines)


def _cell(number: float, digits: int | None) -> str:
    if not np.isfinite(number):
        return ""
    return repr(number) if digits is None else f"{number:.{digits}f}"


def _plain(values: Mapping[str, float | None]) -> dict[str, float | None]:
    """Return numbers as JSON has them: what is not finite is null."""
    return {name: None if value is None or not np.isfinite(value) else float(value) for name, value in values.items()}


def _thumb(sequence: CaseSequence, number: int) -> bytes:
    """Return a small JPEG of a frame, beside its clean counterpart on the left if there is one."""
    import cv2

    shown = [sequence.opened[number].rgb]
    if sequence.clean is not None:
        shown.insert(0, sequence.clean[number].rgb)
    picture = np.hstack([_small(image) for image in shown])
    done, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])
    assert done, "an image of bytes can be encoded"
    return data.tobytes()


def _small(image: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.uint8]:
    import cv2

    assert image.dtype == np.uint8, "datasets of light, as EXR files hold it, are not evaluated"

    high, wide = image.shape[:2]
    size = (min(THUMB_PX, wide), max(1, round(high * min(THUMB_PX, wide) / wide)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
