# SPDX-License-Identifier: GPL-3.0-or-later
"""What fills the holes in walls: windows with what is seen through them, curtains, doors."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from . import surfaces as pt
from .finishes import garden
from .surfaces import (
    Array,
    Piece,
    Point,
    ball,
    box,
    cloud,
    colour,
    hash01,
    joined,
    mix,
    ramp,
    rect,
    rod,
    shadeless,
    sheet,
    thing,
    tube,
)

Hole: TypeAlias = tuple[float, float, float, float]  # metres: from, to, low, high
# (s, t), right and up by ahead -> (R, C, 3) display-encoded colours of what is far away.
Outlook: TypeAlias = Callable[[Array, Array], Array]

REVEAL_M = 0.16  # depth of the windows in the wall

_PAINTED = pt.plain("#e9e4d6", 300, grain=0.04, patch=0.04)
TRIM = pt.wood("#efe9da", "#d8cfba", 301)


@thing("window")
def window(hole: Hole, y_m: float, seed: int) -> Piece:
    """Reveal, sill, frame and glazing bars of a window in a wall at y_m whose room lies at lower y."""
    x_low, x_high, z_low, z_high = hole
    depth, width, height = REVEAL_M, x_high - x_low, z_high - z_low
    parts = [
        rect((x_low, y_m, z_low), (width, 0, 0), (0, depth, 0), 0.02, _PAINTED),
        rect((x_low, y_m + depth, z_high), (width, 0, 0), (0, -depth, 0), 0.02, _PAINTED),
        rect((x_low, y_m, z_low), (0, depth, 0), (0, 0, height), 0.02, _PAINTED),
        rect((x_high, y_m + depth, z_low), (0, -depth, 0), (0, 0, height), 0.02, _PAINTED),
        box(
            (x_low - 0.03, y_m - 0.044, z_low - 0.03),
            (x_high + 0.03, y_m + 0.05, z_low + 0.004),
            0.016,
            pt.wood("#c99c6b", "#8f6238", seed),
        ),
    ]
    front, back = y_m + 0.07, y_m + 0.125

    def bar(a: float, b: float, low: float, high: float, inset: float = 0.0) -> None:
        parts.append(box((a, front + inset, low), (b, back - inset, high), 0.04, TRIM, glow=0.3))

    rim = 0.055
    bar(x_low, x_low + rim, z_low, z_high)
    bar(x_high - rim, x_high, z_low, z_high)
    bar(x_low + rim, x_high - rim, z_low, z_low + rim)
    bar(x_low + rim, x_high - rim, z_high - rim, z_high)
    for x in _mullions(x_low, x_high):
        bar(x - 0.022, x + 0.022, z_low + rim, z_high - rim, 0.004)
    for k in (1, 2):
        z = z_low + height * k / 3
        bar(x_low + rim, x_high - rim, z - 0.011, z + 0.011, 0.014)
    return shadeless(joined(parts))


def _mullions(x_low: float, x_high: float) -> list[float]:
    count = round((x_high - x_low) / 0.5)
    return [x_low + (x_high - x_low) * k / count for k in range(1, count)]


def pane_bars_m(window: tuple[float, float, float, float]) -> tuple[list[float], list[float]]:
    """Centres of a window's upright (x) and level (z) glazing bars, for the sun's pattern on the floor."""
    x_low, x_high, z_low, z_high = window
    return _mullions(x_low, x_high), [z_low + (z_high - z_low) * k / 3 for k in (1, 2)]


@thing("outdoors")
def outdoors(low_m: Point, high_m: Point, eye_m: Point, view: Outlook) -> Piece:
    """What is behind windows: a glowing box, open towards -y, whose picture is right from eye_m."""
    low, high, eye = np.array(low_m), np.array(high_m), np.array(eye_m)
    size = high - low
    corners = (
        ((low[0], high[1], low[2]), (size[0], 0, 0), (0, 0, size[2]), 0.0345),
        ((low[0], low[1], low[2]), (0, size[1], 0), (0, 0, size[2]), 0.06),
        ((high[0], high[1], low[2]), (0, -size[1], 0), (0, 0, size[2]), 0.04),
        ((low[0], low[1], low[2]), (size[0], 0, 0), (0, size[1], 0), 0.04),
        ((low[0], high[1], high[2]), (size[0], 0, 0), (0, -size[1], 0), 0.04),
    )
    parts: list[Piece] = []
    for corner, u_edge, v_edge, cell in corners:
        c, a, b = (np.array(x, np.float64) for x in (corner, u_edge, v_edge))
        a, b = a / abs(a).sum(), b / abs(b).sum()

        def paint(u: Array, v: Array, c: Array = c, a: Array = a, b: Array = b) -> Array:
            away = c + u[..., None] * a + v[..., None] * b - eye
            return view(away[..., 0] / away[..., 1], away[..., 2] / away[..., 1])

        parts.append(rect(tuple(c), u_edge, v_edge, cell, paint, glow=1.0))
    return joined(parts)


def _curtain(x_low: float, x_high: float, y_m: float, seed: int, codes: list[str]) -> Piece:
    """A gathered curtain with a hem just above the floor."""
    top, bottom, folds = 2.44, 0.03, 5
    print_ = pt.stripes(codes, [0.05, 0.03, 0.05, 0.016, 0.05, 0.03], seed)
    u, v = np.meshgrid(np.arange(47) / 46.0, np.arange(111) / 110.0)
    swing = 0.5 + 0.5 * (1 - v)
    fold = np.sin(2 * np.pi * (folds * u + 0.15 * pt.noise(2 * u, 2 * v, seed) + 0.1 * seed))
    x = x_low + (x_high - x_low) * (0.5 + (u - 0.5) * (0.92 + 0.16 * abs(v - 0.5)))
    y = y_m - 0.085 - 0.034 * swing * fold
    cloth = sheet(np.stack([x, y, bottom + (top - bottom) * v], -1), print_(u * 1.1, v * 2.4))
    low, high = (x_low + 0.02, y_m - 0.048, bottom), (x_high - 0.02, y_m - 0.02, top)
    return Piece((cloth,), ((low, high),))


CURTAIN_CODES = ["#e8dcc0", "#d9a441", "#e8dcc0", "#b5653a", "#e8dcc0", "#5f7f78"]


@thing("curtain")
def curtains(x_low: float, x_high: float, y_m: float, seed: int, codes: list[str] = CURTAIN_CODES) -> Piece:
    """Two curtains, striped in six colours, on a brass rod before a window in a wall at y_m."""
    brass = pt.plain("#a8803e", 310, grain=0.12)
    y, z, a, b = y_m - 0.085, 2.47, x_low - 0.52, x_high + 0.52
    parts = [
        _curtain(x_low - 0.45, x_low + 0.08, y_m, seed, codes),
        _curtain(x_high - 0.08, x_high + 0.45, y_m, seed + 1, codes),
    ]
    parts += [
        rod((a, y, z), (b, y, z), 0.012, 0.02, brass),
        ball((a, y, z), 0.028, 0.012, brass),
        ball((b, y, z), 0.028, 0.012, brass),
    ]
    angle = np.arange(13) * (2 * np.pi / 12)
    for k in range(7):
        for x in (a + 0.1 + 0.075 * k, b - 0.1 - 0.075 * k):
            ring = [(x, y + 0.02 * np.cos(t), z - 0.008 + 0.022 * np.sin(t)) for t in angle]
            parts.append(tube(ring, 0.003, 5, brass))
    return joined([*parts[:2], *map(shadeless, parts[2:])])


@thing("door")
def door(hole: Hole, y_m: float, code: str = "#6f918b") -> Piece:
    """A panelled door with its frame, in a wall at y_m whose room lies at higher y."""
    x_low, x_high, _, top = hole
    leaf = pt.plain(code, 330, grain=0.06, grain_m=0.022, patch=0.1, fleck=0.08)
    back, front = y_m - 0.045, y_m - 0.01
    parts = [box((x_low, back, 0.008), (x_high, front, top), 0.022, leaf, skip="yzZ")]
    middle = (x_low + x_high) / 2
    for low, high in ((0.16, 0.62), (0.76, 1.3), (1.42, 1.92)):
        for a, b in ((x_low + 0.12, middle - 0.05), (middle + 0.05, x_high - 0.12)):
            parts.append(box((a, front, low), (b, front + 0.008, high), 0.022, leaf, skip="y"))
            parts.append(
                box((a + 0.05, front + 0.008, low + 0.05), (b - 0.05, front + 0.016, high - 0.05), 0.02, leaf, skip="y")
            )
    for a, b, low, high in (
        (x_low - 0.09, x_low, 0.0, top + 0.09),
        (x_high, x_high + 0.09, 0.0, top + 0.09),
        (x_low, x_high, top, top + 0.09),
    ):
        parts.append(box((a, y_m - 0.06, low), (b, y_m + 0.025, high), 0.024, TRIM))
    parts.append(
        box((x_low, y_m - 0.06, -0.01), (x_high, y_m + 0.01, 0.008), 0.018, pt.wood("#8a623d", "#4f3420", 331))
    )
    brass = pt.plain("#c19a4b", 332, grain=0.12)
    x = x_low + 0.07
    parts.append(box((x - 0.02, front, 0.93), (x + 0.02, front + 0.006, 1.13), 0.01, brass, skip="y"))
    parts.append(
        tube(
            [
                (x, front, 1.06),
                (x, front + 0.05, 1.06),
                (x + 0.02, front + 0.06, 1.06),
                (x + 0.13, front + 0.06, 1.055),
            ],
            0.009,
            8,
            brass,
        )
    )
    return shadeless(joined(parts))


# What is seen through windows, by direction: s = right / ahead, t = up / ahead. (R, C, 3) display-encoded.


def garden_from(share: float) -> Outlook:
    """The garden, with its hills and clouds elsewhere than in the living room's view."""

    def view(s: Array, t: Array) -> Array:
        return garden((s + share) * (-1.0 if share > 0.5 else 1.0), t)

    return view


