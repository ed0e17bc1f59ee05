# SPDX-License-Identifier: GPL-3.0-or-later
"""Dirt on the front glass: dust, grease and scratches, and the glare and streaks of bright light on them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import BroughtImage, Graph, Socket
from ...core.schema import key
from ...core.srgb import decoded, encoded
from ...core.streams import stream
from ..groups import SEEDS, Canvas
from ..kinds import About, ColourPerturbation, Example, FrameContext, Nodes
from ._arrays import by_bands, gaussian, kept_for_sequence, three_channels
from ._glass import mean_of, reduced, reduced_nodes, sampled, share_of
from ._noise import WhiteNoise, white_noise

# A pane's dirt, drawn once: a picture that repeats, with specks of dust, smears of grease and scratches.
#
# All are as a lens shows them that does not focus on its glass: specks are discs, as in Willson, Maimone, Johnson and
# Scherr, "An optical model for image artifacts produced by dust particles on lenses", 2005.


Float32: TypeAlias = NDArray[np.float32]

SIZE = (768, 512)  # width and height in texels
TEXEL_PX = 2.0  # pixels of the reference width that a texel spans
DUST_BLUR_PX = 9.0  # standard deviation, as wide as a speck's median radius; chosen
SPECKS = 420
SPECK_RADIUS = (4.6, 0.28)  # median in texels, deviation of the logarithm
WIPES = 9
PRINTS = 3
SCRATCHES = 84


@lru_cache(maxsize=1)
def tile() -> NDArray[np.uint8]:
    """Return (512, 768, 3) uint8: of 255, how much dust, grease and scratches there is; edges meet."""
    layers = [_dust(), _grease(), _scratches()]
    drawn = np.stack([np.clip(layer, 0, 1) * 255 + 0.5 for layer in layers], axis=2).astype(np.uint8)
    drawn.flags.writeable = False
    return drawn


@lru_cache(maxsize=1)
def soft_tile() -> NDArray[np.uint8]:
    """Return the tile with its dust as the lens sees what lies on it: without edges, which only a sensor's dust has."""
    drawn = tile().copy()
    drawn[..., 0] = (_softened(np.clip(_dust(), 0, 1), DUST_BLUR_PX / TEXEL_PX) * 255 + 0.5).astype(np.uint8)
    drawn.flags.writeable = False
    return drawn


TILE = BroughtImage("Dirt on a lens", "1", tile)
SOFT_TILE = BroughtImage("Dirt on a lens, out of focus", "1", soft_tile)


def _around(position: tuple[float, float], reach: float) -> tuple[NDArray[np.intp], NDArray[np.intp], Float32, Float32]:
    """Return rows and columns about a position, across the edges, and how far they are from it: right, down."""
    x, y = position
    columns = np.arange(math.floor(x - reach), math.ceil(x + reach) + 1)
    rows = np.arange(math.floor(y - reach), math.ceil(y + reach) + 1)[:, None]
    right, down = np.broadcast_arrays((columns - x).astype(np.float32), (rows - y).astype(np.float32))
    return rows % SIZE[1], columns % SIZE[0], right, down


def _dust() -> Float32:
    """Return discs with a soft edge and a slightly darker rim, most of them faint."""
    drawn = stream("dirt", "dust")
    layer = np.zeros(SIZE[::-1], np.float32)
    for _ in range(SPECKS):
        place = drawn.random(2) * SIZE
        radius = SPECK_RADIUS[0] * math.exp(SPECK_RADIUS[1] * drawn.standard_normal())
        opaque = min(1.0, 0.16 * math.exp(0.8 * drawn.standard_normal()))
        narrow, turn = drawn.uniform(0.85, 1.0), drawn.uniform(0, math.pi)
        rows, columns, right, down = _around((place[0], place[1]), 1.5 * radius)
        along = right * np.float32(math.cos(turn)) + down * np.float32(math.sin(turn))
        across = (down * np.float32(math.cos(turn)) - right * np.float32(math.sin(turn))) / np.float32(narrow)
        rho = np.hypot(along, across) / np.float32(radius)
        disc = np.clip((1 - rho) * np.float32(radius / 1.6) + np.float32(0.5), 0, 1)
        layer[rows, columns] += disc * (1 + np.float32(0.5) * rho**6) * np.float32(opaque / 1.5)
    return layer


