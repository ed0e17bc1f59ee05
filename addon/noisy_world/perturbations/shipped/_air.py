# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of the air before a scene and of lamps on what floats in it, on arrays and as nodes.

The light of the air before a scene, estimated from the scene, on arrays.

Where there is sky the air has the sky's own colour, as what is far fades into the horizon; elsewhere that of the mean
of the surfaces. Both are means that a lamp hardly moves: each pixel weighs 1 / (1 + (l / (4 m))^4), with l its
luminance and m a first mean, that of fourth roots to the fourth power. The weights are smooth, so the light is even
from frame to frame. Of lit frames, which arrays give to nodes, the mean of 16 pixels is one.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, Socket, Value
from ...core.schema import Choice, key
from ...core.srgb import LUMINANCE, decoded
from ..groups import Canvas, convert
from ._arrays import SKY_M
from ._sizes import extra_of, halved, with_extra

Float32: TypeAlias = NDArray[np.float32]
Float64: TypeAlias = NDArray[np.float64]

GIVEN_AIR = {f"air_{name}": ("air", "colour") for name in ("red", "green", "blue")} | {"airlight": ("air", "grey")}
"""What giving a grey or a colour implies."""
AIR_TOOLTIPS = {
    "air": "Whether its light comes from the scene, is a gray, or is the color below",
    "air_red": "Higher: redder light, where Air is Color",
    "air_green": "Higher: greener light, where Air is Color",
    "air_blue": "Higher: bluer light, where Air is Color",
    "lamps": "Higher: on lit scenes, lamps light more of the air around them; 0 is none",
    "air_around": "On: a window does not fill a dark room's air with the light of the sky",
    "leave_sky": "On: the sky keeps its colors",
}

KNEE = 4.0  # times the first mean; what is as bright weighs a half; chosen
WHOLE_SKY = 0.02  # share of the frame; less sky counts in part, so that none appears at once; chosen
NIGHT = 1e-4  # luminance of a sky that counts half; a black one is none; chosen
LEAST = 1e-9  # below it nothing is divided by


@dataclass(frozen=True)
class AirLight:
    """What the scene says of the air's light. surfaces, sky: (3,) linear. share: of the sky's in it, 0 to 1."""

    surfaces: Float64
    sky: Float64
    share: float

    def over(self, surfaces: Float64) -> Float64:
        """Return (3,): the sky's colour and another one than the surfaces', mixed by the share."""
        return surfaces + (self.sky - surfaces) * self.share


def sky_in(depth_m: Float32) -> NDArray[np.bool_]:
    """Return where a depth image (H, W), metres, shows sky: void, or what is farther than any surface."""
    return ~((depth_m > 0) & (depth_m <= SKY_M))


def air_light(linear: Float32, depth_m: Float32, *, around: bool = False) -> AirLight:
    """Return the light of the air before (H, W, 3) of linear light, with its depth (H, W), metres.

    around: whether sky counts by its share of the frame alone.
    """
    sky = sky_in(depth_m)
    own = robust_mean(linear[sky])
    bright = float(own @ LUMINANCE)
    seen = float(sky.mean())
    share = (seen if around else min(seen / WHOLE_SKY, 1.0)) * bright / (bright + NIGHT)
    return AirLight(robust_mean(linear[~sky]), own, share)


def robust_mean(linear: Float32) -> Float64:
    """Return (3,): the mean of light (N, 3) that lamps hardly move; 0 of no pixels."""
    if not len(linear):
        return np.zeros(3)
    luminance = np.maximum(linear @ np.array(LUMINANCE, np.float32), np.float32(0))
    first = float(np.sqrt(np.sqrt(luminance)).mean(dtype=np.float64)) ** 4
    ratio = luminance * np.float32(1 / max(KNEE * first, LEAST))
    weight = 1 / (1 + np.square(np.square(ratio)))
    return (weight[:, None] * linear).mean(axis=0, dtype=np.float64) / max(weight.mean(dtype=np.float64), LEAST)


def colour_of(red: float, green: float, blue: float) -> Float64:
    """Return (3,): linear light of a colour that is sRGB-encoded."""
    return decoded(np.array([red, green, blue], np.float32)).astype(np.float64)


