# SPDX-License-Identifier: GPL-3.0-or-later
"""A palm, trailing pot plants and tulips: many thin leaves, each a small sheet."""

import numpy as np

from . import patterns as pt
from .surfaces import Array, Painter, Piece, disc, grid, joined, lathe, placed, shadeless, sheet, tube


def _blade(base_m: Array, along: Array, size_m: tuple[float, float, float], paint: Painter) -> Piece:
    """A narrow leaf from base_m in the direction along, bending down towards its tip; size_m: length, width, droop."""
    length_m, width_m, droop_m = size_m
    t = np.arange(8) / 7.0
    spine = base_m + along * (length_m * t)[:, None] - np.array([0, 0, 1.0]) * (droop_m * t * t)[:, None]
    aside = np.array([-along[1], along[0], 0.0])
    aside = aside / max(float(np.sqrt((aside * aside).sum())), 1e-6)
    half = 0.5 * width_m * np.maximum(4 * t * (1 - t), 0.07) + 0.0005
    s = np.array([-1.0, 0.0, 1.0])
    points = spine[:, None] + aside * (half[:, None] * s)[..., None]
    points = points - np.array([0, 0, 0.25]) * (half[:, None] * abs(s))[..., None]
    u, v = grid(s * width_m, t * length_m)
    return Piece((sheet(points, paint(u + base_m[0], v + base_m[2])),))


def _palm(fronds: int, height_m: float, seed: int) -> Piece:
    """Arching fronds with two rows of narrow leaves, out of the origin."""
    parts: list[Piece] = []
    leaf = [
        pt.plain(c, seed + k, grain=0.16, patch=0.0) for k, c in enumerate(("#4f8a4a", "#3b7040", "#6fa354", "#2f5f3a"))
    ]
    stem = pt.plain("#8aa05a", seed + 9, grain=0.1, patch=0.0)
    for k in range(fronds):
        yaw = 2.399963 * k + 0.3 * pt.pick(k, seed)
        rise = height_m * pt.pick(k, seed + 1, 0.55, 1.0)
        reach = pt.pick(k, seed + 2, 0.22, 0.52) * (1.25 - 0.5 * rise / height_m)
        out = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        t = np.arange(15) / 14.0
        line = (
            out * (reach * t * t)[:, None]
            + np.array([0, 0, 1.0]) * (rise * (1.25 * t - 0.3 * t**3))[:, None]
            + out * 0.03
        )
        parts.append(tube([tuple(p) for p in line], 0.0055 - 0.0035 * t, 5, stem))
        for j in range(5, 15):
            ahead = line[j] - line[j - 1]
            ahead = ahead / np.sqrt((ahead * ahead).sum())
            for side in (-1.0, 1.0):
                across = np.array([-out[1], out[0], 0.0]) * side
                along = 0.62 * ahead + 0.78 * across
                length = 0.21 * (1 - 0.05 * abs(j - 9)) * pt.pick(j * 2 + int(side > 0), seed + k, 0.85, 1.1)
                parts.append(_blade(line[j], along, (length, 0.022, 0.07), leaf[(j + k) % 4]))
    return joined(parts)


def potted_palm() -> Piece:
    """A palm, 1.5 m with its banded clay pot, standing on the origin."""
    pot = pt.stripes(["#c9714e", "#c9714e", "#f0e2c8", "#2f5a55", "#f0e2c8"], [0.16, 0.03, 0.014, 0.024, 0.014], 790)

    def rings(u: Array, v: Array) -> Array:
        return pot(v, u)

    outline = [(0.12, 0.0), (0.165, 0.24), (0.185, 0.33), (0.192, 0.345), (0.18, 0.35), (0.17, 0.33)]
    body = lathe((0, 0, 0), outline, 40, rings, cell_m=0.012)
    soil = disc((0, 0, 0.325), 0.172, 0.016, pt.plain("#4a3524", 791, grain=0.5))
    blocker = Piece((), (((-0.15, -0.15, 0.0), (0.15, 0.15, 0.33)),))
    return shadeless(joined([body, soil, placed(_palm(16, 1.15, 792), (0, 0, 0.32))])) + blocker


def trailing_plant() -> Piece:
    """A small pot whose shoots hang down in front (-y)."""
    parts = [
        lathe(
            (0, 0, 0), [(0.055, 0), (0.08, 0.13), (0.07, 0.13)], 24, pt.plain("#e8e0cf", 800, grain=0.08), cell_m=0.01
        )
    ]
    parts.append(disc((0, 0, 0.127), 0.0715, 0.012, pt.plain("#4a3524", 806, grain=0.5)))
    leaf = [pt.plain(c, 801 + k, grain=0.14, patch=0.0) for k, c in enumerate(("#5f9a50", "#86b565", "#427a44"))]
    stem = pt.plain("#6b8a48", 805, patch=0.0)
    for k in range(11):
        yaw = -np.pi / 2 + 0.27 * (k - 5)
        out = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        fall = pt.pick(k, 806, 0.15, 0.62)
        t = np.arange(13) / 12.0
        line = (
            out * (0.02 + 0.16 * np.minimum(1.0, 2.2 * t))[:, None]
            + np.array([0, 0, 1.0]) * (0.13 + 0.05 * t - fall * t * t)[:, None]
        )
        parts.append(tube([tuple(p) for p in line], 0.002, 4, stem))
        for j in range(2, 13):
            side = np.array([np.cos(yaw + 1.3 * (-1) ** j), np.sin(yaw + 1.3 * (-1) ** j), 0.1])
            parts.append(_blade(line[j], side, (0.075, 0.05, 0.02), leaf[(j + k) % 3]))
    return joined(parts)


def flowers() -> Piece:
    """A jug of tulips."""
    jug = pt.terrazzo("#f0e8d6", ["#3d6470", "#7fa0a8"], 820, chip_m=0.022)
    parts = [
        lathe((0, 0, 0), [(0.05, 0), (0.075, 0.06), (0.07, 0.13), (0.04, 0.19), (0.055, 0.22)], 28, jug, cell_m=0.008)
    ]
    green = pt.plain("#5f8f48", 821, grain=0.12)
    codes = ("#d9482f", "#e8b13c", "#e07a8c", "#f3e6d0", "#c23b5a")
    for k in range(11):
        yaw, reach, top = 2.4 * k, pt.pick(k, 822, 0.03, 0.17), pt.pick(k, 823, 0.34, 0.48)
        x, y = reach * float(np.cos(yaw)), reach * float(np.sin(yaw))
        parts.append(tube([(0.15 * x, 0.15 * y, 0.18), (0.5 * x, 0.5 * y, 0.3), (x, y, top)], 0.003, 5, green))
        petal = pt.stripes([codes[k % 5], codes[(k + 1) % 5]], [0.014, 0.004], 824 + k)
        parts.append(
            lathe(
                (x, y, top - 0.01),
                [(0.008, 0), (0.024, 0.014), (0.026, 0.035), (0.014, 0.056)],
                10,
                petal,
                cell_m=0.008,
            )
        )
        out = np.array([np.cos(yaw + 1), np.sin(yaw + 1), 0.9])
        parts.append(_blade(np.array([0, 0, 0.2]), out * 0.7, (0.2, 0.03, 0.05), green))
    return joined(parts)