def _noise(name: str, length: tuple[float, float]) -> Float32:
    """Return smooth noise of mean 0 and deviation 1 whose edges meet. length: its scale in x and y, texels."""
    white = stream("dirt", name).standard_normal(SIZE[::-1])
    x = np.fft.fftfreq(SIZE[0]) * length[0]
    y = np.fft.fftfreq(SIZE[1])[:, None] * length[1]
    smooth = np.fft.ifft2(np.fft.fft2(white) * np.exp(-2 * (math.pi * np.hypot(x, y)) ** 2)).real
    return (smooth / smooth.std()).astype(np.float32)


def _grease() -> Float32:
    """Return a thin uneven film, bands that a cloth or a finger has wiped, and prints of fingers."""
    drawn = stream("dirt", "grease")
    uneven, fine = _noise("uneven", (60, 45)), _noise("fine", (7, 6))
    layer = np.clip(np.float32(0.16) + np.float32(0.13) * uneven + np.float32(0.03) * fine, 0, None)
    hairs = _noise("hairs", (26, 1.2))
    for _ in range(WIPES):
        place, turn = drawn.random(2) * SIZE, drawn.uniform(-0.5, 0.9)
        half, wide, strong = drawn.uniform(70, 170), drawn.uniform(14, 40), drawn.uniform(0.2, 0.55)
        bend = drawn.uniform(-1.5e-3, 1.5e-3)
        rows, columns, right, down = _around((place[0], place[1]), min(half + 10, 0.49 * SIZE[1]))
        along = right * np.float32(math.cos(turn)) + down * np.float32(math.sin(turn))
        across = down * np.float32(math.cos(turn)) - right * np.float32(math.sin(turn)) + along**2 * np.float32(bend)
        # Hairs of the cloth leave lines along the way.
        lines = hairs[np.floor(across + place[1]).astype(int) % SIZE[1], np.floor(along).astype(int) % SIZE[0]]
        shape = np.exp(-((along / np.float32(half)) ** 4) * 2 - (across / np.float32(wide)) ** 4)
        layer[rows, columns] += np.float32(strong) * shape * np.clip(np.float32(0.55) + np.float32(0.3) * lines, 0, 1.5)
    for _ in range(PRINTS):
        place, turn = drawn.random(2) * SIZE, drawn.uniform(0, math.pi)
        rows, columns, right, down = _around((place[0], place[1]), 48)
        along = right * np.float32(math.cos(turn)) + down * np.float32(math.sin(turn))
        across = down * np.float32(math.cos(turn)) - right * np.float32(math.sin(turn))
        swirl = np.float32(0.7) * uneven[rows, columns] + np.float32(0.25) * fine[rows, columns]
        ridges = np.sin(np.hypot(along * np.float32(0.6), across + 17) * np.float32(2 * math.pi / 4.2) + swirl * 3)
        shape = np.exp(-((along / 34) ** 4) - (across / 24) ** 4)
        layer[rows, columns] += shape * (np.float32(0.32) + np.float32(0.16) * ridges)
    return _softened(np.asarray(layer, np.float32), 1.0)


