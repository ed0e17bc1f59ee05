# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw every perturbation at three strengths in the demo's room: a picture for each, of three tiles, and the clean one.

Colour is perturbed in the compositor. Weather and what is on the front glass are shown on the whole frame, the other
perturbations of colour on a part of it, pixel for pixel; depth in false colours; motion and pairing by two frames laid
over each other.

python headless/pictures/gallery.py docs/gallery
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import TypeAlias

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.schema import ConfigPath
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.dataset.completion import colour_depth
from noisy_world.dataset.frame import CleanFrame
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.rendering import open_render, render_options, source_paths
from noisy_world.images.pixels import rgb_bytes
from noisy_world.nodes.compositor import Compositor
from noisy_world.perturb import apply
from noisy_world.perturbations import registry
from noisy_world.perturbations.execution import perturb_colour
from noisy_world.perturbations.kinds import (
    ColourPerturbation,
    DepthPerturbation,
    EarlierFrame,
    ExposurePerturbation,
    FrameContext,
    MotionPerturbation,
    SequenceContext,
    small_light,
)
from noisy_world.perturbations.new_steps import new_step
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.steps import Step
from noisy_world.preset.keys import read_preset

Tiles: TypeAlias = list[NDArray[np.uint8]]

DEMO = ROOT / "presets" / "demo.yaml"
FRAME = 8  # chosen by eye: it shows near and far surfaces
SEED = 1
SEVERITIES = (1, 3, 5)  # as in the paper, like the strengths below
DEVIATIONS = ((1, 0.0125), (3, 0.025), (5, 0.05))  # degrees, metres
FACTORS = (2, 4, 8)
OFFSETS = (5, 10, 20)
# The demo's walk in ten seconds at 20 Hz, the rate of the paper's sequences; its frame that is the demo's FRAME.
WALK = "scenes.0.trajectory.handheld={frames: 200, rate_hz: 20}"
WALK_FRAME = 5 * FRAME
ON_THE_LENS = ("bloom", "lens_frost", "vignetting", "lens_drops", "lens_dirt")
TILE_PX = (280, 158)  # like the rest below, chosen for a picture 852 pixels wide
DETAIL_PX = (200, 330)  # column and row of the part's upper left corner
SAMPLE_PX = (560, 317)  # the clean frame, to try things on
GAP_PX = 6
QUALITY, LIGHT_QUALITY = 52, 30  # of JPEG: 1 MB in all
SMALL = ("gaussian_noise", "impulse_noise", "shot_noise", "speckle_noise", "snow", "spatter")
SMALL += ("auto_exposure", "flicker", "sensor_noise", "white_balance")
JPEG = (cv2.IMWRITE_JPEG_OPTIMIZE, 1, cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
ROSE_STOPS, ROSE_S, READOUT_MS = 3, 0.4, 20.0
EDGE = 0.05  # of depth: a jump by this share
SHAKEN_S = 5.0  # how long smooth motion is shown
AXES_RGB = ((200, 40, 40), (40, 140, 40), (40, 70, 200))
EDGE_RGB, GROUND = (255, 140, 0), 255


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="gallery.py", description="Draw every perturbation.")
    parser.add_argument("folder", type=Path, help="the folder to write the pictures into")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only these perturbations of colour")
    options = parser.parse_args(arguments)
    folder = options.folder
    folder.mkdir(parents=True, exist_ok=True)
    rgb, depth_m = demo_frame()
    if options.only:
        some = chain(of_colour(rgb, depth_m, options.only), of_electronics(rgb, options.only))
        for name, row in some:
            save(folder / f"{name}.jpg", strip(row), LIGHT_QUALITY if name in SMALL else QUALITY)
        return 0
    of_images = chain(of_colour(rgb, depth_m), of_electronics(rgb), of_depth(rgb, depth_m))
    tiles = dict(chain(of_images, of_sequences(), of_smooth_motion(), of_exposures()))
    shown = rgb_bytes(rgb)
    tiles["clean"] = [whole(shown), detail(shown), whole_depth(depth_m, far_m=float(depth_m.max()))]
    for name, row in tiles.items():
        save(folder / f"{name}.jpg", strip(row), LIGHT_QUALITY if name in SMALL else QUALITY)
    sample = np.asarray(cv2.resize(shown, SAMPLE_PX, interpolation=cv2.INTER_AREA), np.uint8)
    save(folder / "room.jpg", sample, QUALITY)
    print(f"wrote {len(tiles) + 1} pictures into {folder}")
    return 0


