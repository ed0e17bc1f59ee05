# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset as one page that opens offline: a slider over frames, settings side by side, depth beside colour."""

import base64
import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..core.file_access import read_text
from ..core.packages import PACKAGE
from ..core.progress import counted

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..dataset.loader import Opened
    from .frame_views import DepthScale


PAGE_FRAMES = 40  # of each sequence, where nothing else is asked for; chosen: seven sequences are 7 MB
TILE_PX = 240  # the height of an image; chosen
QUALITY = 70  # of the page's JPEG; chosen
BESIDE = 4  # settings that are shown at first; chosen
TEMPLATE = PACKAGE / "cli" / "look_page.html"


def look_page(opened: "Opened", parts: Mapping[str, Sequence[int]], every: int | None) -> str:
    """Return the page. parts: the numbers of the frames of each sequence. every: of these every n-th, else PAGE_FRAMES.

    What the dataset says is data to the page's script, which makes texts of it; nothing is fetched.
    """
    from ..dataset.sequence import spread
    from .frame_views import DepthScale, clean_beside, colour_and_depth_of

    held = colour_and_depth_of(opened)
    scales: dict[str, DepthScale] = {}  # one for each scene, so that settings can be compared
    sequences = []
    for name, numbers in parts.items():
        shown = spread(numbers, PAGE_FRAMES) if every is None else list(numbers)[::every]
        scene = name.rpartition("/")[2]
        if scene not in scales:
            beside = clean_beside(opened, name)
            scales[scene] = (
                DepthScale(0.0, 1.0)
                if "depth" not in held
                else DepthScale.of(*((opened[name], shown) if beside is None else (beside, list(beside.frames))))
            )
        sequences.append(_sequence(opened, name, shown, held, scales[scene]))
    left_out = sum(len(numbers) for numbers in parts.values()) - sum(len(item["frames"]) for item in sequences)
    note = f"The dataset has {counted(left_out, 'frame')} more; --every 1 shows all." if left_out else ""
    data = {
        "title": opened.place.rstrip("/").rsplit("/", 1)[-1],
        "channels": ["colour" if name == "rgb" else name for name in held],
        "sequences": sequences,
        "beside": BESIDE,
        "note": note,
    }
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    return read_text(TEMPLATE).replace(">DATA<", f">{text}<", 1)


def _sequence(
    opened: "Opened", name: str, numbers: Sequence[int], held: Sequence[str], scale: "DepthScale"
) -> dict[str, Any]:
    from .frame_views import panes, words_of

    sequence = opened[name]
    setting, _, scene = name.rpartition("/")
    frames = [
        {
            "number": frame.index,
            "stamp_s": frame.stamp_s,
            "done": words_of(frame.done),
            "images": [_jpeg(pane) for pane in panes(frame, held, scale)],
        }
        for frame in (sequence[number] for number in numbers)
    ]
    depth = f"Depth from {scale.near_m:.2f} m, warm, to {scale.far_m:.2f} m." if "depth" in held else ""
    return {"name": name, "setting": setting or name, "scene": scene or name, "frames": frames, "depth": depth}


def _jpeg(image: "NDArray[np.uint8]") -> str:
    """Return an image (H, W, 3), made small, as base64 of a JPEG."""
    import cv2

    from .frame_views import fitted

    small = fitted(image, min(TILE_PX, image.shape[0]))
    _, data = cv2.imencode(".jpg", small[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return base64.b64encode(data.tobytes()).decode("ascii")
