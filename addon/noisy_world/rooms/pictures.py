# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural images: the garden behind the windows, paintings, the screen, the rug."""

import numpy as np

from .patterns import cloud, colour, hash01, mix, noise, ramp
from .surfaces import Array, Painter


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
