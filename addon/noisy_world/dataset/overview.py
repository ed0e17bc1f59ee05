# SPDX-License-Identifier: GPL-3.0-or-later
"""A contact sheet of a dataset: a few frames of each sequence, colour above depth, without repeating what is equal.

Other channels are not on it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..channels import COLOUR_AND_DEPTH, in_order
from ..core.file_access import read_bytes
from ..core.srgb import encoded
from ..images.image_files import read_pixels
from ..images.pixels import decode_light, rgb_bytes
from ..layouts import OutputFormat
from ..layouts.layout import StampsLike

# Chosen, so that the sheet fits a screen's width and its text can be read.
COLUMNS = 5
TILE_WIDTH_PX = 320
GAP_PX = 8
LABEL_PX = 26
MAX_SEQUENCES = 24
BACKGROUND = 24
INK = (225, 225, 225)
VOID_GREY = 60


def draw_overview(
    out: Path, output: OutputFormat, frames: Mapping[str, Sequence[int]], stamps: Mapping[str, StampsLike]
) -> bytes:
    """Draw the contact sheet and return it as PNG.

    out: the dataset. frames: the numbers of the frames of each sequence, by the sequence's folder; the first
    MAX_SEQUENCES are shown. stamps: the time stamps of each scene's frames, by the scene's name. Of a scene's later
    sequences only what differs from the first one is shown. All depths share one colour scale, from the nearest to the
    farthest shown.
    """
    import cv2

    shown = list(_shown(frames).items())
    models = _first_of_scene([folder for folder, _ in shown])
    named = {folder: output.names(stamps[_scene(folder)]) for folder, _ in shown}
    names = {folder: {"rgb": name.rgb, "depth": name.depth} for folder, name in named.items()}
    same = {
        (folder, modality): folder != models[folder]
        and all(
            _same_bytes(out / folder / name, out / models[folder] / name)
            for name in map(names[folder][modality], numbers)
        )
        for folder, numbers in shown
        for modality in in_order(COLOUR_AND_DEPTH.intersection(output.modalities))
    }
    depths_m = {
        folder: [_read_depth(out / folder / named[folder].depth(frame), output) for frame in numbers]
        for folder, numbers in shown
        if same.get((folder, "depth")) is False
    }
    seen_m = np.concatenate([depth_m[depth_m > 0] for row in depths_m.values() for depth_m in row] or [np.zeros(0)])
    near_m, far_m = (float(seen_m.min()), float(seen_m.max())) if seen_m.size else (0.0, 1.0)
    rows = [_legend(near_m, far_m)] if depths_m else []
    for folder, numbers in shown:
        as_there = [word for word, key in (("colour", "rgb"), ("depth", "depth")) if same.get((folder, key))]
        note = f"   ({' and '.join(as_there)} as in {models[folder]})" if as_there else ""
        rows.append(_label(f"{folder}   frames {', '.join(str(number) for number in numbers)}{note}"))
        if same.get((folder, "rgb")) is False:
            rows.append(_row([_read_rgb(out / folder / named[folder].rgb(frame)) for frame in numbers]))
        if folder in depths_m:
            rows.append(_row([colour_depth(depth_m, near_m, far_m) for depth_m in depths_m[folder]]))
    if len(frames) > MAX_SEQUENCES:
        rows.append(_label(f"and {len(frames) - MAX_SEQUENCES} more sequences"))
    _, data = cv2.imencode(".png", np.concatenate(rows)[..., ::-1])
    return data.tobytes()


def _shown(frames: Mapping[str, Sequence[int]]) -> dict[str, list[int]]:
    return {folder: spread(numbers, COLUMNS) for folder, numbers in list(frames.items())[:MAX_SEQUENCES] if numbers}


def needed_frames(frames: Mapping[str, Sequence[int]]) -> dict[str, set[int]]:
    """Return the frames whose images are needed to draw the sheet: those shown, and those that these are compared with.

    frames: the numbers of all, by the sequence's folder.
    """
    shown = _shown(frames)
    needed = {folder: set(numbers) for folder, numbers in shown.items()}
    for folder, model in _first_of_scene(list(shown)).items():
        needed[model] |= set(shown[folder]) & set(frames[model])
    return needed


def _first_of_scene(folders: Sequence[str]) -> dict[str, str]:
    """Return for each sequence (`setting/scene`) the first sequence of its scene."""
    first: dict[str, str] = {}
    return {folder: first.setdefault(_scene(folder), folder) for folder in folders}


def _scene(folder: str) -> str:
    return folder.split("/")[1]


def _same_bytes(path: Path, other: Path) -> bool:
    return other.exists() and (path.samefile(other) or read_bytes(path) == read_bytes(other))


def spread(numbers: Sequence[int], count: int) -> list[int]:
    """Return so many of the numbers, evenly apart, the first and the last among them; all where there are fewer."""
    chosen = np.unique(np.linspace(0, len(numbers) - 1, min(count, len(numbers))).round().astype(int))
    return [numbers[index] for index in chosen]


def _read_rgb(path: Path) -> NDArray[np.uint8]:
    import cv2

    if path.suffix == ".exr":
        rgb = _shown_light(path)
    else:
        rgb = np.asarray(read_pixels(path, cv2.IMREAD_COLOR), np.uint8)[..., ::-1]
    tile = cv2.resize(np.ascontiguousarray(rgb), _tile_size(rgb.shape), interpolation=cv2.INTER_AREA)
    return np.asarray(tile, np.uint8)


def _shown_light(path: Path) -> NDArray[np.uint8]:
    """Return light by sRGB's curve, clipped at 1: the scene's own view transform is Blender's alone."""
    return rgb_bytes(encoded(decode_light(read_bytes(path))))


def _read_depth(path: Path, output: OutputFormat) -> NDArray[np.float64]:
    import cv2

    steps = np.asarray(read_pixels(path, cv2.IMREAD_UNCHANGED), np.uint16)
    # Nearest pixel: averaging would make depths between two surfaces, where there is nothing.
    tile = cv2.resize(steps, _tile_size(steps.shape), interpolation=cv2.INTER_NEAREST)
    return np.divide(tile, output.depth_scale_per_m, dtype=np.float64)


def _tile_size(shape: tuple[int, ...]) -> tuple[int, int]:
    return TILE_WIDTH_PX, max(1, round(TILE_WIDTH_PX * shape[0] / shape[1]))


def colour_depth(depth_m: NDArray[np.floating], near_m: float, far_m: float) -> NDArray[np.uint8]:
    """Return planar depth (H, W) in metres, 0 = void, as colours (H, W, 3): from warm, near_m, to cold; void grey."""
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
    row[8 : 8 + ramp_m.shape[0], left : left + bar_px] = colour_depth(ramp_m + 1e-12, near_m, far_m)
    _write(row, f"planar depth  {near_m:.2f} m", GAP_PX)
    return _write(row, f"{far_m:.2f} m   (grey: void)", left + bar_px + GAP_PX)


def _blank(height: int) -> NDArray[np.uint8]:
    return np.full((height, GAP_PX + COLUMNS * (TILE_WIDTH_PX + GAP_PX), 3), BACKGROUND, dtype=np.uint8)


def _write(row: NDArray[np.uint8], text: str, left: int) -> NDArray[np.uint8]:
    import cv2

    cv2.putText(row, text, (left, 19), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    return row
