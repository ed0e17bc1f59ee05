# SPDX-License-Identifier: GPL-3.0-or-later
"""Coats of walls, floors and ceilings, and what is painted, printed and shown.

More coats for walls, floors and ceilings: plaster, concrete, tiles, parquet, carpet, stone, cork, slats.

None of them repeats: what looks alike is chosen by a hash of its place.
"""

import numpy as np

from .surfaces import GAP_M, Array, Painter, _knots, cloud, colour, hash01, mix, noise, ramp, wood


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


# Procedural images: the garden behind the windows, paintings, the screen, the rug.


def garden(s: Array, t: Array) -> Array:
    """Sky, hills, trees and lawn by direction: s = right / ahead, t = up / ahead. (R, C, 3) display-encoded."""
    sky = mix(colour("#dcecf5"), colour("#78aee0"), ramp(t, 0.0, 1.3))
    rgb = mix(sky, colour("#ffffff"), ramp(cloud(s * 2.2 + 5, t * 5.0, 400, 4), 0.5, 0.68) * ramp(t, -0.05, 0.15))
    for k, (height, far, near) in enumerate(
        (("0.20", "#a9bfd0", "#b9cbd6"), ("0.13", "#86a79c", "#9db9a2"), ("0.05", "#6f9a62", "#88ad69"))
    ):
        crest = float(height) + 0.22 * (cloud(s * (1.3 + k) + 3 * k, s * 0, 410 + k, 3) - 0.5)
        tone = mix(colour(far), colour(near), cloud(s * 14, t * 22, 420 + k, 3))
        rgb = np.where((t < crest)[..., None], tone, rgb)
    ground = mix(colour("#5f8f45"), colour("#a3c065"), cloud(s * 18, t * 40, 430, 3))
    flowers = hash01(np.floor(s * 55), np.floor(t * 70), 431)
    blossoms = np.array([colour(c) for c in ("#f4e26b", "#ffffff", "#d9607a", "#e89a4a")])
    ground = np.where((flowers > 0.9)[..., None], blossoms[(flowers * 400).astype(np.int64) % 4], ground)
    rgb = np.where((t < -0.06)[..., None], ground, rgb)
    for k in range(9):
        rgb = _tree(rgb, s, t, k)
    return rgb


def _tree(rgb: Array, s: Array, t: Array, k: int) -> Array:
    at = -1.75 + 0.43 * k + 0.2 * float(hash01(np.array([k]), np.array([0]), 440)[0])
    size = 0.16 + 0.16 * float(hash01(np.array([k]), np.array([1]), 440)[0])
    crown_t = 0.05 + size * 0.9
    trunk = (abs(s - at) < 0.022) & (t > -0.14) & (t < crown_t)
    rgb = np.where(trunk[..., None], colour("#6b4b33"), rgb)
    reach = ((s - at) / size) ** 2 + ((t - crown_t) / (size * 1.15)) ** 2
    leafy = reach + 1.3 * (cloud(s * 14, t * 14, 450 + k, 3) - 0.5) < 0.8
    speck = cloud(s * 34, t * 34, 460 + k, 2)
    light = np.clip(0.45 + 0.4 * (t - crown_t) / size - 0.2 * (s - at) / size + 1.5 * (speck - 0.5), 0, 1)
    return np.where(leafy[..., None], mix(colour("#35592f"), colour("#9fbf5a"), light), rgb)


def landscape(width_m: float, height_m: float, seed: int, codes: tuple[str, ...]) -> Painter:
    """Layered hills below a low sun, in brush strokes; codes: sky top, sky low, sun, then hills from far to near."""
    tones = [colour(c) for c in codes]

    def paint(u: Array, v: Array) -> Array:
        x, y = u / width_m, v / height_m
        dab = noise(u / 0.03, v / 0.009, seed + 30)
        rgb = mix(tones[1], tones[0], ramp(y + 0.12 * (dab - 0.5), 0.45, 1.0))
        sun = np.sqrt((u - 0.66 * width_m) ** 2 + (v - 0.66 * height_m) ** 2) / height_m
        rgb = mix(rgb, tones[2], ramp(sun, 0.13, 0.11) + 0.5 * ramp(sun, 0.4, 0.1) * (dab > 0.6))
        hills = tones[3:]
        for k, tone in enumerate(hills):
            crest = 0.62 - 0.5 * k / len(hills) + 0.28 * (cloud(x * (2.0 + k) + 9 * k, y * 0, seed + k, 3) - 0.5)
            stroke = 0.72 + 0.55 * noise(u / 0.022, (v - 0.3 * u) / 0.012, seed + 40 + k)
            rgb = np.where((y < crest)[..., None], tone * stroke[..., None], rgb)
        return rgb * (0.9 + 0.18 * dab)[..., None]

    return paint


