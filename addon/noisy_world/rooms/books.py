# SPDX-License-Identifier: GPL-3.0-or-later
"""Books, one by one, in rows and in stacks; vases; shelves full of both."""

from dataclasses import dataclass

import numpy as np

from . import patterns as pt
from .surfaces import Array, Painter, Piece, box, joined, lathe, placed, rect, shadeless, tilted

OAK = pt.wood("#c9a06c", "#94683c", 501)
SHELF_BACK = pt.wood("#a9794b", "#6f4a2b", 540)


def _spine(width_m: float, height_m: float, seed: int) -> Painter:
    """The back of a book: ground, bands, and a title of little marks."""
    grounds = (
        "#7d2e2a",
        "#274a63",
        "#d9c9a3",
        "#3f5d45",
        "#c98f3c",
        "#54345a",
        "#b7563a",
        "#1f2d3a",
        "#8fa7a3",
        "#e7dcc4",
        "#6b4a33",
        "#a33b4b",
        "#3c7a80",
        "#d8b23f",
    )
    inks = ("#e9cf86", "#f3ead6", "#2a2523")
    number = int(pt.pick(seed, 7, 0, len(grounds)))
    ground = pt.colour(grounds[number])
    ink = pt.colour(inks[2] if number in (2, 9, 13) else inks[seed % 2])
    style = seed // 3 % 4

    def paint(u: Array, v: Array) -> Array:
        wear = 0.88 + 0.2 * pt.hash01(np.floor(u / 0.006), np.floor(v / 0.012), seed)
        rgb = ground * wear[..., None]
        h = v / height_m
        bands = (abs(h - 0.90) < 0.018) | (abs(h - 0.10) < 0.018)
        if style == 1:
            bands |= (abs(h - 0.82) < 0.012) | (abs(h - 0.18) < 0.012)
        if style == 2:
            bands = (h > 0.66) & (h < 0.86)
        rgb = np.where(bands[..., None], ink, rgb)
        inside = (u > 0.22 * width_m) & (u < 0.78 * width_m)
        title = (
            inside & (h > 0.3) & (h < 0.62) & (pt.hash01(np.floor(u / 0.007), np.floor(v / 0.0085), seed + 1) > 0.42)
        )
        return np.where(title[..., None], ink, rgb)

    return paint


def book(width_m: float, height_m: float, depth_m: float, seed: int) -> Piece:
    """An upright book on the origin with its spine at y = 0 and its pages behind."""
    spine = _spine(width_m, height_m, seed)
    cover_rgb = spine(np.full((1, 1), 0.001), np.full((1, 1), 0.5 * height_m))[0, 0]

    def bound(u: Array, v: Array) -> Array:
        return cover_rgb * np.ones_like(u + v)[..., None]

    pages = pt.plain("#e3d6b8", seed, grain=0.1, patch=0.0)
    back = rect((0, 0, 0), (width_m, 0, 0), (0, 0, height_m), 0.009, spine)
    sides = box((0, 0, 0), (width_m, depth_m, height_m), 0.4, bound, skip="yYzZ")
    top = rect((0, 0, height_m - 0.003), (width_m, 0, 0), (0, depth_m, 0), 0.016, pages)
    return shadeless(joined([back, sides, top]))


def book_row(length_m: float, room_m: float, seed: int) -> Piece:
    """Books from x = 0 on, the last one leaning, in a shelf room_m high."""
    parts: list[Piece] = []
    x, k = 0.004, 0
    while True:
        number = seed * 40 + k
        width = pt.pick(number, 1, 0.018, 0.052)
        height = min(pt.pick(number, 2, 0.17, 0.30), room_m - 0.025)
        if x + width > length_m - 0.075:
            break
        parts.append(placed(book(width, height, 0.19, number), (x, pt.pick(number, 3, 0.0, 0.03), 0.0)))
        x += width + 0.0022
        k += 1
    last = placed(tilted(book(0.026, 0.215, 0.18, seed * 40 + 39), 1, -13.0), (x + 0.001, 0.01, 0.0062))
    return joined([*parts, last])