# --- what each kind of perturbation is shown by ---


def of_colour(
    rgb: NDArray[np.float32], depth_m: NDArray[np.float32], only: Sequence[str] = ()
) -> Iterator[tuple[str, Tiles]]:
    """Yield the name and the tiles of each perturbation of colour. only: those that are drawn; () for all."""
    shown = [item for item in shown_perturbations() if not only or item.name in only]
    made = perturbed(rgb, depth_m, SEVERITIES, shown)
    for item in shown:
        if item.on_light:
            continue
        yield item.name, [view(item)(made[item.name, severity]) for severity in SEVERITIES]


def of_electronics(rgb: NDArray[np.float32], only: Sequence[str] = ()) -> Iterator[tuple[str, Tiles]]:
    """Yield the name and the tiles of each perturbation of colour of the camera's electronics.

    Exposure is shown a moment after the light rose eightfold, flicker across lines that are read one by one.
    """
    shown = np.clip(rgb, 0, 1)
    for item in registry().values():
        if not isinstance(item, ColourPerturbation) or not item.on_light or (only and item.name not in only):
            continue
        if item.name == "auto_exposure":
            made = [exposed_late(shown, severity) for severity in SEVERITIES]
        else:
            extra = {"readout_ms": READOUT_MS, "exposure_ms": 1.0} if item.name == "flicker" else {}
            seen = {"seed": SEED, "frame": FRAME, **extra, **item.newly}
            made = [rgb_bytes(apply(shown, item.name, severity=value, **seen)) for value in SEVERITIES]
        yield item.name, [(detail if item.grain else whole)(image) for image in made]


def exposed_late(rgb: NDArray[np.float32], severity: float) -> NDArray[np.uint8]:
    """Return a frame that auto-exposure takes ROSE_S after the light rose by ROSE_STOPS."""
    kind, now = registry()["auto_exposure"], small_light(rgb_bytes(rgb))
    assert isinstance(kind, ColourPerturbation)
    frames = EarlierFrame(-9.0, now / np.float32(2**ROSE_STOPS)), EarlierFrame(-ROSE_S, now)
    context = FrameContext(FRAME, (SEED, "", ""), stamp_s=0.0, read_earlier=lambda _: frames)
    return rgb_bytes(perturb_colour(step(kind, severity), rgb, severity, context))


def of_depth(rgb: NDArray[np.float32], depth_m: NDArray[np.float32]) -> Iterator[tuple[str, Tiles]]:
    """Yield the name and the tiles of each perturbation of depth."""
    far_m = float(depth_m.max())
    beside = {"rgb": np.clip(rgb, 0, 1), "intrinsics": demo_camera(), "seed": SEED, "frame": FRAME}
    for item in registry().values():
        if isinstance(item, DepthPerturbation):
            made = [apply(depth_m, item.name, severity=value, **beside) for value in SEVERITIES]
            yield item.name, [whole_depth(each_m, far_m) for each_m in made]


def of_sequences() -> Iterator[tuple[str, Tiles]]:
    """Yield the name and the tiles of each perturbation of motion and of pairing.

    A deviating frame lies over the frame of the planned path; faster motion shows a frame and the next one; of a pair,
    edges of the depth lie over the colour.
    """
    settings = {"clean": []}
    settings |= {
        f"motion_deviation {k}": [{"motion_deviation": {"rotation_deg": degrees, "translation_m": metres}}]
        for k, (degrees, metres) in enumerate(DEVIATIONS)
    }
    settings |= {f"faster_motion {k}": [{"faster_motion": {"factor": factor}}] for k, factor in enumerate(FACTORS)}
    settings |= {f"desync {k}": [{"desync": {"offset": offset}}] for k, offset in enumerate(OFFSETS)}
    document = json.dumps([{"name": name.replace(" ", "_"), "perturb": steps} for name, steps in settings.items()])
    plan = make_plan(read_preset(DEMO, [f"settings={document}", WALK]))
    first = plan.renders[0]
    rgbs: dict[str, list[NDArray[np.uint8]]] = {}
    depths_m: dict[str, NDArray[np.float32]] = {}
    with first.scene.source.prepare(first.camera, print) as prepared:
        for render in plan.renders:
            paths = source_paths(plan, render)
            opened = prepared.open(paths, render_options(plan, render), print)
            for sequence in render.sequences:
                # Of faster motion the frames around the same place: what is shown before is factor times as far.
                at = sequence.frame_at(WALK_FRAME)
                seen = [sequence.shown(frame) for frame in (at, at + 1)]
                sources = [each.rgb_source for each in seen] + [seen[0].depth_source]
                frames = [CleanFrame(source, opened.frame(paths.request(source))) for source in sources]
                name = sequence.setting.name
                rgbs[name] = [rgb_bytes(frame.float_rgb()) for frame in frames[:2]]
                depths_m[name] = frames[2].depth_m
    strengths = range(len(SEVERITIES))
    clean = rgbs["clean"][0]
    yield "motion_deviation", [whole(over(clean, rgbs[f"motion_deviation_{k}"][0])) for k in strengths]
    yield "faster_motion", [whole(over(*rgbs[f"faster_motion_{k}"])) for k in strengths]
    yield "desync", [edged(rgbs[f"desync_{k}"][0], depths_m[f"desync_{k}"]) for k in strengths]