def _scratches() -> Float32:
    """Return thin arcs, some in bundles as grit under a cloth leaves them."""
    import cv2

    drawn = stream("dirt", "scratches")
    layer = np.zeros(SIZE[::-1], np.float32)
    middle, radius, start = np.zeros(2), 1.0, 0.0
    for number in range(SCRATCHES):
        if number % 4 == 0:
            radius, start = math.exp(drawn.uniform(4.0, 6.5)), drawn.uniform(0, 2 * math.pi)
            middle = drawn.random(2) * SIZE - radius * np.array([math.cos(start), math.sin(start)])
        length = min(math.exp(drawn.uniform(2.0, 4.8)) / radius, 2.0)
        begin = start + drawn.normal(0, 30 / radius)
        angle = begin + np.linspace(0, length, 24)
        own = radius + drawn.normal(0, 7)
        points = middle + own * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        one = np.zeros(SIZE[::-1], np.uint8)
        for shift in ((x, y) for x in (-SIZE[0], 0, SIZE[0]) for y in (-SIZE[1], 0, SIZE[1])):
            cv2.polylines(one, [np.rint((points + shift) * 16).astype(np.int32)], False, 255, 1, cv2.LINE_AA, 4)
        layer += one * np.float32(drawn.uniform(0.15, 1.0) / 255)
    return _softened(layer, 0.7)


def _softened(layer: Float32, sigma: float) -> Float32:
    """Blur a layer whose edges meet. sigma: in texels."""
    import cv2

    margin = max(8, math.ceil(4 * sigma))
    wide = cv2.copyMakeBorder(layer, margin, margin, margin, margin, cv2.BORDER_WRAP)
    return np.asarray(cv2.GaussianBlur(wide, (0, 0), sigma), np.float32)[margin:-margin, margin:-margin]


# Glare of a dirty lens: scattered light with long tails, partly as streaks.
#
# The point spread is a sum of Gaussians, near, middle and far, of sum 1: the light is spread, none is lost. Grease that
# was wiped has grooves along the wiping, which scatter across them: a lamp's streak is at right angles to it.


HALVINGS = 3  # from the frame to the image that is spread
# Share, and standard deviation as a multiple of the reach; chosen.
PARTS = ((0.5, 0.1), (0.3, 0.4), (0.2, 1.5))
ALONG, ACROSS = 1.6, 0.05  # standard deviations of a streak, of the reach


@dataclass(frozen=True)
class Spread:
    """How light is spread. reach_px: how far, in pixels of the image given. streaks: the share that is drawn out.

    turn_rad: the streaks' direction, from the right downwards.
    """

    reach_px: float
    streaks: float
    turn_rad: float


def glare_of(small: Float32, spread: Spread) -> Float32:
    """Return the scattered light of an image (h, w, 3) of linear light, of the same shape."""
    total = np.zeros_like(small)
    for share, times in PARTS:
        total += gaussian(small, times * spread.reach_px) * np.float32(share * (1 - spread.streaks))
    total += streaked(small, spread) * np.float32(spread.streaks)
    return total