def stack(count: int, seed: int, yaw_deg: float = 0.0) -> Piece:
    """Books lying on each other, spines to the front."""
    parts, z = [], 0.0
    for k in range(count):
        number = seed * 40 + k
        thick, long_ = pt.pick(number, 1, 0.022, 0.045), pt.pick(number, 2, 0.2, 0.27)
        flat = placed(tilted(book(thick, long_, 0.17, number), 1, 90.0), (-long_ / 2, 0.0, thick))
        parts.append(placed(flat, (0.0, 0.0, z), yaw_deg + pt.pick(number, 3, -8, 8)))
        z += thick + 0.001
    return joined(parts)


def vase(seed: int, height_m: float, paint: Painter) -> Piece:
    """A vase on the origin; seed decides how wide it is."""
    h = height_m
    wide = 0.3 + 0.1 * (seed % 3)
    outline = [(0.18 * h, 0), (wide * h, 0.35 * h), (wide * 0.85 * h, 0.6 * h), (0.12 * h, 0.85 * h), (0.17 * h, h)]
    return lathe((0, 0, 0), outline, 28, paint, cell_m=0.009)


_GLAZES = (
    pt.terrazzo("#e8dcc4", ["#c9714e", "#35525f", "#e0b14e"], 530, chip_m=0.028),
    pt.stripes(["#3d6470", "#e9dfc9", "#3d6470", "#c25a3c"], [0.02, 0.02, 0.02, 0.02], 531),
    pt.checks(["#c25a3c", "#b4553a", "#d98b5f", "#8a3f2c"], 0.02, 532),
)


@dataclass(frozen=True)
class Shelf:
    """A bookshelf against the wall at y = 0: its size, and how many compartments it has beside and above each other."""

    width_m: float = 2.46
    height_m: float = 2.22
    depth_m: float = 0.32
    bays: int = 3
    levels: int = 6
    timber: Painter = OAK
    back: Painter = SHELF_BACK
    seed: int = 600
    odd: tuple[tuple[int, int], ...] = ((1, 0), (6, 1), (8, 2), (10, 1), (15, 2), (17, 0))  # compartment, what it holds


def _shelf_fill(shelf: Shelf, number: int, width_m: float, room_m: float) -> Piece:
    """The content of one compartment; the origin is its lower left front corner."""
    odd = dict(shelf.odd)
    if number not in odd:
        return book_row(width_m, room_m, shelf.seed + number)
    kind = odd[number]
    things = [placed(vase(number, 0.21, _GLAZES[kind]), (0.14, 0.14, 0.0))]
    things.append(placed(book_row(width_m - 0.30, room_m, shelf.seed + 40 + number), (0.29, 0.0, 0.0)))
    if kind == 2:
        things[1] = placed(stack(5, shelf.seed + 60 + number), (0.46, 0.04, 0.0))
    return joined(things)


def bookshelf(shelf: Shelf) -> Piece:
    """A bookshelf full of books, its back at y = 0."""
    t, w, h, d, timber = 0.024, shelf.width_m, shelf.height_m, shelf.depth_m, shelf.timber
    parts = [rect((-w / 2, -0.012, 0), (w, 0, 0), (0, 0, h), 0.035, shelf.back)]
    bay = (w - t) / shelf.bays
    for k in range(shelf.bays + 1):
        x = -w / 2 + k * bay
        parts.append(box((x, -d, 0.0), (x + t, -0.013, h), 0.03, timber, skip="zY"))
    gap = (h - 0.08 - t) / shelf.levels
    for level in range(shelf.levels + 1):
        z = 0.08 + level * gap
        for k in range(shelf.bays):
            x = -w / 2 + k * bay + t
            parts.append(box((x, -d + 0.004, z), (x + bay - t, -0.013, z + t), 0.03, timber, skip="xXY"))
            if level < shelf.levels:
                fill = _shelf_fill(shelf, k + shelf.bays * level, bay - t, gap - t)
                parts.append(placed(fill, (x, -d + 0.035, z + t)))
                block = ((x + 0.01, -d + 0.06, z + t), (x + bay - t - 0.08, -0.03, z + 0.7 * gap))
                parts.append(Piece((), (block,)))
    plinth = box((-w / 2 + t, -d + 0.03, 0.0), (w / 2 - t, -d + 0.045, 0.08), 0.02, timber, skip="xXzZ")
    return joined([*parts, shadeless(plinth)])