def blocks(width_m: float, height_m: float, seed: int) -> Painter:
    """Coloured fields between black bars of uneven spacing."""
    tones = np.array([colour(c) for c in ("#f1ead8", "#c8452f", "#f1ead8", "#2f5b8c", "#e2b13c", "#f1ead8", "#dcd2bd")])

    def cuts(count: int, number: int) -> Array:
        gaps = 0.35 + hash01(np.arange(count), np.full(count, number), seed)
        return np.cumsum(gaps) / gaps.sum()

    def paint(u: Array, v: Array) -> Array:
        x, y = u / width_m, v / height_m
        a, b = cuts(6, 0), cuts(5, 1)
        i, j = np.searchsorted(a, x).clip(0, 5), np.searchsorted(b, y).clip(0, 4)
        rgb = tones[(hash01(i, j, seed + 2) * len(tones)).astype(np.int64)]
        rgb = rgb * (0.93 + 0.1 * hash01(np.floor(u / 0.008), np.floor(v / 0.008), seed + 3))[..., None]
        near_u = abs(x[..., None] - a[:-1]).min(-1) * width_m
        near_v = abs(y[..., None] - b[:-1]).min(-1) * height_m
        return np.where((np.minimum(near_u, near_v) < 0.008)[..., None], colour("#1f1d1c"), rgb)

    return paint


def circles(width_m: float, seed: int) -> Painter:
    """Rows of concentric rings, each square with its own colours."""
    tones = np.array(
        [colour(c) for c in ("#d9523c", "#e9b949", "#2f6f77", "#f0e5cf", "#3b3b58", "#e58a5c", "#7fae9a", "#8c3b4a")]
    )
    size = width_m / max(2, round(width_m / 0.16))

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / size), np.floor(v / size)
        wobble = 0.12 * (noise(u / 0.05, v / 0.05, seed) - 0.5)
        d = np.sqrt((u / size - i - 0.5) ** 2 + (v / size - j - 0.5) ** 2) + wobble
        ring = np.floor(d / 0.125)
        return (
            tones[(hash01(i * 8 + ring, j, seed + 1) * len(tones)).astype(np.int64)]
            * (0.88 + 0.2 * hash01(np.floor(u / 0.007), np.floor(v / 0.007), seed + 2))[..., None]
        )

    return paint


def botanical(width_m: float, height_m: float, seed: int, ink: str) -> Painter:
    """A pressed fern on old paper with lines of handwriting below."""
    paper, tone = colour("#efe3c6"), colour(ink)

    def paint(u: Array, v: Array) -> Array:
        x, y = u - width_m / 2, v / height_m
        x = x - 0.12 * width_m * (y - 0.5) ** 2 * 4 * (1 if seed % 2 else -1)
        rise = np.clip((y - 0.2) / 0.7, 0, 1)
        reach = 0.42 * width_m * (1 - rise) ** 0.5 * np.minimum(1, 6 * rise + 0.2)
        slant = (v - 0.55 * abs(x)) / 0.034
        frond = (abs((slant % 1) - 0.5) < 0.32 - 0.1 * abs(x) / (reach + 1e-6)) & (abs(x) < reach)
        stem = (abs(x) < 0.005) & (y > 0.14)
        grown = (frond | stem) & (y > 0.14) & (y < 0.92)
        rgb = paper * (0.86 + 0.2 * cloud(u / 0.05, v / 0.05, seed, 3))[..., None]
        shade = 0.7 + 0.6 * hash01(np.floor(slant), np.floor(x / 0.012), seed + 1)
        rgb = np.where(grown[..., None], tone * shade[..., None], rgb)
        line = (y < 0.11) & (y > 0.04) & ((v / 0.016 % 1) < 0.5) & (abs(x) < 0.3 * width_m)
        letters = line & (hash01(np.floor(u / 0.008), np.floor(v / 0.016), seed + 2) < 0.6)
        return np.where(letters[..., None], colour("#4a3b2a"), rgb)

    return paint


