# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass blur: the scene through textured glass."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import BroughtImage, Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import QUICK_NOISE, QUICKLY, as_blur_node, gaussian, quick_key
from ._noise import WhiteNoise, look_up, uniform_codes, white_noise
from ._sizes import full_size, with_full_sizes

T = TypeVar("T", bound=np.integer | np.floating)

MAX_DELTA_PX = 10  # chosen: two and a half times the delta of severity 5; a table of offsets is made for each delta
TABLE_SIDE = 256  # 256 x 256 = 65,536 equally likely offsets, one for each 16-bit code
TABLE_ZERO = 128  # the byte that stands for an offset of 0


@dataclass(frozen=True)
class GlassBlur:
    """Blur, take every pixel from a random place nearby a few times, blur again.

    After ImageNet-C, whose loop is meant to swap pixels at whole offsets in [-max_delta, max_delta), but copies
    instead. The loop runs in place from the last pixel to the first, so a pixel that is copied from further on was
    itself replaced before, and offsets add up. Here each pixel draws the sum of its offsets at once, over the whole
    frame; outside the frame its border is replicated.
    """

    sigma_px: float = key(
        "standard deviation of the blur before and after", default=1.0, unit="px", minimum=0, maximum=20
    )
    max_delta_px: int = key(
        "how far away one copy takes a pixel from", default=2, unit="px", minimum=0, maximum=MAX_DELTA_PX
    )
    iterations: int = key("how many times pixels change places", default=3, minimum=0, maximum=20)
    coarse: bool = quick_key()
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "sigma_px": "Higher: softer before and after pixels change places",
        "max_delta_px": "Higher: pixels change places over a longer way, as behind coarser glass",
        "iterations": "Higher: more pixels change places, and it takes longer",
        "coarse": QUICK_NOISE,
    }


def apply(rgb: NDArray[np.float32], parameters: GlassBlur, context: FrameContext) -> NDArray[np.float32]:
    """Blur and shuffle (H, W, 3)."""
    if context.lit:
        return _as_nodes(rgb, parameters, white_noise(context, quick=parameters.coarse))
    image = gaussian(rgb, parameters.sigma_px)
    if parameters.max_delta_px and parameters.iterations:
        height, width = rgb.shape[:2]
        generator = context.pattern_stream()
        # Where a pixel comes from after all copies, so that the image itself is copied once.
        sources = _positions(height, width, parameters.max_delta_px, generator)
        for _ in range(parameters.iterations - 1):
            sources = _copied(sources, _positions(height, width, parameters.max_delta_px, generator))
        image = _copied(image, sources)
    return gaussian(image, parameters.sigma_px)


