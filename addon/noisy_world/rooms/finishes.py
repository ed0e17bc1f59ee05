# SPDX-License-Identifier: GPL-3.0-or-later
"""More coats for walls, floors and ceilings: plaster, concrete, tiles, parquet, carpet, stone, cork, slats.

None of them repeats: what looks alike is chosen by a hash of its place.
"""

import numpy as np

from .patterns import GAP_M, _knots, cloud, colour, hash01, mix, noise, ramp, wood
from .surfaces import Array, Painter


def joints(pitch_m: float, inner: int, length_m: float) -> Array:
    """Lines of vertices across tiles or boards: inner ones a tile, and three close together at each joint."""
    count = int(np.ceil(length_m / pitch_m))
    offsets = np.array([0.0, GAP_M, *np.arange(1, inner + 1) * (pitch_m / (inner + 1)), pitch_m - GAP_M])
    lines = (np.arange(count)[:, None] * pitch_m + offsets).ravel()
    return np.append(lines[lines < length_m - 0.002], length_m)


def _grain(u: Array, v: Array, size_m: float, seed: int) -> Array:
    return hash01(np.floor(u / size_m), np.floor(v / size_m), seed)


def plaster(code: str, shade: str, seed: int, *, stroke: float = 0.5) -> Painter:
    """Limewash: clouds between two colours, broad brush strokes that cross, sand grains that catch the light."""
    base, deep = colour(code), colour(shade)

    def paint(u: Array, v: Array) -> Array:
        wash = cloud(u / 0.55, v / 0.45, seed, 3)
        cross_ = np.where(_grain(u, v, 0.31, seed + 3) < 0.5, noise(u / 0.24, v / 0.035, seed + 1), 0.0)
        cross_ = np.where(cross_ == 0.0, noise(u / 0.035, v / 0.24, seed + 2), cross_)
        sand = _grain(u, v, 0.021, seed + 4)
        tone = 1 + 0.10 * (sand - 0.5) - 0.17 * (sand > 0.955) + 0.08 * (sand < 0.03)
        return mix(base, deep, ramp(wash, 0.3, 0.75) + stroke * (cross_ - 0.5)) * tone[..., None]

    return paint


def concrete(code: str, seed: int, *, board_m: tuple[float, float] = (1.2, 0.9)) -> Painter:
    """Concrete as it comes out of its shuttering: panels with seams and anchor holes, clouds, pores."""
    base = colour(code)

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / board_m[0]), np.floor(v / board_m[1])
        du, dv = u - i * board_m[0], v - j * board_m[1]
        tone = 0.92 + 0.12 * hash01(i, j, seed) + 0.3 * (cloud(u / 0.35, v / 0.5, seed + 1, 4) - 0.5)
        edge = np.minimum(np.minimum(du, board_m[0] - du), np.minimum(dv, board_m[1] - dv))
        tone -= 0.28 * ramp(edge, 0.016, 0.004)
        hole = np.sqrt((abs(du - board_m[0] / 2) - 0.38) ** 2 + (abs(dv - board_m[1] / 2) - 0.26) ** 2)
        tone -= 0.42 * ramp(hole, 0.026, 0.016)
        pore = _grain(u, v, 0.022, seed + 2)
        tone -= 0.3 * (pore > 0.965) + 0.1 * (pore < 0.06)
        stain = ramp(cloud(u / 0.12, v / 0.9, seed + 3, 2), 0.62, 0.85)
        return base * (tone - 0.12 * stain)[..., None]

    return paint


