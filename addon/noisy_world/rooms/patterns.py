# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural colour patterns from an integer hash: the same bytes on every machine and in every run.

A painter maps (u_m, v_m), metres along a surface with u along its length, to display-encoded colours.
"""

import numpy as np
from numpy.typing import NDArray

from .surfaces import Array, Painter

_MASK = 0xFFFFFFFF  # the lower 32 bits
_I, _J, _SEED = 374761393, 668265263, 2246822519
_ROUNDS = tuple(map(np.uint32, (15, 0x2C1B3C6D, 12, 0x297A2D39, 15)))


def colour(code: str) -> Array:
    """(3,) float64 from a "#rrggbb" code."""
    return np.array([int(code[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0


def hash01(i: NDArray[np.int64] | Array, j: NDArray[np.int64] | Array, seed: int) -> Array:
    """A pseudo-random number in [0, 1) for every pair of whole numbers.

    The multipliers are primes of xxHash32; the final mix is the two-round hash 15-2c1b3c6d-12-297a2d39-15 that
    hash-prospector lists.
    """
    return _mixed(_times(i, _I) + _times(j, _J) + np.uint32(seed * _SEED & _MASK))


def _times(numbers: NDArray[np.int64] | Array, prime: int) -> NDArray[np.uint32]:
    """Whole numbers times a prime, in 32 bits."""
    return np.asarray(numbers).astype(np.int64).astype(np.uint32) * np.uint32(prime)


def _mixed(h: NDArray[np.uint32]) -> Array:
    """Numbers in [0, 1) from hashes, which are used up."""
    first, by, second, again, last = _ROUNDS
    h ^= h >> first
    h *= by
    h ^= h >> second
    h *= again
    h ^= h >> last
    return h / 4294967296.0


def pick(index: int, seed: int, low: float = 0.0, high: float = 1.0) -> float:
    """A pseudo-random number in [low, high) for an index: hash01 of one number, which costs less without arrays."""
    h = (index * _I + seed % 9973 * _J + seed * _SEED) & _MASK
    h = (h ^ h >> 15) * 0x2C1B3C6D & _MASK
    h = (h ^ h >> 12) * 0x297A2D39 & _MASK
    return low + (high - low) * ((h ^ h >> 15) / 4294967296.0)


def noise(u: Array, v: Array, seed: int) -> Array:
    """Value noise in [0, 1) with a lattice of step 1: scale u and v to choose the grain."""
    iu, iv = np.floor(u), np.floor(v)
    fu, fv = u - iu, v - iv
    fu, fv = fu * fu * (3 - 2 * fu), fv * fv * (3 - 2 * fv)
    first_u, first_v = iu.min(), iv.min()
    count_u, count_v = int(iu.max() - first_u) + 2, int(iv.max() - first_v) + 2
    if count_u * count_v < 2 * iu.size:
        # There are fewer lattice points than vertices: hash each point once, then look up the four corners.
        table = hash01(first_u + np.arange(count_u)[:, None], first_v + np.arange(count_v), seed).ravel()
        at = ((iu - first_u) * count_v + (iv - first_v)).astype(np.int64)
        near, far_u, far_v, far = (table[at + step] for step in (0, count_v, 1, count_v + 1))
    else:
        h = np.empty((4, *iu.shape), np.uint32)
        h[0] = _times(iu, _I) + _times(iv, _J) + np.uint32(seed * _SEED & _MASK)
        h[1] = h[0] + np.uint32(_I)
        h[2:] = h[:2] + np.uint32(_J)
        near, far_u, far_v, far = _mixed(h)
    low, high = near + (far_u - near) * fu, far_v + (far - far_v) * fu
    return low + (high - low) * fv


def cloud(u: Array, v: Array, seed: int, octaves: int = 3) -> Array:
    """Noise of several grains, each half as wide and half as strong as the one before; in [0, 1)."""
    total, weight = np.zeros_like(u), 0.0
    for k in range(octaves):
        total += noise(u * 2**k, v * 2**k, seed + 17 * k) * 0.5**k
        weight += 0.5**k
    return total / weight


def mix(a: Array, b: Array, t: Array) -> Array:
    """From colour a (t = 0) to colour b (t = 1); a and b are (3,) or (R, C, 3), t is (R, C)."""
    w = np.clip(t, 0.0, 1.0)[..., None]
    return a * (1 - w) + b * w


def ramp(x: Array, start: float | Array, end: float | Array) -> Array:
    """0 at start, 1 at end, smooth between; start may be the larger one."""
    t = np.clip((x - start) / (end - start), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def plain(
    code: str, seed: int, *, grain: float = 0.05, grain_m: float = 0.012, patch: float = 0.05, fleck: float = 0.0
) -> Painter:
    """One colour with fine grain and faint patches, as paint, leather or glazed clay have; fleck adds dark dots."""
    base = colour(code)

    def paint(u: Array, v: Array) -> Array:
        dot = hash01(np.floor(u / grain_m), np.floor(v / grain_m), seed)
        tone = 1 + 2 * grain * (dot - 0.5) - fleck * (dot < 0.08)
        if patch:
            tone += 2 * patch * (cloud(u / 0.15, v / 0.15, seed + 1, 2) - 0.5)
        return base * tone[..., None]

    return paint


def wood(light: str, dark: str, seed: int, *, scale: float = 1.0) -> Painter:
    """Timber with its grain along u: streaks, growth rings and a knot here and there."""
    pale, deep = colour(light), colour(dark)

    def paint(u: Array, v: Array) -> Array:
        u, v = u / scale, v / scale
        bend = 0.03 * (noise(u / 0.5, v / 0.2, seed) - 0.5)
        rings = cloud(u / 0.9, (v + bend) / 0.035, seed + 1, 3)
        streak = noise(u / 0.11, v / 0.011, seed + 2)
        pores = 0.35 * (hash01(np.floor(u / 0.05), np.floor(v / 0.016), seed + 3) > 0.9)
        return mix(pale, deep, 0.9 * ramp(rings, 0.25, 0.8) + 0.5 * (streak - 0.5) + 0.75 * _knots(u, v, seed) + pores)

    return paint


def _knots(u: Array, v: Array, seed: int) -> Array:
    """Darkness of the knots: at most one in a cell of 45 x 14 cm, with a ring around it."""
    iu, iv = np.floor(u / 0.45), np.floor(v / 0.14)
    du = u / 0.45 - iu - (0.25 + 0.5 * hash01(iu, iv, seed + 5))
    dv = v / 0.14 - iv - (0.3 + 0.4 * hash01(iu, iv, seed + 6))
    d = np.sqrt((du * 0.45 / 1.7) ** 2 + (dv * 0.14) ** 2)
    return np.where(
        hash01(iu, iv, seed + 7) < 0.45, ramp(d, 0.016, 0.006) + 0.4 * ramp(abs(d - 0.024), 0.007, 0.0), 0.0
    )


PLANK_M = (1.4, 0.125)  # length and width of a board; like the other sizes in this room, designed, not measured
GAP_M = 0.003  # between boards


def plank_rows(length_m: float, inner: int) -> Array:
    """Grid rows across boards of PLANK_M, inner ones a board and three close together at every gap: a thin line."""
    count = round(length_m / PLANK_M[1])
    offsets = np.array([0.0, GAP_M, *np.arange(1, inner + 1) * (PLANK_M[1] / (inner + 1)), PLANK_M[1] - GAP_M])
    return np.append((np.arange(count)[:, None] * PLANK_M[1] + offsets).ravel(), count * PLANK_M[1])


def planks(light: str, dark: str, gap: str, seed: int) -> Painter:
    """Boards of PLANK_M laid along u with staggered ends; every board has its own tone and grain."""
    timber = wood(light, dark, seed)
    joint = colour(gap)

    def paint(u: Array, v: Array) -> Array:
        row = np.floor(v / PLANK_M[1] + 1e-6)
        shifted = u / PLANK_M[0] + hash01(row, row * 0, seed + 20)
        board = np.floor(shifted)
        own = hash01(board, row, seed + 21)
        rgb = timber(u + 7.3 * own, v + 3.1 * np.floor(8 * own))
        tone = 0.80 + 0.36 * hash01(board, row, seed + 22)
        warm = 1 + (hash01(board, row, seed + 23)[..., None] - 0.5) * np.array([0.04, 0.0, -0.10])
        edge_m = np.minimum(abs(v - row * PLANK_M[1]), abs(v - (row + 1) * PLANK_M[1]))
        end_m = (shifted - board) * PLANK_M[0]
        seam = np.maximum(edge_m < GAP_M / 2, 0.8 * (end_m < 0.016))
        return mix(rgb * tone[..., None] * warm, joint, seam)

    return paint


def beadboard(code: str, gap: str, seed: int) -> Painter:
    """Painted upright boards of PLANK_M's width, the brush marks and a knot showing here and there."""
    base, joint = colour(code), colour(gap)

    def paint(u: Array, v: Array) -> Array:
        board = np.floor(u / PLANK_M[1] + 1e-6)
        edge_m = np.minimum(abs(u - board * PLANK_M[1]), abs(u - (board + 1) * PLANK_M[1]))
        brush = noise(u / 0.024, v / 0.14 + 9 * hash01(board, board * 0, seed), seed + 1) - 0.5
        dots = hash01(np.floor(u / 0.025), np.floor(v / 0.026), seed + 2) < 0.05
        tone = 0.95 + 0.1 * hash01(board, board * 0, seed + 3) + 0.13 * brush - 0.13 * dots
        return mix(base * tone[..., None], joint, np.maximum(edge_m < GAP_M / 2, 0.45 * _knots(v, u, seed + 4)))

    return paint


