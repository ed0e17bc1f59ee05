# SPDX-License-Identifier: GPL-3.0-or-later
"""Beds, wardrobes, chests, armchairs, shelves, and what stands in halls.

A piece has its back at y = 0, or is about its own origin where its docstring says so.
"""

import numpy as np

from . import patterns as pt
from .books import book_row
from .furniture import STEEL
from .surfaces import (
    Painter,
    Piece,
    Point,
    ball,
    box,
    disc,
    joined,
    lathe,
    pillow,
    placed,
    rect,
    rod,
    rounded_box,
    shadeless,
    sheet,
    tilted,
    tube,
)
from .things import BLACK, BRASS


def bed(width_m: float, timber: Painter, cover: Painter, linen: Painter, cushion: Painter) -> Piece:
    """A bed with a headboard, pillows and a quilt that hangs over its sides; 2.1 m long."""
    w = width_m / 2
    parts = [
        rounded_box((-w - 0.04, -0.07, 0.0), (w + 0.04, 0.0, 1.08), 0.02, 0.018, timber),
        box((-w, -2.08, 0.16), (w, -0.07, 0.31), 0.022, timber, skip="Y"),
        rounded_box((-w + 0.01, -2.05, 0.31), (w - 0.01, -0.08, 0.52), 0.06, 0.022, linen, arc=3),
        *(box((x - 0.03, -2.06, 0.0), (x + 0.03, -2.0, 0.16), 0.02, timber) for x in (-w + 0.05, w - 0.05)),
        shadeless(_coverlet(w, cover)),
    ]
    for k, x in enumerate((-w / 2, w / 2) if width_m > 1.2 else (0.0,)):
        for j, (paint, size, y, lean) in enumerate(((linen, 0.66, -0.17, -28.0), (cushion, 0.44, -0.36, -34.0))):
            soft = tilted(placed(pillow(size, 0.45 - 0.06 * j, 0.17, 0.013, paint), (0, 0, 0.2)), 0, lean)
            parts.append(placed(soft, (x, y - 0.07, 0.52), 7.0 * (-1) ** (k + j)))
    return joined(parts)


def _coverlet(half_m: float, paint: Painter) -> Piece:
    """A quilt over the mattress from y = -2.12 to -0.75, in one sheet with folds where it hangs."""
    drop = 0.30
    across = np.linspace(-half_m - drop, half_m + drop, round((2 * half_m + 2 * drop) / 0.013) + 1)
    along = np.linspace(0.0, 1.36 + drop, round((1.36 + drop) / 0.013) + 1)
    a, b = np.meshgrid(across, along)
    side, foot = np.maximum(abs(a) - half_m - 0.012, 0.0), np.maximum(b - 1.36, 0.0)
    fold = 0.018 * np.sin(9.0 * b + 2.0 * np.sign(a)) * np.minimum(side / 0.15, 1.0)
    fold_foot = 0.015 * np.sin(11.0 * a) * np.minimum(foot / 0.15, 1.0)
    x = np.sign(a) * (np.minimum(abs(a), half_m + 0.012) + fold + 0.06 * side)
    y = -0.74 - np.minimum(b, 1.36) - 0.06 * foot - abs(fold_foot)
    puff = 0.012 * np.sin(a * 22.0) * np.sin(b * 22.0)
    z = 0.545 + np.where((side == 0) & (foot == 0), puff, 0.0) - np.maximum(side, foot)
    return Piece((sheet(np.stack([x, y, z], -1)[::-1], paint(a + 5, b)[::-1]),))