def tiles(codes: list[str], grout: str, size_m: tuple[float, float], seed: int, *, bond: float = 0.0) -> Painter:
    """Glazed tiles, each with its own tone and cloudy glaze; bond shifts every other course by that share."""
    tones, joint = np.array([colour(c) for c in codes]), colour(grout)
    width, height = size_m

    def paint(u: Array, v: Array) -> Array:
        j = np.floor(v / height + 1e-6)
        shifted = u / width + bond * (j % 2)
        i = np.floor(shifted + 1e-6)
        du, dv = (shifted - i) * width, v - j * height
        edge = np.minimum(np.minimum(du, width - du), np.minimum(dv, height - dv))
        which = hash01(i, j, seed)
        tone = 0.9 + 0.2 * hash01(i, j, seed + 1) + 0.22 * (cloud(u / 0.06 + 9 * which, v / 0.06, seed + 2, 2) - 0.5)
        rgb = tones[(which * len(tones)).astype(np.int64)] * tone[..., None]
        return mix(rgb, joint * (0.9 + 0.2 * _grain(u, v, 0.02, seed + 3))[..., None], ramp(edge, 0.006, 0.0015))

    return paint


def cement_tiles(codes: list[str], size_m: float, seed: int) -> Painter:
    """Floor tiles with stars, rings and quarter circles in four colours, laid at random."""
    tones = np.array([colour(c) for c in codes])

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / size_m + 1e-6), np.floor(v / size_m + 1e-6)
        x, y = u / size_m - i - 0.5, v / size_m - j - 0.5
        kind, turn = np.floor(hash01(i, j, seed) * 4), hash01(i, j, seed + 1)
        corner_x = np.where(turn < 0.5, x, -x)
        quarter = np.floor(np.sqrt((corner_x + 0.5) ** 2 + (y + 0.5) ** 2) * 4.0)
        opposite = np.floor(np.sqrt((corner_x - 0.5) ** 2 + (y - 0.5) ** 2) * 4.0)
        arcs = np.where(quarter < 3, quarter, np.where(opposite < 3, opposite + 1, 3))
        star = np.floor((abs(x) + abs(y)) * 4.5) + 2 * (abs(abs(x) - abs(y)) < 0.08)
        ring = np.floor(np.sqrt(x * x + y * y) * 7.0)
        cross_ = np.where((abs(x) < 0.14) | (abs(y) < 0.14), 0, 2) + (np.maximum(abs(x), abs(y)) > 0.36)
        chosen = np.choose(kind.astype(np.int64), [arcs, star, ring, cross_]).astype(np.int64) % len(tones)
        worn = 0.82 + 0.16 * cloud(u / 0.2, v / 0.2, seed + 2, 3) + 0.14 * _grain(u, v, 0.022, seed + 3)
        edge = 0.5 - np.maximum(abs(x), abs(y))
        return tones[chosen] * (worn * (1 - 0.35 * ramp(edge * size_m, 0.005, 0.001)))[..., None]

    return paint


PARQUET_M = 0.36  # a square of four strips


def parquet(light: str, dark: str, gap: str, seed: int) -> Painter:
    """Squares of four strips, turned at every other square, as in old flats; each strip from another tree."""
    timber, joint = wood(light, dark, seed), colour(gap)
    strip = PARQUET_M / 4

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / PARQUET_M + 1e-6), np.floor(v / PARQUET_M + 1e-6)
        turned = (i + j) % 2 > 0.5
        du, dv = u - i * PARQUET_M, v - j * PARQUET_M
        along, across = np.where(turned, dv, du), np.where(turned, du, dv)
        k = np.clip(np.floor(across / strip + 1e-6), 0, 3)
        own = hash01(i * 4 + k, j, seed + 20)
        rgb = timber(along + 5.1 * np.floor(own * 97), across + 2.3 * np.floor(own * 31))
        tone = 0.72 + 0.5 * hash01(i * 4 + k, j, seed + 21)
        across = across - k * strip
        edge = np.minimum(np.minimum(across, strip - across), np.minimum(along, PARQUET_M - along))
        return mix(rgb * tone[..., None], joint, 0.85 * ramp(edge, 0.004, 0.001))

    return paint


