# SPDX-License-Identifier: GPL-3.0-or-later
"""What is written, printed and shown: boards with notes, screens at work, posters, maps, quilts."""

import numpy as np

from .finishes import cork
from .patterns import cloud, colour, hash01, mix, noise, ramp
from .surfaces import Array, Painter

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
