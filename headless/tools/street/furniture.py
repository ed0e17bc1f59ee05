# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands in the street: lamps, cars, benches, a cafe's table, bulbs on a wire."""

import math

from .solids import Point, Solid

LANTERN_GLOW, BULB_GLOW, CANDLE_GLOW, TAIL_GLOW = 60.0, 40.0, 20.0, 8.0  # scene-linear; chosen
LANTERN_M = 4.3  # above the ground


def add_lamp(solid: Solid, x_m: float, y_m: float) -> None:
    """Add an iron lamp with a glowing lantern."""
    solid.tube([(x_m, y_m, z) for z in (0.0, 0.5, 0.55, 0.9, 4.0)], [0.13, 0.12, 0.08, 0.055, 0.045], "iron", sides=10)
    solid.tube([(x_m, y_m, z) for z in (3.95, 4.05, 4.1)], [0.05, 0.17, 0.17], "iron", sides=6)
    solid.tube([(x_m, y_m, z) for z in (4.1, 4.5)], [0.13, 0.2], "lantern", sides=6, glow=LANTERN_GLOW)
    for k in range(6):
        angle = 2 * math.pi * k / 6
        low = (x_m + 0.14 * math.cos(angle), y_m + 0.14 * math.sin(angle), 4.1)
        high = (x_m + 0.21 * math.cos(angle), y_m + 0.21 * math.sin(angle), 4.5)
        solid.tube([low, high], [0.012, 0.012], "iron", sides=4)
    solid.tube([(x_m, y_m, z) for z in (4.5, 4.53, 4.72, 4.85)], [0.25, 0.24, 0.05, 0.02], "iron", sides=6)


def add_bulbs(solid: Solid, first: Point, last: Point, sag_m: float, count: int) -> list[Point]:
    """Hang bulbs on a wire between two points; return where they are."""
    steps = 24
    wire = [_hanging(first, last, sag_m, k / steps) for k in range(steps + 1)]
    solid.tube(wire, [0.012] * len(wire), "rubber", sides=4)
    places = [_hanging(first, last, sag_m, (k + 0.5) / count) for k in range(count)]
    for x, y, z in places:
        solid.tube([(x, y, z), (x, y, z - 0.08)], [0.02, 0.02], "rubber", sides=5)
        solid.ball((x, y, z - 0.12), 0.05, "bulb", sides=8, glow=BULB_GLOW)
    return places


def _hanging(first: Point, last: Point, sag_m: float, share: float) -> Point:
    x, y, z = ((1 - share) * a + share * b for a, b in zip(first, last, strict=True))
    return (x, y, z - 4 * sag_m * share * (1 - share))


# Stations of a car along its length, from the back: place, half width, lowest, belt and top.
CAR = (
    (0.00, 0.66, 0.42, 0.74, 0.80),
    (0.06, 0.78, 0.30, 0.84, 0.92),
    (0.35, 0.84, 0.24, 0.92, 1.02),
    (0.62, 0.86, 0.22, 0.93, 1.12),
    (1.05, 0.87, 0.22, 0.92, 1.44),
    (1.75, 0.87, 0.22, 0.91, 1.50),
    (2.35, 0.87, 0.22, 0.90, 1.45),
    (3.02, 0.86, 0.22, 0.89, 1.02),
    (3.30, 0.85, 0.23, 0.86, 0.96),
    (3.80, 0.82, 0.26, 0.78, 0.86),
    (4.02, 0.76, 0.32, 0.68, 0.74),
    (4.10, 0.64, 0.42, 0.60, 0.64),
)
CABIN = (3, 7)  # stations between which there is glass
WHEELS_M = (0.72, 3.28)


