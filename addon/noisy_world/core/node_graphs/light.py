# SPDX-License-Identifier: GPL-3.0-or-later
"""A group's image at its input and output: scene-linear or encoded, clipped or not.

The encoding is sRGB's. Above 1 its power goes on, so light comes back as it was; what a group gives is never negative.
"""

from dataclasses import dataclass

from .graph import Graph, Socket

BACK = "From encoded colour"
DARK = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Light:
    """A group's image and how it is given.

    encoded: whether it is encoded already. clip: whether what is brighter than white is cut off; what is darker than
    black always is.
    """

    image: Socket
    encoded: Socket
    clip: Socket | bool = True

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

    def to_average(self) -> Socket:
        """Return the image as it is where light is not clipped, else encoded: for what only averages."""
        if self.clip is False:
            return self.image
        if self.clip is True:
            return self.to_encoded()
        graph, coded = self.image.graph, self.to_encoded()
        with graph.section("To light or encoded colour"):
            return graph.choose(self.clip, coded, self.image)

    def from_average(self, result: Socket, share: Socket | None = None) -> Socket:
        """Return averages of what `to_average` gives as the image was given. share: as in `from_encoded`."""
        if self.clip is True:
            return self.from_encoded(result, share)
        graph = self.image.graph
        with graph.section(BACK):
            light = self._with_alpha(graph, self._mixed(graph.math("MAXIMUM", result, DARK), share))
        if self.clip is False:
            return light
        coded = self.from_encoded(result, share)
        with graph.section(BACK):
            return graph.choose(self.clip, coded, light)

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
            light = result if self.clip is True else self.clipped(result)
            return graph.choose(self.encoded, back, self._with_alpha(graph, self._mixed(light, share)))

    def clipped(self, value: Socket) -> Socket:
        """Return values clipped to [0, 1], if they are to be; else those below 0 alone."""
        graph = value.graph
        if self.clip is True:
            return graph.clamp(value)
        lit = graph.math("MAXIMUM", value, DARK)
        return lit if self.clip is False else graph.choose(self.clip, graph.clamp(value), lit)

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