def city(seed: int, sky_codes: tuple[str, str] = ("#e6edf2", "#8fb4d8")) -> Outlook:
    """Rows of houses with windows, the nearer ones darker and in front."""
    walls = [colour(c) for c in ("#b9a48f", "#a65f4a", "#8b8f96", "#c8b79c", "#6f7f8c", "#93755f")]
    panes = [colour(c) for c in ("#3a4855", "#566a7c", "#efd9a0", "#2c3640")]

    def view(s: Array, t: Array) -> Array:
        rgb = mix(colour(sky_codes[0]), colour(sky_codes[1]), ramp(t, 0.0, 1.1))
        white = ramp(cloud(s * 2.0 + seed, t * 5.0, seed, 4), 0.5, 0.7)
        rgb = mix(rgb, colour("#ffffff"), white * ramp(t, -0.05, 0.2))
        for k, (width, height, far) in enumerate(((0.16, 0.42, 0.45), (0.25, 0.24, 0.22), (0.42, 0.04, 0.0))):
            i = np.floor(s / width + 0.31 * k)
            top = height * (0.45 + 1.1 * hash01(i, i * 0 + k, seed + 1))
            x, y = s / width + 0.31 * k - i, (top - t) / width
            pick = hash01(i, i * 0 + k, seed + 2)
            wall = np.array(walls)[(pick * len(walls)).astype(np.int64)]
            bricks = 0.9 + 0.16 * hash01(np.floor(x * 34), np.floor(y * 40), seed + 3)
            floors = 3.0 + 3.0 * (pick * 13.0 % 1.0) // 1.0
            a, b = x * floors, y * floors * 0.85
            glass = (abs(a % 1.0 - 0.5) < 0.27) & (abs(b % 1.0 - 0.5) < 0.32) & (x > 0.04) & (x < 0.96)
            chosen = np.array(panes)[(hash01(np.floor(a) + 40 * i, np.floor(b), seed + 4) * 4).astype(np.int64)]
            bar = abs(a % 1.0 - 0.5) < 0.03
            house = np.where((glass & ~bar)[..., None], chosen, wall * bricks[..., None])
            house = np.where((y < 0.05)[..., None], wall * 0.6, house)
            rgb = np.where((t < top)[..., None], mix(house, colour(sky_codes[0]), np.full_like(t, far)), rgb)
        street = mix(colour("#6a6864"), colour("#8d8a84"), cloud(s * 9, t * 20, seed + 5, 3))
        rgb = np.where((t < -0.34)[..., None], street, rgb)
        tree = cloud(s * 5.0, t * 7.0, seed + 6, 3) + 0.5 * ramp(t, -0.05, -0.3) - 0.5 * ramp(t, -0.1, 0.12)
        leaf = mix(colour("#35592f"), colour("#8fae52"), cloud(s * 30, t * 30, seed + 7, 2))
        return np.where(((tree > 0.62) & (t > -0.4))[..., None], leaf, rgb)

    return view
