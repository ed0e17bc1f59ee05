# SPDX-License-Identifier: GPL-3.0-or-later
"""The arithmetic of Blender's Math, Vector Math, Mix and White Noise nodes on arrays, in float32 as there.

A value is a number, an image of numbers (H, W) with the bottom row first, or three of these: a vector or a colour;
where alpha has a meaning it is a fourth.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .jenkins_hash import hash_of_four, hash_of_three

Number: TypeAlias = NDArray[np.float32] | np.float32
Triple: TypeAlias = tuple[Number, Number, Number]
Held: TypeAlias = Number | Triple | tuple[Number, Number, Number, Number]

_ONE, _ZERO = np.float32(1), np.float32(0)


def triple(value: Held) -> Triple:
    """Return a number three times, and three numbers as they are; a fourth, alpha, is left out."""
    return value[:3] if isinstance(value, tuple) else (value, value, value)


def number(value: Held) -> Number:
    """Return one number. Raises TypeError for a vector or a colour, which no description narrows."""
    if isinstance(value, tuple):
        raise TypeError("a vector stands where one number is wanted")
    return value


def _exact(function: Callable[[Any], Any]) -> Callable[[Number], Number]:
    """Return a function that is rounded once from float64 for single numbers, as the C library's nearly always is."""

    def found(value: Number) -> Number:
        if isinstance(value, np.ndarray):
            return function(value)
        return np.float32(function(np.float64(value)))

    return found


def _divided(a: Number, b: Number) -> Number:
    if isinstance(b, np.ndarray):
        return np.where(b == 0, _ZERO, a / np.where(b == 0, _ONE, b)).astype(np.float32)
    return a / b if b != 0 else a * _ZERO


def _power(a: Number, b: Number) -> Number:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.power(a, b)
    return np.float32(np.power(np.float64(a), np.float64(b)))


def _logarithm(a: Number, b: Number) -> Number:
    log = _exact(np.log)
    above = log(np.maximum(a, np.float32(np.finfo(np.float32).tiny)))
    return np.where(a > 0, above / log(b), _ZERO) if isinstance(above, np.ndarray) else above / log(b)


def _wrapped(a: Number, high: Number, low: Number) -> Number:
    span = high - low
    return a - span * np.floor((a - low) / span)


def _there_and_back(a: Number, side: Number) -> Number:
    turns = (a - side) / (side * np.float32(2))
    return np.abs((turns - np.floor(turns)) * side * np.float32(2) - side)


def _told(condition: Any) -> Number:
    return condition.astype(np.float32) if isinstance(condition, np.ndarray) else np.float32(condition)


OPERATIONS: Mapping[str, Callable[..., Number]] = {
    "ADD": lambda a, b: a + b,
    "SUBTRACT": lambda a, b: a - b,
    "MULTIPLY": lambda a, b: a * b,
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "DIVIDE": _divided,
    "POWER": _power,
    "LOGARITHM": _logarithm,
    "EXPONENT": _exact(np.exp),
    "SQRT": lambda a: np.sqrt(np.maximum(a, _ZERO)),
    "ABSOLUTE": np.abs,
    # Of NaN and a number, the number: Blender takes the first, and descriptions put the number first.
    "MINIMUM": np.fmin,
    "MAXIMUM": np.fmax,
    "LESS_THAN": lambda a, b: _told(a < b),
    "GREATER_THAN": lambda a, b: _told(a > b),
    "COMPARE": lambda a, b, near: _told(np.abs(a - b) <= np.maximum(near, np.float32(1e-5))),
    "SIGN": np.sign,
    "FLOOR": np.floor,
    "CEIL": np.ceil,
    "ROUND": lambda a: np.floor(a + np.float32(0.5)),
    "FRACT": lambda a: a - np.floor(a),
    "FRACTION": lambda a: a - np.floor(a),  # the same, of vectors
    "MODULO": np.fmod,
    "WRAP": _wrapped,
    "PINGPONG": _there_and_back,
    "SINE": _exact(np.sin),
    "COSINE": _exact(np.cos),
    "TANGENT": _exact(np.tan),
    "ARCSINE": _exact(np.arcsin),
    "ARCTAN2": np.arctan2,
}


def vector_math(operation: str, values: Sequence[Triple]) -> Held:
    """Calculate with vectors as Vector Math does."""
    if operation in ("DOT_PRODUCT", "LENGTH", "DISTANCE"):
        first, second = values[0], values[-1]
        if operation == "DISTANCE":
            first = second = (first[0] - second[0], first[1] - second[1], first[2] - second[2])
        total = first[0] * second[0] + first[1] * second[1] + first[2] * second[2]
        return total if operation == "DOT_PRODUCT" else np.sqrt(total)
    x, y, z = (OPERATIONS[operation](*parts) for parts in zip(*values, strict=True))
    return x, y, z


def mixed(first: Held, second: Held, share: Number) -> Held:
    """Return first x (1 - share) + second x share, the share clamped, as Mix does."""
    part = np.clip(share, _ZERO, _ONE)
    if not isinstance(first, tuple) and not isinstance(second, tuple):
        return first * (_ONE - part) + second * part
    x, y, z = (a * (_ONE - part) + b * part for a, b in zip(triple(first), triple(second), strict=True))
    return x, y, z


# --- random numbers ---


def white_noise(where: Triple, w: Number | None) -> Callable[[str], Held]:
    """Return White Noise's outputs by name, Value or Color: Jenkins' hash of three or four words (lookup3, 2006)."""
    parts = (*where,) if w is None else (*where, w)
    wide = np.broadcast_arrays(*(np.asarray(part, np.float32) for part in parts))
    words = [np.ascontiguousarray(part).view(np.uint32).reshape(part.shape) for part in wide]
    # Of three words the node's colour adds a fourth of its own, so here Value alone is known.
    orders = ((0, 1, 2),) if w is None else ((0, 1, 2, 3), (2, 0, 3, 1), (3, 2, 1, 0))
    hashed = hash_of_three if w is None else hash_of_four

    def uniform(order: tuple[int, ...]) -> Number:
        found = hashed(*(words[k] for k in order)).astype(np.float32) / np.float32(2.0**32)
        return found if found.ndim else np.float32(found)

    def of(name: str) -> Held:
        if name == "Value":
            return uniform(orders[0])
        x, y, z = (uniform(order) for order in orders)
        return x, y, z

    return of