def add_car(body: Solid, parts: Solid, x_m: float, y_m: float, paint: str) -> None:
    """Add a car that stands with its back at y_m. body: what will be smoothed; parts: what is not."""
    rows: list[list[Point]] = []
    for along, half, low, belt, top in CAR:
        y = y_m + along
        roof = half * (0.80 if top > 1.2 else 0.9)
        half_row = [(0.0, low), (half * 0.86, low), (half, low + 0.18), (half, belt - 0.06), (half * 0.98, belt)]
        half_row += [(roof, top - 0.04), (roof * 0.6, top), (0.0, top + 0.01)]
        mirrored = [(-x, z) for x, z in half_row[1:-1][::-1]]
        rows.append([(x_m + x, y, z) for x, z in [*half_row, *mirrored]])
    first, across = len(body.points), len(rows[0])
    body.grid(rows, paint, closed=True)
    made = len(body.faces) - (len(rows) - 1) * across
    for k in range(*CABIN):
        for j in (4, across - 5):
            body.materials[made + k * across + j] = "car glass"
    for k in (CABIN[0], CABIN[1] - 1):  # the windows behind and in front
        for j in (5, 6, 7, across - 8 + 2):
            body.materials[made + k * across + j % across] = "car glass"
    for ends in (range(first, first + across), range(first + (len(rows) - 1) * across, first + len(rows) * across)):
        corners = tuple(ends)
        body.faces.append(corners if ends.start != first else corners[::-1])
        body.materials.append(paint)
        body.glows.append(0.0)
        body.smooth.append(True)
    _car_parts(parts, x_m, y_m)


def _car_parts(parts: Solid, x_m: float, y_m: float) -> None:
    for along in WHEELS_M:
        for side in (-1, 1):
            inner, outer = x_m + side * 0.62, x_m + side * 0.885
            y = y_m + along
            parts.tube([(inner, y, 0.32), (outer, y, 0.32)], [0.32, 0.32], "rubber", sides=20)
            parts.tube([(outer, y, 0.32), (outer + side * 0.015, y, 0.32)], [0.2, 0.16], "chrome", sides=12)
    for side in (-1, 1):
        x = x_m + side * 0.6
        parts.box((x - 0.13, y_m - 0.01, 0.66), (x + 0.13, y_m + 0.1, 0.8), "red light", TAIL_GLOW)
        parts.box((x - 0.14, y_m + 3.98, 0.5), (x + 0.14, y_m + 4.07, 0.62), "porcelain")
    parts.box((x_m - 0.26, y_m - 0.015, 0.46), (x_m + 0.26, y_m + 0.05, 0.57), "porcelain")
    parts.box((x_m - 0.75, y_m - 0.04, 0.34), (x_m + 0.75, y_m + 0.1, 0.42), "rubber")


def add_bench(solid: Solid, x_m: float, y_m: float) -> None:
    """Add a bench of slats along the street, whose back is at the side of x_m's sign."""
    side = 1.0 if x_m > 0 else -1.0
    for k in range(4):
        near = x_m - side * (0.05 + 0.11 * k)
        solid.box((min(near, near - side * 0.09), y_m, 0.59), (max(near, near - side * 0.09), y_m + 1.7, 0.62), "wood")
    for k in range(3):
        solid.box((x_m - 0.02, y_m, 0.72 + 0.12 * k), (x_m + 0.02, y_m + 1.7, 0.81 + 0.12 * k), "wood")
    for y in (y_m + 0.15, y_m + 1.5):
        for x in (x_m, x_m - side * 0.42):
            solid.box((x - 0.025, y - 0.03, 0.15), (x + 0.025, y + 0.03, 1.05 if x == x_m else 0.59), "iron")