def carpet_tiles(codes: list[str], seed: int, *, size_m: float = 0.5) -> Painter:
    """Office carpet: squares with their pile turned at random, flecked and streaked in a few colours."""
    tones = np.array([colour(c) for c in codes])

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / size_m), np.floor(v / size_m)
        turned = hash01(i, j, seed) < 0.5
        along, across = np.where(turned, v, u), np.where(turned, u, v)
        streak = noise(along / 0.3, across / 0.024, seed + 1)
        which = np.clip(np.floor(len(tones) * (0.75 * streak + 0.25 * hash01(i, j, seed + 2))), 0, len(tones) - 1)
        fleck = _grain(u, v, 0.023, seed + 3)
        tone = 0.84 + 0.22 * fleck + 0.35 * (fleck > 0.965) + 0.06 * hash01(i, j, seed + 4)
        return tones[which.astype(np.int64)] * tone[..., None]

    return paint


def worley(u: Array, v: Array, seed: int) -> tuple[Array, Array, Array]:
    """Cells about scattered points, one a unit square: distance to the nearest, how far from a border, a number."""
    i, j = np.floor(u), np.floor(v)
    first, second = np.full(u.shape, 9.0), np.full(u.shape, 9.0)
    name = np.zeros(u.shape)
    for a in (-1, 0, 1):
        for b in (-1, 0, 1):
            x, y = i + a, j + b
            own = hash01(x, y, seed)
            d = (x + 0.15 + 0.7 * own - u) ** 2 + (y + 0.15 + 0.7 * (own * 61.0 % 1.0) - v) ** 2
            nearer = d < first
            second = np.where(nearer, first, np.minimum(second, d))
            first, name = np.where(nearer, d, first), np.where(nearer, own, name)
    first, second = np.sqrt(first), np.sqrt(second)
    return first, second - first, name


def stones(codes: list[str], mortar: str, size_m: float, seed: int, *, joint: float = 0.07) -> Painter:
    """Stones without order in mortar: rubble walls, flagged floors, or terrazzo where they are small."""
    tones, between = np.array([colour(c) for c in codes]), colour(mortar)

    def paint(u: Array, v: Array) -> Array:
        _, edge, name = worley(u / size_m, v / size_m, seed)
        rough = cloud(u / (0.3 * size_m) + 40 * name, v / (0.3 * size_m), seed + 1, 2)
        tone = 0.7 + 0.35 * (name * 37.0 % 1.0) + 0.35 * (rough - 0.5) + 0.12 * (_grain(u, v, 0.022, seed + 2) - 0.5)
        rgb = tones[(name * 997.0 % 1.0 * len(tones)).astype(np.int64)] * tone[..., None]
        bed = between * (0.9 + 0.2 * _grain(u, v, 0.02, seed + 3))[..., None]
        return mix(rgb, bed, ramp(edge, joint, 0.4 * joint))

    return paint


def facets(codes: list[str], size_m: float, seed: int) -> Painter:
    """Wallpaper of triangles in tones of a few colours."""
    tones = np.array([colour(c) for c in codes])

    def paint(u: Array, v: Array) -> Array:
        y = v / (size_m * 0.866)
        x = u / size_m - 0.5 * y
        i, j = np.floor(x), np.floor(y)
        upper = (x - i) + (y - j) > 1
        own = hash01(2 * i + upper, j, seed)
        paper = 0.93 + 0.1 * cloud(u / 0.12, v / 0.12, seed + 1, 2) + 0.09 * (_grain(u, v, 0.024, seed + 2) - 0.5)
        return tones[(own * len(tones)).astype(np.int64)] * (paper + 0.14 * (own * 53.0 % 1.0 - 0.5))[..., None]

    return paint