# The light of lamps on what floats in the air before them, estimated from the picture.
#
# A lamp of radiance L that covers the solid angle w, seen z away at the angle a from a ray, lights what is at the
# distance d from it by L w z^2 / d^2. Over all places on the ray this is L w (2 C) pi / a divided by pi 2 z / z, so
# the particles' mean light is C L w / a: with C = 1/8 for those that scatter to all sides alike (the integral in
# closed form: Sun, Ramamoorthi, Narasimhan and Nayar, A practical analytic single scattering model for real time
# rendering, 2005). In general C is half the integral of the phase function over the angle of scattering, as each
# angle has an equal share of 1 / a. A drop of water that is looked through (Snell, Fresnel, once through; Garg and
# Nayar, Vision and rain, 2007) throws light forward, and has C = 0.256.
#
# Even air with an extinction of b a metre takes 1 - exp(-b x) of the light up to a depth x, and so has that share of
# it, but no more than 1 - exp(-2 b z): beyond twice the lamp's distance hardly any of its light is left.
#
# Through fog of the optical depth t the share 1 / (1 + 0.75 (1 - g) t) of a lamp's light arrives at all, most of it
# scattered many times (Eddington's approximation for a layer that absorbs nothing); g = 0.85 of water's droplets.
#
# C / a is a sum of Gaussians, each twice as wide as the one before: of width s and volume ln(2) s C sqrt(8 pi). The
# widest has twice that, for all that would be wider: from 0.02 to 0.4 radians the sum is right within 6 %.


FLAKE, DROP = 0.125, 0.256
DIFFUSE = 0.75 * (1 - 0.85)
WIDTHS_RAD = (0.8, 0.4, 0.2, 0.1, 0.05, 0.025, 0.0125)
WIDE = 4  # of them are wide enough for larger blocks; chosen
LARGE_RAD = 0.1 / 3  # of these blocks: a third of the least width; chosen
VOLUMES = tuple(math.log(2) * math.sqrt(8 * math.pi) * width * (2 if width == 0.8 else 1) for width in WIDTHS_RAD)


def air_key(name: str, meaning: str, choice: Choice) -> Any:
    """Return the parameter that says where the air's light comes from. name, meaning, choice: of what it is unlit."""
    scene = "The sky's colour where there is sky, else a mean that lamps do not move"
    return key(
        f"where its light comes from: auto is scene on lit scenes, whose light is not clipped, else {name}; scene: "
        f"{scene[0].lower()}{scene[1:]}; {name}: {meaning}; colour: as given",
        default="auto",
        choices={
            "auto": Choice("Automatic", f"Scene on lit scenes, whose light is not clipped, else {choice.label}"),
            "scene": Choice("Scene", scene),
            name: choice,
            "colour": Choice("Colour", "As given below"),
        },
    )


def air_colour_key(name: str, default: float) -> float:
    """Return the parameter of one channel of the air's light."""
    return key(f"{name} of its light, sRGB-encoded", default=default, minimum=0, maximum=20)


def around_key() -> bool:
    """Return the parameter that says whether the air's light is the mean of all that is seen, as in a room."""
    return key(
        "of light from the scene: the sky counts by its share of the frame alone, as in a room with windows",
        default=False,
        later=True,
    )


FAR_M, FAR_SHARE = 15.0, 0.1  # chosen: a tenth of what is seen of a room is hardly farther


def reach_of(depth_m: Float32) -> tuple[float, float, float]:
    """Return how far a tenth of what a frame shows is, half of it, and all, metres; 0 where nothing is known.

    depth_m: (H, W), 0 = void, which says nothing: of a recording it was not measured.
    """
    known = depth_m[depth_m > 0]
    if not len(known):
        return 0.0, 0.0, 0.0
    return float(np.quantile(known, 1 - FAR_SHARE)), float(np.median(known)), float(known.max())