BRICK_M = (0.22, 0.075)  # length and height of a brick with its mortar
MORTAR_M = 0.010  # width of a joint


def brick_grid(u_length_m: float, v_length_m: float) -> tuple[Array, Array]:
    """Columns and rows of a grid whose lines follow the edges of bricks of BRICK_M in running bond."""
    half, course, m = BRICK_M[0] / 2, BRICK_M[1], MORTAR_M / 2
    along = np.array([0.0, m, m + 0.003, *np.linspace(m + 0.028, half - m - 0.028, 2), half - m - 0.003, half - m])
    up = np.array([0.0, m, m + 0.003, course / 2, course - m - 0.003, course - m])
    u = (np.arange(int(u_length_m / half) + 1)[:, None] * half + along).ravel()
    v = (np.arange(int(v_length_m / course) + 1)[:, None] * course + up).ravel()
    ends = ((u, u_length_m), (v, v_length_m))
    u, v = (np.append(x[x < length - 0.001], length) for x, length in ends)
    return u, v


def brick_depth(u: Array, v: Array) -> tuple[Array, Array, Array]:
    """(face, column, course): face is 1 on a brick and 0 on mortar; column and course are the brick's numbers."""
    course = np.floor(v / BRICK_M[1] + 1e-6)
    shifted = u / BRICK_M[0] + 0.5 * (course % 2)
    column = np.floor(shifted + 1e-6)
    in_u = (shifted - column) * BRICK_M[0]
    in_v = v - course * BRICK_M[1]
    edge = np.minimum(np.minimum(in_u, BRICK_M[0] - in_u), np.minimum(in_v, BRICK_M[1] - in_v)) - MORTAR_M / 2
    return ramp(edge, 0.0005, 0.0029), column, course