def ferns(ground: str, codes: list[str], seed: int, *, size_m: float = 0.42) -> Painter:
    """Large leaves in three layers, each leaf with its midrib and its own lean: a wallpaper of a conservatory."""
    base, tones = colour(ground), [colour(c) for c in codes]

    def paint(u: Array, v: Array) -> Array:
        rgb = base * (0.9 + 0.2 * cloud(u / 0.3, v / 0.3, seed, 3))[..., None]
        for k, tone in enumerate(tones):
            size = size_m * (0.8 + 0.16 * k)
            x, y = u / size + 0.37 * k, v / size + 0.61 * k
            i, j = np.floor(x), np.floor(y)
            own = hash01(i, j, seed + 5 * k)
            du, dv = x - i - 0.5, y - j - 0.5
            lean = 0.9 * (own - 0.5) + (0.5 if k % 2 else -0.5)
            length = 0.48 * (0.8 + 0.2 * (own * 17.0 % 1.0))
            along = (dv + lean * du) / np.sqrt(1 + lean * lean) / length
            across = (du - lean * dv) / np.sqrt(1 + lean * lean)
            half = 0.24 * np.maximum(1 - along * along, 0.0) * (1 - 0.3 * along)
            cut = abs((along * 5.5 + abs(across) * 7.0) % 1.0 - 0.5) < 0.34
            leaf = (abs(across) < half) & (cut | (abs(across) < 0.3 * half))
            rib = abs(across) < 0.016
            light = 0.72 + 0.45 * (own * 29.0 % 1.0) + 0.2 * (across > 0)
            rgb = np.where(leaf[..., None], tone * np.where(rib, 1.35 * light, light)[..., None], rgb)
        return rgb * (0.93 + 0.12 * _grain(u, v, 0.022, seed + 31))[..., None]

    return paint


def slats(light: str, dark: str, seed: int, *, pitch_m: float = 0.06) -> Painter:
    """Upright strips of timber with dark felt between them."""
    timber, felt = wood(light, dark, seed), colour("#2b2623")

    def paint(u: Array, v: Array) -> Array:
        i = np.floor(u / pitch_m + 1e-6)
        du = u - i * pitch_m
        own = hash01(i, i * 0, seed + 1)
        rgb = timber(v + 3.7 * np.floor(own * 50), du + 0.29 * np.floor(own * 23)) * (0.8 + 0.35 * own)[..., None]
        return mix(rgb, felt, ramp(abs(du - pitch_m / 2), 0.36 * pitch_m, 0.42 * pitch_m))

    return paint


def boards(code: str, gap: str, seed: int, *, width_m: float = 0.16) -> Painter:
    """Painted boards that lie, with worn edges, knots and nail heads: v runs across them."""
    base, joint = colour(code), colour(gap)

    def paint(u: Array, v: Array) -> Array:
        j = np.floor(v / width_m + 1e-6)
        own = hash01(j, j * 0, seed)
        dv = v - j * width_m
        brush = noise(u / 0.2 + 9 * own, v / 0.025, seed + 1) - 0.5
        dots = _grain(u, v, 0.026, seed + 2) < 0.04
        nail = (abs((u + 0.6 * own) % 0.6 - 0.3) < 0.009) & (abs(abs(dv - width_m / 2) - 0.04) < 0.009)
        tone = 0.88 + 0.18 * own + 0.16 * brush - 0.16 * dots - 0.4 * nail
        edge = np.minimum(dv, width_m - dv)
        return mix(base * tone[..., None], joint, np.maximum(ramp(edge, 0.006, 0.001), 0.5 * _knots(u, v, seed + 4)))

    return paint


def mineral(code: str, seed: int) -> Painter:
    """An office ceiling: tiles of 60 cm with worm holes in their metal grid."""
    base, rail = colour(code), colour("#f6f6f2")

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / 0.6 + 1e-6), np.floor(v / 0.6 + 1e-6)
        du, dv = u - 0.6 * i, v - 0.6 * j
        edge = np.minimum(np.minimum(du, 0.6 - du), np.minimum(dv, 0.6 - dv))
        worm = ramp(noise(u / 0.05 + 3 * j, v / 0.035 + 5 * i, seed), 0.72, 0.8)
        dot = _grain(u, v, 0.03, seed + 1) > 0.9
        tone = 0.93 + 0.1 * hash01(i, j, seed + 2) - 0.3 * worm - 0.16 * dot
        return mix(base * tone[..., None], rail * np.where(edge < 0.008, 0.62, 1.0)[..., None], ramp(edge, 0.02, 0.016))

    return paint


def cork(seed: int) -> Painter:
    """Granules of cork."""
    return stones(["#b98a58", "#a87745", "#c79d6c", "#8d6238", "#d4ae80"], "#7a5230", 0.045, seed, joint=0.1)
