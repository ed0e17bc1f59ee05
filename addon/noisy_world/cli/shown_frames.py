# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of an opened dataset as pictures for people: colour, depth in colours, and what was done in words."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.channels import COLOUR_AND_DEPTH
from ..core.datasets.images import rgb_bytes
from ..core.datasets.overview import BACKGROUND, INK, LABEL_PX, colour_depth, spread
from ..core.geometry import invert_pose, pose, rotation_from_quat_wxyz
from ..core.linear_light import encoded
from ..recipes.opened import Frame, Opened, OpenedSequence

CLEAN = "clean"
SAMPLED = 16  # frames whose depths decide the scale of colours; chosen
_FAR_QUANTILE = 0.99  # chosen: a window's far view leaves the room its colours


@dataclass(frozen=True)
class DepthScale:
    """Which depths the colours span, metres."""

    near_m: float
    far_m: float

    @classmethod
    def of(cls, sequence: OpenedSequence, numbers: Sequence[int]) -> "DepthScale":
        """Return that of a few of the frames: from the nearest to what 99 % of the pixels are nearer than."""
        frames = (sequence[number] for number in spread(numbers, SAMPLED))
        seen = [depth_m[depth_m > 0] for depth_m in (frame.depth_m for frame in frames)]
        seen_m = np.concatenate([np.zeros(0, np.float32), *seen])
        if not seen_m.size:
            return cls(0.0, 1.0)
        return cls(float(seen_m.min()), float(np.quantile(seen_m, _FAR_QUANTILE)))


def colour_and_depth_of(opened: Opened) -> tuple[str, ...]:
    """Return which of colour and depth a dataset has; both where it does not say."""
    held = opened.identity.get("output", {}).get("modalities", COLOUR_AND_DEPTH)
    return tuple(name for name in ("rgb", "depth") if name in held)


def shown_colour(frame: Frame) -> NDArray[np.uint8]:
    """Return a frame's colour (H, W, 3), uint8; light of an EXR by sRGB's curve, clipped at 1."""
    rgb = frame.rgb
    return np.asarray(rgb, np.uint8) if rgb.dtype == np.uint8 else rgb_bytes(encoded(np.asarray(rgb, np.float32)))


def panes(frame: Frame, held: Sequence[str], scale: DepthScale) -> list[NDArray[np.uint8]]:
    """Return a frame's colour and depth (H, W, 3), those that there are."""
    shown = [shown_colour(frame)] if "rgb" in held else []
    return shown + ([colour_depth(frame.depth_m, scale.near_m, scale.far_m)] if "depth" in held else [])


def clean_beside(opened: Opened, name: str) -> OpenedSequence | None:
    """Return the clean sequence of the same scene; None where there is none, or it is this one."""
    setting, _, scene = name.partition("/")
    settings: dict[str, Any] = opened.identity.get("settings", {})
    undone = [other for other, what in settings.items() if not what.get("steps")] or [CLEAN]
    found = next((f"{other}/{scene}" for other in undone if f"{other}/{scene}" in opened), None)
    return None if found is None or setting in undone else opened[found]


def source_frame(frame: Frame) -> int:
    """Return the number of the pose on the scene's path that a frame shows: its own without faster motion."""
    return int(frame.done.get("motion", {}).get("source_frame", frame.index))


def planned_pose(frame: Frame) -> NDArray[np.float64]:
    """Return the pose (4, 4) that a frame's camera would have had without deviation: written = planned @ deviation."""
    deviation = frame.done.get("motion", {}).get("deviation")
    if deviation is None:
        return frame.c2w
    turned = rotation_from_quat_wxyz(np.array(deviation["quat_wxyz"], np.float64))
    return frame.c2w @ invert_pose(pose(turned, np.array(deviation["translation_m"], np.float64)))


def words_of(done: Mapping[str, Any]) -> list[str]:
    """Return what was done to a frame, a few words for each thing: `rgb fog severity 3` for instance."""
    words = [
        f"{channel} {step['name']}" + (f" severity {step['severity']:g}" if step.get("severity") is not None else "")
        for channel in ("rgb", "depth")
        for step in done.get(channel, [])
    ]
    motion, pairing = done.get("motion", {}), done.get("pairing", {})
    if "depth_of_frame" in pairing:
        words.append(f"depth of frame {pairing['depth_of_frame']}")
    if "source_frame" in motion:
        words.append(f"source frame {motion['source_frame']}")
    if "deviation" in motion:
        words.append(f"camera {1000 * np.linalg.norm(motion['deviation']['translation_m']):.0f} mm off its path")
    return words


def side_by_side(tiles: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return images (H, W, 3) beside each other, as high as the first one; even sides, as codecs ask for."""
    height = tiles[0].shape[0]
    row = np.concatenate([fitted(tile, height) for tile in tiles], axis=1)
    return np.pad(row, ((0, row.shape[0] % 2), (0, row.shape[1] % 2), (0, 0)), constant_values=BACKGROUND)


def fitted(image: NDArray[np.uint8], height_px: int) -> NDArray[np.uint8]:
    """Return an image (H, W, 3) as high as this."""
    import cv2

    if image.shape[0] == height_px:
        return image
    size = max(1, round(image.shape[1] * height_px / image.shape[0])), height_px
    return np.asarray(cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA), np.uint8)


def lettered(text: str, width_px: int) -> NDArray[np.uint8]:
    """Return a row (LABEL_PX, W, 3) with a text, which is smaller where it would not fit."""
    import cv2

    row = np.full((LABEL_PX, width_px, 3), BACKGROUND, dtype=np.uint8)
    (wide, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    size = 0.5 * min(1.0, (width_px - 8) / max(wide, 1))
    cv2.putText(row, text, (4, 18), cv2.FONT_HERSHEY_SIMPLEX, size, INK, 1, cv2.LINE_AA)
    return row


def stacked(rows: Iterable[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return rows of several widths above each other, from the left."""
    found = list(rows)
    width = max(row.shape[1] for row in found)
    filled = [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0)), constant_values=BACKGROUND) for row in found]
    return np.concatenate(filled)