RED_BRICKS = ("#b5745a", "#a9644c", "#c08468", "#97563f", "#b98f78", "#8a4e3e", "#c69a82")


def bricks(seed: int, codes: tuple[str, ...] = RED_BRICKS, joint: str = "#cfc5b6") -> Painter:
    """Bricks, reddish if nothing else is asked for, each with its own tone, with pits and pale smears, in mortar."""
    tones = np.array([colour(c) for c in codes])
    mortar = colour(joint)

    def paint(u: Array, v: Array) -> Array:
        face, column, course = brick_depth(u, v)
        tone = tones[(hash01(column, course, seed) * len(tones)).astype(np.int64)]
        pits = hash01(np.floor(u / 0.013), np.floor(v / 0.013), seed + 1)
        grime = cloud(u / 0.08, v / 0.05, seed + 2)
        rgb = tone * (0.72 + 0.5 * grime - 0.28 * (pits > 0.88) + 0.14 * (pits < 0.1))[..., None]
        smear = ramp(cloud(u / 0.3, v / 0.2, seed + 3), 0.62, 0.8) * 0.5
        joint = mortar * (0.86 + 0.25 * hash01(np.floor(u / 0.011), np.floor(v / 0.009), seed + 4))[..., None]
        return mix(joint, mix(rgb, mortar, smear), face)

    return paint


def _leaf(u: Array, v: Array, length: Array, width: float) -> Array:
    """Coverage of a leaf from the origin, rising to the right: a lens of the given length and width."""
    along, aside = (0.82 * u + 0.57 * v) / length, abs(0.82 * v - 0.57 * u) / width
    inside = 4 * along * (1 - along) - 2 * aside
    return ramp(inside, 0.0, 0.45)


SPRIG_M = (0.28, 0.35)  # width and height of the repeat


