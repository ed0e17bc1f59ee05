# SPDX-License-Identifier: GPL-3.0-or-later
"""Frost: the scene through an iced pane."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.file_access import read_bytes
from ...core.node_graph import BroughtImage, Kind, Socket, Value
from ...core.schema import key
from ...images.pixels import as_float, rgb_bytes
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import by_bands
from ._noise import look_up, white_noise

# Pictures of ice on a pane, drawn by `headless/pictures/draw_ice.py`: loaded, and tinted like photographs of ice.


# Chosen: a frame of 1200 x 680 and the tenth that frost's crop moves in (1320 x 748) fit without enlarging the ice.
HEIGHT_PX, WIDTH_PX = 1024, 1536

Rgb: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class Ice:
    """A grey picture, and the factors per channel that tint its darkest and its brightest greys."""

    name: str
    shadow_rgb: Rgb
    light_rgb: Rgb


# The tints follow those of the five photographs that ImageNet-C picks from; two of these show white ice, so the white
# picture (number 1) is picked twice as often as each of the others.
PICTURES = (
    Ice("sheet", (0.0, 1.33, 1.50), (1.15, 0.95, 1.03)),
    Ice("needles", (0.94, 0.96, 1.0), (0.98, 0.99, 1.04)),
    Ice("rime", (0.85, 1.0, 1.12), (0.95, 1.01, 1.05)),
    Ice("ferns", (0.84, 0.97, 1.18), (0.98, 1.01, 1.05)),
)
EQUALLY_OFTEN = (0, 1, 1, 2, 3)


def picture_file(name: str) -> Path:
    """Return the path of a grey picture."""
    return Path(__file__).parent / "ice" / f"{name}.jpg"


def grey_picture(number: int) -> NDArray[np.uint8]:
    """Return one of PICTURES as it is drawn: (HEIGHT_PX, WIDTH_PX)."""
    import cv2

    encoded = np.frombuffer(read_bytes(picture_file(PICTURES[number].name)), dtype=np.uint8)
    return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE), np.uint8)


def tinted(levels: NDArray[np.float32], number: int) -> NDArray[np.float32]:
    """Return grey (H, W) in [0, 1] tinted as one of PICTURES is, (H, W, 3), at most 1."""
    item = PICTURES[number]
    shadow, light = np.array(item.shadow_rgb, np.float32), np.array(item.light_rgb, np.float32)
    level = levels[..., None]
    return np.minimum(level * (shadow + (light - shadow) * level), np.float32(1))


@lru_cache(maxsize=8)
def ice_picture(number: int) -> NDArray[np.uint8]:
    """Return one of PICTURES, tinted: (HEIGHT_PX, WIDTH_PX, 3) uint8 RGB, read-only."""
    import cv2

    item = PICTURES[number]
    levels = np.arange(256, dtype=np.float32)[:, None] / np.float32(255)
    shadow, light = np.array(item.shadow_rgb, np.float32), np.array(item.light_rgb, np.float32)
    table = levels * (shadow + (light - shadow) * levels)
    tints = np.rint(np.clip(table, 0, 1) * np.float32(255)).astype(np.uint8)
    picture = np.asarray(
        cv2.merge([cv2.LUT(grey_picture(number), tint) for tint in np.ascontiguousarray(tints.T)]), np.uint8
    )
    picture.flags.writeable = False
    return picture


Float32: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True)
class Frost:
    """intensity * image + influence * ice, as ImageNet-C; a picture of ice is picked for each frame.

    The picture is cropped at random, enlarged only where a frame is larger than it, and never squashed.
    """

    intensity: float = key("share of the image that is left", default=0.7, minimum=0, maximum=2)
    influence: float = key("share of the ice that is added", default=0.7, minimum=0, maximum=2)
    creep_px: float = key(
        "drift: how far the ice creeps a frame, to and fro",
        default=0.5,
        unit="px",
        minimum=0,
        maximum=100,
        slider=(0, 10),
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "intensity": "Lower: the picture behind the ice gets darker",
        "influence": "Higher: the ice on the lens gets brighter",
        "creep_px": "Higher: with the pattern Drift, the ice moves faster",
    }


def apply(rgb: NDArray[np.float32], parameters: Frost, context: FrameContext) -> NDArray[np.float32]:
    """Put ice over (H, W, 3)."""
    if context.lit:
        ice = _lit_crop(rgb.shape[:2], parameters, context)
        ice *= np.float32(parameters.influence)
        return np.asarray(rgb * np.float32(parameters.intensity) + ice, np.float32)
    ice = _crop(rgb.shape[:2], parameters, context)
    return by_bands(rgb, rgb.dtype, lambda band, ice_band: _frosted(band, ice_band, parameters), ice)


def _frosted(band: NDArray[np.float32], ice: NDArray[np.uint8], parameters: Frost) -> NDArray[np.float32]:
    import cv2

    cold = ice.astype(np.float32)
    cv2.addWeighted(band, parameters.intensity, cold, parameters.influence / 255, 0.0, dst=cold)
    return cold


def apply_bytes(rgb: NDArray[np.uint8], parameters: Frost, context: FrameContext) -> NDArray[np.uint8]:
    """Put ice over (H, W, 3) bytes by a table that has an entry for every byte of the image with every byte of ice."""
    ice, table = _crop(rgb.shape[:2], parameters, context), _table(parameters)
    return by_bands(rgb, rgb.dtype, lambda *parts: look_up(_positions(*parts), table), ice)


def _positions(rgb: NDArray[np.uint8], ice: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Return the table's indices (H, W, 3): ice x 256 + byte."""
    import cv2

    flat = [np.ascontiguousarray(part).reshape(len(rgb), -1) for part in (rgb, ice)]
    return cv2.merge(flat).view("<u2").reshape(rgb.shape)