def add_table(solid: Solid, x_m: float, y_m: float) -> None:
    """Add a round table with two cups and a candle in a glass, and two chairs."""
    ground = 0.15
    top = ground + 0.74
    solid.tube([(x_m, y_m, z) for z in (ground, ground + 0.03, ground + 0.06)], [0.24, 0.22, 0.03], "iron", sides=20)
    solid.tube([(x_m, y_m, z) for z in (ground + 0.05, top)], [0.03, 0.03], "iron", sides=10)
    solid.tube([(x_m, y_m, z) for z in (top - 0.025, top)], [0.36, 0.36], "wood", sides=32)
    for dx, dy in ((0.17, -0.08), (-0.16, 0.1)):
        x, y = x_m + dx, y_m + dy
        solid.tube([(x, y, top + z) for z in (0.0, 0.008, 0.014)], [0.05, 0.075, 0.08], "porcelain", sides=20)
        solid.tube([(x, y, top + z) for z in (0.014, 0.03, 0.085)], [0.026, 0.038, 0.046], "porcelain", sides=20)
        handle = [(x + 0.045 + 0.025 * math.sin(a), y, top + 0.055 + 0.022 * math.cos(a)) for a in (0.1, 1.0, 2.1, 3.0)]
        solid.tube(handle, [0.006] * 4, "porcelain", sides=6)
    solid.tube([(x_m, y_m, top + z) for z in (0.0, 0.06)], [0.03, 0.034], "car glass", sides=16)
    solid.tube([(x_m, y_m, top + z) for z in (0.06, 0.075, 0.1)], [0.006, 0.01, 0.002], "bulb", glow=CANDLE_GLOW)
    for side in (-1, 1):
        _chair(solid, x_m + 0.1 * side, y_m + 0.78 * side, ground, side)


def _chair(solid: Solid, x_m: float, y_m: float, ground: float, side: int) -> None:
    seat = ground + 0.45
    solid.tube([(x_m, y_m, seat - 0.02), (x_m, y_m, seat + 0.01)], [0.21, 0.21], "wood", sides=20)
    for dx, dy in ((-0.16, -0.14), (0.16, -0.14), (-0.16, 0.14), (0.16, 0.14)):
        foot = (x_m + dx * 1.15, y_m + dy * 1.15, ground)
        solid.tube([foot, (x_m + dx, y_m + dy, seat)], [0.013, 0.013], "iron", sides=6)
    back = [(x_m + 0.2 * math.cos(a), y_m + side * (0.14 + 0.07 * math.sin(a)), 0.0) for a in _half_turn(9)]
    turns = _half_turn(9)
    for k, height in enumerate((0.22, 0.42)):
        arched = zip(back, turns, strict=True)
        hoop = [(x, y + side * 0.03 * k, seat + height + 0.04 * math.sin(a)) for (x, y, _), a in arched]
        solid.tube(hoop, [0.013] * len(hoop), "iron", sides=6)
    for x, y, _ in (back[0], back[2], back[4], back[6], back[8]):
        solid.tube([(x, y, seat), (x, y + side * 0.03, seat + 0.43)], [0.009, 0.009], "iron", sides=5)


def _half_turn(count: int) -> list[float]:
    return [math.pi * k / (count - 1) for k in range(count)]


def add_board(solid: Solid, x_m: float, y_m: float) -> None:
    """Add a menu board that leans."""
    for side in (-1, 1):
        low = [(x_m - 0.3, y_m + 0.28 * side, 0.15), (x_m + 0.3, y_m + 0.28 * side, 0.15)]
        high = [(x_m + 0.3, y_m + 0.02 * side, 1.15), (x_m - 0.3, y_m + 0.02 * side, 1.15)]
        solid.face([*low, *high], "chalkboard")
        for a, b in ((low[0], high[1]), (low[1], high[0]), (low[0], low[1]), (high[0], high[1])):
            solid.tube([a, b], [0.022, 0.022], "wood", sides=4)
    for k, width_m in enumerate((0.34, 0.22, 0.28, 0.2)):
        share = 0.78 - 0.16 * k
        y, z = y_m - 0.28 + 0.26 * share - 0.004, 0.15 + share
        solid.box((x_m - width_m / 2, y - 0.004, z), (x_m + width_m / 2, y, z + 0.025), "porcelain")


def add_bollard(solid: Solid, x_m: float, y_m: float) -> None:
    """Add a bollard at the kerb."""
    solid.tube([(x_m, y_m, z) for z in (0.1, 0.9, 0.93, 1.0)], [0.06, 0.05, 0.075, 0.03], "iron", sides=12)


def add_pot(solid: Solid, x_m: float, y_m: float) -> None:
    """Add a pot with a clipped bush."""
    solid.tube([(x_m, y_m, z) for z in (0.15, 0.62)], [0.2, 0.27], "goods", sides=16)
    solid.ball((x_m, y_m, 0.95), 0.36, "leaves", sides=14)