def _as_nodes(rgb: NDArray[np.float32], parameters: GlassBlur, noise: WhiteNoise) -> NDArray[np.float32]:
    """Blur and shuffle lit frames as the nodes do: with their draws, table and blur."""
    height, width = rgb.shape[:2]
    image = as_blur_node(rgb, parameters.sigma_px * 3.0)
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    shuffles = parameters.iterations if parameters.max_delta_px else 0
    draws = [noise.random(purpose, x, y) for purpose in range(math.ceil(shuffles / 3))]
    table = _offsets(parameters.max_delta_px).view(np.int16).reshape(TABLE_SIDE, TABLE_SIDE, 2) if shuffles else None
    for index in range(shuffles):
        assert table is not None, "something is shuffled"
        number = draws[index // 3][index % 3]
        column = (number * np.float32(TABLE_SIDE) % 1 * TABLE_SIDE).astype(int)
        # Blender counts the rows of all tables from below, in float32.
        below = np.float32(MAX_DELTA_PX - parameters.max_delta_px)
        share = (number + below) / np.float32(MAX_DELTA_PX)
        row = (share * np.float32(MAX_DELTA_PX * TABLE_SIDE)).astype(int) - int(below) * TABLE_SIDE
        offset = table[TABLE_SIDE - 1 - np.clip(row, 0, TABLE_SIDE - 1), np.minimum(column, TABLE_SIDE - 1)]
        image = _copied(image, offset + _grid(height, width))
    return as_blur_node(image, parameters.sigma_px * 3.0)


def _copied(image: NDArray[T], positions: NDArray[np.int16]) -> NDArray[T]:
    """Take each pixel of (H, W, C) from its position, (H, W, 2); the border is replicated."""
    import cv2

    # Two int16 of a position are copied as one int32.
    pixels = image if image.dtype == np.float32 else image.view(np.int32)
    taken = cv2.remap(
        pixels,
        positions,
        None,  # pyright: ignore[reportCallIssue, reportArgumentType]  one map holds both coordinates
        cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(taken).reshape(pixels.shape).view(image.dtype)


def _positions(height: int, width: int, delta: int, generator: np.random.Generator) -> NDArray[np.int16]:
    """Return (H, W, 2) int16: the column and the row from which each pixel is taken."""
    # One look-up of 32 bits fetches both the column and the row.
    positions = look_up(uniform_codes(generator, (height, width)), _offsets(delta)).view(np.int16)
    positions = positions.reshape(height, width, 2)
    positions += _grid(height, width)
    return positions


@lru_cache(maxsize=2)
def _grid(height: int, width: int) -> NDArray[np.int16]:
    """Return (H, W, 2): each pixel's own column and row; read-only."""
    grid = np.empty((height, width, 2), dtype=np.int16)
    grid[..., 0] = np.arange(width)
    grid[..., 1] = np.arange(height)[:, None]
    grid.flags.writeable = False
    return grid


@lru_cache(maxsize=MAX_DELTA_PX)
def _offsets(delta: int) -> NDArray[np.int32]:
    """Return (65536,) equally likely offsets, read-only: each two int16 (columns, rows) viewed as one int32."""
    shares = offset_shares(delta)
    reach = shares.shape[0] // 2
    ends = np.rint(np.cumsum(shares) / shares.sum() * 65536).astype(np.int64)
    cells = np.repeat(np.arange(shares.size), np.diff(ends, prepend=0))
    rows, columns = np.divmod(cells, shares.shape[1])
    offsets = np.stack([columns - reach, rows - reach], axis=-1).astype(np.int16).view(np.int32).ravel()
    offsets.flags.writeable = False
    return offsets


def offset_shares(delta: int, copies: int = 10) -> NDArray[np.float64]:
    """Return each offset's probability, (rows, columns) about the middle, of a loop in place from last pixel to first.

    delta: the offsets of one copy are whole numbers, uniform in [-delta, delta). A copy from further on (down, or right
    in the same row) takes a value that was itself copied, so offsets add up. `copies` of these are followed at most;
    1 chain in 1,000 is longer.
    """
    reach = delta * copies
    onward = np.zeros((2 * reach + 1, 2 * reach + 1))
    onward[reach, reach] = 1.0
    stopped = np.zeros_like(onward)
    for copy in range(copies):
        first, last = reach - copy * delta, reach + copy * delta + 1  # the farthest that offsets reach by now
        share = onward[first:last, first:last] / (4 * delta**2)
        moved = np.zeros_like(onward)
        for row in range(-delta, delta):
            for column in range(-delta, delta):
                goes_on = row > 0 or (row == 0 and column > 0)
                target = moved if goes_on else stopped
                target[first + row : last + row, first + column : last + column] += share
        onward = moved
    return stopped


@lru_cache(maxsize=1)
def _table() -> NDArray[np.uint8]:
    """Return the tables of offsets, delta 1 on top, 2 below and so on: a byte for columns, one for rows (downwards)."""
    tables = [_offsets(delta).view(np.int16).reshape(TABLE_SIDE, TABLE_SIDE, 2) for delta in range(1, MAX_DELTA_PX + 1)]
    picture = np.zeros((MAX_DELTA_PX * TABLE_SIDE, TABLE_SIDE, 3), dtype=np.uint8)
    picture[..., :2] = np.concatenate(tables) + TABLE_ZERO
    return picture


TABLE = BroughtImage("Glass Blur Offsets", "1", _table)


def build(canvas: Canvas, given: Mapping[str, Socket], served: Mapping[str, float]) -> Socket:
    """Blur, move pixels by offsets from a packed table, blur again; a preview's pixels are moved at full size."""
    full = full_size(canvas)
    return full.back(_shuffled(full.canvas, with_full_sizes(full, given, "sigma_px", "max_delta_px"), served))


def _shuffled(canvas: Canvas, given: Mapping[str, Socket], served: Mapping[str, float]) -> Socket:
    graph = canvas.graph
    image = _gaussian(canvas.image, given["sigma_px"], "Blur before")
    with graph.section("Table of offsets"):
        table = graph.picture(TABLE)
        delta = graph.math("ROUND", given["max_delta_px"] / canvas.scale, label="At the reference width")
        top = graph.math("SUBTRACT", float(MAX_DELTA_PX), delta, label="Tables below this one")
        # A delta of 0 moves nothing, so no shuffle is needed.
        count = given["iterations"] * (delta > 0.5)
    with graph.section("Draws"):
        # A draw gives three numbers, which serve three shuffles.
        draws = [canvas.random(purpose, canvas.position_px) for purpose in range(math.ceil(served["iterations"] / 3))]
        choices = [_component(draws[index // 3], index % 3) for index in range(int(served["iterations"]))]
    for index, choice in enumerate(choices):
        with graph.section(f"Shuffle {index + 1}"):
            # A shuffle that is not asked for gets a single value instead of a frame, so it costs nothing.
            active = count > index + 0.5
            number = graph.choose(active, choice, 0.0, "float")
            where = graph.vector(graph.math("FRACT", number * float(TABLE_SIDE)), (number + top) / MAX_DELTA_PX, 1.0)
            inputs = {"Image": table, "UV": where, "Interpolation": "Nearest"}
            found = graph.node("CompositorNodeMapUV", inputs).out("Image", "color")
            offset = (found * 255.0 - float(TABLE_ZERO)) * graph.vector(-canvas.scale, canvas.scale)
            image = graph.choose(active, _displaced(graph.choose(active, image, 0.0), offset), image)
    return _gaussian(image, given["sigma_px"], "Blur after")


def _gaussian(image: Socket, sigma_px: Socket, section: str) -> Socket:
    graph = image.graph
    with graph.section(section):
        size = sigma_px * 3.0
        inputs = {"Image": image, "Size": graph.vector(size, size), "Type": "Gaussian", "Separable": True}
        return graph.node("CompositorNodeBlur", inputs).out("Image", "color")


def _displaced(image: Socket, offset_px: Socket) -> Socket:
    extend = {"Extension X": "Extend", "Extension Y": "Extend"}
    inputs = {"Image": image, "Displacement": offset_px, "Interpolation": "Nearest", **extend}
    return image.graph.node("CompositorNodeDisplace", inputs).out("Image", "color")


def _component(value: Socket, index: int) -> Socket:
    return (value.x, value.y, value.z)[index]


PERTURBATION = ColourPerturbation(
    name="glass_blur",
    label="Glass blur",
    stage="lens",
    order=40,
    parameters=GlassBlur,
    severities={
        "sigma_px": (0.7, 0.9, 1.0, 1.1, 1.5),
        "max_delta_px": (1, 2, 2, 3, 4),
        "iterations": (2, 1, 3, 2, 2),
    },
    newly=QUICKLY,
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Shifts each pixel by chance, as ribbed glass does",
        "every pixel takes the value of one nearby, between two blurs",
        of_paper=True,
    ),
    apply=apply,
    averages=True,
    temporals=("fresh", "fixed"),
    counts=frozenset({"max_delta_px", "iterations"}),
    nodes=Nodes(build, capacity={"iterations": 3}),
)