def drawers(size_m: Point, columns: int, rows: int, timber: Painter, face: Painter) -> Piece:
    """A chest of drawers with knobs; size: width, height, depth."""
    w, h, d = size_m[0] / 2, size_m[1], size_m[2]
    parts = [box((-w, -d, 0.05), (w, 0.0, h), 0.018, timber, skip="Yz")]
    parts.append(shadeless(box((-w + 0.02, -d + 0.03, 0.0), (w - 0.02, 0.0, 0.05), 0.03, BLACK, skip="YzZ")))
    step_x, step_z = (2 * w - 0.02) / columns, (h - 0.08) / rows
    for i in range(columns):
        for j in range(rows):
            x, z = -w + 0.01 + i * step_x, 0.065 + j * step_z
            front = box(
                (x + 0.006, -d - 0.016, z + 0.006), (x + step_x - 0.006, -d, z + step_z - 0.006), 0.018, face, skip="Y"
            )
            parts.append(shadeless(front))
            middle = (x + step_x / 2, -d - 0.03, z + step_z * 0.55)
            parts.append(shadeless(ball(middle, 0.017, 0.008, BRASS)))
    return joined(parts)


def wardrobe(size_m: Point, doors: int, timber: Painter, face: Painter) -> Piece:
    """A wardrobe with panelled doors and a cornice; size: width, height, depth."""
    w, h, d = size_m[0] / 2, size_m[1], size_m[2]
    parts = [
        box((-w, -d, 0.08), (w, 0.0, h), 0.02, timber, skip="Yz"),
        shadeless(box((-w + 0.02, -d + 0.03, 0.0), (w - 0.02, 0.0, 0.08), 0.03, timber, skip="YzZ")),
        shadeless(box((-w - 0.03, -d - 0.03, h), (w + 0.03, 0.0, h + 0.06), 0.025, timber, skip="Y")),
    ]
    step = 2 * w / doors
    for k in range(doors):
        a, b = -w + k * step + 0.005, -w + (k + 1) * step - 0.005
        parts.append(shadeless(box((a, -d - 0.02, 0.1), (b, -d, h - 0.02), 0.018, face, skip="Y")))
        for low, high in ((0.18, 0.42 * h), (0.46 * h, h - 0.1)):
            parts.append(
                shadeless(box((a + 0.07, -d - 0.032, low), (b - 0.07, -d - 0.02, high), 0.018, timber, skip="Y"))
            )
        x = b - 0.035 if k % 2 == 0 else a + 0.035
        parts.append(shadeless(rod((x, -d - 0.04, 0.98), (x, -d - 0.04, 1.14), 0.008, 0.02, BRASS)))
    return joined(parts)


def armchair(cloth: Painter, legs: Painter) -> Piece:
    """A wide chair with arms, about its origin, looking towards -y."""
    cell = 0.019
    parts = [
        rounded_box((-0.36, -0.36, 0.16), (0.36, 0.34, 0.3), 0.03, cell, cloth),
        rounded_box((-0.27, -0.4, 0.29), (0.27, 0.22, 0.45), 0.05, cell, cloth, arc=3, bulge_m=0.02),
        rounded_box((-0.42, -0.38, 0.16), (-0.27, 0.36, 0.6), 0.06, cell, cloth, arc=3),
        rounded_box((0.27, -0.38, 0.16), (0.42, 0.36, 0.6), 0.06, cell, cloth, arc=3),
        placed(
            tilted(
                rounded_box((-0.36, -0.08, 0.0), (0.36, 0.08, 0.62), 0.07, cell, cloth, arc=3, bulge_m=0.02), 0, -10
            ),
            (0, 0.26, 0.28),
        ),
    ]
    parts += [
        shadeless(rod((x, y, 0.0), (0.9 * x, 0.9 * y, 0.17), 0.018, 0.03, legs))
        for x in (-0.34, 0.34)
        for y in (-0.32, 0.3)
    ]
    return joined(parts)