def of_exposures() -> Iterator[tuple[str, Tiles]]:
    """Yield the name and the tiles of each perturbation of exposure; what is only displaced, over the clean frame."""
    names = [item.name for item in registry().values() if isinstance(item, ExposurePerturbation)]
    steps = {(name, severity): [{name: {"severity": severity}}] for name in names for severity in SEVERITIES}
    settings = {"clean": [], **{f"{name}_{severity}": done for (name, severity), done in steps.items()}}
    document = json.dumps([{"name": name, "perturb": done} for name, done in settings.items()])
    plan = make_plan(read_preset(DEMO, [f"settings={document}", WALK, "render.engine=embree"]))
    rgbs: dict[str, NDArray[np.uint8]] = {}
    first = plan.renders[0]
    with first.scene.source.prepare(first.camera, print) as prepared:
        for render in plan.renders:
            paths = source_paths(plan, render)
            opened = open_render(prepared, render, paths, render_options(plan, render), print)
            frame = CleanFrame(WALK_FRAME, opened.frame(paths.request(WALK_FRAME)))
            rgbs |= {sequence.setting.name: rgb_bytes(frame.float_rgb()) for sequence in render.sequences}
    for name in names:
        made = [rgbs[f"{name}_{severity}"] for severity in SEVERITIES]
        yield name, [whole(over(rgbs["clean"], each) if name == "rolling_shutter" else each) for each in made]


def of_smooth_motion() -> Iterator[tuple[str, Tiles]]:
    """Yield the name and the tiles of each motion that is smooth in time: how far the camera goes along its axes."""
    path = evenly_stamped(np.tile(np.eye(4), (round(SHAKEN_S * 100) + 1, 1, 1)), 100.0)
    for item in registry().values():
        if isinstance(item, MotionPerturbation) and item.continuous and item.apply is not None:
            context = SequenceContext((SEED, "room", item.name))
            moved = [item.apply(path, item.at_severity(value), context).c2w[:, :3, 3] for value in SEVERITIES]
            yield item.name, [plotted(each_m, float(np.abs(moved[-1]).max())) for each_m in moved]


# --- tiles ---


def plotted(values: NDArray[np.float64], most: float) -> NDArray[np.uint8]:
    """Return lines of values (N, 3) over time, red, green and blue for x, y and z, as a tile; most: at its border."""
    width, height = TILE_PX
    tile = np.full((height, width, 3), GROUND, np.uint8)
    across = np.linspace(0, width - 1, len(values))
    for axis in (2, 1, 0):
        down = (height - 1) * (0.5 + 0.48 * values[:, axis] / most)
        points = np.rint(np.stack([across, down], axis=-1) * 16).astype(np.int32)
        cv2.polylines(tile, [points], isClosed=False, color=AXES_RGB[axis], lineType=cv2.LINE_AA, shift=4)
    return tile


def view(item: ColourPerturbation) -> Callable[[NDArray[np.uint8]], NDArray[np.uint8]]:
    """Return the function that gives the part of a frame to show: all of it for weather and what is on the lens."""
    return whole if item.stage == "environment" or item.name in ON_THE_LENS else detail


