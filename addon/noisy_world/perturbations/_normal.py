# SPDX-License-Identifier: GPL-3.0-or-later
"""Normal numbers out of uniform ones, by nodes."""

from collections.abc import Sequence
from functools import reduce

from ..core.graph import Socket

# Minimax in probability over the 24 bits of a uniform number: with w = (u (1 - u))^(1/4), the quantile is (u - 1/2)
# times RISE(w) / FALL(w) to 3e-5 of probability, to 0.003 up to 3.5 sigma, to 0.006 beyond; at u = 0 and 1 it is 6.4.
RISE = (12.747028463, 327.304928436, -263.945984520, 79.965965824)
FALL = (1.0, 42.748553891, 49.673244573)


def normal_quantile(uniform: Socket) -> Socket:
    """Return the standard normal number below which one falls as often as below these in [0, 1], channel by channel."""
    graph = uniform.graph
    w = graph.math("POWER", uniform * (1.0 - uniform), 0.25)
    return (uniform - 0.5) * (_polynomial(w, RISE) / _polynomial(w, FALL))


def _polynomial(x: Socket, coefficients: Sequence[float]) -> Socket:
    """Return a polynomial by Horner's rule; coefficients: the constant first."""
    *rest, last = coefficients
    highest = x.graph.math("MULTIPLY_ADD", x, last, rest.pop())
    return reduce(lambda value, term: x.graph.math("MULTIPLY_ADD", value, x, term), reversed(rest), highest)
