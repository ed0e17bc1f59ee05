# SPDX-License-Identifier: GPL-3.0-or-later
"""What is seen through a drop of water on a pane: a spherical cap that bends the light, on arrays and as nodes.

A ray that meets the pane at a right angle goes on straight to the drop's surface, whose normal is tilted there by
alpha: sin(alpha) = rho sin(contact angle), with rho the distance from the drop's middle as a share of its radius. By
Snell's law it leaves at beta, sin(beta) = n sin(alpha), bent towards the drop's axis by beta - alpha. What passes
follows Fresnel's equations for unpolarised light; beyond the critical angle nothing does. Halimeh and Roser, "Raindrop
detection on car windshields using geometric-photometric environment construction and intensity-based correlation",
2009, and von Bernuth, Volk and Bringmann, "Rendering physically correct raindrops on windshields for robustness
verification of camera-based object recognition", 2018, trace rays through the same cap.
"""

from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.graph import Graph, Socket

T = TypeVar("T")

Float32: TypeAlias = NDArray[np.float32]

WATER = 1.333  # refractive index
LEAST = 1e-6  # of a cosine's square: keeps roots and quotients finite at the critical angle


@dataclass(frozen=True)
class Bent(Generic[T]):
    """Of each ray: tangent of the angle by which it is bent towards the drop's axis, and the share of its light."""

    tangent: T
    passes: T


def bent(rho: Float32, contact_sine: float) -> Bent[Float32]:
    """Return what a cap does at rho, the share of its radius, in [0, 1]."""
    sine = rho * np.float32(contact_sine)
    inside, outside, beyond = _cosines(sine)
    out_sine = np.minimum(sine * np.float32(WATER), np.float32(1))
    turned = outside * inside + out_sine * sine
    tangent = (out_sine * inside - outside * sine) / turned
    across = (WATER * inside - outside) / (WATER * inside + outside)
    along = (WATER * outside - inside) / (WATER * outside + inside)
    passes = 1 - (across * across + along * along) / 2
    return Bent(tangent.astype(np.float32), (passes * beyond).astype(np.float32))


def _cosines(sine: Float32) -> tuple[Float32, Float32, Float32]:
    """Return the cosines of alpha and beta, and 1 where light leaves, 0 beyond the critical angle."""
    squared = sine * sine
    left = 1 - np.float32(WATER**2) * squared
    inside = np.sqrt(np.maximum(1 - squared, np.float32(LEAST)))
    return inside, np.sqrt(np.maximum(left, np.float32(LEAST))), (left > 0).astype(np.float32)


def bent_nodes(graph: Graph, rho_squared: Socket, contact_sine: Socket) -> Bent[Socket]:
    """Return the same as nodes, by the square of rho."""
    squared = rho_squared * (contact_sine * contact_sine)
    sine = graph.math("SQRT", squared)
    left = graph.math("MULTIPLY_ADD", squared, -(WATER**2), 1.0)
    inside = graph.math("SQRT", graph.math("MAXIMUM", 1.0 - squared, LEAST))
    outside = graph.math("SQRT", graph.math("MAXIMUM", left, LEAST))
    out_sine = graph.math("MINIMUM", sine * WATER, 1.0)
    turned = graph.math("MULTIPLY_ADD", outside, inside, out_sine * sine)
    tangent = (out_sine * inside - outside * sine) / turned
    across = graph.math("MULTIPLY_ADD", inside, WATER, outside * -1.0)
    across = across / graph.math("MULTIPLY_ADD", inside, WATER, outside)
    along = graph.math("MULTIPLY_ADD", outside, WATER, inside * -1.0)
    along = along / graph.math("MULTIPLY_ADD", outside, WATER, inside)
    both = graph.math("MULTIPLY_ADD", across, across, along * along)
    passes = graph.math("MULTIPLY_ADD", both, -0.5, 1.0) * (left > 0.0)
    return Bent(tangent, passes)