def around_by_depth(depth_m: Float32) -> tuple[Mapping[str, Any], str]:
    """Return whether the air's light is that of a room: by how far a tenth of what a frame (H, W), metres, shows is."""
    far_m, _, farthest_m = reach_of(depth_m)
    if not far_m:
        return {"air_around": False}, "The sky lights the air, as no depth is known"
    why = f"lights the air, as a tenth of what is seen is farther than {far_m:.3g} m"
    if far_m > FAR_M:
        return {"air_around": False}, f"Outdoors: the sky {why}"
    return air_of_rooms(farthest_m), f"Indoors: all that is seen {why}"


def air_of_rooms(farthest_m: float) -> Mapping[str, Any]:
    """Return what air has indoors: all that is seen lights it, and there is as much of it before a window as walls.

    farthest_m: how far one sees.
    """
    return {"air_around": True, "void_m": float(f"{farthest_m:.2g}")}


def lamps_key() -> float:
    """Return the parameter that says how strong that light is."""
    return key("light of lamps in the air, on lit scenes, times its estimate", default=1.0, minimum=0, maximum=100)


# Images of blocks as nodes: means that are blurred widely for little, and put back over the frame.
#
# Blur repeats an image's edge, so a block of nothing is put around: what leaves the frame is gone, and none comes in.


BLOCK_PX = 8  # blocks whose means are blurred
MARGIN = 3.0  # standard deviations to which light may go


@dataclass(frozen=True)
class FrameBlocks:
    """FrameBlocks over a frame. side: of one, pixels. columns, rows: with those of nothing around; 1 where not wanted.

    first: where the lower left pixel of each lies, from 0 to 1. inside: the share of each that lies in the frame.
    """

    canvas: Canvas
    on: Socket
    side: Socket
    columns: Socket
    rows: Socket
    first: Socket
    inside: Socket

    def means(self, image: Socket) -> Socket:
        """Return an image's means in the blocks' parts that lie in the frame."""
        graph = self.canvas.graph
        means = graph.node("CompositorNodePixelate", {"Color": image, "Size": self.side}).out("Color", "color")
        return looked_up(graph, means, self.first, "Nearest", "Clip")

    def back(self, means: Socket) -> Socket:
        """Return an image of the blocks over the frame, smoothly."""
        graph, side = self.canvas.graph, self.side
        blocks = graph.vector(self.columns * side, self.rows * side, 1.0)
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": self.canvas.image}).out("Pixel", "vector")
        pixel = graph.choose(self.on, pixel, (0.0, 0.0, 0.0), "vector")
        at = graph.math("DIVIDE", pixel + graph.vector(side + 0.5, side + 0.5, 1.0), blocks)
        return looked_up(graph, means, at, "Bilinear")

    def over(self, means: Socket, image: Socket) -> Socket:
        """Return an image of the blocks, with its alpha, over an image that shows what the frame does, smoothly."""
        graph = self.canvas.graph
        share = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Normalized", "vector")
        return self.at(means, graph.choose(self.on, share, (0.0, 0.0, 0.0), "vector"))

    def at(self, means: Socket, share: Socket) -> Socket:
        """Return an image of the blocks at places from 0 to 1 along the frame's sides."""
        graph, side = self.canvas.graph, self.side
        per_block = [graph.math("DIVIDE", 1.0, each * side) for each in (self.columns, self.rows)]
        scale = graph.vector(self.canvas.width_px * per_block[0], self.canvas.height_px * per_block[1])
        at = graph.math("MULTIPLY_ADD", share, scale, graph.vector(side * per_block[0], side * per_block[1], 1.0))
        return looked_up(graph, means, at, "Bilinear")


