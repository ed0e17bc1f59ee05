# SPDX-License-Identifier: GPL-3.0-or-later
"""How large a particle is on the image, as nodes."""

from collections.abc import Mapping

from ..core.node_graphs.graph import Graph, Socket
from ._streaks import LEAST_WIDTH_PX


def area_and_width(graph: Graph, taken: Mapping[str, Socket], large: Socket, nearness: Socket) -> tuple[Socket, Socket]:
    """Return the square of a particle's size on the image, and its streak's width, blurred by the lens, in pixels."""
    size_px = large * (taken["Mean"] * taken["Focal length"] * 1e-3) * nearness
    aperture_px = taken["Aperture"] * taken["Focal length"]
    blur_px = (nearness - graph.math("DIVIDE", 1.0, taken["Focus"])) * aperture_px
    area = graph.math("MULTIPLY", size_px, size_px)
    wide = graph.math("SQRT", graph.math("MULTIPLY_ADD", blur_px, blur_px, area))
    return area, graph.math("MAXIMUM", wide, LEAST_WIDTH_PX)