def rug(length_m: float, width_m: float, seed: int) -> Painter:
    """A knotted rug with borders, a field of small figures and a stepped medallion, mirrored both ways."""
    red, navy, cream, gold, teal = (colour(c) for c in ("#a8412f", "#27405e", "#eadcc0", "#d8a24a", "#4f8580"))
    knot = 0.019

    def paint(u: Array, v: Array) -> Array:
        i = np.floor(abs(u - length_m / 2) / knot)
        j = np.floor(abs(v - width_m / 2) / knot)
        half_i, half_j = np.floor(length_m / 2 / knot), np.floor(width_m / 2 / knot)
        edge = np.minimum(half_i - i, half_j - j)
        along = np.where(half_i - i < half_j - j, j, i)
        diamond = abs(i % 12 - 6) + abs(j % 12 - 6)
        rgb = np.where((diamond < 2)[..., None], gold, np.where((diamond == 4)[..., None], cream, red))
        rgb = np.where((diamond > 9)[..., None], teal, rgb)
        medal = i * 0.75 + j + (i % 3 == 0) + (j % 4 == 0)
        bands = np.array(
            [gold, navy, navy, cream, teal, teal, navy, gold, red, cream, navy, navy, gold, navy, red, cream]
        )
        ring = np.floor(medal / 2.0).astype(np.int64)
        rgb = np.where((ring < 16)[..., None], bands[ring.clip(0, 15)], rgb)
        corner = (half_i - i) + (half_j - j)
        rgb = np.where((corner < 34)[..., None], np.where(((i + j) % 5 < 2)[..., None], gold, navy), rgb)
        tooth = abs(along % 8 - 4)
        border = np.where((tooth + abs(edge - 6) < 4)[..., None], gold, navy)
        border = np.where((tooth + abs(edge - 6) < 2)[..., None], red, border)
        rgb = np.where((edge < 11)[..., None], border, rgb)
        rgb = np.where(((edge == 11) | (edge == 1))[..., None], cream, rgb)
        rgb = np.where((edge < 1)[..., None], red * 0.7, rgb)
        pile = (
            0.82
            + 0.22 * hash01(np.floor(u / 0.0095), np.floor(v / 0.0095), seed)
            + 0.12 * cloud(u / 0.12, v / 0.02, seed + 1)
        )
        return rgb * pile[..., None]

    return paint


def screen(width_m: float, height_m: float, seed: int) -> Painter:
    """The television's start page: two rows of tiles with captions before mountains and a lake."""
    codes = ("#d9482f", "#e8b13c", "#2f7fa6", "#f3ead6", "#6b4264", "#3f8a5a", "#e58a5c", "#27405e")
    tones = np.array([colour(c) for c in codes])
    scene = landscape(
        width_m, height_m, seed, ("#2f7fc2", "#cfe8f2", "#fff6d8", "#dfe6ec", "#8fa6bd", "#4f7f6a", "#2f5f4a")
    )

    def paint(u: Array, v: Array) -> Array:
        rgb = scene(u, np.maximum(v, 0.56 * height_m - v))
        water = v < 0.28 * height_m
        ripple = 0.75 + 0.4 * noise(u / 0.06, v / 0.008, seed + 60)
        rgb = np.where(water[..., None], rgb * ripple[..., None] + np.array([0.0, 0.02, 0.05]), rgb)
        step_u, step_v, size_u, size_v = 0.168, 0.15, 0.148, 0.094
        i, j = np.floor((u - 0.11) / step_u), np.floor((v - 0.045) / step_v)
        in_u, in_v = u - 0.11 - i * step_u, v - 0.045 - j * step_v
        row = (i >= 0) & (i < 6) & (j >= 0) & (j < 2)
        tile = row & (in_u < size_u) & (in_v < size_v)
        number = (hash01(i, j, seed + 61) * 8).astype(np.int64)
        ring = np.floor(np.sqrt((in_u - size_u / 2) ** 2 + (in_v - size_v / 2) ** 2) / 0.021 + hash01(i, j, seed + 62))
        rgb = np.where(tile[..., None], tones[(number + 3 * ring.astype(np.int64)) % 8], rgb)
        mark = hash01(np.floor(u / 0.0085), np.floor(v / 0.0085), seed + 63) > 0.45
        caption = row & (in_u < 0.1) & (abs(in_v - 0.117) < 0.01) & mark
        title = (v > height_m - 0.12) & (v < height_m - 0.075) & (u > 0.11) & (u < 0.5)
        title &= hash01(np.floor(u / 0.0125), np.floor(v / 0.0125), seed + 64) > 0.45
        return np.where((caption | title)[..., None], colour("#ffffff"), rgb)

    return paint