def blocks_of(canvas: Canvas, on: Socket, least: Value = 1.0) -> FrameBlocks:
    """Return the frame's blocks. on: 1 where they are wanted; otherwise they are one, and cost nothing.

    least: side in pixels of the canvas, at least.
    """
    graph = canvas.graph
    side = graph.math("MAXIMUM", graph.math("ROUND", canvas.scale * float(BLOCK_PX)), least)
    columns, rows = (
        graph.math("MULTIPLY_ADD", graph.math("CEIL", each / side) + 1.0, on, 1.0)
        for each in (canvas.width_px, canvas.height_px)
    )
    blank = graph.node("CompositorNodeBlankImage", {"Size": graph.vector(columns, rows)}).out("Image", "color")
    block = graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector") - (1.0, 1.0, 0.0)
    size = graph.vector(canvas.width_px, canvas.height_px, 1.0)
    sides = graph.vector(side, side, 0.0)
    first = graph.math("DIVIDE", graph.math("MULTIPLY_ADD", block, sides, (0.5, 0.5, 1.0)), size)
    # FrameBlocks that the frame's edge cuts hold as much less light.
    left = graph.math("SUBTRACT", 1.0, first) * size + (0.5, 0.5, 0.0)
    share = graph.clamp(graph.math("DIVIDE", left, sides))
    return FrameBlocks(canvas, on, side, columns, rows, first, share.x * share.y)


def blurred(image: Socket, sigma: Socket, before: Value) -> Socket:
    """Return an image, blurred by a Gaussian, added to what was before."""
    return image.graph.math("ADD", gaussian(image, sigma), before)


def gaussian(image: Socket, sigma: Socket) -> Socket:
    """Return an image, with its alpha, blurred by a Gaussian."""
    graph, reach = image.graph, sigma * MARGIN
    inputs = {"Image": image, "Size": graph.vector(reach, reach), "Type": "Gaussian", "Separable": True}
    return graph.node("CompositorNodeBlur", inputs).out("Image", "color")


def looked_up(graph: Graph, image: Socket, where: Socket, interpolation: str, beyond: str = "Extend") -> Socket:
    """Return an image's values at places from 0 to 1."""
    inputs = {"Image": image, "UV": where, "Interpolation": interpolation}
    inputs |= {"Extension X": beyond, "Extension Y": beyond}
    return graph.node("CompositorNodeMapUV", inputs).out("Image", "vector")


# The light of the air before a scene as nodes: what `_air_light` calculates. Where it is not used it costs nothing.


CHANNELS = ("Red", "Green", "Blue")


@dataclass(frozen=True)
class AirSockets:
    """What the scene says of the air's light, as `AirLight`, and how the light is chosen, each 1 or 0.

    estimated: from the scene. given: as a colour, `colour`. plain: as where nothing else is known.
    """

    surfaces: Socket
    sky: Socket
    share: Socket
    estimated: Socket
    given: Socket
    plain: Socket
    colour: Socket

    def chosen(self, plain: Value, surfaces: Value, over: float = 1.0) -> Socket:
        """Return the light. plain: where it is neither estimated nor given. surfaces: in place of the surfaces' own.

        over: by how much the sky's and the given colour are divided.
        """
        graph = self.share.graph
        parts = (
            (graph.mix(surfaces, self.sky * (1 / over, 1 / over, 1 / over), _wide(self.share)), self.estimated),
            (self.colour * (1 / over, 1 / over, 1 / over), self.given),
            (plain, self.plain),
        )
        total: Value = (0.0, 0.0, 0.0)
        for light, share in parts:
            total = graph.math("MULTIPLY_ADD", light, _wide(share), total)
        assert isinstance(total, Socket)
        return total


def air_nodes(canvas: Canvas, given: Mapping[str, Socket]) -> AirSockets:
    """Return the light of the air, by the parameters `air`, `air_red`, `air_green`, `air_blue`, and `air_around`."""
    graph, depth_m = canvas.graph, canvas.depth_m
    assert depth_m is not None
    with graph.section("The air: what is sky"):
        auto, scene, plain, colour = graph.chosen(given["air"])
        lit = canvas.lit
        estimated = scene + auto * lit
        used = estimated > 0.5
        image = graph.choose(used, canvas.image, (0.0, 0.0, 0.0, 1.0))
        sky = graph.choose(used, _sky(graph, depth_m), 0.0, "float")
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Pixel", "vector")
        sky = graph.math("MULTIPLY_ADD", pixel.x, 0.0, sky)  # an image even where Depth is one number
        if not canvas.never_lit:  # means of sixteen pixels do as well
            small = halved(canvas, image, sky, used, times=2)
            image, sky = small.canvas.image, small.extra
        luminance = graph.math("MAXIMUM", graph.math("DOT_PRODUCT", image, LUMINANCE), 0.0)
        others = graph.math("SUBTRACT", 1.0, sky)
    surfaces, _ = _robust_mean(canvas, image, luminance, others)
    own, part = _robust_mean(canvas, image, luminance, sky)
    with graph.section("The air: its light"):
        bright = graph.math("DOT_PRODUCT", own, LUMINANCE)
        seen = graph.math("MINIMUM", part / WHOLE_SKY, 1.0)
        if "air_around" in given:
            seen = graph.choose(given["air_around"], part, seen, "float")
        share = seen * bright / (bright + NIGHT)
        encoded = graph.vector(*(given[f"air_{name}"] for name in ("red", "green", "blue")))
        light = convert(graph, encoded, "sRGB", "Linear Rec.709")
        rest = plain + auto * graph.math("SUBTRACT", 1.0, lit)
        return AirSockets(surfaces, own, share, estimated, colour, rest, light)