@lru_cache(maxsize=16)
def _table(parameters: Frost) -> NDArray[np.uint8]:
    ice, levels = (np.ascontiguousarray(axis) for axis in np.indices((256, 256), np.uint8))
    return rgb_bytes(_frosted(as_float(levels), ice, parameters))


def _crop(size: tuple[int, int], parameters: Frost, context: FrameContext) -> NDArray[np.uint8]:
    """Return the part of the ice that covers the frame, (H, W, 3) uint8."""
    import cv2

    generator = context.pattern_stream()
    picture = ice_picture(int(generator.choice(EQUALLY_OFTEN)))
    start, angle = generator.random(2), generator.uniform(0, 2 * np.pi)
    # The picture is a tenth larger than the frame at least, as in ImageNet-C, so that the crop can move.
    scale = max(1.0, 1.1 * size[0] / HEIGHT_PX, 1.1 * size[1] / WIDTH_PX)
    slack = np.array([HEIGHT_PX - size[0] / scale, WIDTH_PX - size[1] / scale])
    origin = np.floor(start * slack)
    if scale == 1 and not context.drift_frames:
        row, column = origin.astype(int)
        return picture[row : row + size[0], column : column + size[1]]
    if context.drift_frames:
        crept = context.drift_frames * parameters.creep_px / scale * np.array([np.sin(angle), np.cos(angle)])
        origin = _to_and_fro(origin + crept, slack)
    matrix = np.array([[1 / scale, 0, origin[1]], [0, 1 / scale, origin[0]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpAffine(picture, matrix, (size[1], size[0]), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(seen, np.uint8)


def _lit_crop(size: tuple[int, int], parameters: Frost, context: FrameContext) -> Float32:
    """Return the part of the ice that covers a lit frame, (H, W, 3) in [0, 1]: as the nodes draw and look it up."""
    noise = white_noise(context)
    right, down, which = noise.numbers(0)
    shares = np.cumsum([EQUALLY_OFTEN.count(number) for number in range(len(PICTURES))])
    number = int(np.searchsorted(shares[:-1] / len(EQUALLY_OFTEN), which, side="right"))
    scale = max(1.0, 1.1 * size[0] / HEIGHT_PX, 1.1 * size[1] / WIDTH_PX)
    full, seen = np.array([WIDTH_PX, HEIGHT_PX]), np.array(size[::-1]) / scale
    # The nodes count rows from below.
    angle = 2 * np.pi * noise.numbers(1)[0]
    crept = context.drift_frames * parameters.creep_px / scale * np.array([np.cos(angle), np.sin(angle)])
    left, below = _to_and_fro(np.floor(np.array([right, down]) * (full - seen)) + crept, full - seen)
    columns = left + (np.arange(size[1]) + 0.5) / scale - 0.5
    rows = HEIGHT_PX - below - seen[1] + (np.arange(size[0]) + 0.5) / scale - 0.5
    return tinted(_between(grey_picture(number), rows, columns), number)


def _between(
    picture: NDArray[np.uint8], rows: NDArray[np.float64], columns: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return a grey picture between its pixels, linearly, in [0, 1]: (rows, columns)."""
    values = picture.astype(np.float32) / np.float32(255)
    for axis, places in enumerate((rows, columns)):
        before = np.floor(places)
        share = (places - before).astype(np.float32)
        share = share[:, None] if axis == 0 else share
        last = picture.shape[axis] - 1
        first, second = (values.take(np.clip(before + k, 0, last).astype(np.int64), axis=axis) for k in (0, 1))
        values = first * (1 - share) + second * share
    return values


def _to_and_fro(position: NDArray[np.float64], length: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fold positions back at both ends of [0, length]."""
    return length - np.abs(position % (2 * length) - length)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Pick a picture, look at a part of it, tint it and add it."""
    graph = canvas.graph
    with graph.section("Pick a picture"):
        position = canvas.random(0)
        pictures = [graph.picture(_packed(item)) for item in PICTURES]
        picture = _pick(position.z, pictures, "color")
        shadow = _pick(position.z, [item.shadow_rgb for item in PICTURES], "vector")
        light = _pick(position.z, [item.light_rgb for item in PICTURES], "vector")
    with graph.section("Crop"):
        inputs = {"Image": picture, "UV": _uv(canvas, position, given["creep_px"] / canvas.scale)}
        inputs |= {"Interpolation": "Bilinear", "Extension X": "Extend", "Extension Y": "Extend"}
        grey = graph.node("CompositorNodeMapUV", inputs).out("Image", "color")
    with graph.section("Tint"):
        ice = graph.math("MINIMUM", grey * graph.math("MULTIPLY_ADD", grey, light - shadow, shadow), 1.0)
    with graph.section("Over the image"):
        frosted = ice * given["influence"]
        return graph.math("MULTIPLY_ADD", canvas.image, graph.vector(*[given["intensity"]] * 3), frosted)


def _packed(item: Ice) -> BroughtImage:
    path = picture_file(item.name)
    return BroughtImage(f"Ice: {item.name}", hashlib.sha256(read_bytes(path)).hexdigest()[:16], lambda: path)


def _pick(uniform: Socket, items: Sequence[Value], kind: Kind) -> Socket:
    """Return one of the items, each equally likely, by a uniform number in [0, 1]."""
    shares = np.cumsum([EQUALLY_OFTEN.count(number) for number in range(len(items))]) / len(EQUALLY_OFTEN)
    chosen = items[-1]
    for item, share in reversed(list(zip(items[:-1], shares, strict=False))):
        chosen = uniform.graph.choose(uniform < share, item, chosen, kind)
    assert isinstance(chosen, Socket), "there are several pictures"
    return chosen


def _uv(canvas: Canvas, position: Socket, creep_px: Socket) -> Socket:
    """Return which point of the picture each pixel shows, as `_crop` does, from 0 to 1 along the picture's sides."""
    graph, full_px = canvas.graph, (float(WIDTH_PX), float(HEIGHT_PX), 1.0)
    frame_px = graph.vector(canvas.width_px, canvas.height_px) / graph.vector(canvas.scale, canvas.scale, 1.0)
    room = frame_px * (1.1 / full_px[0], 1.1 / full_px[1], 0.0)
    enlarged = graph.math("MAXIMUM", graph.math("MAXIMUM", room.x, room.y), 1.0, label="Enlarged")
    seen_px = frame_px / graph.vector(enlarged, enlarged, 1.0)
    slack_px = graph.math("SUBTRACT", full_px, seen_px)
    start_px = graph.math("FLOOR", position * slack_px)
    angle = canvas.random_value(1) * (2 * math.pi)
    crept_px = canvas.drift_frames * creep_px / enlarged
    moved_px = start_px + graph.vector(graph.math("COSINE", angle), graph.math("SINE", angle)) * crept_px
    # Blender's ping-pong folds back at both ends, as the reference does.
    origin_px = graph.vector(
        graph.math("PINGPONG", moved_px.x, slack_px.x), graph.math("PINGPONG", moved_px.y, slack_px.y)
    )
    share = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Normalized", "vector")
    # The third number is Map UV's weight: 1 shows the picture as it is.
    return graph.math("MULTIPLY_ADD", share, seen_px / full_px, origin_px / full_px + (0.0, 0.0, 1.0))


PERTURBATION = ColourPerturbation(
    name="frost",
    label="Frost",
    stage="environment",
    order=30,
    parameters=Frost,
    severities={"intensity": (1.0, 0.8, 0.7, 0.65, 0.6), "influence": (0.4, 0.6, 0.7, 0.7, 0.75)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"; the ice: our own',
    about=About(
        "Lays a picture of ice over the whole image, another for each frame",
        "ice on the lens, from pictures that our own program drew (`make ice`)",
        caption="the benchmark's ice, over the whole frame.",
        twin="lens_frost",
        of_paper=True,
    ),
    overlay=True,
    apply=apply,
    version=2,  # float colour is rounded before it
    apply_bytes=apply_bytes,
    nodes=Nodes(build),
    temporals=("fresh", "fixed", "drift"),
    tinted=True,
)
