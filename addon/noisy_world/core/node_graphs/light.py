# SPDX-License-Identifier: GPL-3.0-or-later
"""A group's image at its input and output: scene-linear or encoded, clipped or not.

The encoding is sRGB's. Above 1 its power goes on, below 0 its straight line, so light comes back as it was.
"""

from dataclasses import dataclass

from .graph import Graph, Socket

BACK = "From encoded colour"


@dataclass(frozen=True)
class Light:
    """A group's image and how it is given.

    encoded: whether it is encoded already. clip: whether what is brighter than white is cut off; None: always.
    """

    image: Socket
    encoded: Socket
    clip: Socket | None = None

    def to_encoded(self) -> Socket:
        """Return the image's encoded colour; an image that is encoded already is not converted."""
        graph = self.image.graph
        with graph.section("To encoded colour"):
            colour = self.clipped(convert(graph, self.image, "Linear Rec.709", "sRGB"))
            return graph.choose(self.encoded, self.image, colour)

    def to_linear(self) -> Socket:
        """Return the image's linear light; an image that is linear already is not converted."""
        graph = self.image.graph
        with graph.section("To linear light"):
            return graph.choose(self.encoded, convert(graph, self.image, "sRGB", "Linear Rec.709"), self.image)

    def from_encoded(self, result: Socket, share: Socket | None = None) -> Socket:
        """Return encoded colour as the image was given: linear light with its alpha, or encoded.

        share: of the result, the rest being the image; None: all of it.
        """
        graph = self.image.graph
        with graph.section(BACK):
            clipped = self.clipped(result)
            back = self._mixed(convert(graph, clipped, "sRGB", "Linear Rec.709"), share)
            return graph.choose(self.encoded, self._mixed(clipped, share), self._with_alpha(graph, back))

    def from_linear(self, result: Socket, share: Socket | None = None) -> Socket:
        """Return linear light as the image was given: with its alpha, or encoded. share: as in `from_encoded`."""
        graph = self.image.graph
        with graph.section(BACK):
            back = self._mixed(self.clipped(convert(graph, result, "Linear Rec.709", "sRGB")), share)
            light = result if self.clip is None else self.clipped(result)
            return graph.choose(self.encoded, back, self._with_alpha(graph, self._mixed(light, share)))

    def clipped(self, value: Socket) -> Socket:
        """Return values clipped to [0, 1], if they are to be."""
        graph = value.graph
        clamped = graph.clamp(value)
        return clamped if self.clip is None else graph.choose(self.clip, clamped, value)

    def _mixed(self, result: Socket, share: Socket | None) -> Socket:
        return result if share is None else result.graph.blend(self.image, result, share)

    def _with_alpha(self, graph: Graph, result: Socket) -> Socket:
        alpha = graph.node("CompositorNodeSeparateColor", {"Image": self.image}, {"mode": "RGB"}).out("Alpha", "float")
        inputs = {"Image": result, "Alpha": alpha, "Type": "Replace Alpha"}
        return graph.node("CompositorNodeSetAlpha", inputs).out("Image", "color")


def convert(graph: Graph, image: Socket, source: str, target: str) -> Socket:
    """Convert between colour spaces, named as Blender does."""
    properties = {"from_color_space": source, "to_color_space": target}
    return graph.node("CompositorNodeConvertColorSpace", {"Image": image}, properties).out("Image", "color")
