# SPDX-License-Identifier: GPL-3.0-or-later
"""The sheet that drops are painted on, as nodes: `Sheet` of `_drop_sheet`, with one drop after another added."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from ..core.node_graphs.graph import Graph, GroupInput, Socket, Value
from ..core.node_graphs.groups import Canvas
from ._drop_laws import CLEAR, UNMARKED

ABSENT = 1e3  # added to the square of the distance from a drop that is not there


@dataclass(frozen=True)
class SheetNodes:
    """As `Sheet`: each pixel's place on the even glass; the drop that it lies in; what is taken."""

    graph: Graph
    x_px: Socket
    y_px: Socket
    rho_squared: Value = 1.0
    aside: Value = 0.0
    down: Value = 0.0
    taken: Value = 0.0

    @classmethod
    def of(cls, graph: Graph, x_px: Socket, y_px: Socket) -> "SheetNodes":
        """Return a sheet without drops."""
        return cls(graph, x_px, y_px)

    def with_drop(self, aside: Socket, down: Socket, absent: Socket) -> "SheetNodes":
        """Return the sheet with a drop at each pixel, where none is yet: the place from its middle, in radii."""
        graph = self.graph
        squared = graph.math("MULTIPLY_ADD", absent, ABSENT, graph.math("MULTIPLY_ADD", down, down, self.taken))
        squared = graph.math("MULTIPLY_ADD", aside, aside, squared)
        inside = squared < 1.0
        shown = graph.math("MULTIPLY_ADD", self.taken, -UNMARKED, squared)
        return replace(
            self,
            rho_squared=graph.math("MULTIPLY_ADD", shown - 1.0, inside, self.rho_squared),
            aside=graph.math("MULTIPLY_ADD", aside, inside, self.aside),
            down=graph.math("MULTIPLY_ADD", down, inside, self.down),
            taken=graph.math("MAXIMUM", CLEAR - squared, self.taken),
        )

    def after(self, canvas: Canvas, part: Graph, given: Mapping[str, Value], name: str) -> "SheetNodes":
        """Return the sheet after a group of `sheet_graph`. given: the group's own inputs by name. name: of the node."""
        assert canvas.seed is not None
        assert canvas.key is not None
        inputs = dict(zip(_SHEET, (getattr(self, item) for item in _FIELDS), strict=True))
        made = self.graph.group(part, {"Seed": canvas.seed, "Key": canvas.key, **inputs, **given}, name=name)
        found = {item: made.out(label, "float") for item, label in zip(_FIELDS[2:], tuple(_SHEET)[2:], strict=True)}
        return replace(self, **found)


_FIELDS = ("x_px", "y_px", "rho_squared", "aside", "down", "taken")
_SHEET = {
    "X": "Each pixel's place on the glass, from the left",
    "Y": "Each pixel's place on the glass, from the top",
    "Rho Squared": "Square of the distance from the middle of its drop, in radii; 1 where there is none",
    "Aside": "Direction from there, to the right",
    "Down": "Direction from there, down",
    "Taken": "Where this is 1 there are no further drops",
}


def sheet_graph(
    name: str,
    description: str,
    own: Mapping[str, str],
    draw: Callable[[Canvas, Mapping[str, Socket], SheetNodes], SheetNodes],
    canvas: Canvas,
) -> Graph:
    """Describe a group that adds drops to a sheet. own: meanings of its own inputs by name. canvas: of the whole."""
    graph = Graph(name, description, alone=True)
    seed = graph.input(GroupInput("Seed", "int", 0, "The pattern's"))
    key = graph.input(GroupInput("Key", "float", 0.0, "The frame's, where each has a pattern of its own"))
    sheet = [graph.input(GroupInput(label, "float", 0.0, text)) for label, text in _SHEET.items()]
    taken = {label: graph.input(GroupInput(label, "float", 1.0, text)) for label, text in own.items()}
    before = SheetNodes(graph, *sheet)
    after = draw(replace(canvas, graph=graph, seed=seed, key=key), taken, before)
    for item, (label, text) in list(zip(_FIELDS, _SHEET.items(), strict=True))[2:]:
        graph.output(label, getattr(after, item), "float", text)
    return graph