def clock_face(radius_m: float) -> Painter:
    """Twelve bars and a ring on a pale dial; u and v start at the centre."""

    def paint(u: Array, v: Array) -> Array:
        d = np.sqrt(u * u + v * v) / radius_m
        rgb = colour("#f4ecd8") * (0.92 + 0.1 * hash01(np.floor(u / 0.006), np.floor(v / 0.006), 470))[..., None]
        marks = np.zeros(u.shape, bool)
        for k in range(12):
            a = 2 * np.pi * k / 12
            aside = abs(u * np.cos(a) - v * np.sin(a))
            ahead = (u * np.sin(a) + v * np.cos(a)) / radius_m
            marks |= (aside < (0.010 if k % 3 == 0 else 0.006)) & (ahead > 0.68) & (ahead < 0.9)
        rgb = np.where(marks[..., None], colour("#2a2522"), rgb)
        return np.where((d > 0.95)[..., None], colour("#8c5a35"), rgb)

    return paint


# What is written, printed and shown: boards with notes, screens at work, posters, maps, quilts.


_INKS = ("#1f4f9c", "#b3261e", "#1d6b3a", "#26242a")


def _writing(u: Array, v: Array, line_m: float, seed: int) -> Array:
    """Whether there is ink: words of uneven length in lines, joined up."""
    row = np.floor(v / line_m)
    in_row = v / line_m - row
    word = hash01(np.floor(u / (1.6 * line_m) + 3 * hash01(row, row * 0, seed)), row, seed + 1) < 0.78
    wave = 0.42 + 0.5 * (noise(u / (0.28 * line_m), row * 3.7, seed + 2) - 0.5)
    stem = hash01(np.floor(u / (0.45 * line_m)), row, seed + 3) < 0.35
    return word & ((abs(in_row - wave) < 0.16) | (stem & (in_row > 0.3) & (in_row < 0.78) & (u / line_m % 0.45 < 0.2)))


