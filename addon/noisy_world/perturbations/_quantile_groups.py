# SPDX-License-Identifier: GPL-3.0-or-later
"""Node groups that turn uniform random numbers into normal or Poisson ones; the groups of noise use them."""

from collections.abc import Sequence
from functools import cache, reduce

from ..core.node_graphs.graph import Graph, GroupInput, Socket

# The normal quantile of u is (u - 1/2) RISE(s) / FALL(s) with s = 256 u (1 - u). The coefficients are fitted: minimax
# in probability over the 24 bits of a uniform number. The error is 4e-5 in probability at most; in the quantile it is
# 0.004 sigma up to 3.5 sigma, and 0.008 sigma up to the outermost number, 5.6 sigma.
RISE = (11.178267632, 409952.79183, 431089282.72, 16590423823.0, 31374931130.0, 3848232857.0, 23366387.121)
FALL = (1.0, 42045.923683, 51749151.633, 2443034354.4, 6111273993.7, 1141341577.0, 17034050.319)

# The Poisson quantile is the whole part of mean F(t) + G(t) + H(t) / mean with t = normal quantile / sqrt(mean), as in
# Temme's uniform expansion (Giles 2016, ACM TOMS 42-1). Its first terms, 1, t, t^2 / 6 and 1 / 3, are kept; the other
# coefficients are fitted to the exact distributions of means from FEW photons up. The error is 3e-4 in probability at
# most.
F = (1.0, 1.0, 1 / 6, -0.0150540613, 0.00470244695, -0.00102170197, 6.80581343e-05)
G = (1 / 3, -0.0251174809, 0.00214705062, -0.000638400676, 0.000452340337)
H = (-0.0187086449, 0.0146071656, -0.00383880426)
FEW = 0.5  # photons: below this mean the probabilities are summed instead
MOST_OF_FEW = 6  # photons: of mean FEW, one number in a million is larger
LOWEST_T = -1.4  # of t: at and below it the quantile is 0 whatever the mean


def normal_quantile(uniform: Socket) -> Socket:
    """Return the standard normal quantiles of `uniform`, in [0, 1], for each channel."""
    return uniform.graph.group(_normal_group(), {"Uniform": uniform}).out("Normal", "vector")


def poisson_quantile(mean: Socket, uniform: Socket) -> Socket:
    """Return the quantiles of `uniform`, in [0, 1], of Poisson numbers of this mean, 0 to 256, for each channel."""
    return uniform.graph.group(_poisson_group(), {"Mean": mean, "Uniform": uniform}).out("Count", "vector")


@cache
def _normal_group() -> Graph:
    graph = Graph("Normal Numbers", "Turns uniform random numbers into standard normal ones, each channel by itself")
    uniform = graph.input(GroupInput("Uniform", "vector", (0.5, 0.5, 0.5), "Uniform random numbers in [0, 1]"))
    with graph.section("Rational function"):
        position = uniform * graph.math("MULTIPLY_ADD", uniform, -256.0, 256.0)
        ratio = _polynomial(position, RISE) / _polynomial(position, FALL)
    with graph.section("Both sides"):
        graph.output("Normal", (uniform - 0.5) * ratio, "vector", "Numbers of mean 0 and standard deviation 1")
    return graph


@cache
def _poisson_group() -> Graph:
    graph = Graph("Poisson Numbers", "Turns uniform random numbers into Poisson ones, each channel by itself")
    mean = graph.input(GroupInput("Mean", "vector", (1.0, 1.0, 1.0), "Expected numbers, from 0 to 256"))
    uniform = graph.input(GroupInput("Uniform", "vector", (0.5, 0.5, 0.5), "Uniform random numbers in [0, 1]"))
    with graph.section("Many: expansion about the normal"):
        normal = normal_quantile(uniform)
        many = _many(graph.math("MAXIMUM", mean, FEW), normal)
    with graph.section("Few: one probability after the other"):
        few = _few(graph.math("MINIMUM", mean, FEW), uniform)
    with graph.section("Choose"):
        graph.output("Count", graph.mix(many, few, mean < FEW), "vector", "Whole numbers")
    return graph


def _many(mean: Socket, normal: Socket) -> Socket:
    graph = mean.graph
    narrow = graph.math("POWER", mean, -0.5)
    t = graph.math("MAXIMUM", normal * narrow, LOWEST_T)
    rest = graph.math("MULTIPLY_ADD", _polynomial(t, H), narrow * narrow, _polynomial(t, G))
    number = graph.math("MULTIPLY_ADD", _polynomial(t, F), mean, rest)
    return graph.math("MAXIMUM", graph.math("FLOOR", number), 0.0)


def _few(mean: Socket, uniform: Socket) -> Socket:
    """Return how many of the probabilities of 0, 1, 2, ..., summed in this order, stay below `uniform`."""
    graph = mean.graph
    probability = graph.math("POWER", (1 / 2.718281828,) * 3, mean)
    count: Socket | None = None
    left = uniform
    for number in range(1, MOST_OF_FEW + 1):
        left = left - probability
        fits = graph.math("SIGN", graph.math("MAXIMUM", left, 0.0))
        count = fits if count is None else count + fits
        probability = probability * (mean * (1 / number))
    assert count is not None
    return count


def _polynomial(x: Socket, coefficients: Sequence[float]) -> Socket:
    """Evaluate a polynomial by Horner's rule; coefficients: from the constant upwards."""
    *rest, last = coefficients
    highest = x.graph.math("MULTIPLY_ADD", x, last, rest.pop())
    return reduce(lambda value, term: x.graph.math("MULTIPLY_ADD", value, x, term), reversed(rest), highest)
