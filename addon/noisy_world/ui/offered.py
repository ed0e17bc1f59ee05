# SPDX-License-Identifier: GPL-3.0-or-later
"""How the perturbations are offered: in two lists, the benchmark's and the physical ones, and in a sentence each."""

from dataclasses import dataclass

from ..core.labels import american, title
from ..core.perturbing.kinds import Perturbation
from ..perturbations import registry
from .document import OWN_FIELDS


@dataclass(frozen=True)
class Offered:
    """A list of perturbations. name: of its menu. said: what is in it, in a line."""

    name: str
    label: str
    said: str


PHYSICAL = Offered("physical", "Physical", "Of the scene's air and light, the lens, the sensors")
BENCHMARK = Offered("benchmark", "Benchmark", "The paper's: laid over images, depth and path")
PACKAGES = Offered("packages", "Packages", "Of packages that are installed")

_BENCHMARK = frozenset({
    "motion_deviation", "faster_motion", "desync",
    "fog", "frost", "snow", "spatter",
    "defocus_blur", "gaussian_blur", "glass_blur", "motion_blur",
    "gaussian_noise", "impulse_noise", "shot_noise", "speckle_noise",
    "brightness", "contrast", "jpeg_compression", "pixelate",
    "depth_edge_erosion", "depth_gaussian_noise", "depth_random_missing", "depth_range_clipping",
})  # fmt: skip

TWINS = {
    "fog": "fog_depth",
    "snow": "snow_depth",
    "frost": "lens_frost",
    "spatter": "lens_drops",
    "defocus_blur": "defocus_depth",
    "motion_blur": "camera_motion_blur",
}
"""Of the benchmark's perturbations the physical one of the same cause."""

SAID = {
    "fog": "Lays clouds of one gray over the image, as thick near as far away",
    "haze": "Fades what is far and turns it blue, as dry air does",
    "fog_depth": "Hides what is far behind lit air; it may lie on the ground, come in clumps, and glow around lamps",
    "snow_depth": "Lets flakes fall through the scene; near ones are large, fast and out of focus",
    "rain_depth": "Lets drops fall through the scene; near ones are long and wide streaks",
    "frost": "Lays a picture of ice over the whole image, another for each frame",
    "lens_frost": "Grows crystals of ice on the glass, from its border inwards",
    "snow": "Whitens the image and lays streaks of flakes over it, all at one distance",
    "spatter": "Lays drops of water or mud over the image, which show nothing through them",
    "defocus_blur": "Blurs the whole image alike, by a disk",
    "defocus_depth": "Blurs what is nearer or farther than the focus, as a lens does",
    "gaussian_blur": "Blurs the whole image alike, softly",
    "glass_blur": "Shifts each pixel by chance, as ribbed glass does",
    "motion_blur": "Smears the whole image along one line, whatever the camera does",
    "chromatic_aberration": "Moves red outwards and blue inwards, so edges near the border have colored fringes",
    "bloom": "Lets bright things glow, as a lens scatters a part of their light",
    "vignetting": "Darkens the image towards its corners, as lenses do",
    "lens_drops": "Puts drops of water on the front glass, which show the scene upside down, run and dry",
    "lens_dirt": "Puts dust, grease and scratches on the front glass, which light up near lamps",
    "gaussian_noise": "Adds grain, as strong in dark places as in bright ones",
    "impulse_noise": "Makes single pixels black or white",
    "shot_noise": "Adds the grain of few photons, most of it in bright places",
    "auto_exposure": "Sets exposure and gain by the frames before, so that changes of light are followed late",
    "flicker": "Makes frames lighter and darker, or bands across them, as lamps on the mains do",
    "sensor_noise": "Counts light in electrons, and reads them with noise, gain and a few bits",
    "white_balance": "Turns the colors of what was seen before towards gray, late and never quite",
    "speckle_noise": "Adds grain in proportion to brightness",
    "brightness": "Makes the whole image lighter",
    "contrast": "Makes the whole image flatter, or harsher",
    "jpeg_compression": "Leaves the blocks and rings of strong compression",
    "pixelate": "Turns the image into large squares",
    "depth_edge_erosion": "Takes depth away in blocks along the edges of things",
    "depth_gaussian_noise": "Roughens depth, wherever it is, by the spread of the frame's depths",
    "depth_random_missing": "Punches rectangular holes into depth",
    "depth_range_clipping": "Takes depth away that is too near or too far",
    "vibration": "Shakes the camera as a hand, a walker or a machine does, smoothly in time",
    "drift": "Lets the camera slowly lean and shift away from its path, as a loose mount does",
    "jerk": "Throws the camera aside at single moments, as a curb or a stumble does",
    "rolling_shutter": "Reads lines one after another, so that what moves is bent",
    "camera_motion_blur": "Leaves the shutter open while the camera moves, so that near things smear more",
    "axial_noise": "Roughens depth with distance and makes edges ragged, as measured on depth cameras",
    "lidar": "Leaves the ranges of a spinning lidar's beams, and no depth between them",
    "redwood": "Roughens and rounds depth as a Kinect does, by Redwood's model",
    "stereo": "Measures depth by two cameras: coarse far away, lost on plain walls and beside near things",
    "structured_light": "Measures depth by a projected pattern: in steps far away, with shadows beside near things",
    "time_of_flight": "Measures depth by the phase of light: noisy where it is dark, with pixels in the air at edges",
    "desync": "Pairs color with depth of another moment",
}
"""What a perturbation does to what is seen, in a sentence."""


def list_of(perturbation: Perturbation) -> Offered:
    """Return the list that a perturbation is offered in."""
    if perturbation.distribution:
        return PACKAGES
    return BENCHMARK if perturbation.name in _BENCHMARK else PHYSICAL


def offered(chosen: Offered) -> list[Perturbation]:
    """Return what a list offers, in the order of propagation: what has no fields of its own in the panel."""
    return [item for item in registry().values() if list_of(item) == chosen and item.name not in OWN_FIELDS]


def sentence_of(perturbation: Perturbation) -> str:
    """Return what a perturbation does in a sentence; of packages what their parameters say of themselves."""
    documented = (perturbation.parameters.__doc__ or "").split("\n")[0].strip().rstrip(".")
    return american(SAID.get(perturbation.name) or documented)


def line_on(perturbation: Perturbation) -> str:
    """Return which list a perturbation is of, what it does, and its physical twin, where it has one."""
    line = f"{list_of(perturbation).label}: {sentence_of(perturbation)}"
    twin = TWINS.get(perturbation.name)
    return line if twin is None else f"{line}. Its physical twin is {title(registry()[twin].label)}"


def short_label(perturbation: Perturbation) -> str:
    """Return a perturbation's name for a list that shows its stage beside it."""
    label = perturbation.label.removeprefix("Depth: ").removeprefix("RGB-D ")
    return title(label[0].upper() + label[1:])