def whiteboard(width_m: float, height_m: float, seed: int) -> Painter:
    """A board after a meeting: text in four colours, boxes with arrows, a curve in its axes, sticky notes."""
    notes = np.array([colour(c) for c in ("#f5d94e", "#f08fb0", "#8fd0e8", "#a5d96a")])

    def paint(u: Array, v: Array) -> Array:
        rgb = colour("#f2f3f0") * (0.95 + 0.05 * cloud(u / 0.3, v / 0.1, seed, 3))[..., None]
        cell_u, cell_v = 0.62, 0.46
        i, j = np.floor(u / cell_u), np.floor(v / cell_v)
        du, dv = u - i * cell_u, v - j * cell_v
        kind = hash01(i, j, seed + 1)
        ink = np.array([colour(c) for c in _INKS])[(hash01(i, j, seed + 2) * 4).astype(np.int64)]
        inside = (du > 0.05) & (du < cell_u - 0.05) & (dv > 0.05) & (dv < cell_v - 0.05)
        text = inside & _writing(u, v, 0.062, seed + 3) & (du < 0.3 + 0.25 * hash01(np.floor(v / 0.062), i, seed + 9))
        axes = inside & ((abs(du - 0.1) < 0.007) | (abs(dv - 0.09) < 0.007))
        curve = inside & (abs(dv - 0.12 - 0.22 * noise(du / 0.15 + 7 * i, j * 2.3, seed + 4)) < 0.011) & (du > 0.1)
        frame = np.maximum(abs(abs(du - cell_u / 2) - 0.15) / 0.09, abs(dv - cell_v / 2) / 0.08)
        boxes = (abs(frame - 1) < 0.09) | ((abs(dv - cell_v / 2) < 0.007) & (abs(du - cell_u / 2) < 0.06))
        drawn = np.where(kind < 0.45, text, np.where(kind < 0.65, axes | curve, boxes))
        drawn &= (u > 0.03) & (u < width_m - 0.03) & (v > 0.05) & (v < height_m - 0.04) & (kind < 0.9)
        rgb = np.where(drawn[..., None], ink, rgb)
        a, b = np.floor(u / 0.13), np.floor(v / 0.13)
        here = (hash01(a, b, seed + 5) < 0.6) & (u > 0.66 * width_m) & (v < 0.62 * height_m) & (v > 0.13)
        near = np.maximum(abs(u / 0.13 - a - 0.5), abs(v / 0.13 - b - 0.5)) < 0.36 + 0.08 * hash01(a, b, seed + 6)
        note = notes[(hash01(a, b, seed + 7) * 4).astype(np.int64)]
        note = np.where(_writing(u, v, 0.03, seed + 8)[..., None], colour("#3a3a44"), note)
        return np.where((here & near)[..., None], note, rgb)

    return paint


def noticeboard(width_m: float, height_m: float, seed: int) -> Painter:
    """Cork with papers, cards and photographs pinned to it."""
    ground = cork(seed)
    papers = np.array([colour(c) for c in ("#f4f0e4", "#f5e39a", "#cfe3ea", "#f2f2f2", "#f0c8bc", "#d6e8c2")])

    def paint(u: Array, v: Array) -> Array:
        rgb = ground(u, v)
        for k, size in enumerate((0.34, 0.25)):
            i, j = np.floor(u / size + 0.3 * k), np.floor(v / size + 0.4 * k)
            own = hash01(i, j, seed + 3 * k + 1)
            x, y = u / size + 0.3 * k - i - 0.5, v / size + 0.4 * k - j - 0.5
            lean = 0.2 * (own - 0.5)
            a, b = x + lean * y, y - lean * x
            sheet = (
                (abs(a) < 0.28 + 0.14 * (own * 7.0 % 1.0)) & (abs(b) < 0.30 + 0.13 * (own * 11.0 % 1.0)) & (own < 0.85)
            )
            tone = papers[(own * 41.0 % 1.0 * len(papers)).astype(np.int64)]
            text = _writing(a * size, b * size, 0.034, seed + 20 + k) & (abs(a) < 0.24) & (b < 0.2)
            photo = (own * 23.0 % 1.0 < 0.35) & (abs(a) < 0.24) & (abs(b) < 0.24)
            image = mix(colour("#35526b"), colour("#e0a860"), cloud(u / 0.07, v / 0.05 + 9 * own, seed + 30 + k, 3))
            tone = np.where(photo[..., None], image, np.where(text[..., None], colour("#2c2c34"), tone))
            pin = a * a + (b - 0.26) ** 2 < 0.0016
            tone = np.where(pin[..., None], colour("#c8322a"), tone)
            rgb = np.where(sheet[..., None], tone, rgb)
        edge = np.minimum(np.minimum(u, width_m - u), np.minimum(v, height_m - v))
        return np.where((edge < 0.012)[..., None], colour("#8f6238"), rgb)

    return paint