def radiator(width_m: float) -> Piece:
    """A ribbed radiator on the wall."""
    enamel = pt.plain("#e9e6dc", 1500, grain=0.07, grain_m=0.02)
    count = round(width_m / 0.06)
    ribs = [
        rounded_box(
            (-width_m / 2 + 0.06 * k, -0.11, 0.14), (-width_m / 2 + 0.06 * k + 0.05, -0.035, 0.72), 0.02, 0.045, enamel
        )
        for k in range(count)
    ]
    pipe = [rod((-width_m / 2, -0.07, z), (width_m / 2 - 0.01, -0.07, z), 0.012, 0.05, enamel) for z in (0.17, 0.69)]
    feet = [
        rod((x, -0.07, 0.0), (x, -0.07, 0.15), 0.012, 0.03, enamel) for x in (-width_m / 2 + 0.025, width_m / 2 - 0.035)
    ]
    block = Piece((), (((-width_m / 2, -0.1, 0.14), (width_m / 2, -0.03, 0.7)),))
    return shadeless(joined([*ribs, *pipe, *feet])) + block


def wall_shelf(width_m: float, timber: Painter, seed: int) -> Piece:
    """A board on two brackets with books on it, its top at z = 0."""
    w = width_m / 2
    parts = [rounded_box((-w, -0.22, -0.03), (w, 0.0, 0.0), 0.006, 0.014, timber)]
    arms = [[(x, -0.2, -0.03), (x, -0.02, -0.03), (x, -0.012, -0.16)] for x in (-w + 0.12, w - 0.12)]
    parts += [shadeless(tube(arm, 0.007, 6, BLACK)) for arm in arms]
    parts.append(placed(book_row(width_m - 0.03, 0.33, seed), (-w + 0.02, -0.205, 0.001)))
    return joined(parts)


def coat_rack(width_m: float, timber: Painter, codes: list[str], seed: int) -> Piece:
    """A board with hooks at eye height, and a coat on all but one of them."""
    w = width_m / 2
    parts = [box((-w, -0.025, 1.66), (w, 0.0, 1.78), 0.018, timber, skip="Y")]
    count = round(width_m / 0.26)
    for k in range(count):
        x = -w + (k + 0.5) * width_m / count
        hook = [(x, -0.025, 1.74), (x, -0.075, 1.73), (x, -0.085, 1.76)]
        parts.append(tube(hook, 0.007, 6, BRASS))
        if k != count // 2:
            parts.append(placed(_coat(codes[k % len(codes)], seed + k), (x, -0.02, 0.0)))
    return shadeless(joined(parts)) + Piece((), (((-w, -0.16, 0.75), (w, -0.03, 1.66)),))


def _coat(code: str, seed: int) -> Piece:
    """A coat that hangs from 1.74 m: a body in folds with a buttoned front, a collar, two sleeves."""
    cloth = (
        pt.weave(code, "#d8c8b0", seed, thread_m=0.02)
        if seed % 2
        else pt.checks([code, code, "#3a3430", "#8c7a62"], 0.045, seed)
    )
    v, a = np.meshgrid(np.linspace(0.0, 1.0, 60), np.linspace(0.0, 2 * np.pi, 61), indexing="ij")
    half = np.interp(v, [0.0, 0.03, 0.05, 0.1, 0.45, 1.0], [0.045, 0.05, 0.075, 0.15, 0.14, 0.175])
    fold = 1.0 + 0.2 * np.sin(6 * a + seed) * np.maximum(v - 0.25, 0.0)
    long_ = 0.85 + 0.2 * pt.pick(seed, 3)
    x, y = 0.82 * half * np.cos(a) * fold, -0.085 + np.minimum(0.07, 0.8 * half) * np.sin(a) * fold
    points = np.stack([x, y, 1.73 - long_ * v], -1)[::-1]
    front = abs(a - 1.5 * np.pi)
    button = (front < 0.16) & (front > 0.05) & (abs(v * 9 % 1.0 - 0.5) < 0.12) & (v > 0.12) & (v < 0.8)
    rgb = np.where((front < 0.05)[..., None], 0.55, 1.0) * cloth(a * 0.17, v * long_)
    rgb = np.where(button[..., None], 0.12, rgb)
    sleeves = [
        tube([(0.09 * s, -0.09, 1.64), (0.125 * s, -0.1, 1.52), (0.13 * s, -0.11, 1.3), (0.12 * s, -0.125, 1.08)],
             np.array([0.03, 0.045, 0.042, 0.036]), 14, cloth)
        for s in (-1, 1)
    ]  # fmt: skip
    return joined([Piece((sheet(points, rgb[::-1]),)), *sleeves])