def kept_sky(canvas: Canvas, given: Mapping[str, Socket]) -> Socket:
    """Return 0 where the sky is left as it is, else 1."""
    graph, depth_m = canvas.graph, canvas.depth_m
    assert depth_m is not None
    return graph.math("SUBTRACT", 1.0, _sky(graph, depth_m) * given["leave_sky"])


def _sky(graph: Graph, depth_m: Socket) -> Socket:
    known_m = graph.math("MAXIMUM", 0.0, depth_m)  # its first operand where the second is NaN
    return graph.math("MAXIMUM", graph.math("LESS_THAN", known_m, 1e-12), graph.math("GREATER_THAN", known_m, SKY_M))


def _robust_mean(canvas: Canvas, image: Socket, luminance: Socket, mask: Socket) -> tuple[Socket, Socket]:
    """Return the mean of the image where the mask is 1, as `robust_mean`, and the mask's share of the frame."""
    graph = canvas.graph
    with graph.section("The air: a mean that lamps hardly move"):
        part = _mean(mask, "Red")
        root = graph.math("SQRT", graph.math("SQRT", luminance))
        first = graph.math("POWER", _mean(root * mask, "Red") / graph.math("MAXIMUM", part, LEAST), 4.0)
        ratio = luminance / graph.math("MAXIMUM", first * KNEE, LEAST)
        weight = mask / (graph.math("POWER", ratio, 4.0) + 1.0)
        weighted = image * _wide(weight)
        total = graph.vector(*(_mean(weighted, name) for name in CHANNELS))
        return total / _wide(graph.math("MAXIMUM", _mean(weight, "Red"), LEAST)), part


def _mean(image: Socket, channel: str) -> Socket:
    return image.graph.node("CompositorNodeLevels", {"Image": image, "Channel": channel}).out("Mean", "float")


def _wide(value: Socket) -> Socket:
    return value.graph.vector(value, value, value)


# The light of lamps on what floats in the air, as nodes; `_lamp_light` says why.


@dataclass(frozen=True)
class LampLight:
    """Light of lamps at each pixel. particles: of particles before it. most: the share of it that even air can have."""

    particles: Socket
    most: Socket

    def veil(self, hidden: Socket) -> Socket:
        """Return the light of even air. hidden: the share of the light behind it that it takes, up to each pixel."""
        share = hidden.graph.math("MINIMUM", hidden, self.most)
        return self.particles * hidden.graph.vector(share, share, share)


