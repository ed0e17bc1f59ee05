# SPDX-License-Identifier: GPL-3.0-or-later
"""The errors of a run frame by frame, and the file that holds them: `errors.csv`."""

import csv
import io
import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64: TypeAlias = NDArray[np.float64]

COLUMNS = ("index", "stamp_s", "tracked", "error_m", "rotation_error_deg", "x_m", "y_m", "z_m")


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Of every true frame: (N,) stamps in seconds, whether it has a pose, and how far that is off.

    error_m, rotation_error_deg: (N,), after alignment; NaN where the frame has no pose, and where the run failed.
    position_m: (N, 3) the estimated position in the true world frame.
    """

    stamp_s: Float64
    tracked: NDArray[np.bool_]
    error_m: Float64
    rotation_error_deg: Float64
    position_m: Float64

    def __len__(self) -> int:
        return len(self.stamp_s)


def frame_errors_text(errors: FrameErrors) -> str:
    """Return the errors as CSV: a row for each frame, an empty cell where a number is missing; tracked is 1 or 0."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for index in range(len(errors)):
        numbers = (errors.error_m[index], errors.rotation_error_deg[index], *errors.position_m[index])
        cells = ["" if math.isnan(number) else repr(float(number)) for number in numbers]
        rows.writerow([index, f"{errors.stamp_s[index]:.9f}", int(errors.tracked[index]), *cells])
    return text.getvalue()