def bench(width_m: float, timber: Painter, cushion: Painter) -> Piece:
    """A bench with a cushion and boots below it."""
    w = width_m / 2
    parts = [
        rounded_box((-w, -0.38, 0.41), (w, -0.02, 0.45), 0.01, 0.016, timber),
        shadeless(rounded_box((-w + 0.03, -0.37, 0.45), (w - 0.03, -0.03, 0.51), 0.025, 0.016, cushion, bulge_m=0.01)),
        shadeless(box((-w + 0.02, -0.36, 0.13), (w - 0.02, -0.04, 0.15), 0.03, timber)),
    ]
    parts += [box((x - 0.02, -0.36, 0.0), (x + 0.02, -0.04, 0.41), 0.022, timber) for x in (-w + 0.04, w - 0.04)]
    tones = ("#6b3f26", "#2f3d52", "#a8412f", "#45502f", "#3a3430", "#c9a35e")
    for k in range(int((width_m - 0.25) / 0.26)):
        x = -w + 0.14 + 0.26 * k
        skin = pt.plain(tones[k % 6], 1520 + k, grain=0.2, fleck=0.1)
        parts += [shadeless(_shoe(x + dx, skin)) for dx in (0.0, 0.105)]
    return joined(parts)


def _shoe(x_m: float, skin: Painter) -> Piece:
    return rounded_box((x_m, -0.34, 0.151), (x_m + 0.09, -0.08, 0.24), 0.04, 0.02, skin, arc=3)


def table_lamp(base: Painter, shade: Painter) -> Piece:
    """A lamp to stand on something; its bulb is 0.38 m above the origin."""
    parts = [
        lathe((0, 0, 0), [(0.07, 0), (0.09, 0.05), (0.085, 0.12), (0.03, 0.2), (0.02, 0.24)], 28, base, cell_m=0.009),
        lathe((0, 0, 0.25), [(0.15, 0.0), (0.1, 0.21)], 48, shade, cell_m=0.011, glow=0.85),
        tube([(0, 0, 0.23), (0, 0, 0.35)], 0.008, 6, BRASS),
        disc((0, 0, 0.459), 0.099, 0.02, shade, glow=0.85),
    ]
    return shadeless(joined(parts))


def mirror_table(timber: Painter) -> Piece:
    """A narrow hall table with a bowl's shelf, 0.9 m wide, its top at 0.8 m."""
    parts = [
        rounded_box((-0.45, -0.3, 0.77), (0.45, 0.0, 0.8), 0.008, 0.013, timber),
        box((-0.41, -0.27, 0.66), (0.41, -0.02, 0.77), 0.018, timber, skip="Z"),
        shadeless(box((-0.43, -0.28, 0.2), (0.43, -0.02, 0.22), 0.02, timber)),
    ]
    parts += [
        box((x - 0.018, y - 0.018, 0.0), (x + 0.018, y + 0.018, 0.77), 0.02, timber, skip="zZ")
        for x in (-0.42, 0.42)
        for y in (-0.27, -0.03)
    ]
    return joined(parts)