def lamp_light_nodes(
    canvas: Canvas, given: Mapping[str, Socket], air: Socket, scattering: float, depth: Socket
) -> LampLight:
    """Return the light at each pixel of what outshines the air's light, C / a of it; nothing where not lit.

    air: its light, which makes a lamp of what `_air_light` weighs little. given: the parameters `lamps` and `view_deg`.
    scattering: C. depth: optical, of the even air before each pixel.
    """
    graph, view_deg = canvas.graph, given["view_deg"]
    with graph.section("Lamps: what outshines the air"):
        on = graph.math("MULTIPLY", graph.math("GREATER_THAN", canvas.lit, 0.5), given["lamps"] > 0.0)
        image = graph.choose(on, canvas.image, (0.0, 0.0, 0.0))
        small = halved(canvas, image, graph.choose(on, depth, 0.0, "float"), on)
        luminance = graph.math("MAXIMUM", graph.math("DOT_PRODUCT", small.canvas.image, LUMINANCE), 0.0)
        usual = graph.math("DOT_PRODUCT", air, LUMINANCE)
        ratio = luminance * graph.math("DIVIDE", 1.0, graph.math("MAXIMUM", usual * KNEE, LEAST))
        squared = graph.math("MULTIPLY", ratio, ratio)
        fourth = graph.math("MULTIPLY", squared, squared)
        arrives = graph.math("DIVIDE", fourth / (fourth + 1.0), graph.math("MULTIPLY_ADD", small.extra, DIFFUSE, 1.0))
        lit_up = 1.0 - graph.math("EXPONENT", small.extra * -2.0)
        bright = small.canvas.image * graph.vector(arrives, arrives, arrives)
        smaller = halved(small.canvas, bright, luminance * arrives * lit_up, on)
        blocks = blocks_of(smaller.canvas, on)
    with graph.section("Lamps: their light around them"):
        half = graph.math("TANGENT", view_deg * (math.pi / 360))
        focal_px = smaller.canvas.width_px * 0.5 / half
        strength = graph.vector(*[given["lamps"] * scattering] * 3)
        total, of_air = _around(blocks, smaller.canvas.image, focal_px, given["coarse"])
        most = of_air / graph.math("MAXIMUM", graph.math("DOT_PRODUCT", total, LUMINANCE), LEAST)
        found = blocks.over(with_extra(total * strength, most), canvas.image)
        return LampLight(found, extra_of(found))


def _around(blocks: FrameBlocks, image: Socket, focal_px: Socket, quick: Socket) -> tuple[Socket, Socket]:
    """Return the sum of Gaussians of lamps in blocks, and that of their alpha; quickly, wide ones of larger blocks."""
    graph = quick.graph
    large = blocks_of(blocks.canvas, blocks.on, graph.math("MAXIMUM", graph.math("FLOOR", focal_px * LARGE_RAD), 1.0))
    reach = blocks.side - 1.0
    where = graph.math("MULTIPLY_ADD", graph.vector(reach, reach), _half_px(blocks.canvas), blocks.first)
    wide, narrow = WIDTHS_RAD[:WIDE], WIDTHS_RAD[WIDE:]
    sums = _sum(blocks, image, focal_px, WIDTHS_RAD, ((0.0, 0.0, 0.0), 0.0))
    far = _sum(large, image, focal_px, wide, ((0.0, 0.0, 0.0), 0.0))
    found = large.at(with_extra(*far), where)
    quickly = _sum(blocks, image, focal_px, narrow, (found, extra_of(found)))
    total = graph.choose(quick, quickly[0], sums[0], "vector")
    return total, graph.choose(quick, quickly[1], sums[1], "float")


def _half_px(canvas: Canvas) -> Socket:
    """Return half a pixel as a share of the sides."""
    return canvas.graph.math("DIVIDE", (0.5, 0.5, 0.0), canvas.graph.vector(canvas.width_px, canvas.height_px, 1.0))


def _sum(
    blocks: FrameBlocks, image: Socket, focal_px: Socket, widths_rad: Sequence[float], before: tuple[Value, Value]
) -> tuple[Socket, Socket]:
    """Return Gaussians of an image's means in blocks, and those of its alpha, added to what was before."""
    graph = blocks.canvas.graph
    lamps = blocks.means(image)
    lamps = with_extra(lamps * graph.vector(*[blocks.inside] * 3), extra_of(lamps) * blocks.inside)
    focal, (total, of_air) = focal_px / blocks.side, before
    for width in widths_rad:
        volume = VOLUMES[WIDTHS_RAD.index(width)]
        around = gaussian(lamps, focal * width)
        total = graph.math("MULTIPLY_ADD", around, (volume, volume, volume), total)
        of_air = graph.math("MULTIPLY_ADD", extra_of(around), volume, of_air)
    assert isinstance(total, Socket)
    assert isinstance(of_air, Socket)
    return total, of_air