def whole(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the whole frame in the size of a tile."""
    return np.asarray(cv2.resize(image, TILE_PX, interpolation=cv2.INTER_AREA), np.uint8)


def detail(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a part of the frame that is as large as a tile."""
    left, top = DETAIL_PX
    return image[top : top + TILE_PX[1], left : left + TILE_PX[0]]


def whole_depth(depth_m: NDArray[np.floating], far_m: float) -> NDArray[np.uint8]:
    """Return the whole of a depth (H, W) as a tile: warm is near, blue far_m away, grey is void."""
    return colour_depth(small(depth_m), 0.0, far_m)


def small(depth_m: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return depth in the size of a tile, by nearest pixels: averages would lie where there is nothing."""
    return np.asarray(cv2.resize(depth_m, TILE_PX, interpolation=cv2.INTER_NEAREST), np.float32)


def over(image: NDArray[np.uint8], other: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return two images laid over each other."""
    return np.asarray(cv2.addWeighted(image, 0.5, other, 0.5, 0), np.uint8)


def edged(rgb: NDArray[np.uint8], depth_m: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return colour as a tile, with the edges of a depth drawn over it."""
    tile, depth_m = whole(rgb).copy(), small(depth_m)
    across = np.zeros(depth_m.shape, bool)
    for axis in (0, 1):
        step_m = np.abs(np.diff(depth_m, axis=axis, append=np.take(depth_m, [-1], axis=axis)))
        across |= step_m > EDGE * depth_m
    tile[across] = EDGE_RGB
    return tile


def strip(tiles: Tiles) -> NDArray[np.uint8]:
    """Return the tiles beside each other."""
    gap = np.full((TILE_PX[1], GAP_PX, 3), GROUND, np.uint8)
    return np.concatenate([tiles[0], *chain.from_iterable((gap, tile) for tile in tiles[1:])], axis=1)


def save(path: Path, picture: NDArray[np.uint8], quality: int) -> None:
    """Write a JPEG. Raises OSError where it cannot be written."""
    if not cv2.imwrite(str(path), picture[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, quality, *JPEG)):
        raise OSError(f"{path} cannot be written")


# --- a frame of the demo, and what each perturbation of colour makes of it in the compositor: for pictures of them ---


def shown_perturbations() -> list[ColourPerturbation]:
    """Return the perturbations of colour that have a node group, in the order of propagation."""
    return [item for item in registry().values() if isinstance(item, ColourPerturbation) and item.nodes]


def demo_camera() -> Intrinsics:
    """Return the demo's camera."""
    return make_plan(read_preset(DEMO, ["settings=[{name: clean}]"])).renders[0].camera


def demo_frame() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Render a frame of the demo: encoded colour (H, W, 3), planar depth (H, W) in metres. Empties the file."""
    plan = make_plan(read_preset(DEMO, ["settings=[{name: clean}]"]))
    render = plan.renders[0]
    paths = source_paths(plan, render)
    with render.scene.source.prepare(render.camera, print) as prepared:
        source = prepared.open(paths, render_options(plan, render), print)
        frame = source.frame(paths.request(FRAME))
    clean = CleanFrame(FRAME, frame)
    return clean.float_rgb(), clean.depth_m


def perturbed(
    rgb: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    severities: Iterable[float],
    shown: Iterable[ColourPerturbation],
) -> dict[tuple[str, float], NDArray[np.uint8]]:
    """Return (H, W, 3) uint8 by the perturbation's name and the severity. shown: the perturbations."""
    chains = {f"{item.name} {severity:g}": [step(item, severity, depth_m)] for severity in severities for item in shown}
    with Compositor((rgb.shape[1], rgb.shape[0]), chains, rgb.shape[1]) as compositor:
        made = compositor.perturb(rgb, {name: (FRAME, (SEED, "showcase", name)) for name in chains}, depth_m)
    return {(name.split()[0], float(name.split()[1])): image for name, (image, _) in made.items() if image is not None}


def step(perturbation: ColourPerturbation, severity: float, depth_m: NDArray[np.float32] | None = None) -> Step:
    """Return the step of a severity as it is newly added to a scene, of a depth where that is given."""
    values = new_step(perturbation, (), depth_m).values | {"severity": severity}
    (found,) = parse_steps([{perturbation.name: values}], ConfigPath("showcase"), registry())
    return found


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