def wallpaper(ground: str, leaf: str, berry: str, seed: int) -> Painter:
    """Sprigs with leaves and berries in half-drop repeat, each a little different, on a speckled ground."""
    paper, green, red = colour(ground), colour(leaf), colour(berry)

    def paint(u: Array, v: Array) -> Array:
        column = np.floor(u / SPRIG_M[0])
        v = v + SPRIG_M[1] / 2 * (column % 2)
        row = np.floor(v / SPRIG_M[1])
        x = u - (column + 0.5) * SPRIG_M[0] + 0.04 * (hash01(column, row, seed) - 0.5)
        y = v - row * SPRIG_M[1] - 0.03 * hash01(column, row, seed + 1)
        straight = x
        x = np.where(hash01(column, row, seed + 2) < 0.5, -x, x)
        lean = 0.5 * (hash01(column, row, seed + 3) - 0.3)
        x = x - lean * (y - 0.16) * y * 4
        cover = ramp(abs(x), 0.012, 0.005) * (y > 0.02) * (y < 0.25)
        for k, height in enumerate((0.03, 0.075, 0.12, 0.165, 0.205)):
            side = 1 - 2 * (k % 2)
            size = 0.115 - 0.010 * k + 0.02 * hash01(column, row * 8 + k, seed + 4)
            cover = np.maximum(cover, _leaf(x * side, y - height, size, 0.052 - 0.003 * k))
        tone = 0.85 + 0.3 * hash01(column, row, seed + 5)
        berries = np.zeros_like(u)
        for k in range(4):
            bx = 0.22 * hash01(column, row * 4 + k, seed + 6) - 0.11
            by = 0.03 + 0.29 * hash01(column, row * 4 + k, seed + 7)
            berries = np.maximum(berries, ramp(np.sqrt((straight - bx) ** 2 + (y - by) ** 2), 0.022, 0.014))
        speck = hash01(np.floor(u / 0.014), np.floor(v / 0.014), seed + 8)
        rgb = (
            paper * (1 - 0.22 * (speck > 0.92) + 0.03 * (speck < 0.2) - 0.05 * cloud(u / 0.4, v / 0.4, seed))[..., None]
        )
        rgb = mix(rgb, green * tone[..., None], cover * (0.85 + 0.15 * (speck > 0.3)))
        return mix(rgb, red, 0.9 * berries * (cover < 0.4))

    return paint


def weave(code: str, thread: str, seed: int, *, thread_m: float = 0.018) -> Painter:
    """Coarse cloth: every thread crossing has its own tone, some are of the second colour."""
    base, second = colour(code), colour(thread)

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / thread_m), np.floor(v / thread_m)
        tone = 0.84 + 0.3 * hash01(i, j, seed) + 0.07 * ((i + j) % 2)
        return (
            mix(base * tone[..., None], second, 0.5 * (hash01(i, j, seed + 1) > 0.88))
            * (0.92 + 0.16 * cloud(u / 0.2, v / 0.2, seed + 2, 2))[..., None]
        )

    return paint


def stripes(codes: list[str], widths_m: list[float], seed: int) -> Painter:
    """Woven stripes along v, repeated across u."""
    tones, edges = np.array([colour(c) for c in codes]), np.cumsum(widths_m)

    def paint(u: Array, v: Array) -> Array:
        band = np.searchsorted(edges, u % edges[-1], side="right").clip(0, len(tones) - 1)
        grain = hash01(np.floor(u / 0.012), np.floor(v / 0.012), seed)
        return tones[band] * (0.88 + 0.2 * grain)[..., None]

    return paint


def checks(codes: list[str], size_m: float, seed: int) -> Painter:
    """Squares in random colours, as a patchwork."""
    tones = np.array([colour(c) for c in codes])

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / size_m), np.floor(v / size_m)
        grain = hash01(np.floor(u / 0.01), np.floor(v / 0.01), seed)
        return tones[(hash01(i, j, seed + 1) * len(tones)).astype(np.int64)] * (0.88 + 0.2 * grain)[..., None]

    return paint


def terrazzo(code: str, chips: list[str], seed: int, *, chip_m: float = 0.03) -> Painter:
    """A ground with chips of other colours strewn over it: stone, glaze, or printed cotton."""
    base, tones = colour(code), np.array([colour(c) for c in chips])

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / chip_m), np.floor(v / chip_m)
        du = u / chip_m - i - 0.3 - 0.4 * hash01(i, j, seed)
        dv = v / chip_m - j - 0.3 - 0.4 * hash01(i, j, seed + 1)
        size = 0.18 + 0.22 * hash01(i, j, seed + 2)
        tone = tones[(hash01(i, j, seed + 3) * len(tones)).astype(np.int64)]
        return mix(base * np.ones_like(tone), tone, ramp(np.maximum(abs(du + 0.3 * dv), abs(dv)), size, size - 0.15))

    return paint