def streaked(small: Float32, spread: Spread) -> Float32:
    """Return an image drawn out along a direction: turned, blurred along its rows, and turned back."""
    import cv2

    height, width = small.shape[:2]
    side = math.ceil(math.hypot(width, height))
    cosine, sine = math.cos(spread.turn_rad), math.sin(spread.turn_rad)
    # Where a pixel of the turned image lies in the image.
    turned = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0]])
    turned[:, 2] = (width - 1) / 2, (height - 1) / 2
    turned[:, 2] -= turned[:, :2] @ [(side - 1) / 2, (side - 1) / 2]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    wide = cv2.warpAffine(small, turned, (side, side), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    sigmas = [max(times * spread.reach_px, 1e-3) for times in (ALONG, ACROSS)]
    sizes = [2 * int(4 * sigma + 0.5) + 1 for sigma in sigmas]
    drawn = cv2.GaussianBlur(wide, sizes, sigmas[0], sigmaY=sigmas[1], borderType=cv2.BORDER_REPLICATE)
    back = cv2.invertAffineTransform(turned)
    found = cv2.warpAffine(drawn, back, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32).reshape(small.shape)


# Dirt on the lens as nodes.


Given: TypeAlias = Mapping[str, Socket]


def build_dirt(canvas: Canvas, given: Given, absorbed_share: float) -> Socket:
    """Look at an image of linear light through dirt. given: a socket for each parameter of lens_dirt."""
    graph = canvas.graph
    with graph.section("Pixels"):
        share = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Normalized", "vector")
    assert canvas.seed is not None, "its group is seeded"
    lens = replace(canvas, seed=graph.choose(given["lens"] > 0.0, given["lens"], canvas.seed, "float"))
    dirt = _dirt(lens, given["size"], share)
    with graph.section("What is lost"):
        dust = dirt.x
        absorbed = dust * (given["dust"] * absorbed_share)
        scattered = graph.math("MULTIPLY_ADD", dirt.y, given["smudges"], dust * (given["dust"] * (1 - absorbed_share)))
        scattered = graph.math("MULTIPLY_ADD", dirt.z, given["scratches"], scattered)
        scattered = graph.math("MINIMUM", scattered, 1.0 - absorbed)
    spread = _glare(canvas, given)
    with graph.section("Over the image"):
        glare = sampled(spread, share)
        lit, left = scattered * given["glare"], 1.0 - absorbed - scattered
        seen = canvas.image * graph.vector(left, left, left)
        seen = graph.math("MULTIPLY_ADD", glare, graph.vector(lit, lit, lit), seen)
        own = scattered * given["beside"]
        return graph.math("MULTIPLY_ADD", mean_of(spread), graph.vector(own, own, own), seen)


def _dirt(canvas: Canvas, size: Socket, share: Socket) -> Socket:
    """Return dust, grease and scratches before each pixel, as `dirt_before` does."""
    graph = canvas.graph
    with graph.section("Dirt"):
        frame_px = graph.vector(canvas.width_px, canvas.height_px) / graph.vector(canvas.scale, canvas.scale, 1.0)
        shown = frame_px * (1 / (SIZE[0] * TEXEL_PX), 1 / (SIZE[1] * TEXEL_PX), 0.0) / graph.vector(size, size, 1.0)
        start, turned = canvas.random(0), canvas.random(1)
        # 1 or -1: a half of them is mirrored.
        way = graph.math(
            "MULTIPLY_ADD", graph.math("LESS_THAN", turned, (0.5, 0.5, 0.0)), (2.0, 2.0, 0.0), (-1.0, -1.0, 0.0)
        )
        # Rows are counted from the top, the picture's and the frame's shares from below.
        from_top = graph.math("MULTIPLY_ADD", share, (1.0, -1.0, 0.0), (0.0, 1.0, 0.0))
        place = graph.math("MULTIPLY_ADD", from_top, shown * way, start)
        where = graph.math("MULTIPLY_ADD", place, (1.0, -1.0, 0.0), (0.0, 0.0, 1.0))
        drawn = graph.picture(SOFT_TILE if canvas.always_lit else TILE)
        if not canvas.never_lit and not canvas.always_lit:
            drawn = graph.choose(graph.math("GREATER_THAN", canvas.lit, 0.5), graph.picture(SOFT_TILE), drawn)
        inputs = {"Image": drawn, "UV": where, "Interpolation": "Bilinear"}
        inputs |= {"Extension X": "Repeat", "Extension Y": "Repeat"}
        return graph.node("CompositorNodeMapUV", inputs).out("Image", "color")


def _glare(canvas: Canvas, given: Given) -> Socket:
    """Return the scattered light, on a smaller image, as `glare_of` does."""
    graph = canvas.graph
    small = reduced_nodes(canvas, HALVINGS)
    with graph.section("Glare"):
        reach = given["reach_px"] / canvas.scale * (0.5**HALVINGS)
        total = _streaked(graph, small, reach, given["wiped_deg"]) * graph.vector(*[given["streaks"]] * 3)
        spread = 1.0 - given["streaks"]
        for share, times in PARTS:
            part = _blurred(small, reach * times, reach * times)
            weight = spread * share
            total = graph.math("MULTIPLY_ADD", part, graph.vector(weight, weight, weight), total)
    return total


def _streaked(graph: Graph, small: Socket, reach: Socket, wiped_deg: Socket) -> Socket:
    """Return the image drawn out across the wiping: turned, blurred along its rows, turned back."""
    turn = graph.math("MULTIPLY_ADD", wiped_deg, math.pi / 180, math.pi / 2)
    cosine, sine = graph.math("COSINE", turn), graph.math("SINE", turn)
    size = graph.node("CompositorNodeImageInfo", {"Image": small}).out("Resolution", "vector")
    side = graph.math("CEIL", graph.math("LENGTH", size * (1.0, 1.0, 0.0)))
    square = graph.vector(side, side)
    aside = graph.math("MULTIPLY", share_of(graph, square) - (0.5, 0.5, 0.0), square)
    # Counted from below, a turn to the right and down is one to the right and up.
    x = graph.math("MULTIPLY_ADD", aside.x, cosine, aside.y * sine)
    y = graph.math("MULTIPLY_ADD", aside.y, cosine, aside.x * sine * -1.0)
    turned = sampled(small, graph.vector(x, y) / size + (0.5, 0.5, 0.0))
    drawn = _blurred(turned, reach * ALONG, reach * ACROSS)
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": small}).out("Normalized", "vector")
    aside = graph.math("MULTIPLY", pixel - (0.5, 0.5, 0.0), size)
    x = graph.math("MULTIPLY_ADD", aside.x, cosine, aside.y * sine * -1.0)
    y = graph.math("MULTIPLY_ADD", aside.y, cosine, aside.x * sine)
    return sampled(drawn, graph.vector(x, y) / square + (0.5, 0.5, 0.0))


def _blurred(image: Socket, across_px: Socket, up_px: Socket) -> Socket:
    size = image.graph.vector(across_px * 3.0, up_px * 3.0)
    inputs = {"Image": image, "Size": size, "Type": "Gaussian", "Separable": True}
    return image.graph.node("CompositorNodeBlur", inputs).out("Image", "color")


ABSORBED = 0.6  # of what dust takes away; it scatters the rest; chosen


@dataclass(frozen=True)
class LensDirt:
    """Dust, smears of grease and scratches on the glass before the lens, out of focus.

    image * (1 - absorbed - scattered) + scattered * glare, as Gu, Ramamoorthi, Belhumeur and Nayar (2009) have it, in
    linear light: glare is the image spread far, so lamps light up the dirt around them and draw streaks.
    """

    dust: float = key("share of light that the densest speck takes away", default=0.35, minimum=0, maximum=1)
    smudges: float = key("share of light that the thickest grease scatters", default=0.35, minimum=0, maximum=1)
    scratches: float = key("share of light that the deepest scratch scatters", default=0.25, minimum=0, maximum=1)
    size: float = key("size of all dirt, times its own", default=1.0, minimum=0.25, maximum=8)
    reach_px: float = key("how far scattered light reaches", default=110.0, unit="px", minimum=8, maximum=2000)
    streaks: float = key("share of scattered light that is drawn out to streaks", default=0.35, minimum=0, maximum=1)
    wiped_deg: float = key(
        "direction in which the glass was wiped, across which streaks run; 0 is to the right, 90 down",
        default=25.0,
        unit="deg",
        minimum=-180,
        maximum=180,
    )
    glare: float = key("scattered light, times what is taken away for it", default=1.0, minimum=0, maximum=20)
    beside: float = key(
        "light from beside the frame that falls on what scatters, times the image's mean",
        default=0.0,
        minimum=0,
        maximum=20,
        later=True,
    )
    lens: int = key(
        "which lens: one has the same dirt in all settings and datasets; 0 draws it for each setting",
        default=0,
        minimum=0,
        maximum=SEEDS - 1,
        later=True,
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "dust": "Higher: darker specks of dust",
        "smudges": "Higher: thicker grease; bright light spreads over it",
        "scratches": "Higher: deeper scratches, which light up near lamps",
        "size": "Higher: all dirt is larger",
        "reach_px": "Higher: lamps light up dirt further away from them",
        "streaks": "Higher: lamps draw streaks instead of halos",
        "wiped_deg": "Turns the streaks, which run across the direction of wiping",
        "beside": "Higher: the dirt is lit from outside the picture, and is seen in flat light too",
        "lens": "Another number: other dirt, which is the same wherever the number is; 0 follows Seed",
        "glare": "Higher: dirt shines more than it takes away; 1 is as it is, 0 only takes away",
    }


def apply(rgb: Float32, parameters: LensDirt, context: FrameContext) -> Float32:
    """Look at (H, W, 3) through dirt."""
    import cv2

    linear = by_bands(rgb, rgb.dtype, decoded)
    spread = Spread(parameters.reach_px / 2**HALVINGS, parameters.streaks, math.radians(parameters.wiped_deg + 90))
    small = glare_of(reduced(linear, HALVINGS), spread)
    glare = np.asarray(cv2.resize(small, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)
    beside = np.array(cv2.mean(small)[:3], np.float32) * np.float32(parameters.beside)

    def dirty(band: Float32, band_glare: Float32, band_dirt: Float32) -> Float32:
        absorbed, scattered = lost(band_dirt, parameters)
        seen = band_glare.reshape(band.shape) * three_channels(scattered * np.float32(parameters.glare))
        seen += three_channels(1 - absorbed - scattered).reshape(band.shape) * band
        if parameters.beside > 0:
            seen += scattered[..., None] * beside
        return encoded(seen)

    return by_bands(
        linear, rgb.dtype, dirty, glare, dirt_before(context, rgb.shape[:2], parameters.size, parameters.lens)
    )


def lost(dirt: Float32, parameters: LensDirt) -> tuple[Float32, Float32]:
    """Return which share of light dirt (..., 3) absorbs and which it scatters, each without the last axis."""
    dust, grease, scratched = (dirt[..., k] for k in range(3))
    absorbed = dust * np.float32(parameters.dust * ABSORBED)
    scattered = dust * np.float32(parameters.dust * (1 - ABSORBED)) + grease * np.float32(parameters.smudges)
    scattered += scratched * np.float32(parameters.scratches)
    return absorbed, np.minimum(scattered, 1 - absorbed)


@kept_for_sequence
def dirt_before(context: FrameContext, shape: tuple[int, int], size: float, lens: int = 0) -> Float32:
    """Return (H, W, 3): dust, grease and scratches before each pixel, in [0, 1]. lens: which; 0 is drawn."""
    import cv2

    own = white_noise(context)
    drawn = WhiteNoise(lens, own.key) if lens else own
    start, turned = drawn.numbers(0), drawn.numbers(1)
    dirt = tile()
    matrix = np.zeros((2, 3))
    for axis, side in enumerate(dirt.shape[1::-1]):
        step = (1 if turned[axis] < 0.5 else -1) / (TEXEL_PX * size)  # one of two is mirrored
        matrix[axis, axis] = step
        matrix[axis, 2] = start[axis] * side + 0.5 * step - 0.5
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpAffine(
        dirt.astype(np.float32), matrix, (shape[1], shape[0]), flags=flags, borderMode=cv2.BORDER_WRAP
    )
    before = np.asarray(seen, np.float32).reshape(*shape, 3)
    before *= np.float32(1 / 255)
    before.flags.writeable = False
    return before


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Look the dirt up in a picture, spread the image's light, and mix."""
    return build_dirt(canvas, given, ABSORBED)


PERTURBATION = ColourPerturbation(
    name="lens_dirt",
    label="Lens dirt",
    stage="lens",
    order=62,
    parameters=LensDirt,
    severities={
        "dust": (0.1, 0.2, 0.35, 0.55, 0.8),
        "smudges": (0.1, 0.2, 0.35, 0.55, 0.8),
        "scratches": (0.08, 0.15, 0.25, 0.4, 0.6),
    },
    newly={"lens": 1, "beside": 0.6},
    source="our own: from a lens that was wiped to one that never was",
    about=About(
        "Puts dust, grease and scratches on the front glass, which light up near lamps",
        "dust, grease and scratches on the front glass, and the glare of lamps on them",
        example=Example(
            text="Dust, grease and scratches on the lens in the embedded room, clean and at severities 1, 3 and 5."
        ),
    ),
    apply=apply,
    nodes=Nodes(build, linear=True, draws_lit=True),
    temporals=("fixed", "fresh"),
    tinted=True,
)