def desktop(width_m: float, height_m: float, seed: int) -> Painter:
    """A screen at work: an editor with coloured words beside a chart, a table or a picture."""
    words = np.array([colour(c) for c in ("#d8dee9", "#81a1c1", "#a3be8c", "#ebcb8b", "#d08770", "#b48ead")])
    kind = seed % 3

    def paint(u: Array, v: Array) -> Array:
        rgb = np.ones((*u.shape, 3)) * colour("#232a36")
        row, col = np.floor(v / 0.0165), np.floor(u / 0.0092)
        indent = 0.02 + 0.03 * np.floor(4 * hash01(np.floor(row / 3), row * 0, seed))
        length = indent + 0.05 + 0.2 * hash01(row, row * 0, seed + 1)
        word = np.floor(u / 0.042 + 3 * hash01(row, row * 0, seed + 2))
        typed = (u > indent) & (u < length) & (hash01(col, row, seed + 3) < 0.8) & (v / 0.0165 % 1.0 > 0.35)
        rgb = np.where(typed[..., None], words[(hash01(word, row, seed + 4) * 6).astype(np.int64)], rgb)
        x, y = (u - 0.55 * width_m) / (0.43 * width_m), (v - 0.06 * height_m) / (0.84 * height_m)
        pane = (x > 0) & (x < 1) & (y > 0) & (y < 1)
        rgb = np.where(pane[..., None], _pane(x, y, kind, seed), rgb)
        bar = v > 0.93 * height_m
        icons = hash01(np.floor(u / 0.012), np.floor(u * 0), seed + 5) < 0.4
        return np.where(bar[..., None], np.where(icons[..., None], colour("#5e81ac"), colour("#3b4252")), rgb)

    return paint


def _pane(x: Array, y: Array, kind: int, seed: int) -> Array:
    """The right half of a screen, x and y in [0, 1]: 0 a chart, 1 a table, 2 a picture."""
    paper = np.ones((*x.shape, 3)) * colour("#eceff4")
    if kind == 0:
        i = np.floor(x * 12)
        bars = (y < 0.15 + 0.7 * hash01(i, i * 0, seed + 10)) & (x * 12 - i > 0.25) & (y > 0.08)
        tone = np.array([colour(c) for c in ("#5e81ac", "#bf616a", "#d08770")])[(i % 3).astype(np.int64)]
        rgb = np.where(bars[..., None], tone, paper)
        return np.where((y % 0.2 < 0.014)[..., None], rgb * 0.75, rgb)
    if kind == 1:
        i, j = np.floor(x * 6), np.floor(y * 16)
        filled = (hash01(np.floor(x * 30), j, seed + 11) < 0.55) & (y * 16 - j > 0.4) & (x * 6 - i < 0.75)
        rgb = np.where((j % 2 > 0)[..., None], paper, paper * 0.88)
        rgb = np.where(filled[..., None], colour("#37425a"), rgb)
        return np.where((y > 0.93)[..., None], colour("#4c8c6a"), rgb)
    hills = cloud(x * 3.0, x * 0, seed + 12, 3)
    sky = mix(colour("#f6d9a8"), colour("#5d8fc4"), ramp(y, 0.3, 1.0))
    land = mix(colour("#3a5a3c"), colour("#a8b45c"), cloud(x * 14, y * 20, seed + 13, 3))
    return np.where((y < 0.25 + 0.5 * hills)[..., None], land, sky)


def poster(width_m: float, height_m: float, seed: int, codes: tuple[str, ...]) -> Painter:
    """A bold poster: ground, large shapes, a title in heavy letters, small print; codes: ground, ink, then shapes."""
    tones = np.array([colour(c) for c in codes[2:]])

    def paint(u: Array, v: Array) -> Array:
        x, y = u / width_m, v / height_m
        rgb = colour(codes[0]) * (0.93 + 0.1 * hash01(np.floor(u / 0.012), np.floor(v / 0.012), seed))[..., None]
        for k in range(7):
            cx, cy = (float(hash01(np.array([k]), np.array([n]), seed + 1)[0]) for n in (0, 1))
            size = 0.1 + 0.16 * float(hash01(np.array([k]), np.array([2]), seed + 1)[0])
            dx, dy = (x - cx) * width_m / height_m, y - 0.35 - 0.55 * cy
            shape = (np.sqrt(dx * dx + dy * dy) < size) if k % 2 else (np.maximum(abs(dx), abs(dx + dy)) < 0.8 * size)
            rings = (np.sqrt(dx * dx + dy * dy) / size * 3.0 % 1.0) < 0.7
            rgb = np.where((shape & rings)[..., None], tones[k % len(tones)], rgb)
        letter = np.floor(u / 0.05)
        heavy = (y > 0.16) & (y < 0.27) & (x > 0.08) & (x < 0.92) & (u / 0.05 - letter > 0.2)
        gap = hash01(np.floor(u / 0.025), np.floor(v / 0.03), seed + 2) < 0.35
        small = (y > 0.05) & (y < 0.12) & (x > 0.08) & (x < 0.8) & _writing(u, v, 0.022, seed + 3)
        return np.where(((heavy & ~gap) | small)[..., None], colour(codes[1]), rgb)

    return paint


