# SPDX-License-Identifier: GPL-3.0-or-later
"""The table by which Redwood's simulator warps depth: over the image and at five distances, in a text file.

The format is that of redwood-data.org's dist-model.txt, which Open3D reads: five lines of head, comments after %, then
for each of 80 x 80 cells, row by row, 3 numbers that do not count, 5 of how often it was measured, 10 that do not
count, and 5 factors, at 1, 3, 5, 7 and 9 m. A cell that was nowhere measured 8000 times has no depth.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.regular_files import read_text

CELLS, DISTANCES = 80, 5
HEAD, NUMBERS = 5, 23  # lines; numbers of a cell
MEASURED, FACTORS = slice(3, 8), slice(18, 23)
LEAST = 8000.0  # measurements
WIDTH_PX, HEIGHT_PX = 640, 480  # of the image that the table was measured in
NOTHING = 1e-5  # a factor that gives no depth


def warp_table(path: Path) -> NDArray[np.float32]:
    """Return the factors (80, 80, 5) of a file, 0 where a cell has no depth; it is kept while the file stays.

    Raises OSError where it cannot be read, and ValueError, with what is wrong, where it is no such table.
    """
    status = path.stat()
    return _read(str(path), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=4)
def _read(path: str, _changed_ns: int, _size: int) -> NDArray[np.float32]:
    try:
        lines = read_text(path).splitlines()[HEAD:]
    except UnicodeDecodeError as error:
        raise ValueError("is no text") from error
    wanted = f"after {HEAD} lines a table has {CELLS * CELLS * NUMBERS} numbers"
    words = " ".join(line.partition("%")[0] for line in lines).split()
    if len(words) != CELLS * CELLS * NUMBERS:
        raise ValueError(f"holds {len(words)} words, but {wanted}")
    try:
        values = np.array(words, np.float64)
    except ValueError as error:
        raise ValueError(f"holds something else than numbers, but {wanted}") from error
    if not np.isfinite(values).all():
        raise ValueError("holds numbers that are not finite")
    cells = values.reshape(CELLS, CELLS, NUMBERS)
    known = (cells[..., MEASURED] >= LEAST).any(axis=-1, keepdims=True)
    table = np.where(known, cells[..., FACTORS], 0.0).astype(np.float32)
    table.setflags(write=False)
    return table


def warped(
    table: NDArray[np.float32], depth_m: NDArray[np.float32], rows: NDArray[np.int32], columns: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Return depth (H, W) over the table's factor at the places (H, W) of the image, 0 where there is none.

    The factor is interpolated between the distances; an image of another size than the table's is taken for it scaled.
    """
    height, width = depth_m.shape
    cell = tuple(
        (np.rint(place * ((size - 1) / max(side - 1, 1))).astype(np.int32)) // (size // CELLS)
        for place, side, size in ((rows, height, HEIGHT_PX), (columns, width, WIDTH_PX))
    )
    after = ((depth_m + np.float32(1)) / np.float32(2)).astype(np.int32)
    part = (depth_m - (2 * after - 1).astype(np.float32)) / np.float32(2)
    near, far = (table[(*cell, np.clip(index, 0, DISTANCES - 1))] for index in (after - 1, after))
    factor = (np.float32(1) - part) * near + part * far
    return np.divide(depth_m, factor, out=np.zeros_like(depth_m), where=factor > NOTHING)