def basket(code: str, seed: int) -> Piece:
    """A round wicker basket with rolled blankets, about its origin."""
    wicker = pt.weave(code, "#6b4a2b", seed, thread_m=0.022)
    outline = [(0.17, 0.0), (0.22, 0.2), (0.21, 0.36), (0.195, 0.37), (0.19, 0.25)]
    parts = [lathe((0, 0, 0), outline, 36, wicker, cell_m=0.012), disc((0, 0, 0.25), 0.2, 0.02, wicker)]
    for k, tone in enumerate(("#c9714e", "#e9dfc9", "#4f7f88")):
        x, y = 0.1 * np.cos(2.1 * k), 0.1 * np.sin(2.1 * k)
        roll = pt.stripes([tone, "#f3ead6", tone], [0.05, 0.02, 0.03], seed + k)
        parts.append(rod((x, y, 0.2), (1.3 * x, 1.3 * y, 0.5 + 0.03 * k), 0.07, 0.015, roll, sides=16))
        parts.append(placed(disc((0, 0, 0), 0.07, 0.012, roll), (1.3 * x, 1.3 * y, 0.5 + 0.03 * k)))
    return shadeless(joined(parts)) + Piece((), (((-0.18, -0.18, 0.0), (0.18, 0.18, 0.36)),))


def chest(size_m: Point, timber: Painter, seed: int) -> Piece:
    """A trunk with iron bands; size: width, height, depth."""
    w, h, d = size_m[0] / 2, size_m[1], size_m[2]
    parts = [box((-w, -d, 0.0), (w, 0.0, h), 0.016, timber, skip="z")]
    iron = pt.plain("#3b3a3c", seed, grain=0.25)
    for x in (-0.7 * w, 0.0, 0.7 * w):
        parts.append(shadeless(box((x - 0.025, -d - 0.006, 0.0), (x + 0.025, -d, h + 0.006), 0.016, iron, skip="Y")))
        parts.append(shadeless(box((x - 0.025, -d, h), (x + 0.025, 0.0, h + 0.006), 0.016, iron, skip="z")))
    parts.append(shadeless(box((-0.05, -d - 0.02, h - 0.14), (0.05, -d - 0.006, h - 0.04), 0.014, BRASS)))
    return joined(parts)


def easel(image: Painter) -> Piece:
    """A painter's easel with a canvas of 0.7 x 0.9 m, about its origin, its front towards -y."""
    beech = pt.wood("#d2b07c", "#a87f4c", 1540)
    parts = [
        rod((-0.35, -0.25, 0.0), (-0.06, 0.08, 1.7), 0.018, 0.05, beech),
        rod((0.35, -0.25, 0.0), (0.06, 0.08, 1.7), 0.018, 0.05, beech),
        rod((0.0, 0.45, 0.0), (0.0, 0.09, 1.66), 0.018, 0.05, beech),
        box((-0.4, -0.21, 0.66), (0.4, -0.11, 0.69), 0.02, beech),
    ]

    canvas = rect((-0.35, -0.032, 0.0), (0.7, 0, 0), (0, 0, 0.9), 0.0095, image)
    canvas += box((-0.35, -0.03, 0.0), (0.35, 0.0, 0.9), 0.03, pt.plain("#e6dcc6", 1541), skip="y")
    parts.append(placed(tilted(canvas, 0, -11.0), (0, -0.12, 0.692)))
    return joined(parts)


def stool(seat: Painter, height_m: float = 0.66) -> Piece:
    """A round stool on four legs, about its origin."""
    h = height_m
    parts = [
        lathe((0, 0, h - 0.05), [(0.15, 0.0), (0.17, 0.015), (0.17, 0.045), (0.16, 0.05)], 32, seat, cell_m=0.012),
        disc((0, 0, h), 0.161, 0.012, seat),
    ]
    parts += [
        rod((0.2 * x, 0.2 * y, 0.0), (0.1 * x, 0.1 * y, h - 0.05), 0.013, 0.04, STEEL)
        for x, y in ((1, 0.0), (-1, 0.0), (0.0, 1), (0.0, -1))
    ]
    ring = [(0.165 * float(np.cos(a)), 0.165 * float(np.sin(a)), 0.22) for a in np.arange(17) * (2 * np.pi / 16)]
    parts.append(tube(ring, 0.007, 6, STEEL))
    return shadeless(joined(parts)) + Piece((), (((-0.12, -0.12, 0.1), (0.12, 0.12, h)),))
