# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixelation as PIL's documentation has it: BOX down, and nearest up."""

from fractions import Fraction

import numpy as np

HALF = Fraction(1, 2)


def pixelated(image, factor):
    """An image (H, W, 3) with blocks by this factor, float64."""
    found = image.astype(np.float64)
    for axis in (0, 1):
        line = np.moveaxis(found, axis, 0)
        small = box_down(line, max(int(len(line) * factor), 1))
        found = np.moveaxis(nearest_up(small, len(line)), 0, axis)
    return found


def box_down(line, blocks):
    """PIL's BOX along one axis, as its documentation has it: equal weights within half a block of the centre."""
    scale = Fraction(len(line), blocks)  # which side a centre on a border falls on is no matter of rounding
    result = []
    for block in range(blocks):
        centre = (block + HALF) * scale
        inside = [x for x in range(len(line)) if -HALF < (x + HALF - centre) / scale <= HALF]
        result.append(np.mean([line[x] for x in inside], axis=0))
    return np.array(result)


def nearest_up(line, size):
    places, centre, step = [], len(line) / size * 0.5, len(line) / size
    for x in range(size):
        exact = Fraction((2 * x + 1) * len(line), 2 * size)
        on_a_border = exact.denominator == 1 and Fraction(len(line), size) != Fraction(2, 5)
        places.append(after_the_border(exact) if on_a_border else int(centre))
        centre += step
    return line[places]


def after_the_border(border):
    """Where float64's rounding has no order to follow, the order that it has at two blocks for five pixels."""
    turns = sum(border > turn for turn in (2, 4, 20, 74))
    return int(border) - turns % 2
