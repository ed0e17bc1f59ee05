# SPDX-License-Identifier: GPL-3.0-or-later
"""A contact sheet of a dataset: a few frames of each sequence, colour above and depth below."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .layouts import Layout

COLUMNS = 5
TILE_WIDTH_PX = 320
GAP_PX = 8
LABEL_PX = 26
MAX_SEQUENCES = 24
BACKGROUND = 24
INK = (225, 225, 225)
VOID_GREY = 60


def draw_overview(out: Path, layout: Layout, frames: Mapping[str, Sequence[int]]) -> bytes:
    """Draw the contact sheet and return it as PNG.

    out: the dataset. frames: the numbers of the frames of each sequence, by the sequence's folder; the first
    MAX_SEQUENCES are shown. All depths share one colour scale, from the nearest to the farthest shown.
    """
    import cv2

    shown = [(folder, _spread(numbers)) for folder, numbers in list(frames.items())[:MAX_SEQUENCES] if numbers]
    tiles = {folder: [_read_pair(out / folder, layout, frame) for frame in numbers] for folder, numbers in shown}
    depths_m = [depth_m[depth_m > 0] for pairs in tiles.values() for _, depth_m in pairs]
    seen_m = np.concatenate(depths_m) if depths_m else np.zeros(0)
    near_m, far_m = (float(seen_m.min()), float(seen_m.max())) if seen_m.size else (0.0, 1.0)
    rows = [_legend(near_m, far_m)]
    for folder, numbers in shown:
        rows.append(_label(f"{folder}   frames {', '.join(str(number) for number in numbers)}"))
        rows.append(_row([rgb for rgb, _ in tiles[folder]]))
        rows.append(_row([_coloured(depth_m, near_m, far_m) for _, depth_m in tiles[folder]]))
    if len(frames) > MAX_SEQUENCES:
        rows.append(_label(f"and {len(frames) - MAX_SEQUENCES} more sequences"))
    _, data = cv2.imencode(".png", np.concatenate(rows)[..., ::-1])
    return data.tobytes()


def _spread(numbers: Sequence[int]) -> list[int]:
    chosen = np.unique(np.linspace(0, len(numbers) - 1, min(COLUMNS, len(numbers))).round().astype(int))
    return [numbers[index] for index in chosen]


def _read_pair(folder: Path, layout: Layout, frame: int) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    import cv2

    rgb = cv2.imread(str(folder / layout.rgb_name(frame)), cv2.IMREAD_COLOR)[..., ::-1]
    steps = cv2.imread(str(folder / layout.depth_name(frame)), cv2.IMREAD_UNCHANGED)
    height = max(1, round(TILE_WIDTH_PX * rgb.shape[0] / rgb.shape[1]))
    size = (TILE_WIDTH_PX, height)
    # Depth is picked, not averaged: between two surfaces there is none.
    small = cv2.resize(steps, size, interpolation=cv2.INTER_NEAREST) / layout.depth_scale_per_m
    return cv2.resize(np.ascontiguousarray(rgb), size, interpolation=cv2.INTER_AREA), small


def _coloured(depth_m: NDArray[np.float64], near_m: float, far_m: float) -> NDArray[np.uint8]:
    import cv2

    level = np.clip((far_m - depth_m) / max(far_m - near_m, 1e-9), 0, 1)  # near is warm
    picture = cv2.applyColorMap((level * 255).round().astype(np.uint8), cv2.COLORMAP_TURBO)[..., ::-1]
    return np.where((depth_m > 0)[..., None], picture, np.uint8(VOID_GREY))


def _row(tiles: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    height = tiles[0].shape[0]
    row = _blank(height + GAP_PX)
    for column, tile in enumerate(tiles):
        left = GAP_PX + column * (TILE_WIDTH_PX + GAP_PX)
        row[:height, left : left + TILE_WIDTH_PX] = tile
    return row


def _label(text: str) -> NDArray[np.uint8]:
    return _write(_blank(LABEL_PX), text, GAP_PX)


def _legend(near_m: float, far_m: float) -> NDArray[np.uint8]:
    row = _blank(LABEL_PX + GAP_PX)
    bar_px = 200
    ramp_m = np.broadcast_to(np.linspace(near_m, far_m, bar_px), (LABEL_PX - 12, bar_px))
    left = GAP_PX + 190
    row[8 : 8 + ramp_m.shape[0], left : left + bar_px] = _coloured(ramp_m + 1e-12, near_m, far_m)
    _write(row, f"planar depth  {near_m:.2f} m", GAP_PX)
    return _write(row, f"{far_m:.2f} m   (grey: void)", left + bar_px + GAP_PX)


def _blank(height: int) -> NDArray[np.uint8]:
    return np.full((height, GAP_PX + COLUMNS * (TILE_WIDTH_PX + GAP_PX), 3), BACKGROUND, dtype=np.uint8)


def _write(row: NDArray[np.uint8], text: str, left: int) -> NDArray[np.uint8]:
    import cv2

    return cv2.putText(row, text, (left, 19), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