def world_map(width_m: float, height_m: float, seed: int) -> Painter:
    """An old map: coasts, mountains, rivers of contour lines, a graticule and names."""
    del height_m

    def paint(u: Array, v: Array) -> Array:
        h = cloud(u / (0.36 * width_m), v / (0.36 * width_m), seed, 5)
        sea = mix(colour("#7fa7b5"), colour("#b9d2d4"), ramp(h, 0.3, 0.5))
        land = mix(colour("#d9cfa0"), colour("#a5743f"), ramp(h, 0.52, 0.72))
        land = np.where(((h * 36.0 % 1.0) < 0.16)[..., None], land * 0.72, land)
        rgb = np.where((h > 0.5)[..., None], land, sea)
        rgb = np.where((abs(h - 0.5) < 0.008)[..., None], colour("#4d3b28"), rgb)
        name = _writing(u, v, 0.03, seed + 1) & (hash01(np.floor(u / 0.16), np.floor(v / 0.09), seed + 2) < 0.3)
        rgb = np.where(name[..., None], colour("#3b2f26"), rgb)
        lines = (u % 0.15 < 0.008) | (v % 0.15 < 0.008)
        old = 0.88 + 0.2 * cloud(u / 0.2, v / 0.2, seed + 3, 3)
        return np.where(lines[..., None], rgb * 0.8, rgb) * old[..., None]

    return paint


def quilt(codes: list[str], size_m: float, seed: int) -> Painter:
    """A patchwork: each square of plain, striped, dotted or halved cotton, with a seam about it."""
    tones = np.array([colour(c) for c in codes])

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / size_m), np.floor(v / size_m)
        x, y = u / size_m - i, v / size_m - j
        own = hash01(i, j, seed)
        a = tones[(own * len(codes)).astype(np.int64)]
        b = tones[(own * 17.0 % 1.0 * len(codes)).astype(np.int64)]
        kind = np.floor(own * 97.0 % 1.0 * 4)
        dots = (x * 4 % 1 - 0.5) ** 2 + (y * 4 % 1 - 0.5) ** 2 < 0.08
        second = np.choose(kind.astype(np.int64), [x < -1, (x * 5) % 1 < 0.4, dots, x + y > 1])
        rgb = np.where(second[..., None], b, a)
        edge = np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y))
        cloth = 0.87 + 0.2 * hash01(np.floor(u / 0.012), np.floor(v / 0.012), seed + 1)
        return rgb * (cloth * np.where(edge < 0.05, 0.72, 1.0))[..., None]

    return paint


def wandering(codes: list[str], seed: int, *, band_m: float = 0.09) -> Painter:
    """A modern rug: bands that wander, in thick wool."""
    tones = np.array([colour(c) for c in codes])

    def paint(u: Array, v: Array) -> Array:
        h = cloud(u / 0.9, v / 0.7, seed, 3) * 0.9 / band_m
        k = np.floor(h)
        wool = 0.8 + 0.26 * hash01(np.floor(u / 0.012), np.floor(v / 0.012), seed + 1)
        line = (h - k) < 0.12
        rgb = tones[(hash01(k, k * 0, seed + 2) * len(tones)).astype(np.int64)]
        return np.where(line[..., None], rgb * 0.6, rgb) * wool[..., None]

    return paint
